"""Supervision of a cluster started by this program: adaptive size, and replacement of lost workers."""

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
"""Remaining work that justifies another local process or batch job, s: a few times its start or waiting time."""
_ADAPT_PAUSE_S, _IDLE_LOOKS = "3s", 10
"""Interval between adaptations of the size, and number of them in which a worker must be idle before it is stopped."""
_LISTED = {"slurm": ("squeue", "--me", "--noheader", "--format=%A")}
"""Commands that list the ids of a user's unfinished batch jobs."""
_LIST_PAUSE_S, _LIST_TIMEOUT_S = 30.0, 20.0
"""Interval between such lists, and timeout of one, s."""
_SUBMITTED_IN_VAIN = 3
"""Number of consecutive submissions whose batch jobs all end without a worker, after which the run stops."""
_RESUBMIT_PAUSE_S, _RESUBMIT_TIMEOUT_S = 10.0, 30.0
"""Interval between resubmissions, and timeout of one, s."""


CLOSED = "--no-dashboard --dashboard-address 127.0.0.1:0"
"""Options of a Dask worker without dashboard, which has no authentication."""
_WARN_AFTER_S = 60.0
"""Time without workers before a warning, s."""


class ByWorkLeft(Adaptive):
    """Adapts the number of workers to the remaining work, most of which is not yet submitted to the scheduler."""

    worth_s, work_left_s, at_hand = _WORTH_A_WORKER_S, 0.0, 0

    async def target(self) -> int:
        """Number of processes justified by the remaining work, at least as many as are busy."""
        return max(math.ceil(self.work_left_s / self.worth_s), self.at_hand)


_ADAPTIVE: WeakKeyDictionary[SpecCluster, ByWorkLeft] = WeakKeyDictionary()
"""Adaptive controllers of clusters with a variable size."""


def let_resize(cluster: Any, least: int, most: int) -> None:
    """Set the number of local workers or batch jobs: `least`, and up to `most` while there is work for them."""
    of_queue = not isinstance(cluster, LocalWorkers)
    cluster.scale(**{"jobs" if of_queue else "n": least})
    if most > least:
        suffix, options = "_jobs" if of_queue else "", {"interval": _ADAPT_PAUSE_S, "wait_count": _IDLE_LOOKS}
        bounds = {f"minimum{suffix}": least, f"maximum{suffix}": most}
        _ADAPTIVE[cluster] = cluster.adapt(Adaptive=ByWorkLeft, **bounds, **options)
        _ADAPTIVE[cluster].worth_s = _WORTH_A_BATCH_JOB_S if of_queue else _WORTH_A_WORKER_S


class ClusterSupervisor:
    """Maintains the size of a cluster that this program started, and warns if any cluster has no worker for long."""

    def __init__(self, client: Client) -> None:
        self._client, self._cluster = client, client.cluster
        self._came: set[str] = set()  # batch jobs whose workers have joined
        self._ended: set[str] = set()  # batch jobs that left the queue without a worker
        self._listed = -math.inf
        self._in_vain = 0
        self._all_there = self._worked = time.monotonic()
        self._warned = False

    def look(self, work_left_s: float, at_hand: int) -> None:
        """Adapt the size to the remaining work (of one process) and the batches in flight; resubmit batch jobs.

        Raises RunError if local workers repeatedly die at their start, or batch jobs end before a worker joins.
        """
        if isinstance(self._cluster, LocalWorkers) and (why := self._cluster.fatal):
            raise RunError(f"worker processes die as they start: {why}")
        self._warn_of_absence()
        if adaptive := _ADAPTIVE.get(self._cluster) if isinstance(self._cluster, SpecCluster) else None:
            adaptive.work_left_s, adaptive.at_hand = work_left_s, at_hand
        if not self.gone():
            self._all_there = time.monotonic()
        elif time.monotonic() - self._all_there > _RESUBMIT_PAUSE_S:
            self.resubmit()

    def _warn_of_absence(self) -> None:
        if self._client.nthreads():
            self._worked, self._warned = time.monotonic(), False
        elif not self._warned and time.monotonic() - self._worked >= _WARN_AFTER_S:
            self._warned = True
            address = getattr(self._client.scheduler, "address", "the scheduler")
            remedy = "look at the queue of the batch system and at the logs of its jobs"
            if self._cluster is None:
                remedy = f"start some with 'dask worker {address} --nthreads 1 {CLOSED}'"
            elif isinstance(self._cluster, LocalWorkers):
                remedy = "they may still compile; run.log has the reason of each death"
            log.warning("no worker has joined for %g s at %s: %s", _WARN_AFTER_S, address, remedy)

    def replace(self, workers: Sequence[str]) -> None:
        """Restart workers that hang, without waiting for it."""
        if isinstance(self._cluster, LocalWorkers):
            there = self._client.scheduler_info(n_workers=-1)["workers"]
            for worker in set(workers) & there.keys():
                self._cluster.workers[there[worker]["name"]].kill()
            return
        loop = self._client.loop
        assert loop is not None  # as long as the client is open
        # On the client's loop the call does not block.
        loop.add_callback(self._client.restart_workers, list(workers), raise_for_error=False)

    def gone(self) -> list[str]:
        """Batch jobs that have ended, with all their workers."""
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
        """Query the batch system for jobs that were cancelled or failed before a worker joined."""
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
        """Replace batch jobs that have ended, which Dask does not; RunError after repeated failures."""
        cluster: Any = self._cluster
        ended = self.gone()
        wanted = len(cluster.worker_spec)
        if self._ended >= set(cluster.worker_spec):
            self._in_vain += 1
        if self._in_vain > _SUBMITTED_IN_VAIN:
            raise RunError(
                f"batch jobs ended {self._in_vain} times before a worker came of them; their output says why "
                "(log-directory in jobqueue.yaml, else the folder of this command)"
            )
        self._came.difference_update(ended)  # their names are reused
        self._ended.clear()
        # Dask has already dropped some, which need only be requested again.
        if dropped := [name for name in ended if name in cluster.workers]:
            log.warning("%d batch jobs have ended: as many are submitted again", len(dropped))
            with contextlib.suppress(TimeoutError):  # repeated at the next look
                self._client.sync(cluster.scale_down, dropped, callback_timeout=_RESUBMIT_TIMEOUT_S)
        cluster.scale(jobs=wanted)
