"""Workers that are told to leave, by a batch system or a cloud that takes its node back: no death, no job's failure.

A worker that gets SIGTERM ends the job at hand, hands its rows over and goes; where it is given no time for that, its
batch is done again elsewhere. Either way it says so before it goes, which one that crashes cannot. One whose scheduler
is gone waits for another at the same address, where Dask's own would end at once.
"""

import asyncio
import contextlib
import logging
import signal
import threading
import time
from collections.abc import Iterator
from typing import Any

from distributed import Client, Status, Worker
from distributed.diagnostics.plugin import WorkerPlugin

log = logging.getLogger(__name__)

LEAVING = threading.Event()
"""Set in a worker's process that is told to leave: the batch at hand ends with the job at hand."""

_GRACE_S = 5.0
"""A job at hand has this long; clouds and batch systems give half a minute before they kill."""

BACK_WITHIN_S = 120.0
"""A scheduler of somebody else that is gone has this long to be started again."""

_LOOK_S = 0.02
_ASK_S = 1.0
_PLUGIN = "toppling-leaving"
_REASON = "told to leave"
_BROKEN = ("worker-handle-scheduler-connection-broken", "worker-heartbeat-missing")
"""Reasons for which Dask ends a worker whose scheduler is gone, or is another one that does not know it."""
_SERVED: set[str] = set()
"""Clients whose workers leave in order now."""


class _LeaveInOrder(WorkerPlugin):
    """Has each worker that is there or joins leave in order on SIGTERM, and rest for no lack of memory.

    outlive: whether a worker waits for its scheduler to come back.
    """

    def __init__(self, *, outlive: bool = False) -> None:
        self.outlive = outlive

    def setup(self, worker: Worker) -> None:
        """Listen, in a worker's own process: only its main thread gets signals."""
        with contextlib.suppress(ValueError, RuntimeError, NotImplementedError):
            loop = asyncio.get_running_loop()
            loop.add_signal_handler(signal.SIGTERM, lambda: loop.create_task(_leave(worker)))
        # Nothing would become free: a worker that rests would wait for ever.
        worker.memory_manager.memory_pause_fraction = False
        if self.outlive:
            _outlive_scheduler(worker)

    def teardown(self, worker: Worker) -> None:
        """Let the worker end as Dask's own again."""
        vars(worker).pop("close", None)


def let_leave_in_order(client: Client) -> None:
    """Have the workers of a scheduler leave in order, those that join later too."""
    client.register_plugin(_LeaveInOrder(outlive=client.cluster is None), name=_PLUGIN)


@contextlib.contextmanager
def leaving_in_order(client: Client) -> Iterator[None]:
    """Let workers that are to leave in order do so until this ends."""
    if client.id in _SERVED:  # a session within another, as where bases are weighed
        yield
        return
    _SERVED.add(client.id)
    try:
        yield
    finally:
        _SERVED.discard(client.id)
        if client.status == "running":
            with contextlib.suppress(OSError, KeyError, ValueError):  # who could not load it has none
                client.unregister_worker_plugin(_PLUGIN)


def was_told_to_leave(client: Client, address: str) -> bool:
    """Whether a worker that is gone had said that it would go."""
    events = client.get_events(address) or ()
    return any(isinstance(event, dict) and event.get("action") == "closing-worker" for _, event in events)


async def _leave(worker: Worker) -> None:
    LEAVING.set()
    log.warning("told to leave: ending the job at hand")
    at_hand = {task.key for task in worker.state.executing}
    end = time.monotonic() + _GRACE_S
    while time.monotonic() < end and at_hand & {task.key for task in worker.state.executing}:
        await asyncio.sleep(_LOOK_S)
    with contextlib.suppress(OSError):  # the scheduler is gone too
        await worker.close_gracefully(reason=_REASON)
    await worker.close(reason=_REASON)


def _outlive_scheduler(worker: Worker) -> None:
    close, broken = worker.close, False

    async def close_and_come_back(*arguments: Any, **options: Any) -> Any:
        nonlocal broken
        broken = broken or options.get("reason") == _BROKEN[0]
        if broken and options.get("reason") in _BROKEN and await _comes_back(worker):
            options["nanny"] = False  # which starts another process, and that one joins the new scheduler
        return await close(*arguments, **options)

    vars(worker)["close"] = close_and_come_back


async def _comes_back(worker: Worker) -> bool:
    end = time.monotonic() + BACK_WITHIN_S
    while time.monotonic() < end and not LEAVING.is_set() and worker.status == Status.running:
        with contextlib.suppress(OSError):
            await worker.scheduler.identity(n_workers=0)
            return True
        await asyncio.sleep(_ASK_S)
    return False
