"""A cluster is made ready for a run, though workers may leave at that moment."""

import errno
import os
import socket
import ssl
from concurrent.futures import CancelledError
from types import SimpleNamespace

import pyarrow as pa
import pytest
from distributed.comm import CommClosedError

from toppling.orchestrator import dask_cluster, task
from toppling.orchestrator.context import RunError
from toppling.workers.job import JobSpec


@pytest.mark.parametrize("cluster", [None, object()], ids=["somebody else's", "ours"])
def test_a_worker_that_leaves_while_all_are_asked_is_no_lost_scheduler(cluster, monkeypatch):
    client, asked = SimpleNamespace(status="running", cluster=cluster), []

    def ask(client):
        asked.append(client)
        if len(asked) < 3:
            raise OSError("Stream is closed")

    monkeypatch.setattr(dask_cluster, "let_leave_in_order", ask)
    monkeypatch.setattr(dask_cluster, "check_workers", lambda *_, **__: None)
    dask_cluster.make_ready(client)
    assert len(asked) == 3


def test_a_scheduler_of_ours_that_is_lost_is_not_waited_for(monkeypatch):
    client = SimpleNamespace(status="running", cluster=object())

    def ask(client):
        client.status = "connecting"
        raise OSError("Stream is closed")

    monkeypatch.setattr(dask_cluster, "let_leave_in_order", ask)
    monkeypatch.setattr(dask_cluster, "check_workers", lambda *_, **__: None)
    with pytest.raises(RunError, match=r"the connection to the scheduler is lost$"):
        dask_cluster.make_ready(client)


@pytest.mark.parametrize("cluster", [None, object()], ids=["somebody else's", "ours"])
@pytest.mark.parametrize(
    ("number", "path"),
    [
        (errno.ENOSPC, "run/parts/part"), (errno.EACCES, "run/scene/rock.ply"), (errno.EMFILE, None),
        (errno.EIO, "run"),
    ],
)  # fmt: skip
def test_what_a_disk_or_a_limit_refuses_is_reported_as_that_at_once(number, path, cluster, monkeypatch):
    client = SimpleNamespace(status="running", cluster=cluster)
    refused = OSError(number, os.strerror(number), *([path] if path else []))

    def ask(*_, **__):
        raise refused

    monkeypatch.setattr(dask_cluster, "check_workers", ask)
    with pytest.raises(OSError, match=os.strerror(number)) as raised:
        dask_cluster.make_ready(client)
    assert raised.value is refused


@pytest.mark.parametrize(
    "error",
    [
        CommClosedError("in <TCP>: Stream is closed"),
        OSError("Timed out trying to connect to tcp://node1:8786 after 30 s"),
        TimeoutError(errno.ETIMEDOUT, "Connection timed out"),
        ConnectionResetError(errno.ECONNRESET, "Connection reset by peer"),
        OSError(errno.EHOSTUNREACH, "No route to host"),
        socket.gaierror(socket.EAI_AGAIN, "Temporary failure in name resolution"),
        ssl.SSLError(1, "certificate has expired"), CancelledError(),
    ], ids=repr,
)  # fmt: skip
def test_what_a_network_refuses_may_be_a_lost_scheduler(error):
    assert dask_cluster.may_be_lost(error)


JOB = {"record_id": "R", "pga_m_s2": 1.0, "azimuth_deg": 0.0, "friction_static": 0.9, "friction_kinetic": 0.9,
       "restitution": 0.0, "realisation": 0}  # fmt: skip


@pytest.fixture
def batch(monkeypatch):
    """What a worker is asked, whose scene and records are replaced."""
    ensemble = SimpleNamespace(sha=lambda record: "sha")
    monkeypatch.setattr(task, "_assets_of", lambda run_key: SimpleNamespace(ensemble=ensemble))
    spec = JobSpec(scene_id="scene", record_sha="sha", preset="fast", **JOB)
    return (
        task.RunKey("", "scene", "", ()),
        {"preset": "fast"},
        pa.Table.from_pylist([JOB | {"job_id": spec.job_id}]),
    )


def test_a_worker_without_room_for_its_work_is_unfit_and_no_job_of_its_fails(batch, monkeypatch):
    def refuse(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "/tmp/work")

    monkeypatch.setattr(task, "run_job", refuse)
    with pytest.raises(task.UnfitWorkerError, match=r"cannot work .*No space left on device: '/tmp/work'"):
        task.shake_batch(*batch, 1.0)


def test_an_exception_in_a_job_is_a_row(batch, monkeypatch):
    monkeypatch.setattr(task, "run_job", lambda *_: 1 / 0)
    (row,) = task.shake_batch(*batch, 1.0).to_pylist()
    assert row["status"] == "failed"
    assert "ZeroDivisionError" in row["message"]


def test_a_worker_that_would_do_another_job_than_asked_is_unfit(batch):
    run_key, settings, jobs = batch
    with pytest.raises(task.UnfitWorkerError):
        task.shake_batch(run_key, settings | {"preset": "standard"}, jobs, 1.0)


@pytest.mark.parametrize("cluster", [None, object()], ids=["somebody else's", "a batch system's"])
def test_a_minute_without_workers_is_reported_once_with_the_address_and_the_remedy(
    cluster, monkeypatch, caplog
):
    now, workers = [0.0], {}
    client = SimpleNamespace(
        cluster=cluster, scheduler=SimpleNamespace(address="tcp://node1:8786"), nthreads=lambda: workers
    )
    monkeypatch.setattr(dask_cluster.time, "monotonic", lambda: now[0])
    supervisor = dask_cluster.DaskCluster(client)

    def log_at(at_s):
        now[0] = at_s
        caplog.clear()
        supervisor.look(0.0, 0)
        return caplog.text

    assert log_at(59.0) == ""
    result = log_at(60.0)
    assert "tcp://node1:8786" in result
    assert ("dask worker tcp://node1:8786" in result) == (cluster is None)
    assert log_at(300.0) == ""
    workers["tcp://node2:1"] = 1
    assert log_at(301.0) == ""
    workers.clear()
    assert log_at(330.0) == ""
    assert "no worker" in log_at(361.0)
