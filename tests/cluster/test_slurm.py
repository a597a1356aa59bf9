"""A real Slurm whose batch jobs reach their walltime, are cancelled, wait for a drained node or end at once."""

import contextlib
import os
import subprocess
import sys

import pytest
from answers import answers_of
from slurm import Slurm, can_be_started

from toppling.orchestrator.journal import last

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        not can_be_started(), reason="slurmctld, slurmd and munged are not installed, or no root"
    ),
]

PATIENCE_S = 400.0
TOPPLING = [sys.executable, "-P", "-c", "from toppling.orchestrator.cli import main; main()"]
JOBQUEUE = """\
jobqueue:
  slurm:
    cores: {cores}
    memory: 2GB
    walltime: "00:01:00"
    interface: lo
    log-directory: {folder}
"""


@pytest.fixture(scope="module")
def slurm(tmp_path_factory):
    pytest.importorskip("dask_jobqueue", reason="the extra hpc is not installed")
    with Slurm(tmp_path_factory.mktemp("slurm"), cpus=4) as started:
        yield started


@pytest.fixture
def submit(slurm, inputs, tmp_path):
    """Begin a run on batch jobs; returns its process, which is ended with the test."""
    begun = []

    def begin(jobs, cores=1, **more):
        settings = tmp_path / "dask"
        settings.mkdir()
        text = JOBQUEUE.format(cores=cores, folder=tmp_path) + "".join(
            f"    {name}: {value}\n" for name, value in more.items()
        )
        (settings / "jobqueue.yaml").write_text(text)
        unaudited = inputs / "unaudited.toml"
        unaudited.write_text(f"audit = 0\n{(inputs / 'campaign.toml').read_text()}")
        words = ["run", unaudited, "--out", tmp_path / "run", "--no-estimate"]
        environment = os.environ | slurm.environment | {"DASK_CONFIG": str(settings)}
        with (tmp_path / "told").open("w") as told:
            process = subprocess.Popen(
                [*TOPPLING, *map(str, words), "--queue", "slurm", "--queue-jobs", str(jobs)],
                env=environment, cwd=tmp_path, stdout=told, stderr=told,
            )  # fmt: skip
        begun.append(process)
        return process

    yield begin
    for process in begun:
        process.terminate()
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(60)
        process.kill()


def told(folder):
    return (folder / "told").read_text()


def completed(process, folder, undisturbed):
    """See that a run ends with all rows, and counts no failure for workers that left."""
    assert process.wait(PATIENCE_S) == 0, told(folder)
    assert answers_of(folder / "run") == undisturbed
    assert last(folder / "run", "session ended")["deaths"] == 0


def test_batch_jobs_that_reach_their_walltime_are_submitted_again_until_all_rows_are_there(
    slurm, submit, faults, undisturbed, tmp_path
):
    faults.set(every={"kind": "wait", "seconds": 4.0})  # 72 jobs on two processes: two walltimes or three
    process = submit(1, cores=2)
    slurm.until(lambda: slurm.jobs("running"))
    (first,) = slurm.jobs("running")
    completed(process, tmp_path, undisturbed)
    assert first in slurm.jobs("timeout")
    assert "1 batch jobs have ended: as many are submitted again" in told(tmp_path)


def test_jobs_cancelled_on_a_drained_node_come_back_with_it_and_give_the_same_rows(
    slurm, submit, faults, undisturbed, tmp_path
):
    faults.set(every={"kind": "wait", "seconds": 1.0})
    process = submit(2)
    slurm.until(lambda: len(slurm.jobs("running")) == 2 and last(tmp_path / "run", "rows stored"))
    first, second = slurm.jobs("running")
    slurm.drain()
    slurm.cancel(first)  # its successor has to wait
    slurm.until(lambda: len(pending := slurm.jobs("pending")) == 1 and pending[0] not in (first, second))
    (waiting,) = slurm.jobs("pending")
    slurm.cancel(waiting)  # before any worker of it has come
    slurm.until(lambda: len(pending := slurm.jobs("pending")) == 1 and pending[0] != waiting)
    slurm.cancel(second)
    slurm.until(lambda: len(slurm.jobs("pending")) == 2)
    slurm.resume()
    completed(process, tmp_path, undisturbed)


def test_batch_jobs_that_end_before_a_worker_comes_end_the_run_with_a_sentence(slurm, submit, tmp_path):
    process = submit(1, python="/nonexistent/python")
    assert process.wait(PATIENCE_S) == 1
    assert "batch jobs ended" in told(tmp_path)
    assert "To go on: toppling run" in told(tmp_path)
    assert "Traceback" not in told(tmp_path)
