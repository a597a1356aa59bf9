"""A local run belongs to its user: who shares the host but not the session's key gets no answer."""

import os
import signal
import stat
import time
from contextlib import suppress
from http.client import HTTPException
from pathlib import Path
from urllib.request import urlopen

import dask
import psutil
import pytest
from distributed.comm import connect
from distributed.security import Security

from toppling.orchestrator.cluster import _ClosedIfNotStarted, _queue_cluster
from toppling.orchestrator.folder import KEY_FILES


def listening(client):
    """Sockets on which the scheduler and its workers listen."""
    me = psutil.Process()
    for process in (me, *me.children(recursive=True)):
        for socket in process.net_connections("inet"):
            if socket.status == psutil.CONN_LISTEN:
                yield socket.laddr


def test_a_local_run_listens_to_nobody_without_its_key(client):
    client.wait_for_workers(2)
    address = client.scheduler.address
    assert address.startswith("tls://127.0.0.1:")
    others = {
        "no key": {"address": address.replace("tls", "tcp")},
        "another key": {"address": address, "security": Security.temporary()},
    }
    for options in others.values():
        with pytest.raises((OSError, TimeoutError)):
            _ClosedIfNotStarted(**options, timeout=5, set_as_default=False)
    workers = list(client.scheduler_info(n_workers=-1)["workers"])
    assert len(workers) == 2
    for worker in workers:
        with pytest.raises((OSError, TimeoutError)):
            client.sync(ask_without_a_key, worker.replace("tls", "tcp"))


async def ask_without_a_key(address):
    comm = await connect(address, timeout=5)
    try:
        await comm.write({"op": "run", "function": b"", "reply": True})
        return await comm.read()
    finally:
        comm.abort()


def test_a_local_run_is_on_loopback_and_its_pages_tell_nothing(client):
    places = set(listening(client))
    assert places
    assert {place.ip for place in places} == {"127.0.0.1"}
    told = []
    for place in places:
        for page in ("info/main/workers.html", "info/logs.html", "json/index.html", "status", "metrics"):
            with suppress(OSError, HTTPException):
                told.append(urlopen(f"http://127.0.0.1:{place.port}/{page}", timeout=5).read())
    assert told == []


def test_scratch_folders_of_a_local_run_are_its_own(client):
    places = client.run(lambda dask_worker: dask_worker.local_directory)
    for place in places.values():
        above = next(folder for folder in Path(place).parents if folder.name.startswith("toppling-session-"))
        assert stat.S_IMODE(above.stat().st_mode) == 0o700
        assert above.stat().st_uid == os.getuid()


def test_workers_hear_nothing_of_ctrl_c_nor_do_those_that_come_in_their_place(client):
    client.wait_for_workers(2)
    first = set(client.run(os.getpid).values())
    os.kill(min(first), signal.SIGKILL)
    end = time.monotonic() + 60
    while len(there := set(client.run(os.getpid, on_error="ignore").values())) < 2 or there == first:
        assert time.monotonic() < end, "no worker came in its place"
        time.sleep(0.2)
    for process in there:
        os.kill(process, signal.SIGINT)
    time.sleep(1.0)
    assert set(client.run(os.getpid).values()) == there


def test_batch_jobs_find_the_key_in_files_of_the_user_alone(tmp_path):
    pytest.importorskip("dask_jobqueue", reason="the extra hpc is not installed")
    with (
        dask.config.set({"jobqueue.slurm.cores": 2, "jobqueue.slurm.memory": "4GB"}),
        _queue_cluster("slurm", tmp_path) as cluster,
    ):
        assert cluster.scheduler_address.startswith("tls://")
        files = list(tmp_path.glob(f"{KEY_FILES}*"))
        assert {stat.S_IMODE(file.stat().st_mode) for file in files} == {0o600}
        script = cluster.job_script()
        assert [file for file in files if str(file) not in script] == []
        assert "--tls-key" in script
        assert "PRIVATE KEY" not in script
    assert list(tmp_path.iterdir()) == []
