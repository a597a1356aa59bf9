"""The campaign that `toppling init` writes suits the rock, and says why."""

import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from reference.idealised import ricker

from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.record import Record
from toppling.models.scene import Scene
from toppling.orchestrator.advice import warnings_of
from toppling.orchestrator.campaign import Campaign
from toppling.orchestrator.cli import cli
from toppling.orchestrator.pilot import try_out
from toppling.orchestrator.verbs.init import levels_between


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
