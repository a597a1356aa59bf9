"""What a campaign is warned of before it runs, and what its shares suggest afterwards."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from reference.idealised import ricker

from toppling.models.hidden_base.draws import BaseDraw, UnseenBase
from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.record import Record
from toppling.models.scene import Scene
from toppling.orchestrator.advice import (
    HARDLY_SHARE,
    MOSTLY_SHARE,
    Share,
    scaling_warnings,
    shaking_warnings,
    suggestions,
    warnings_of,
)
from toppling.orchestrator.campaign import Campaign
from toppling.orchestrator.pilot import statics_of

BLOCK = Scene.block(0.2, 0.2, 0.6)
LEAST_M_S2 = 9.81 * 0.2 / 0.6


FEET_M = np.array([[0.2, 0.2, 0.0], [-0.2, 0.2, 0.0], [0.0, -0.2, 0.0]])
UNSEEN = replace(BLOCK, unseen=UnseenBase(0.05, (BaseDraw(FEET_M),)))


def warned(levels, friction=(0.8,), scene=BLOCK, **more):
    pga = levels if isinstance(levels, str) else list(levels)
    axes = {"pga_m_s2": pga, "azimuth_deg": [0], "friction": list(friction), **more}
    return warnings_of(Campaign.of({"scene": "s", "ensemble": "e", **axes}, Path()), scene)


def test_the_least_static_acceleration_is_that_of_the_closed_form():
    assert statics_of(BLOCK).least_m_s2 == pytest.approx(LEAST_M_S2)


def test_a_sound_campaign_is_warned_of_nothing():
    assert warned([2, 4, 8]) == []
    assert warned("recorded") == []


def test_low_levels_that_topple_a_slender_rock_are_no_levels_in_g():
    assert warned([0.2, 1.1], scene=Scene.block(0.02, 0.2, 0.6)) == []


def test_a_campaign_that_shakes_one_of_many_possible_bases_is_told_so():
    (said,) = warned([2, 4, 8], scene=UNSEEN)
    assert "only one of the rock's possible bases" in said
    assert "realisations = 25" in said
    assert warned([2, 4, 8], scene=UNSEEN, realisations=12) == []
    assert warned([2, 4, 8], scene=UNSEEN, first_realisation=3) == []


@pytest.mark.parametrize(
    ("levels", "friction", "told"),
    [
        ([0.2, 1.4], [0.8], "are they in g? 1.4 g is 13.7 m/s2"),
        ([1.6, LEAST_M_S2 - 0.01], [0.8], "below the least constant acceleration"),
        ([2, 8], [0.8, 35], r"is it in degrees? tan(35°) is 0.7"),
        ([2, 8], [1.7], "rock on rock has 0.6 to 1.0"),
        ([2, 8], [0.3], "slides in every direction before it tips"),
    ],
)
def test_each_slip_is_told_once(levels, friction, told):
    (sentence,) = warned(levels, friction)
    assert told in sentence


@pytest.mark.parametrize(
    ("azimuths", "told"),
    [
        ((0, 1.5708, 3.1416), True),
        ((0, 0.79, 1.57), True),
        ((0, 90, 180), False),
        ((0, 2, 4), False),
        ((0,), False),
    ],
)
def test_azimuths_in_radians_are_told(azimuths, told):
    found = warned([2, 4, 8], azimuth_deg=list(azimuths))
    assert [("in radians" in sentence) for sentence in found] == [True] * told


@pytest.fixture
def weak(tmp_path):
    """An ensemble of pulses, one of which is far weaker than the others."""
    strengths = (("strong", 3.0), ("weak", 0.0045), ("fair", 0.2))
    records = [Record.of(name, ricker(pga_m_s2, 1.0)) for name, pga_m_s2 in strengths]
    return Ensemble.write(tmp_path / "ensemble", records)


def scaled(ensemble, levels, **more):
    axes = {"pga_m_s2": levels, "azimuth_deg": [0], "friction": [0.8], **more}
    return scaling_warnings(Campaign.of({"scene": "s", "ensemble": "e", **axes}, Path()), ensemble)


def test_records_that_are_scaled_more_than_a_hundredfold_are_named(weak):
    (told,) = scaled(weak, [4.0, 16.0])
    assert "1 record is scaled by more than 100 to 16 m/s2: weak (0.0045 m/s2, 3,5" in told
    assert "fold)" in told
    assert "strong" not in told.partition(";")[0]
    assert "--pga 0.16 100" in told
    (told,) = scaled(weak, [30.0])
    assert told.startswith("2 records are scaled")
    assert scaled(weak, [16.0], records=["fair", "strong"]) == []
    assert scaled(weak, [0.4]) == []
    assert scaled(weak, "recorded") == []


def shaken(ensemble, levels, **more):
    axes = {"pga_m_s2": levels, "azimuth_deg": [0], "friction": [0.8], **more}
    return shaking_warnings(Campaign.of({"scene": "s", "ensemble": "e", **axes}, Path()), ensemble)


def test_shaking_beyond_nature_is_told_with_factor_velocity_and_displacement(weak):
    (told,) = shaken(weak, [4.0, 60.0])
    assert told.startswith(
        "50 % of the jobs shake beyond what was ever recorded (PGV above 3 m/s or PGD above 4 m)"
    )
    own = weak.record("strong").intensity
    pgv_m_s, pgd_m = (own[name] * 60.0 / own["pga_m_s2"] for name in ("pgv_m_s", "pgd_m"))
    assert f"strong ({60.0 / own['pga_m_s2']:.0f}-fold, PGV {pgv_m_s:.1f} m/s, PGD {pgd_m:.1f} m)" in told
    assert "at 60 m/s2" in told
    assert shaken(weak, [4.0]) == shaken(weak, "recorded") == []


def test_a_table_that_holds_displacement_bounds_it(weak):
    (free,), (held,) = shaken(weak, [60.0]), shaken(weak, [60.0], peak_displacement_m=0.5)
    assert "PGD 0.5 m" in held
    assert "PGD 0.5 m" not in free


def test_a_run_that_saw_the_whole_rise_suggests_nothing():
    assert (
        suggestions([Share(level, 100, n) for level, n in ((1, 0), (3, 20), (5, 50), (7, 80), (9, 100))])
        == []
    )


def test_a_run_without_an_answer_suggests_nothing():
    assert suggestions([]) == []
    assert suggestions([Share(1.0, 0, 0)]) == []


def test_few_topplings_at_the_highest_level_ask_for_higher_ones():
    (told,) = suggestions([Share(13.0, 78, 7), Share(9.0, 78, 0)])
    assert told == "7 of 156 toppled, 9 % at the highest level: add levels above 13 m/s2"
    assert suggestions([Share(9.0, 40, 0)]) == ["0 of 40 toppled: add levels above 9 m/s2"]


def test_many_topplings_at_the_lowest_level_ask_for_lower_ones():
    (told,) = suggestions([Share(5.0, 10, 4), Share(9.0, 10, 10)])
    assert told == "4 of 10 toppled at the lowest level: add levels below 5 m/s2"


def test_a_rise_between_two_levels_asks_for_levels_between_them():
    (told,) = suggestions([Share(1, 50, 0), Share(3, 50, 1), Share(6, 50, 49), Share(9, 50, 50)])
    assert told.endswith("add levels between 3 and 6 m/s2")


@given(st.lists(st.tuples(st.integers(1, 50), st.floats(0, 1)), min_size=1, max_size=12))
def test_every_share_is_advised_without_a_fault_and_ends_are_asked_for_exactly_where_they_are_open(drawn):
    shares = [Share(float(n + 1), jobs, round(jobs * part)) for n, (jobs, part) in enumerate(drawn)]
    told = suggestions(shares)
    assert any("levels above" in sentence for sentence in told) == (shares[-1].share < MOSTLY_SHARE)
    assert any("levels below" in sentence for sentence in told) == (shares[0].share > HARDLY_SHARE)
