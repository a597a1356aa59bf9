"""Workers that this machine does not start as its own: what they lack is sent, once a host, or told."""

import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
from answers import answers_of
from conftest import can_mount
from distributed import Client
from refusals import refused
from waiting import wait_until

from toppling.models.compiled import FOLDER
from toppling.models.motions.ensemble import Ensemble
from toppling.models.scene import Scene
from toppling.orchestrator.cluster import existing
from toppling.orchestrator.dask_cluster import make_ready
from toppling.orchestrator.leaving import leaving_in_order
from toppling.orchestrator.plan import plan_of
from toppling.orchestrator.run import run
from toppling.orchestrator.task import RunKey, versions
from toppling.workers.shaking import compile_once

PATIENCE_S = 60.0

hides_files = pytest.mark.skipif(not can_mount(), reason="only root can give a process mounts of its own")


def dask(role, *arguments):
    start = f"import sys; sys.argv[0] = 'dask'; from distributed.cli.{role} import main; main()"
    return [sys.executable, "-P", "-c", start, *map(str, arguments)]


def bare_environment(**more):
    # Without the faults that other tests have workers load: they lie on the client's disk.
    return {name: value for name, value in os.environ.items() if not name.startswith("DASK_")} | more


@pytest.fixture
def scheduler(tmp_path):
    """File with the address of a scheduler that is not this program's."""
    with running_scheduler(tmp_path / "scheduler.json"):
        yield tmp_path / "scheduler.json"


@contextlib.contextmanager
def running_scheduler(file, port=0):
    command = dask(
        "dask_scheduler", "--host", "127.0.0.1", "--port", port, "--no-dashboard", "--scheduler-file", file
    )
    with running(command, env=bare_environment(), cwd="/") as process:
        wait_until(file.exists, PATIENCE_S)
        yield process


@contextlib.contextmanager
def running(command, **options):
    process = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True, **options
    )
    try:
        yield process
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait(PATIENCE_S)


@contextlib.contextmanager
def worker(scheduler, hidden, cache):
    """Start a worker, with mounts of its own, that finds nothing where the client has its files."""
    address = json.loads(scheduler.read_text())["address"]
    command = dask("dask_worker", address, "--nthreads", 1, "--no-dashboard", "--local-directory", cache)
    alone = [f"mount -t tmpfs none {place}" for place in hidden]
    shell = " && ".join([*alone, 'exec "$@"'])
    environment = bare_environment(TOPPLING_CACHE=str(cache))
    with running(
        ["unshare", "--mount", "sh", "-c", shell, "worker", *command], env=environment, cwd="/"
    ) as process:
        yield process


def cache_of_a_host(place):
    """A folder with the compiled code of this machine, as a host has it after its first run."""
    compile_once()
    place.mkdir()
    if FOLDER is not None:
        shutil.copytree(FOLDER, place / FOLDER.name)
    return place


@pytest.fixture
def host_folders():
    """Folders outside of what the workers have hidden from them."""
    with tempfile.TemporaryDirectory(prefix="toppling-hosts-", dir="/var/tmp") as folder:
        yield Path(folder)


@hides_files
@pytest.mark.thorough
def test_workers_that_see_none_of_the_clients_disk_go_on_with_a_scheduler_that_is_started_again_at_its_address(
    campaign, inputs, undisturbed, tmp_path, host_folders
):
    hosts = [cache_of_a_host(host_folders / name) for name in ("first", "second")]
    first, second = tmp_path / "first.json", tmp_path / "second.json"
    with contextlib.ExitStack() as stack:
        lost = stack.enter_context(running_scheduler(first))
        port = int(json.loads(first.read_text())["address"].rpartition(":")[2])
        hidden, three = [inputs, tmp_path], (*hosts, hosts[0])
        workers = [stack.enter_context(worker(first, hidden, cache)) for cache in three]

        def watch(progress):
            if progress.done and lost.poll() is None:
                lost.kill()
                lost.wait(PATIENCE_S)
                for cache in hosts:
                    shutil.rmtree(cache / "delivered")  # all has to be offered once more
                stack.enter_context(running_scheduler(second, port))

        progress = run(plan_of(campaign), tmp_path / "run", existing(f"tcp://127.0.0.1:{port}"), watch)
        assert lost.poll() is not None
        assert [entry.poll() for entry in workers] == [None] * 3  # they came back by themselves
    assert (progress.deaths, progress.failed) == (0, 0)
    assert answers_of(tmp_path / "run") == undisturbed
    for cache in hosts:
        remaining = {place.name for place in (cache / "delivered").iterdir() if place.is_dir()}
        assert remaining == {Scene.load(campaign.scene).id, Ensemble.load(campaign.ensemble).id}


BLOCKING = """\
import sys

class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == "toppling":
            raise ModuleNotFoundError(f"No module named {name!r}")

sys.meta_path.insert(0, Absent())
"""


def test_a_worker_without_the_program_is_refused_before_any_job(scheduler, tmp_path, planned, inputs):
    (tmp_path / "sitecustomize.py").write_text(BLOCKING)
    address = json.loads(scheduler.read_text())["address"]
    command = dask("dask_worker", address, "--nthreads", 1, "--no-dashboard", "--no-nanny")
    run_key = RunKey(str(inputs), planned.scene_id, planned.ensemble_id, versions())
    with (
        running(command, env=bare_environment(PYTHONPATH=str(tmp_path)), cwd=tmp_path),
        Client(address) as client,
    ):
        client.wait_for_workers(1, timeout=PATIENCE_S)
        with refused("cluster.workers_unfit", "No module named"), leaving_in_order(client):  # as a run does
            make_ready(client, run_key)
