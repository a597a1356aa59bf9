"""Processes of this machine that share a loop of work with the program, and end with it."""

import signal
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from typing import Any

from toppling.orchestrator.interrupt import ENDS, kept_from_children

_ASSETS: list[Any] = []


def assets() -> list[Any]:
    """In a process of a pool, what it was given as it began."""
    return _ASSETS


@contextmanager
def pool_of(count: int, *assets: Any) -> Iterator[ProcessPoolExecutor]:
    """A pool of processes that hear nothing of Ctrl-C, and that end at once where what is done with them fails."""
    pool = ProcessPoolExecutor(count, initializer=_begin, initargs=assets)
    try:
        with kept_from_children():
            pool.submit(bool).result()  # all of them start with the first task
        yield pool
    except BaseException:
        for process in list(pool._processes.values()):  # else the end waits for all that was asked for
            process.kill()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _begin(*assets: Any) -> None:
    for number in ENDS:
        signal.signal(number, signal.SIG_DFL)  # a fork has the handlers of the program
    _ASSETS[:] = assets
