"""What a campaign is warned of before it runs, what its shares suggest, and what `toppling init` writes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from reference.idealised import ricker

from toppling.models.hidden_base.unseen_base import BaseDraw, UnseenBase
from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.record import Record
from toppling.models.scene import Scene
from toppling.orchestrator.advice import (
    HARDLY_FRACTION,
    MOSTLY_FRACTION,
    LevelCount,
    shaking_warnings,
    suggestions,
    try_out,
    warnings_of,
)
from toppling.orchestrator.campaign import Campaign
from toppling.orchestrator.cli import cli
from toppling.orchestrator.verbs.init import levels_between

BLOCK = Scene.block(0.2, 0.2, 0.6)
LEAST_M_S2 = 9.81 * 0.2 / 0.6
FEET_M = np.array([[0.2, 0.2, 0.0], [-0.2, 0.2, 0.0], [0.0, -0.2, 0.0]])
UNSEEN = replace(BLOCK, unseen=UnseenBase(0.05, (BaseDraw(FEET_M),)))


def campaign_at(levels, **more):
    axes = {"pga_m_s2": levels, "azimuth_deg": [0], "friction": [0.8], **more}
    return Campaign.of({"scene": "s", "ensemble": "e", **axes}, Path())


def warned(levels, scene=BLOCK, **more):
    return warnings_of(campaign_at(levels, **more), scene)


SLENDER, SOUND = Scene.block(0.02, 0.2, 0.6), [2, 4, 8]


@pytest.mark.parametrize(
    ("levels", "asked", "want"),
    [
        (SOUND, {}, None),
        ("recorded", {}, None),
        ([0.2, 1.4], {}, "are they in g? 1.4 g is 13.7 m/s2"),
        ([0.2, 1.1], {"scene": SLENDER}, None),  # which these levels topple
        ([1.6, LEAST_M_S2 - 0.01], {}, "below the least constant acceleration"),
        ([2, 8], {"friction": [0.8, 35]}, r"is it in degrees? tan(35°) is 0.7"),
        ([2, 8], {"friction": [1.7]}, "rock on rock has 0.6 to 1.0"),
        ([2, 8], {"friction": [0.3]}, "slides in every direction before it tips"),
        (SOUND, {"azimuth_deg": [0, 90, 180]}, None),
        (SOUND, {"azimuth_deg": [0, 2, 4]}, None),
        (SOUND, {"scene": UNSEEN}, "realisations = 25"),
        (SOUND, {"scene": UNSEEN, "realisations": 12}, None),
        (SOUND, {"scene": UNSEEN, "first_realisation": 3}, None),
    ],
)
def test_every_mistake_is_reported_once_and_a_sound_campaign_has_no_warning(levels, asked, want):
    found = warned(levels, **asked)
    assert [want in sentence for sentence in found] == [True] * (want is not None)


@pytest.fixture
def weak(tmp_path):
    strengths = (("strong", 3.0), ("weak", 0.0045), ("fair", 0.2))
    records = [Record.of(name, ricker(pga_m_s2, 1.0)) for name, pga_m_s2 in strengths]
    return Ensemble.write(tmp_path / "ensemble", records)


def shaken(ensemble, levels, **more):
    return shaking_warnings(campaign_at(levels, **more), ensemble)


def test_shaking_beyond_nature_is_reported_with_factor_velocity_and_displacement(weak):
    (out,) = shaken(weak, [4.0, 60.0], records=["strong"])
    assert out.startswith("50 % of the jobs shake beyond what was ever recorded")
    own = weak.record("strong").intensity
    pgv_m_s, pgd_m = (own[name] * 60.0 / own["pga_m_s2"] for name in ("pgv_m_s", "pgd_m"))
    assert f"strong ({60.0 / own['pga_m_s2']:.0f}-fold, PGV {pgv_m_s:.1f} m/s, PGD {pgd_m:.1f} m)" in out
    assert "at 60 m/s2" in out
    assert shaken(weak, [4.0], records=["strong"]) == shaken(weak, "recorded") == []


@pytest.mark.parametrize(
    ("parts", "want"),
    [
        ([(1, 100, 0), (3, 100, 20), (5, 100, 50), (7, 100, 80), (9, 100, 100)], []), ([], []), ([(1.0, 0, 0)], []),
        ([(13.0, 78, 7), (9.0, 78, 0)], ["add levels above 13 m/s2"]),
        ([(5.0, 10, 4), (9.0, 10, 10)], ["add levels below 5 m/s2"]),
        ([(1, 50, 0), (3, 50, 1), (6, 50, 49), (9, 50, 50)], ["add levels between 3 and 6 m/s2"]),
    ],
)  # fmt: skip
def test_levels_are_asked_for_where_the_rise_was_not_seen(parts, want):
    assert [s.rpartition(": ")[2] for s in suggestions([LevelCount(*s) for s in parts])] == want


@given(st.lists(st.tuples(st.integers(1, 50), st.floats(0, 1)), min_size=1, max_size=12))
def test_further_levels_are_advised_exactly_where_the_toppled_fraction_leaves_ends_open(drawn):
    parts = [LevelCount(float(n + 1), jobs, round(jobs * part)) for n, (jobs, part) in enumerate(drawn)]
    out = suggestions(parts)
    assert any("levels above" in sentence for sentence in out) == (parts[-1].fraction < MOSTLY_FRACTION)
    assert any("levels below" in sentence for sentence in out) == (parts[0].fraction > HARDLY_FRACTION)


@pytest.mark.parametrize(
    ("levels", "records", "named"),
    [
        ([4.0, 16.0], {}, {"weak"}), ([20.5], {}, {"weak", "fair"}), ([16.0], {"records": ["fair", "strong"]}, set()),
        ([0.4], {}, set()), ("recorded", {}, set()),
    ],
)  # fmt: skip
def test_records_that_are_scaled_more_than_a_hundredfold_are_named(weak, levels, records, named):
    out = " ".join(shaken(weak, levels, **records))
    assert {name for name in ("strong", "weak", "fair") if f"{name} (" in out} == named


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("inputs")
    Scene.block(0.15, 0.2, 0.6, friction=0.7).save(folder / "scenes" / "a 'block'")
    pulses = [Record.of(f"P{n}", ricker(2.0, 0.5 + 0.4 * n, 0.01)) for n in range(4)]
    Ensemble.write(folder / "quakes", pulses)
    return folder


@pytest.fixture(scope="module")
def written(inputs):
    asked = ["init", str(inputs / "scenes" / "a 'block'"), str(inputs / "quakes")]
    out = inputs / "campaigns" / "first.toml"
    done = CliRunner().invoke(cli, [*asked, "--out", str(out), "--preset", "fast"], catch_exceptions=False)
    assert done.exit_code == 0
    return out, done.stdout, asked


def test_what_is_written_is_a_campaign_on_scene_and_ensemble_that_is_warned_of_nothing(written):
    out, _, _ = written
    campaign = Campaign.read(out)
    assert (campaign.friction, campaign.preset, len(campaign.azimuth_deg)) == (((0.7, 0.7),), "fast", 8)
    assert warnings_of(campaign, Scene.load(campaign.scene)) == []
    assert len(Ensemble.load(campaign.ensemble).record_ids) == 4


def test_levels_span_from_below_the_least_static_acceleration_to_where_most_records_topple(written):
    out, _, _ = written
    campaign = Campaign.read(out)
    least = 9.81 * 0.15 / 0.6
    assert campaign.pga_m_s2[0] < least
    scene, ensemble = Scene.load(campaign.scene), Ensemble.load(campaign.ensemble)
    pilot = try_out(scene, ensemble, least, campaign.azimuth_deg, campaign.friction[0], campaign.preset)
    assert pilot.toppled >= 0.8 * len(ensemble.record_ids)
    assert sum(at <= campaign.pga_m_s2[-1] for at in pilot.topples_at_m_s2) >= 0.8 * len(ensemble.record_ids)


def test_a_campaign_that_is_there_is_not_written_over(written):
    out, _, asked = written
    before = out.read_text()
    done = CliRunner().invoke(cli, [*asked, "--out", str(out)])
    assert isinstance(done.exception, FileExistsError)
    assert out.read_text() == before


@given(st.floats(0.05, 50.0), st.floats(1.05, 30.0), st.integers(2, 40))
def test_levels_begin_above_zero_and_below_the_least_and_reach_the_most(least, ratio, count):
    levels = levels_between(least, least * ratio, count)
    assert 0.0 < levels.start_m_s2 < least
    assert levels.stop_m_s2 >= least * ratio * (1.0 - 1e-9)
    assert len(levels) >= 2
    if 0.5 < least * (ratio - 0.9) / count < 9.0:
        assert count / 2.5 <= len(levels) <= 2.5 * count + 2
