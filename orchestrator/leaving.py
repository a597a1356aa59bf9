"""Workers that are told to leave, by a batch system or a cloud that takes its node back: no death, no job's failure.

A worker that gets SIGTERM ends the job at hand, hands its rows over and goes, within seconds whatever happens; where it
is given no time for that, its batch is done again elsewhere. Either way it says so before it goes, which one that
crashes cannot. One whose scheduler is gone is started anew by its nanny, and joins the next one at the same address.
"""

import asyncio
import contextlib
import logging
import os
import signal
import threading
from collections.abc import Iterator

from distributed import Client, Nanny, Status, Worker
from distributed.diagnostics.plugin import WorkerPlugin
from distributed.protocol.pickle import dumps

log = logging.getLogger(__name__)

LEAVING = threading.Event()
"""Set in a worker's process that is told to leave: the batch at hand ends with the job at hand."""

_GRACE_S = 5.0
"""A job at hand has this long, and after it the handing over; clouds and batch systems give half a minute."""

_LOOK_S = 0.02
_PLUGIN = "toppling-leaving"
_GOODBYE = {"action": "closing-worker", "reason": "told to leave"}
"""As Dask's own, which a worker says later, as it closes."""
_SERVED: set[str] = set()
"""Clients whose workers leave in order now."""


class _LeaveInOrder(WorkerPlugin):
    """Has each worker that is there or joins leave in order on SIGTERM, and rest for no lack of memory.

    outlive: whether a worker's process is started anew where its scheduler is gone.
    """

    def __init__(self, *, outlive: bool = False) -> None:
        self.outlive, self.scheduler = outlive, ""

    async def setup(self, worker: Worker) -> None:
        """Listen, in a worker's own process: only its main thread gets signals."""
        with contextlib.suppress(ValueError, RuntimeError, NotImplementedError):
            loop = asyncio.get_running_loop()
            loop.add_signal_handler(signal.SIGTERM, lambda: loop.create_task(_leave(worker)))
        # Nothing would become free: a worker that rests would wait for ever.
        worker.memory_manager.memory_pause_fraction = False
        if self.outlive:
            self.scheduler = await _scheduler_of(worker)

    async def teardown(self, worker: Worker) -> None:
        """Have the nanny, which has been told to end with its worker, start another if the scheduler is gone."""
        if self.outlive and worker.nanny and not LEAVING.is_set():
            gone = True
            with contextlib.suppress(OSError):
                gone = await _scheduler_of(worker) != self.scheduler
            if gone:
                async with worker.rpc(str(worker.nanny)) as nanny:
                    await nanny.run(function=dumps(_go_on))


async def _scheduler_of(worker: Worker) -> str:
    return (await worker.scheduler.identity(n_workers=0))["id"]


def _go_on(dask_worker: Nanny) -> None:
    dask_worker.status = Status.running


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
    return any(isinstance(event, dict) and event.get("action") == _GOODBYE["action"] for _, event in events)


async def _leave(worker: Worker) -> None:
    LEAVING.set()
    worker.log_event(worker.address, _GOODBYE)
    exit_anyway = threading.Timer(
        3 * _GRACE_S, os._exit, (0,)
    )  # a connection may hold up any of what follows
    exit_anyway.daemon = True
    exit_anyway.start()
    at_hand, now = {task.key for task in worker.state.executing}, asyncio.get_running_loop().time
    end = now() + _GRACE_S
    while now() < end and at_hand & {task.key for task in worker.state.executing}:
        await asyncio.sleep(_LOOK_S)
    with contextlib.suppress(OSError, TimeoutError):  # the scheduler is gone too
        await asyncio.wait_for(worker.close_gracefully(reason="told to leave"), _GRACE_S)
    await worker.close(reason="told to leave")
