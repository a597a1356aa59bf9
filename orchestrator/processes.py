"""Local processes that end with the program, and import no modules from the working folder."""

import contextlib
import os
import signal
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from toppling.orchestrator.interrupt import ENDS, signals_blocked

_ASSETS: list[Any] = []


def assets() -> list[Any]:
    """Assets that a pool's process was started with."""
    return _ASSETS


@contextmanager
def pool_of(count: int, *assets: Any) -> Iterator[ProcessPoolExecutor]:
    """Pool of processes that ignore Ctrl-C, and are killed immediately if the block fails."""
    pool = ProcessPoolExecutor(count, initializer=_begin, initargs=assets)
    try:
        with signals_blocked():
            pool.submit(bool).result()  # all of them start with the first task
        yield pool
    except BaseException:
        for process in list(pool._processes.values()):  # otherwise shutdown waits for all submitted work
            process.kill()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _begin(*assets: Any) -> None:
    for number in ENDS:
        signal.signal(number, signal.SIG_DFL)  # a forked process inherits the program's handlers
    _ASSETS[:] = assets


VARIABLE = "PYTHONSAFEPATH"


def safe_for_children() -> None:
    """Exclude the working folder from import paths of child processes; threads of BLAS mostly wait for each other."""
    os.environ |= {VARIABLE: "1", "OPENBLAS_NUM_THREADS": "1"}


def safe_as_module() -> None:
    """Remove the working folder, which `python -m toppling` adds, from the import paths of this process and workers."""
    if sys.flags.safe_path or not sys.path:
        return
    if not sys.path[0] or Path(sys.path[0]).resolve() == Path.cwd():
        del sys.path[0]


@contextlib.contextmanager
def without_working_folder() -> Iterator[None]:
    """Exclude the working folder, the first path in a notebook, from the import paths of workers.

    The folder of the calling program stays, because workers import that program.
    """
    safe_for_children()
    before = list(sys.path)
    sys.path[:] = [path for path in sys.path if path]
    try:
        yield
    finally:
        sys.path[:] = before
