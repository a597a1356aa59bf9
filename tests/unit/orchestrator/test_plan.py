"""From axes to jobs, the folder that keeps them, and the code that decides their answers."""

import dataclasses
import json
import math
import subprocess
import sys
from contextlib import nullcontext
from itertools import pairwise, product
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st
from refusals import refused
from small_campaigns import VERSIONS, campaign_in

import toppling.models
from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.imposing import impose
from toppling.models.scene import Scene
from toppling.orchestrator.advice import timed_jobs
from toppling.orchestrator.campaign import Campaign
from toppling.orchestrator.cli import cli
from toppling.orchestrator.plan import JOBS_OF_A_SCENE, balanced_order, block_jobs, plan, plan_of
from toppling.orchestrator.run import run
from toppling.orchestrator.run_folder import place_in, prepare
from toppling.orchestrator.task import SOURCES, code
from toppling.results.run_integrity import run_document
from toppling.workers.unmeasured import Unmeasured


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    return campaign_in(tmp_path_factory.mktemp("inputs"), (0.6, 1.0, 1.4), pga_m_s2=[2, 4])


def planned(campaign, **changes):
    changed = dataclasses.replace(campaign, **changes)
    return plan(changed, Scene.load(campaign.scene), Ensemble.load(campaign.ensemble))


def test_every_point_is_a_job_of_its_own_and_realisations_are_spread_over_every_records_jobs(campaign):
    axes = {"pga_m_s2": tuple(range(1, 7)), "azimuth_deg": (0, 60, 120, 180)}
    assert len(planned(campaign, **axes)) == 3 * 6 * 4
    jobs = planned(campaign, **axes, friction=((0.8, 0.8), (0.6, 0.6)), realisations=5).jobs.to_pandas()
    assert len(jobs) == jobs["job_id"].nunique() == 3 * 6 * 4 * 2
    point = ["record_id", "pga_m_s2", "azimuth_deg"]
    assert (jobs.groupby(point, observed=True)["realisation"].nunique() == 1).all()  # of both frictions one
    single = jobs[jobs["friction_static"] == 0.8]
    met = single.groupby(["record_id", "realisation"], observed=True).size()
    assert (len(met), met.min(), met.max()) == (3 * 5, 4, 5)
    for axis in ("pga_m_s2", "azimuth_deg"):
        assert (single.groupby("realisation")[axis].nunique() == single[axis].nunique()).all()


def test_records_as_they_are_are_imposed_unscaled(campaign):
    ensemble = Ensemble.load(campaign.ensemble)
    whole = planned(campaign, pga_m_s2=(), azimuth_deg=(0.0,))
    assert len(whole) == 3
    for row in range(3):
        spec = whole.spec(row)
        record = ensemble.record(spec.record_id)
        motion = impose(record, spec.pga_m_s2, record.intensity["strong_azimuth_deg"]).motion
        assert (motion.acceleration_m_s2 == record.motion.acceleration_m_s2).all()
        assert spec.job_id == whole.jobs["job_id"][row].as_py()


@pytest.mark.parametrize(
    "unmeasured", [None, Unmeasured(friction=(0.3, 0.7), yaw_deg=10.0)], ids=["none", "some"]
)
def test_the_ids_of_a_plan_are_those_of_its_specifications(campaign, unmeasured):
    whole = planned(
        campaign, friction=((0.8, 0.7),), realisations=2, unmeasured=unmeasured, peak_displacement_m=0.5
    )
    assert whole.jobs["job_id"].to_pylist() == [whole.spec(row).job_id for row in range(len(whole))]


def test_a_campaign_of_further_realisations_repeats_no_job(campaign):
    first = planned(campaign, realisations=3)
    further = planned(campaign, realisations=2, first_realisation=3)
    assert first.ids.isdisjoint(further.ids)
    assert len(first) == len(further)


@pytest.mark.parametrize(
    "change",
    [
        {"preset": "fast"}, {"pga_m_s2": (2.0,)}, {"records": ("P1",)}, {"peak_displacement_m": 0.1},
        {"realisations": 2},
    ],
)  # fmt: skip
def test_whatever_can_change_an_answer_changes_the_plan(campaign, change):
    assert planned(campaign, **change).id != planned(campaign).id


def test_the_order_of_the_axes_in_the_file_does_not_change_a_job(campaign):
    ids = set(planned(campaign).jobs["job_id"].to_pylist())
    assert set(planned(campaign, pga_m_s2=(4.0, 2.0)).jobs["job_id"].to_pylist()) == ids


def test_a_record_that_is_not_there_is_named(campaign):
    with refused("ensemble.record_unknown"):
        planned(campaign, records=("P1", "P9"))


def test_a_record_too_coarse_for_the_band_it_is_stated_to_have_is_named(campaign):
    step_s = max(Ensemble.load(campaign.ensemble).catalog["time_step_s"].to_pylist())
    planned(campaign, unmeasured=Unmeasured(band_hz=0.499 / step_s, above_band=(0.0, 0.6)))
    with refused("motion.step_too_coarse"):
        planned(campaign, unmeasured=Unmeasured(band_hz=0.501 / step_s, above_band=(0.0, 0.6)))


