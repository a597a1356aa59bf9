"""A small real ensemble, its undisturbed rows, and a real cluster whose jobs can be told to go wrong."""

import json
import os
import shutil
import subprocess
from contextlib import nullcontext
from pathlib import Path

import pytest
from answers import sorted_answers
from small_campaigns import campaign_in

import toppling
from toppling.models.motions.ensemble import Ensemble
from toppling.models.scene import Scene
from toppling.orchestrator.campaign import Campaign
from toppling.orchestrator.cluster import local
from toppling.orchestrator.plan import plan, plan_of
from toppling.orchestrator.run import run
from toppling.orchestrator.run_folder import prepare
from toppling.orchestrator.task import lost_row, versions
from toppling.results.store import write_part
from toppling.workers.job import Assets, run_job

FAULTS_VARIABLE = "TOPPLING_TEST_FAULTS"
STILLBORN_VARIABLE = "TOPPLING_TEST_STILLBORN"


def can_mount():
    """Whether a process may have mounts of its own, which root alone gives it."""
    command = ["unshare", "--mount", "true"]
    return shutil.which("unshare") is not None and subprocess.run(command, check=False).returncode == 0


@pytest.fixture(scope="session")
def inputs(tmp_path_factory):
    """Folder with campaign.toml, scene and ensemble: 72 jobs of some hundredths of a second."""
    folder = tmp_path_factory.mktemp("inputs")
    axes = {"pga_m_s2": [2, 4, 6, 8], "azimuth_deg": [0, 90, 200], "friction": [0.9, 0.7], "preset": "fast"}
    campaign_in(folder, (0.6, 1.0, 1.4), **axes)
    return folder


@pytest.fixture(scope="session")
def campaign(inputs):
    return Campaign.read(inputs / "campaign.toml")


@pytest.fixture(scope="session")
def planned(campaign):
    return plan(campaign, Scene.load(campaign.scene), Ensemble.load(campaign.ensemble))


@pytest.fixture(scope="session")
def undisturbed(planned, campaign):
    """Rows as one process gives them without any cluster."""
    assets = Assets(Scene.load(campaign.scene), Ensemble.load(campaign.ensemble))
    return sorted_answers([run_job(planned.spec(row), assets) for row in range(len(planned))])


@pytest.fixture
def finished(planned, undisturbed, tmp_path):
    """Make the folder of a run that an earlier session finished; its jobs in `lost` ended so, with such attempts."""

    def make(lost):
        prepare(tmp_path / "run", planned, dict(versions()))
        specs = {job: planned.spec(job) for job in lost}
        ids = {spec.job_id for spec in specs.values()}
        rows = [row | {"attempt": 1} for row in undisturbed if row["job_id"] not in ids]
        for job, (status, attempt) in lost.items():
            rows.append(lost_row(specs[job], status, "as of an earlier session") | {"attempt": attempt})
        write_part(tmp_path / "run", rows)
        return tmp_path / "run"

    return make


class Faults:
    """How long which job waits, s."""

    def __init__(self, path):
        self.path = path

    def set(self, **waits_s):
        hidden = self.path.with_name("hidden")  # a worker may read at any time
        hidden.write_text(json.dumps(waits_s))
        hidden.replace(self.path)

    def clear(self):
        self.path.unlink(missing_ok=True)


@pytest.fixture(scope="session")
def faults_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("faults") / "faults.json"
    os.environ[FAULTS_VARIABLE] = str(path)
    # A frozen worker without a job is only missed by the scheduler; a minute for each would make the tests long.
    os.environ["DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL"] = "15s"
    os.environ["DASK_DISTRIBUTED__WORKER__PRELOAD"] = json.dumps([str(Path(__file__).with_name("faults.py"))])
    return path


@pytest.fixture
def faults(faults_file):
    result = Faults(faults_file)
    yield result
    result.clear()


@pytest.fixture(scope="session")
def client(faults_file):
    """Two real worker processes, which all tests share that need no workers of their own."""
    import dask

    dask.config.refresh()
    with local(2) as client:
        yield client


@pytest.fixture(scope="session")
def whole(inputs, client, tmp_path_factory):
    """The run of all jobs that nothing disturbed, on real workers, as Python hands it back."""
    return toppling.run(inputs / "campaign.toml", tmp_path_factory.mktemp("whole") / "run", cluster=client)


@pytest.fixture
def execute(campaign, client):
    def go(folder, watch=lambda progress: None, **options):
        return run(plan_of(campaign), folder, nullcontext(client), watch, **options)

    return go
