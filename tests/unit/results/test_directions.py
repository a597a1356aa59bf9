"""Directions and frictions, against rows counted by hand."""

import numpy as np
import pandas as pd
import pytest
from seeded import row

from toppling.results.analysis.fragility import (
    CONTACT_COLUMNS,
    PLANES,
    compare_cells,
    compare_frictions,
    compare_jobs,
    least_sector,
    sector_fraction,
    topple_rose,
)
from toppling.results.drawing.maps import friction_figure


def frame_of(jobs):
    return pd.DataFrame(jobs).astype({"toppled": "boolean"})


@pytest.fixture
def four():
    azimuths = [122.5, 157.5, 359.0, None]
    return frame_of(
        [
            row(str(number), toppled=azimuth is not None, falls_toward_deg=azimuth)
            for number, azimuth in enumerate(azimuths)
        ]
        + [row("crashed", status="crashed", toppled=None, falls_toward_deg=None)]
    )


def test_the_fraction_of_a_sector_includes_its_bounds_and_excludes_jobs_without_an_answer(four):
    result = sector_fraction(four, 122.5, 157.5)
    assert (result["jobs"], result["toppled"], result["toppled_within"]) == (4, 3, 2)
    assert result["share_of_jobs"] == pytest.approx(0.5)
    assert sector_fraction(four, 350.0, 10.0)["toppled_within"] == 1  # across azimuth zero
    assert sector_fraction(four, 0.0, 360.0)["share_of_toppled"] == 1.0


def test_the_sector_of_a_rock_is_where_the_least_acceleration_topples_it_to():
    azimuths = np.arange(0.0, 360.0, 5.0)
    # The rock is pushed over toward 10 degrees by ground that accelerates toward 190.
    least = pd.DataFrame({"ground_accelerates_toward_deg": azimuths, "value": 2.0 + np.abs(azimuths - 190.0)})
    assert least_sector(least) == pytest.approx((352.5, 27.5))
    assert least_sector(least.assign(value=None)) is None
    assert least_sector(None) is None


def test_the_rose_counts_every_toppled_job_in_the_nearest_petal(four):
    rose = topple_rose(four, petal_deg=45.0).set_index("falls_toward_deg")["toppled"]
    assert rose.to_dict() == {0.0: 1, 45.0: 0, 90.0: 0, 135.0: 1, 180.0: 1, 225.0: 0, 270.0: 0, 315.0: 0}


ANSWERS = {(1.0, 1.0): [False, False, True], (0.6, 0.6): [True, False, True, True]}
"""Three records at one level; a lower friction topples one more, and its fourth job has no partner."""


def under(answers, **values):
    """Rows of as many records as there are answers, for each pair of static and kinetic friction."""
    return frame_of(
        [
            row(f"{static}-{kinetic}-{number}", record_id=f"R{number}", pgv_m_s=0.3, toppled=toppled,
                friction_static=static, friction_kinetic=kinetic) | values
            for (static, kinetic), answer in answers.items()
            for number, toppled in enumerate(answer)
        ]
    )  # fmt: skip


COUNTS = ["pairs", "both", "neither", "only_this", "only_reference"]


def test_frictions_are_compared_over_the_jobs_that_both_have():
    cell = compare_cells(under(ANSWERS), PLANES["pga_pgv"], reference=(1.0, 1.0)).iloc[0]
    assert cell["probability"] == pytest.approx(2 / 3)
    assert cell["reference_probability"] == pytest.approx(1 / 3)
    pairs = compare_jobs(under(ANSWERS), reference=(1.0, 1.0)).iloc[0]
    assert pairs[COUNTS].tolist() == [3, 1, 1, 1, 0]


def test_frictions_that_differ_in_the_kinetic_value_alone_are_compared():
    answers = {(1.0, 1.0): [False, False, True], (1.0, 0.8): [True, False, True]}
    [(name, table, pairs)] = compare_frictions(under(answers), PLANES["pga_pgv"])
    assert name == ""
    assert table[["friction_static", "friction_kinetic"]].to_numpy().tolist() == [[1.0, 0.8]]
    assert pairs.iloc[0][COUNTS].tolist() == [3, 1, 1, 1, 0]
    assert "friction 1 (0.8 kinetic)" in friction_figure(table, pairs).axes[0].get_ylabel()


def test_jobs_are_paired_once_however_many_kinetic_frictions_there_are():
    answers = ANSWERS | {(0.6, 0.5): [True, True, True], (1.0, 0.9): [False, True, True]}
    pairs = compare_jobs(under(answers), reference=(1.0, 1.0))
    assert pairs[["friction_static", "friction_kinetic", "pairs"]].to_numpy().tolist() == [
        [0.6, 0.5, 3], [0.6, 0.6, 3], [1.0, 0.9, 3],
    ]  # fmt: skip


@pytest.mark.parametrize("column", [name for name in CONTACT_COLUMNS if not name.startswith("friction")])
def test_what_is_no_friction_is_never_pooled_when_frictions_are_compared(column):
    single = under(ANSWERS)
    other = under({pair: [True] * len(answer) for pair, answer in ANSWERS.items()})
    two = pd.concat([single.assign(**{column: 0.1}), other.assign(**{column: 0.2})])
    compared = {name: (table, pairs) for name, table, pairs in compare_frictions(two, PLANES["pga_pgv"])}
    assert len(compared) == 2
    assert [entry["reference_probability"].tolist() for entry, _ in compared.values()] == [[1 / 3], [1.0]]
    assert [entry["pairs"].tolist() for _, entry in compared.values()] == [[3], [3]]
