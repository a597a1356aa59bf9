"""A job seen again is the job that was done; seismograms are judged as they are; a pulse is shown."""

import json

import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner
from reference import idealised
from small_campaigns import VERSIONS

import toppling
from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.record import Record
from toppling.models.scene import Scene
from toppling.orchestrator.campaign import Campaign
from toppling.orchestrator.cli import cli
from toppling.orchestrator.plan import plan
from toppling.orchestrator.run_folder import prepare
from toppling.results.store import write_part
from toppling.workers.job import Assets, run_job

HALF_WIDTH_M, HALF_HEIGHT_M = 0.2, 0.6
UPLIFT_M_S2 = 9.81 * HALF_WIDTH_M / HALF_HEIGHT_M
"""Least acceleration that tips the block; of a pulse of 2 s, not much more than what overturns it."""


def record(name, pga_m_s2):
    return Record.of(name, idealised.full_sine(pga_m_s2, 2.0), event="made", component_azimuths_deg=(0, 90))


def command(*words):
    return CliRunner().invoke(cli, [str(word) for word in words])


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scenes") / "block"
    Scene.block(HALF_WIDTH_M, HALF_WIDTH_M, HALF_HEIGHT_M, friction=0.8).save(folder)
    return folder


@pytest.fixture(scope="module")
def run(tmp_path_factory, scene):
    """A run of one job that topples and one that does not, with a drawn realisation each."""
    folder = tmp_path_factory.mktemp("runs")
    ensemble = Ensemble.write(folder / "ensemble", [record("sine", 1.0)])
    content = {
        "scene": str(scene), "ensemble": str(folder / "ensemble"), "pga_m_s2": [2.0, 6.0],
        "azimuth_deg": [0.0], "friction": [[0.7, 0.6]], "realisations": 4, "preset": "fast",
    }  # fmt: skip
    planned = plan(Campaign.of(content, folder), Scene.load(scene), ensemble)
    prepare(folder / "run", planned, VERSIONS)
    assets = Assets(Scene.load(scene), ensemble)
    rows = [run_job(planned.spec(k), assets) | {"attempt": 1} for k in range(len(planned))]
    write_part(folder / "run", rows)
    return folder / "run", rows


@pytest.fixture(scope="module")
def replayed(run, tmp_path_factory):
    folder, rows = run
    row = next(row for row in rows if row["toppled"] and row["realisation"] > 0)
    out = tmp_path_factory.mktemp("replayed")
    return command("replay", folder, row["job_id"][:12], "--out", out), row, out


def test_a_replayed_job_has_the_answer_and_the_trajectory_of_the_run(replayed):
    done, row, out = replayed
    assert done.exit_code == 0, done.output
    assert "The answer is that of the run" in done.output
    table = pq.read_table(out / "trajectory.parquet")
    assert all(field.metadata[b"unit"] and field.metadata[b"description"] for field in table.schema)
    direction = table.to_pandas()
    # The quaternions have 16 digits, and an arc near 0 keeps half of them.
    assert direction["tilt_deg"].max() == pytest.approx(row["max_tilt_deg"], abs=1e-5)
    assert direction["tilt_deg"].iloc[0] == pytest.approx(0.0, abs=1e-5)
    assert direction["time_s"].is_monotonic_increasing
    assert direction["time_s"].min() <= row["topple_time_s"] <= direction["time_s"].max()
    assert direction["ground_x_m_s2"].abs().max() <= row["pga_m_s2"] * (1 + 1e-9)


@pytest.mark.thorough
def test_an_answer_that_is_not_the_runs_is_stated_and_ends_with_1(run, tmp_path):
    folder, rows = run
    other = tmp_path / "run"
    for name in ("scene", "ensemble", "jobs.parquet", "campaign.toml", "run.json"):
        (other / name).parent.mkdir(exist_ok=True)
        (other / name).symlink_to(folder / name)
    row = next(row for row in rows if not row["toppled"])
    write_part(other, [row | {"max_tilt_deg": row["max_tilt_deg"] + 1.0}])
    done = command("replay", other, row["job_id"], "--out", tmp_path / "out")
    assert done.exit_code == 1
    assert done.exception.code == "replay.differs"
    assert (tmp_path / "out" / "replay.gif").exists()


@pytest.mark.parametrize("job", ["", "none"])
def test_what_names_no_single_job_is_refused(run, tmp_path, job):
    done = command("replay", run[0], job, "--out", tmp_path / "out")
    assert done.exception.code == "run.job_unknown"
    assert not (tmp_path / "out").exists()


def test_seismograms_are_judged_as_they_are_and_next_to_their_neighbours(scene, tmp_path):
    # Below the uplift a block rests, whatever the pulse; three times of it overturn one of this size within 2 s.
    strengths = {"far-below": 0.7, "far-above": 3.0}
    made = [record(name, factor * UPLIFT_M_S2) for name, factor in strengths.items()]
    Ensemble.write(tmp_path / "motions", made)
    done = command("check", scene, tmp_path / "motions", "--neighbours", 2, "--preset", "fast", "--json")
    assert done.exit_code == 0, done.output
    below, above = sorted(json.loads(done.stdout), key=lambda verdict: verdict["pga_m_s2"])
    assert (below["outcome"], below["toppled"], below["shaken"], below["least_factor"]) == (
        "stands",
        0,
        5,
        None,
    )
    assert (above["outcome"], above["probability"], above["least_factor"]) == ("toppled", 1.0, 0.8)
    assert above["pga_m_s2"] == pytest.approx(3.0 * UPLIFT_M_S2, rel=1e-3)  # unscaled; sampled every 5 ms
    checked = toppling.check(scene, [tmp_path / "motions"], neighbours=2, preset="fast")
    assert checked.frame()["record_id"].tolist() == sorted(strengths)
    assert [verdict.shaken for verdict in checked.verdicts] == [5, 5]
