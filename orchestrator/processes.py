"""Pools of local processes that end with the program."""

import signal
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
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
