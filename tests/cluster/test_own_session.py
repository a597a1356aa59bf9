"""A local run belongs to its user: who shares the host but not the session's key gets no answer."""

import os
import shlex
import shutil
import signal
import socket
import stat
import subprocess
import sys
import time
from datetime import timedelta
from http.client import HTTPException
from pathlib import Path
from urllib.request import urlopen

import psutil
import pytest
import yaml
from distributed.comm import connect
from distributed.security import Security

from toppling.orchestrator import session_key
from toppling.orchestrator.cluster import _ClosedIfNotStarted
from toppling.orchestrator.session_key import write_key


def listening(client):
    """Sockets on which the scheduler and its workers listen."""
    me = psutil.Process()
    for process in (me, *me.children(recursive=True)):
        for connection in process.net_connections("inet"):
            if connection.status == psutil.CONN_LISTEN:
                yield connection.laddr


def test_a_local_run_belongs_to_its_user_and_listens_to_nobody_without_its_key(client):
    client.wait_for_workers(2)
    for place in client.run(lambda dask_worker: dask_worker.local_directory).values():
        above = next(folder for folder in Path(place).parents if folder.name.startswith("toppling-session-"))
        assert (stat.S_IMODE(above.stat().st_mode), above.stat().st_uid) == (0o700, os.getuid())
    places = set(listening(client))
    assert {place.ip for place in places} == {"127.0.0.1"}
    for place in places:
        for page in ("info/main/workers.html", "info/logs.html", "json/index.html", "status", "metrics"):
            with pytest.raises((OSError, HTTPException)):
                urlopen(f"http://127.0.0.1:{place.port}/{page}", timeout=5)
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


@pytest.fixture(scope="module")
def composed(tmp_path_factory):
    """Scheduler and a worker as the compose file starts them, on this machine: commands and environment are its own."""
    folder = tmp_path_factory.mktemp("composed")
    services = yaml.safe_load((Path(__file__).parents[2] / "docker-compose.yml").read_text())["services"]
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
    (folder / "own").mkdir()
    own = {
        "/runs/.keys": str(folder / "keys"),
        "--local-directory /tmp": f"--local-directory {folder / 'own'}",
        "127.0.0.1:8789": "127.0.0.1:0",
        "tls://scheduler:8786": f"tls://127.0.0.1:{port}",
        "8786": str(port),
    }

    def here(text):
        for name, value in {
            **own,
            "--dashboard-address 127.0.0.1:8787": "--no-dashboard --host 127.0.0.1",
        }.items():
            text = text.replace(name, value)
        return text

    environment = os.environ | {
        name: here(value) for name, value in services["worker"]["environment"].items()
    }
    environment["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{environment['PATH']}"
    commands = {
        name: shlex.split(here(services[name]["command"])) for name in ("keys", "scheduler", "worker")
    }
    subprocess.run(commands["keys"], env=environment, check=True, cwd=folder)
    started = [
        subprocess.Popen(
            apart(commands[name], folder), env=environment, cwd=folder, stderr=subprocess.DEVNULL
        )
        for name in ("scheduler", "worker")
    ]
    try:
        yield services, folder / "keys", f"tls://127.0.0.1:{port}"
    finally:
        for process in started:
            for child in psutil.Process(process.pid).children(recursive=True):
                child.kill()
            process.kill()
            process.wait()


def apart(command, folder):
    """The command with a folder `own` of its own, as a container has one, where this account may mount."""
    unshared = ["unshare", "--mount", "sh", "-c", f'mount -t tmpfs none {folder / "own"} && exec "$@"', "sh"]
    may = shutil.which("unshare") and not subprocess.run([*unshared, "true"], capture_output=True).returncode
    return [*unshared, *command] if may else command


def test_a_certificate_is_retained_until_its_last_weeks(tmp_path, monkeypatch):
    def written():
        write_key(tmp_path)
        return [path.read_bytes() for path in sorted(tmp_path.iterdir())]

    first = written()
    assert written() == first
    monkeypatch.setattr(session_key, "_LEAST_LEFT", timedelta(days=366))
    assert not set(written()) & set(first)


def test_the_composed_scheduler_lets_in_only_who_holds_the_key(composed):
    services, keys, address = composed
    assert all(stat.S_IMODE(path.stat().st_mode) == 0o600 for path in keys.iterdir())
    security = Security(
        tls_ca_file=str(keys / "certificate.pem"), tls_client_cert=str(keys / "certificate.pem"),
        tls_client_key=str(keys / "key.pem"), require_encryption=True,
    )  # fmt: skip
    with _ClosedIfNotStarted(address, security=security, timeout=60, set_as_default=False) as client:
        client.wait_for_workers(1, timeout=60)
        assert client.submit(sum, [1, 2]).result(timeout=60) == 3
        assert all(worker.startswith("tls://") for worker in client.scheduler_info(n_workers=-1)["workers"])
    for other in (
        {"address": address.replace("tls", "tcp")},
        {"address": address, "security": Security.temporary()},
    ):
        with pytest.raises((OSError, TimeoutError)):
            _ClosedIfNotStarted(**other, timeout=5, set_as_default=False)
    published = [port for service in services.values() for port in service.get("ports", ())]
    assert published == ["127.0.0.1:${TOPPLING_PORT:-8786}:8786"]
