"""Dask cluster of local worker processes.

Each receives its configuration on standard input. It needs neither the calling program nor shared memory: a script
needs no main guard, may come from standard input, and runs where /dev/shm is not writable.
"""

import asyncio
import contextlib
import json
import logging
import os
import select
import signal
import sys
import threading
from pathlib import Path
from typing import IO, Any

import dask
import psutil
from distributed import Scheduler, SpecCluster, Worker
from distributed.deploy.spec import ProcessInterface
from distributed.security import Security
from distributed.system import MEMORY_LIMIT

from toppling.models.compiled import FOLDER
from toppling.orchestrator.interrupt import LOOK_S
from toppling.orchestrator.journal import log_event
from toppling.orchestrator.processes import WorkerProcess, worker_process
from toppling.orchestrator.task import is_compiled, shake_a_block

log = logging.getLogger(__name__)

_DEATHS_AT_START = 2
"""Number of consecutive deaths at the start after which no process is started."""

_OUT_OF_MEMORY = Path("/sys/fs/cgroup/memory.events")


class LocalWorkers(SpecCluster):
    """Worker processes on the loopback interface, at most `most`, which share the machine's memory equally."""

    def __init__(self, scratch: str, security: Security, most: int) -> None:
        self.deaths_at_start, self.why = 0, ""  # number of consecutive deaths; reason of the last
        host = "127.0.0.1"
        scheduler = {"host": host, "port": 0, "protocol": "tls://", "security": security,
                     "dashboard": False, "dashboard_address": f"{host}:0"}  # fmt: skip
        settings = {"scratch": scratch, "config": dask.config.config,
                "security": security.get_tls_config_for_role("worker")}  # fmt: skip
        fraction = dask.config.get("distributed.worker.memory.terminate")
        worker = {"session": self, "settings": settings, "memory": fraction * MEMORY_LIMIT / most}
        parts = {
            "scheduler": {"cls": Scheduler, "options": scheduler},
            "worker": {"cls": _LocalWorker, "options": worker},
        }
        super().__init__(**parts, security=security)

    @property
    def fatal(self) -> str:
        """Reason why no further process is started; empty otherwise."""
        return self.why if self.deaths_at_start >= _DEATHS_AT_START else ""


class _LocalWorker(ProcessInterface):
    """Worker process that a thread restarts when it dies."""

    def __init__(
        self, scheduler: str, name: Any, session: LocalWorkers, settings: dict[str, Any], memory: float
    ) -> None:
        super().__init__()
        self._settings = (
            json.dumps({**settings, "scheduler": scheduler, "name": name}, default=str).encode() + b"\n"
        )
        self._name, self._session, self._memory = name, session, memory
        self._process: WorkerProcess | None = None
        self._supervisor = threading.Thread(target=self._supervise, name=f"worker {name}", daemon=True)
        self._closing = False

    async def start(self) -> None:
        """Start the process, which joins its scheduler asynchronously."""
        self._supervisor.start()
        await super().start()

    async def close(self) -> None:
        """End the process."""
        self._closing = True
        while self._supervisor.is_alive():
            self.kill()
            await asyncio.to_thread(self._supervisor.join, LOOK_S)
        await super().close()

    def kill(self) -> None:
        """End the process immediately."""
        if self._process:
            self._process.kill()

    def _supervise(self) -> None:
        while not self._closing and not self._session.fatal:
            try:
                joined, why = self._live()
            except Exception as error:  # the process could not be started
                joined, why = False, f"it cannot be started: {error}"
            if not self._closing:
                self._session.why = why
                self._session.deaths_at_start = 0 if joined else self._session.deaths_at_start + 1
                log_event("worker process died", worker=self._name, joined=joined, why=why)

    def _live(self) -> tuple[bool, str]:
        """Start a process and wait for its end; returns whether it had joined, and the cause of its end."""
        killed_before = _kills_for_memory()
        self._process = process = worker_process()
        try:
            assert process.stdin
            assert process.stdout
            with contextlib.suppress(OSError):
                process.stdin.write(self._settings)
                process.stdin.flush()
            joined = bool(process.stdout.readline())
            self._session.deaths_at_start *= not joined
            why = self._until_the_end(process.pid, process.stdout)
            code = process.wait()
            process.error_file.seek(0)
            text = process.error_file.read().decode(errors="replace")
            return joined, why or _why(code, text, _kills_for_memory() > killed_before)
        finally:
            process.end()

    def _until_the_end(self, pid: int, output: IO[bytes]) -> str:
        """Wait for the end of the process; end it and return the reason if it exceeds its share of memory."""
        why, end = "", select.poll()
        end.register(output)  # closed as the process ends
        while not end.poll(1000.0 * LOOK_S):
            with contextlib.suppress(psutil.Error):
                held = psutil.Process(pid).memory_info().rss
                if held > self._memory:
                    why = f"it held {held / 1e9:.1f} GB, more than its share of memory"
                    self.kill()
        return why


def _why(code: int, errors: str, out_of_memory: bool) -> str:
    lines = [line.strip() for line in errors.splitlines() if line.strip()]
    if hung := [
        line for line in lines if line.startswith("Timeout (")
    ]:  # by `faulthandler`, before the stack
        return f"a job took longer than it may: {hung[-1]}"
    last = lines[-1] if lines else ""
    if code < 0:
        name = signal.Signals(-code).name
        cause = ", as the system ran out of memory" if out_of_memory else ""
        return f"it was ended by {name}{cause}{f' ({last})' if last and not cause else ''}"
    return last or f"it ended with code {code}"


def _kills_for_memory() -> int:
    """Number of processes of this container killed by the kernel's out-of-memory killer; 0 if unknown."""
    with contextlib.suppress(OSError, ValueError):
        counts = dict(line.split() for line in _OUT_OF_MEMORY.read_text().splitlines())
        return int(counts.get("oom_kill", 0))
    return 0


def main() -> None:
    """Worker process: read the configuration on standard input, and work until that or the scheduler is gone."""
    if is_compiled():
        shake_a_block()  # while the program that started this one checks its plan
    if not (line := sys.stdin.readline()):
        return
    settings = json.loads(line)
    threading.Thread(target=_end_with_the_program, daemon=True).start()
    dask.config.update(dask.config.config, settings["config"])
    if FOLDER is None:  # before it joins, or what it compiles would count as a job that hangs
        shake_a_block()
    asyncio.run(_work(settings))


def _end_with_the_program() -> None:
    """Exit when standard input is closed, although a job may keep the other thread busy for minutes."""
    sys.stdin.read()
    os._exit(0)


async def _work(settings: dict[str, Any]) -> None:
    key = settings["security"]
    security = Security(
        tls_ca_file=key["ca_file"],
        tls_worker_cert=key["cert"],
        tls_worker_key=key["key"],
        require_encryption=True,
    )
    worker = Worker(
        settings["scheduler"], name=settings["name"], nthreads=1, host="127.0.0.1", local_directory=settings["scratch"],
        memory_limit=0, dashboard=False, dashboard_address="127.0.0.1:0", security=security,
    )  # fmt: skip
    async with worker:
        os.write(1, b"joined\n")
        os.dup(1)  # stays open as long as this process lives
        os.dup2(2, 1)  # nobody reads what is printed
        await worker.finished()


if __name__ == "__main__":
    main()