def test_the_verb_counts_the_jobs_and_writes_their_table(campaign, tmp_path):
    table = tmp_path / "jobs.parquet"
    asked = ["plan", str(campaign.scene.parent / "campaign.toml"), "--out", str(table), "--json"]
    counts = json.loads(CliRunner().invoke(cli, asked).stdout)
    whole = planned(campaign)
    assert (counts["jobs"], counts["records"], counts["plan_id"]) == (len(whole), 3, whole.id)
    assert pq.read_table(table)["job_id"].to_pylist() == whole.jobs["job_id"].to_pylist()


def test_a_run_holds_all_that_is_needed_to_repeat_it(campaign, tmp_path):
    whole = planned(campaign)
    prepare(tmp_path / "run", whole, VERSIONS)
    copied = Campaign.read(tmp_path / "run" / "campaign.toml")
    assert copied.scene == tmp_path / "run" / "scene"
    assert plan(copied, Scene.load(copied.scene), Ensemble.load(copied.ensemble)).id == whole.id
    assert run_document(tmp_path / "run")["jobs"] == len(whole)


def test_another_campaign_or_version_is_refused_and_the_run_is_left_as_it_was(campaign, tmp_path):
    prepare(tmp_path / "run", planned(campaign), VERSIONS)
    before = (tmp_path / "run" / "run.json").read_bytes()
    with refused("run.of_another_campaign"):
        prepare(tmp_path / "run", planned(campaign, preset="fast"), VERSIONS)
    with refused("run.versions_differ", "1", "2"):
        prepare(tmp_path / "run", planned(campaign), VERSIONS | {"physics": "2"})
    # Another engine has other versions too: what was changed is said, not what follows from it.
    with refused("run.of_another_campaign", "'pybullet'", "'mujoco'") as error:
        prepare(tmp_path / "run", planned(campaign, engine="mujoco", restitution=(0.0,)), {"mujoco": "4"})
    assert "begun with" not in str(error.value)
    with refused("run.of_another_campaign"):
        prepare(tmp_path / "run", planned(campaign, records=("P1",)), VERSIONS)
    other = plan(campaign, Scene.block(0.15, 0.2, 0.7), Ensemble.load(campaign.ensemble))
    with refused("run.of_another_campaign"):
        prepare(tmp_path / "run", other, VERSIONS)
    assert (tmp_path / "run" / "run.json").read_bytes() == before


@pytest.mark.parametrize("name", ["parts", "scene", "run.json", "run.log", "results.parquet", ".lock"])
def test_a_run_that_leads_outside_itself_is_refused_and_nothing_there_is_touched(campaign, tmp_path, name):
    whole, place = planned(campaign), tmp_path / "run" / name
    prepare(tmp_path / "run", whole, VERSIONS)
    elsewhere = tmp_path / "elsewhere"
    if place.exists():
        place.rename(elsewhere)
    else:
        elsewhere.write_text("mine")
    before = elsewhere.stat()
    place.symlink_to(elsewhere)
    with refused("run.link_elsewhere"):
        prepare(tmp_path / "run", whole, VERSIONS)
    assert elsewhere.stat() == before


@pytest.mark.parametrize("link", ["replay", "replay/one", "replay/one/way.csv", ".report.html.tmp"])
def test_nothing_is_drawn_through_a_link_in_a_run(campaign, tmp_path, link):
    prepare(tmp_path / "run", planned(campaign), VERSIONS)
    assert place_in(tmp_path / "run", "replay/one") == tmp_path / "run" / "replay" / "one"
    (tmp_path / "run" / link).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / "run" / link).symlink_to(tmp_path)
    with refused("run.link_elsewhere", link):
        place_in(tmp_path / "run", "replay/one")


def test_a_folder_that_is_no_run_is_left_alone(campaign, tmp_path):
    (tmp_path / "mine").mkdir()
    with refused("run.absent"):
        prepare(tmp_path / "mine", planned(campaign), VERSIONS)
    assert list((tmp_path / "mine").iterdir()) == []


@pytest.mark.parametrize(
    ("half_width_m", "friction", "expected"),
    [
        (0.1, [0.9], "rock.does_not_stand"),  # .1 / .6 < tan 12 degrees: falls
        (0.2, [0.9, 0.15], "rock.does_not_stand"),  # slides
    ],
)
def test_a_rock_that_does_not_stand_by_itself_is_refused_once_and_before_anything_is_written(
    campaign, tmp_path, half_width_m, friction, expected
):
    block = Scene.block(half_width_m, 0.2, 0.6).rock
    Scene.from_mesh((block.vertices_m, block.faces), slope_deg=12.0).save(tmp_path / "scene")
    axes = {"pga_m_s2": [2, 4], "azimuth_deg": [0, 90], "friction": friction}
    content = {"scene": str(tmp_path / "scene"), "ensemble": str(campaign.ensemble), **axes}
    leaning = Campaign.of(content, tmp_path)

    with refused(expected):
        run(plan_of(leaning), tmp_path / "run", nullcontext(None), watch=lambda progress: None)
    assert not (tmp_path / "run").exists()


