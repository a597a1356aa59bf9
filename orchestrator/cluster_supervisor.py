"""A cluster that this program started: between how many workers it is kept, and what replaces those that are gone."""

import contextlib
import logging
import math
import subprocess
import time
from collections.abc import Sequence
from typing import Any
from weakref import WeakKeyDictionary

from distributed import Client, SpecCluster
from distributed.deploy.adaptive import Adaptive

from toppling.orchestrator.context import RunError
from toppling.orchestrator.local_workers import LocalWorkers

log = logging.getLogger(__name__)

_WORTH_A_WORKER_S, _WORTH_A_BATCH_JOB_S = 15.0, 300.0
"""Work that another process is started for: a few times what it takes to start, or to come out of a queue."""

_ADAPT_PAUSE_S, _IDLE_LOOKS = "3s", 10
"""A worker that could be spared in so many looks is let go: after a few times what it takes to start another."""

_LISTED = {"slurm": ("squeue", "--me", "--noheader", "--format=%A")}
"""What lists the numbers of a user's batch jobs that have not ended."""

_LIST_PAUSE_S, _LIST_TIMEOUT_S = 30.0, 20.0
_SUBMITTED_IN_VAIN = 3
"""Times in a row that batch jobs end, all of them, before a worker of one has come."""

_RESUBMIT_PAUSE_S, _RESUBMIT_TIMEOUT_S = 10.0, 30.0


class ByWorkLeft(Adaptive):
    """Workers as there is work left for them; of that work few tasks wait on the scheduler at a time."""

    worth_s, work_left_s, at_hand = _WORTH_A_WORKER_S, 0.0, 0

    async def target(self) -> int:
        """Processes that are worth their start, and as many as are busy."""
        return max(math.ceil(self.work_left_s / self.worth_s), self.at_hand)


_ADAPTIVE: WeakKeyDictionary[SpecCluster, ByWorkLeft] = WeakKeyDictionary()
"""Of clusters that grow and shrink."""


def let_resize(cluster: Any, least: int, most: int) -> None:
    """Have a cluster of so many local workers, or batch jobs; between so many as there is work for them."""
    of_queue = not isinstance(cluster, LocalWorkers)
    cluster.scale(**{"jobs" if of_queue else "n": least})
    if most > least:
        suffix, options = "_jobs" if of_queue else "", {"interval": _ADAPT_PAUSE_S, "wait_count": _IDLE_LOOKS}
        bounds = {f"minimum{suffix}": least, f"maximum{suffix}": most}
        _ADAPTIVE[cluster] = cluster.adapt(Adaptive=ByWorkLeft, **bounds, **options)
        _ADAPTIVE[cluster].worth_s = _WORTH_A_BATCH_JOB_S if of_queue else _WORTH_A_WORKER_S


class ClusterSupervisor:
    """Keeps a cluster that this program started at its size; of one that is somebody else's it knows nothing."""

    def __init__(self, client: Client) -> None:
        self._client, self._cluster = client, client.cluster
        self._came: set[str] = set()  # batch jobs of which a worker has been there
        self._ended: set[str] = set()  # of which none has been there, and that their queue does not list
        self._listed = -math.inf
        self._in_vain = 0
        self._all_there = time.monotonic()

    def look(self, work_left_s: float, at_hand: int) -> None:
        """See to the size, by the work that is left of one process and the batches in flight, and to what has ended.

        Raises RunError if local workers die whenever they start, or batch jobs end before a worker comes.
        """
        if isinstance(self._cluster, LocalWorkers) and (why := self._cluster.fatal):
            raise RunError(f"worker processes die as they start: {why}")
        if adaptive := _ADAPTIVE.get(self._cluster) if isinstance(self._cluster, SpecCluster) else None:
            adaptive.work_left_s, adaptive.at_hand = work_left_s, at_hand
        if not self.gone():
            self._all_there = time.monotonic()
        elif time.monotonic() - self._all_there > _RESUBMIT_PAUSE_S:
            self.resubmit()

    def replace(self, workers: Sequence[str]) -> None:
        """Have others take the place of workers that hang; it is not waited for, as that takes seconds."""
        if isinstance(self._cluster, LocalWorkers):
            there = self._client.scheduler_info(n_workers=-1)["workers"]
            for worker in set(workers) & there.keys():
                self._cluster.workers[there[worker]["name"]].kill()
            return
        loop = self._client.loop
        assert loop is not None  # as long as the client is open
        # Called on the client's own loop it does not wait.
        loop.add_callback(self._client.restart_workers, list(workers), raise_for_error=False)

    def gone(self) -> list[str]:
        """Batch jobs that have ended with all their workers."""
        cluster: Any = self._cluster
        if not isinstance(cluster, SpecCluster) or not hasattr(cluster, "job_cls"):
            return []
        here = {str(name) for name in cluster.observed}
        present = {
            name
            for name, spec in cluster.worker_spec.items()
            if any(f"{name}{suffix}" in here for suffix in spec.get("group", [""]))
        }
        self._came |= present
        if present:
            self._in_vain = 0
        self._see_which_ended()
        return [name for name in cluster.worker_spec if name in (self._came | self._ended) - present]

    def _see_which_ended(self) -> None:
        """Ask the batch system for jobs that were cancelled, or failed, before a worker of theirs came."""
        cluster: Any = self._cluster
        command = _LISTED.get(getattr(cluster.job_cls, "config_name", ""))
        waiting = {name: job.job_id for name, job in cluster.workers.items() if name not in self._came}
        if command is None or not waiting or time.monotonic() - self._listed < _LIST_PAUSE_S:
            return
        self._listed = time.monotonic()
        with contextlib.suppress(OSError, subprocess.SubprocessError):
            listed = subprocess.run(
                command, capture_output=True, text=True, check=True, timeout=_LIST_TIMEOUT_S
            )
            there = set(listed.stdout.split())
            self._ended = {name for name, number in waiting.items() if number and number not in there}

    def resubmit(self) -> None:
        """Submit batch jobs in place of those that have ended, which Dask does not; RunError if they do so in vain."""
        cluster: Any = self._cluster
        gone = self.gone()
        wanted = len(cluster.worker_spec)
        if self._ended >= set(cluster.worker_spec):
            self._in_vain += 1
        if self._in_vain > _SUBMITTED_IN_VAIN:
            raise RunError(
                f"batch jobs ended {self._in_vain} times before a worker came of them; their output says why "
                "(log-directory in jobqueue.yaml, else the folder of this command)"
            )
        self._came.difference_update(gone)  # their names return
        self._ended.clear()
        # Dask has already dropped some: those only have to be asked for again.
        if dropped := [name for name in gone if name in cluster.workers]:
            log.warning("%d batch jobs have ended: as many are submitted again", len(dropped))
            with contextlib.suppress(TimeoutError):  # the next look finds what is left to do
                self._client.sync(cluster.scale_down, dropped, callback_timeout=_RESUBMIT_TIMEOUT_S)
        cluster.scale(jobs=wanted)
