"""Workers that are told to leave, by a batch system or a cloud that takes its node back: no death, no job's failure.

A worker that gets SIGTERM ends the job at hand, hands its rows over and goes; where it is given no time for that, its
batch is done again elsewhere. Either way it says so before it goes, which one that crashes cannot.
"""

import asyncio
import contextlib
import logging
import signal
import threading
import time
from collections.abc import Iterator

from distributed import Client, Worker
from distributed.comm import CommClosedError
from distributed.diagnostics.plugin import WorkerPlugin

log = logging.getLogger(__name__)

LEAVING = threading.Event()
"""Set in a worker's process that is told to leave: the batch at hand ends with the job at hand."""

GRACE_S = 5.0
"""A job at hand has this long; clouds and batch systems give half a minute before they kill."""

_LOOK_S = 0.02
_PLUGIN = "toppling-leaving"
_REASON = "told to leave"
_SERVED: set[str] = set()
"""Clients whose workers leave in order now."""


class LeaveInOrder(WorkerPlugin):
    """Has each worker that is there or joins leave in order on SIGTERM."""

    def setup(self, worker: Worker) -> None:
        """Listen, in a worker's own process: only its main thread gets signals."""
        with contextlib.suppress(ValueError, RuntimeError, NotImplementedError):
            loop = asyncio.get_running_loop()
            loop.add_signal_handler(signal.SIGTERM, lambda: loop.create_task(_leave(worker)))


@contextlib.contextmanager
def leaving_in_order(client: Client) -> Iterator[None]:
    """Have a cluster's workers leave in order as long as this goes on."""
    if client.id in _SERVED:  # a session within another, as where bases are weighed
        yield
        return
    client.register_plugin(LeaveInOrder(), name=_PLUGIN)
    _SERVED.add(client.id)
    try:
        yield
    finally:
        _SERVED.discard(client.id)
        if client.status == "running":
            with contextlib.suppress(CommClosedError, TimeoutError):
                client.unregister_worker_plugin(_PLUGIN)


def was_told_to_leave(client: Client, address: str) -> bool:
    """Whether a worker that is gone had said that it would go."""
    events = client.get_events(address) or ()
    return any(isinstance(event, dict) and event.get("action") == "closing-worker" for _, event in events)


async def _leave(worker: Worker) -> None:
    LEAVING.set()
    log.warning("told to leave: ending the job at hand")
    at_hand = {task.key for task in worker.state.executing}
    end = time.monotonic() + GRACE_S
    while time.monotonic() < end and at_hand & {task.key for task in worker.state.executing}:
        await asyncio.sleep(_LOOK_S)
    await worker.close_gracefully(reason=_REASON)
