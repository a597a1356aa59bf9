"""Local worker process, which reads its configuration on standard input and ends when that is closed."""

import asyncio
import json
import os
import sys
import threading
from typing import Any

import dask
from distributed import Worker
from distributed.security import Security

import toppling.orchestrator.task  # noqa: F401  (what takes long, before a job needs it)
from toppling.models.compiled import FOLDER
from toppling.orchestrator.compiling import is_compiled, shake_a_block


def main() -> None:
    """Work until the scheduler, or the program that started this one, is gone."""
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
