"""Connecting to a scheduler that somebody else has started, and workers that others start."""

import re
import stat
import sys
import threading
from contextlib import nullcontext
from pathlib import Path
from types import ModuleType, SimpleNamespace

import dask
import pytest
from distributed import SpecCluster
from refusals import refused

from toppling.orchestrator.cluster import (
    _queue_session,
    _warn_of_open_door,
    existing,
    gateway,
    job_script,
    local,
    queue,
)
from toppling.orchestrator.dask_cluster import DaskCluster
from toppling.orchestrator.run_folder import KEY_FOLDERS

ROOT = Path(__file__).parents[3]


def test_an_address_that_asks_for_tls_is_refused_without_certificates_and_nothing_is_left_open():
    before = set(threading.enumerate())
    with refused("cluster.unreachable"):
        existing("tls://127.0.0.1:1").__enter__()
    # A client that is still open would wait for its loop for a minute when the program ends.
    assert set(threading.enumerate()) <= before


@pytest.mark.parametrize("asked", [(10_000, None), (1, 10_000)])
def test_more_workers_than_a_machine_has_room_for_are_refused_before_any_starts(asked):
    before = set(threading.enumerate())
    with refused("cluster.too_many_workers"):
        local(*asked)
    assert set(threading.enumerate()) <= before


CLOSED = "--no-dashboard --dashboard-address 127.0.0.1:0"
"""With the first alone a worker still answers at a port of all interfaces."""


@pytest.mark.parametrize("file", ["docker-compose.yml", "docs/guide/cluster.md"])
def test_workers_are_asked_to_be_started_with_their_pages_closed(file):
    text = (ROOT / file).read_text("utf-8").replace("$closed", CLOSED)
    commands = [line for line in text.splitlines() if re.search("dask worker (tcp|tls|--)", line)]
    assert commands
    assert [line for line in commands if CLOSED.removesuffix("0") not in line] == []


@pytest.mark.parametrize(
    ("address", "warns"),
    [
        ("tcp://10.0.0.1:8786", True), ("tcp://node1:8786", True), ("tcp://[fe80::1]:8786", True),
        ("tcp://127.0.0.1:8786", False), ("tcp://[::1]:8786", False), ("tls://10.0.0.1:8786", False),
    ],
)  # fmt: skip
def test_a_scheduler_that_lets_in_anybody_beyond_this_machine_is_reported(address, warns, caplog):
    _warn_of_open_door(address)
    assert ("asks for no key" in caplog.text) is warns


BATCH_JOB = {"jobqueue.slurm.cores": 1, "jobqueue.slurm.memory": "2GB"}


def test_a_batch_job_has_what_is_asked_before_the_configuration_closed_pages_and_the_users_kernels(
    monkeypatch,
):
    pytest.importorskip("dask_jobqueue")
    monkeypatch.setenv("OPENBLAS_CORETYPE", "Haswell; true")
    asked = {"queue": "long", "account": "geo", "walltime": "03:00:00", "memory": "5GB"}
    configured = {"walltime": "00:30:00", "queue": "short", "worker-extra-args": ["--lifetime", "55m"]}
    with dask.config.set(BATCH_JOB | {f"jobqueue.slurm.{name}": value for name, value in configured.items()}):
        script = job_script("slurm", asked)
        given = job_script("slurm", dict.fromkeys(asked))
    wanted = ["-p long", "-A geo", "-t 03:00:00", "--mem=5G"]
    assert [line for line in wanted if f"#SBATCH {line}" not in script] == []
    kernels = "\nexport OPENBLAS_CORETYPE='Haswell; true'\n"
    for line in ("-p short", "-t 00:30:00", f"{CLOSED} --lifetime 55m", kernels):
        assert line in given


