"""What the draws of a base say in words."""

import pytest

from toppling.models.hidden_base.intervals import base_sentences, median_width


def rows(width, level=4.0):
    half = 0.5 * width * level
    return [
        {"azimuth_deg": azimuth, "low_m_s2": level - half, "median_m_s2": level, "high_m_s2": level + half}
        for azimuth in (0.0, 90.0, 180.0)
    ]


def report(**more):
    reach = [{"azimuth_deg": 0.0, "low_m": 0.1, "median_m": 0.2, "high_m": 0.3}]
    return {
        "unseen_base": {
            "level": 0.9, "draws": 48, "toppling": rows(0.2), "nominal_draw": 3, "com_m": [[0.0, 0.1, 0.2]] * 3,
            "contacts": {"count": [3, 4, 7], "reach": reach}, **more,
        }
    }  # fmt: skip


@pytest.mark.parametrize(
    ("before", "does"),
    [(0.5, "narrows the interval"), (0.1, "widens the interval"), (0.208, "leaves the interval as it was")],
)
def test_what_an_inspection_does_to_the_interval_is_said_as_it_is_with_both_widths(before, does):
    told = base_sentences(report(without_inspection=rows(before)))[2]
    assert told.startswith(f"what is known by inspection {does}: ")
    assert f"its width is 20 % of its median, {100 * before:.0f} % without" in told


def test_the_width_of_a_table_is_the_median_over_azimuths():
    assert median_width(rows(0.1) + rows(0.3) + rows(0.5)) == pytest.approx(0.3)
