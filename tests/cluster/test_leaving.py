"""Workers that come and go: what they had at hand is done elsewhere, and no failure is counted for it."""

import contextlib
import os
import random
import signal
import subprocess
import sys
import threading

import pytest
from answers import answers_of
from distributed import Client, LocalCluster

from toppling.orchestrator import cluster, dask_cluster
from toppling.orchestrator.cluster import load_defaults
from toppling.orchestrator.plan import plan_of
from toppling.orchestrator.run import run

PATIENCE_S = 60.0


@pytest.fixture
def scheduler(faults_file):
    """A cluster without workers of its own."""
    import dask

    dask.config.refresh()
    load_defaults()
    with (
        LocalCluster(n_workers=0, host="127.0.0.1", dashboard_address=None) as cluster,
        Client(cluster) as client,
    ):
        yield client


class Joining:
    """Workers that join a scheduler as those of another host do, each with its own nanny."""

    def __init__(self, address, folder):
        self.address, self.folder = address, folder
        self.here = []

    def join(self):
        start = "import sys; sys.argv[0] = 'dask'; from distributed.cli.dask_worker import main; main()"
        command = [sys.executable, "-P", "-c", start, self.address, "--nthreads", "1", "--no-dashboard"]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        self.here.append(subprocess.Popen(command, cwd=self.folder, start_new_session=True, **quiet))

    def leave(self, worker, whole_node):
        """Tell a worker to leave as a container is told (its first process), or as a node that is taken back (all)."""
        self.here.remove(worker)
        with contextlib.suppress(ProcessLookupError):
            (os.killpg if whole_node else os.kill)(worker.pid, signal.SIGTERM)

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        for worker in self.here:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(worker.pid, signal.SIGKILL)


@pytest.mark.thorough
def test_workers_asked_to_leave_cost_no_try_and_no_row(scheduler, campaign, undisturbed, faults, tmp_path):
    """At random moments one leaves and another joins, until four have left.

    Jobs wait longer while a smaller share has left than is done, on a machine where workers start slowly.
    """
    chance, ended = random.Random(7), threading.Event()
    leaves, left, done = 4, 0, 0.0

    def watch(progress):
        nonlocal done
        done = progress.done / progress.total

    def come_and_go():
        nonlocal left
        while left < leaves and not ended.wait(chance.uniform(0.1, 0.6)):
            if len(scheduler.nthreads()) >= 2:
                joining.leave(joining.here[0], whole_node=chance.random() < 0.5)
                left += 1
            while len(joining.here) < 3:
                joining.join()
            faults.set(every=1.0 if left >= done * leaves else 10.0)
        faults.clear()

    faults.set(every=1.0)
    thread = threading.Thread(target=come_and_go)
    with Joining(scheduler.scheduler.address, tmp_path) as joining:
        for _ in range(3):
            joining.join()
        scheduler.wait_for_workers(2, timeout=PATIENCE_S)
        thread.start()
        try:
            progress = run(plan_of(campaign), tmp_path / "run", contextlib.nullcontext(scheduler), watch)
        finally:
            ended.set()
            thread.join(PATIENCE_S)
    assert (left, progress.deaths) == (leaves, 0)
    assert answers_of(tmp_path / "run") == undisturbed


@pytest.mark.thorough
def test_a_cluster_grows_while_there_is_work_shrinks_when_there_is_less_and_gives_the_same_rows(
    campaign, undisturbed, faults, tmp_path, monkeypatch
):
    import dask

    dask.config.refresh()
    monkeypatch.setattr(dask_cluster, "_WORTH_A_WORKER_S", 0.5)
    monkeypatch.setattr(dask_cluster, "_ADAPT_PAUSE_S", "300ms")
    slow = undisturbed[0]["job_id"]
    faults.set(**{slow: 20.0}, every=0.3)
    sizes = []
    shaken = run(
        plan_of(campaign),
        tmp_path / "run",
        cluster.local(1, most=3),
        lambda progress: sizes.append(progress.workers),
    )
    assert max(sizes) == 3
    assert sizes[-1] == 1  # which has the slow job
    assert shaken.deaths == 0
    assert answers_of(tmp_path / "run") == undisturbed
