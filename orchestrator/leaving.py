"""Graceful shutdown of workers whose node a batch system or a cloud withdraws: not counted as a crash.

A worker that receives SIGTERM finishes the current job, returns its rows and exits within seconds; without enough time
for that, its batch is repeated elsewhere. In both cases it announces its exit, unlike a crashed worker. A worker whose
scheduler is lost is restarted by its nanny, and joins the next scheduler at the same address.
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

from toppling.orchestrator.interrupt import POLL_S

log = logging.getLogger(__name__)

LEAVING = threading.Event()
"""Set in a worker's process that is to exit: the current batch ends with its current job."""
_GRACE_S = 5.0
"""Time for the current job, and then for returning rows, s; clouds and batch systems give half a minute."""
_PLUGIN = "toppling-leaving"
_EXIT_EVENT = {"action": "closing-worker", "reason": "told to leave"}
"""Event that announces an exit, in the form of Dask's event, which a worker sends only when it closes."""
_SERVED: set[str] = set()
"""Clients whose workers have the plugin."""


class _LeaveInOrder(WorkerPlugin):
    """Plugin for graceful exit of workers on SIGTERM, which also disables pausing at low memory.

    outlive: whether a worker's process is restarted when its scheduler is lost.
    """

    def __init__(self, *, outlive: bool = False) -> None:
        self.outlive, self.scheduler = outlive, ""

    async def setup(self, worker: Worker) -> None:
        """Install the signal handler in a worker's process, whose main thread receives signals."""
        with contextlib.suppress(ValueError, RuntimeError, NotImplementedError):
            loop = asyncio.get_running_loop()
            loop.add_signal_handler(signal.SIGTERM, lambda: loop.create_task(_leave(worker)))
        # Pausing would free no memory: a paused worker would wait forever.
        worker.memory_manager.memory_pause_fraction = False
        if self.outlive:
            self.scheduler = await _scheduler_of(worker)

    async def teardown(self, worker: Worker) -> None:
        """Let the nanny, which should end with its worker, restart it if the scheduler is lost."""
        if self.outlive and worker.nanny and not LEAVING.is_set():
            lost = True
            with contextlib.suppress(OSError):
                lost = await _scheduler_of(worker) != self.scheduler
            if lost:
                async with worker.rpc(str(worker.nanny)) as nanny:
                    await nanny.run(function=dumps(_go_on))


async def _scheduler_of(worker: Worker) -> str:
    return (await worker.scheduler.identity(n_workers=0))["id"]


def _go_on(dask_worker: Nanny) -> None:
    dask_worker.status = Status.running


def let_leave_in_order(client: Client) -> None:
    """Register the plugin for graceful exit with all present and future workers of a scheduler."""
    client.register_plugin(_LeaveInOrder(outlive=client.cluster is None), name=_PLUGIN)


@contextlib.contextmanager
def leaving_in_order(client: Client) -> Iterator[None]:
    """Keep the plugin for graceful exit registered within the block."""
    if client.id in _SERVED:  # a nested session, such as the conditioning of bases
        yield
        return
    _SERVED.add(client.id)
    try:
        yield
    finally:
        _SERVED.discard(client.id)
        if client.status == "running":
            with contextlib.suppress(OSError, KeyError, ValueError):  # workers that could not load it
                client.unregister_worker_plugin(_PLUGIN)


def announced_exit(client: Client, address: str) -> bool:
    """Whether a lost worker had announced its exit."""
    events = client.get_events(address) or ()
    return any(
        isinstance(event, dict) and event.get("action") == _EXIT_EVENT["action"] for _, event in events
    )


async def _leave(worker: Worker) -> None:
    LEAVING.set()
    worker.log_event(worker.address, _EXIT_EVENT)
    exit_anyway = threading.Timer(
        3 * _GRACE_S, os._exit, (0,)
    )  # a blocked connection may delay any of the following
    exit_anyway.daemon = True
    exit_anyway.start()
    at_hand, now = {task.key for task in worker.state.executing}, asyncio.get_running_loop().time
    end = now() + _GRACE_S
    while now() < end and at_hand & {task.key for task in worker.state.executing}:
        await asyncio.sleep(POLL_S)
    with contextlib.suppress(OSError, TimeoutError):  # the scheduler is lost too
        await asyncio.wait_for(worker.close_gracefully(reason="told to leave"), _GRACE_S)
    await worker.close(reason="told to leave")