LOADED = """
import json, sys
import toppling.models.motions.ensemble, toppling.models.scene, toppling.workers.job
from toppling.workers import engines
for engine in engines.ENGINES.values():
    __import__(engine.module)
print(json.dumps([module.__file__ for name, module in sys.modules.items() if name.startswith("toppling.")]))
"""
"""What a shake loads."""


@pytest.mark.parametrize("name", ["workers/shaking.py", "models/motions/ensemble.py"])
def test_whatever_can_change_an_answer_is_seen(name, monkeypatch):
    before = code.__wrapped__()
    monkeypatch.setitem(SOURCES, name, SOURCES[name] + b"x = 1")
    assert code.__wrapped__() != before


def test_every_module_that_a_shake_loads_is_part_of_the_identity_of_the_code():
    """The options of a scan aside, whose names the reader of scenes knows."""
    loaded = json.loads(
        subprocess.run([sys.executable, "-c", LOADED], check=True, capture_output=True).stdout
    )
    root = Path(toppling.models.__path__[0]).resolve().parent
    missing = {Path(value).resolve().relative_to(root).as_posix() for value in loaded} - SOURCES.keys()
    assert {name for name in missing if not name.endswith("__init__.py")} <= {"models/scan/hints_file.py"}


def test_a_run_goes_on_when_only_what_makes_scenes_or_reads_records_has_changed():
    assert not [name for name in SOURCES if name.startswith(("models/scan/", "models/motions/formats/"))]


RECORD, SCENE, LEVEL, AZIMUTH = range(4)


def ordered(records, levels, azimuths, scenes=(1,)):
    """Record, scene, level and azimuth of each job, in the order in which they go out, (n, 4)."""
    sizes = (records, math.prod(scenes), levels, azimuths)
    grid = np.array(list(product(*map(range, sizes))))
    order = balanced_order(*(grid[:, axis] for axis in (RECORD, LEVEL, AZIMUTH, SCENE)), scenes)
    assert np.array_equal(np.sort(order), np.arange(len(grid)))
    return grid[order]


def largest_deviation(values):
    """By how many jobs a value's number differs most, over all beginnings, from an even share."""
    entry = values[:, None] == np.arange(values.max() + 1)
    even = np.arange(1, len(values) + 1)[:, None] / entry.shape[1]
    return float(np.abs(np.cumsum(entry, axis=0) - even).max())


@settings(max_examples=40)
@given(records=st.integers(1, 80), levels=st.integers(1, 12), azimuths=st.integers(1, 12))
def test_in_every_beginning_records_levels_and_azimuths_are_balanced_up_to_a_block(records, levels, azimuths):
    jobs = ordered(records, levels, azimuths)
    of_a_record = block_jobs(records, levels, azimuths, 1)[1]
    assert largest_deviation(jobs[:, RECORD]) < of_a_record
    for axis, size in ((LEVEL, levels), (AZIMUTH, azimuths)):
        assert largest_deviation(jobs[:, axis]) <= of_a_record + size / 4 + 2


def test_after_a_quarter_of_a_run_a_quarter_is_done_of_every_record_level_and_azimuth():
    jobs = ordered(30, 12, 12)[: int(0.26 * 4320)]
    assert set(np.bincount(jobs[:, RECORD], minlength=30)) == {37, 38}
    assert np.ptp(np.bincount(jobs[:, LEVEL], minlength=12)) <= 2
    assert np.ptp(np.bincount(jobs[:, AZIMUTH], minlength=12)) <= 2
    # Levels do not go with azimuths, nor with records: no table of the two is less filled than chance would have it.
    for pair in ([LEVEL, AZIMUTH], [RECORD, LEVEL], [RECORD, AZIMUTH]):
        assert len(np.unique(jobs[:, pair], axis=0)) > 0.95 * np.prod(jobs[:, pair].max(axis=0) + 1)


def test_scenes_change_seldom_and_come_round_evenly():
    scenes, records = (2, 1, 10), 30
    jobs = ordered(records, 12, 12, scenes)
    changes = 1 + sum(value != other for value, other in pairwise(jobs[:, SCENE].tolist()))
    assert len(jobs) / changes >= JOBS_OF_A_SCENE * 0.9
    of_block = records * block_jobs(records, 12, 12, 20)[1]
    assert largest_deviation(jobs[:, SCENE]) <= of_block
    friction = jobs[:, SCENE] // 10
    assert largest_deviation(friction) <= of_block


@pytest.mark.parametrize(("jobs", "timed"), [(3, 1), (20, 4), (165, 12), (21280, 48)])
def test_some_jobs_of_every_plan_are_timed_and_few_of_a_small_plan(jobs, timed):
    assert timed_jobs(jobs) == timed