def test_batch_jobs_find_the_key_in_a_folder_of_the_user_alone(tmp_path):
    pytest.importorskip("dask_jobqueue")
    with dask.config.set(BATCH_JOB), _queue_session("slurm", tmp_path, {}) as (cluster, _):
        assert cluster.scheduler_address.startswith("tls://")
        (folder,) = tmp_path.glob(f"{KEY_FOLDERS}*")
        assert stat.S_IMODE(folder.stat().st_mode) == 0o700
        files = list(folder.iterdir())
        script = cluster.job_script()
        assert files
        assert [file for file in files if str(file) not in script] == []
        assert "--tls-key" in script
        assert "PRIVATE KEY" not in script
    assert list(tmp_path.iterdir()) == []


def check_queue_refused(code, interface, folder, *named):
    """Check that a batch system on a network interface is refused, in one line that says what is wrong."""
    pytest.importorskip("dask_jobqueue")
    settings = BATCH_JOB | {"jobqueue.slurm.interface": interface}
    with dask.config.set(settings), refused(code, *named) as caught, queue("slurm", 1, folder):
        pass
    assert "\n" not in caught.value.what


def test_an_interface_that_this_host_lacks_is_refused_with_the_names_of_those_that_it_has(tmp_path):
    check_queue_refused("cluster.queue_unconfigured", "ib17", tmp_path, "ib17", "'lo'", "scheduler-options")


def test_a_batch_system_that_takes_no_job_is_reported_in_a_line(tmp_path, monkeypatch):
    (tmp_path / "sbatch").write_text("#!/bin/sh\necho no such partition >&2\nexit 1\n")
    (tmp_path / "sbatch").chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    check_queue_refused("cluster.job_not_submitted", "lo", tmp_path, "no such partition")


def gateway_with(monkeypatch, *names):
    """Stand in for Dask Gateway with clusters of such names; their clients are named alike."""
    there = SimpleNamespace(
        list_clusters=lambda: [SimpleNamespace(name=name) for name in names],
        connect=lambda name: nullcontext(
            SimpleNamespace(get_client=lambda: nullcontext(f"client of {name}"))
        ),
    )
    package = ModuleType("dask_gateway")
    package.Gateway = lambda: nullcontext(there)
    monkeypatch.setitem(sys.modules, "dask_gateway", package)


def test_a_cluster_of_a_gateway_is_found_by_its_name_or_as_the_only_cluster(monkeypatch):
    gateway_with(monkeypatch, "first", "second")
    with gateway("second") as client:
        assert client == "client of second"
    for name in ("third", ""):
        with refused("cluster.gateway_name_unknown", "first, second"), gateway(name):
            pass
    gateway_with(monkeypatch, "first")
    with gateway("") as client:
        assert client == "client of first"


def test_a_gateway_without_its_package_is_refused(monkeypatch):
    monkeypatch.setitem(sys.modules, "dask_gateway", None)
    with refused("package.not_installed"), gateway("first"):
        pass


class Batch(SpecCluster):
    """A batch system whose jobs are named by a test; of each come two workers."""

    job_cls = SimpleNamespace(config_name="none")

    def __init__(self, *jobs):
        self.worker_spec = {job: {"group": ["-0", "-1"]} for job in jobs}
        self.workers = {job: SimpleNamespace(job_id="1") for job in jobs}
        self.here, self.asked = set(), []

    observed = property(lambda self: self.here)
    __del__ = lambda self: None  # noqa: E731

    def scale(self, jobs):
        self.asked.append(jobs)

    def scale_down(self, jobs):
        self.asked.append(list(jobs))


def test_a_batch_job_that_has_ended_with_all_its_workers_is_resubmitted_and_a_waiting_job_is_not():
    cluster = Batch("first", "second")
    client = SimpleNamespace(
        cluster=cluster, sync=lambda function, *given, callback_timeout: function(*given)
    )
    supervisor = DaskCluster(client)
    assert supervisor.ended_jobs() == []
    cluster.here = {"first-0", "first-1"}
    assert supervisor.ended_jobs() == []
    cluster.here = {"first-1"}
    assert supervisor.ended_jobs() == []
    cluster.here = set()
    assert supervisor.ended_jobs() == ["first"]
    supervisor.resubmit()
    assert cluster.asked == [["first"], 2]
    assert supervisor.ended_jobs() == []  # it waits again
