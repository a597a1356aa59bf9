"""A cluster that this program started is kept at its size, or between two sizes as there is work for it."""

import contextlib
import logging
import math
import subprocess
import time
from collections.abc import Collection, Mapping
from typing import Any
from weakref import WeakKeyDictionary

from distributed import Client, LocalCluster, SpecCluster

from toppling.orchestrator.context import RunError
from toppling.orchestrator.journal import tell

log = logging.getLogger(__name__)

_REPLACE_TIMEOUT_S = 30
_WORTH_A_WORKER_S, _WORTH_A_BATCH_JOB_S = 15.0, 300.0
"""Work that another process is started for: a few times what it takes to start, or to come out of a queue."""

_LISTED = {"slurm": ("squeue", "--me", "--noheader", "--format=%A")}
"""What lists the numbers of a user's batch jobs that have not ended."""

_LIST_PAUSE_S = 30.0
_LIST_TIMEOUT_S = 20.0
_SUBMITTED_IN_VAIN = 3
"""Times in a row that batch jobs end, all of them, before a worker of one has come."""

_IDLE_S = 30.0
"""After which a worker that has nothing to do is let go: a few times what it takes to start another."""

_SIZES: WeakKeyDictionary[SpecCluster, tuple[int, int]] = WeakKeyDictionary()
"""Least and most workers, or batch jobs, of a cluster which this program started."""


def let_resize(cluster: SpecCluster, least: int, most: int) -> None:
    """Have a cluster between so many workers, or batch jobs."""
    _SIZES[cluster] = least, most


class ClusterSupervisor:
    """Keeps a cluster that this program started at its size; of one that is somebody else's it knows nothing."""

    def __init__(self, client: Client) -> None:
        self._client = client
        self._came: set[str] = set()  # batch jobs of which a worker has been there
        self._ended: set[str] = set()  # of which none has been there, and that their queue does not list
        self._listed = -math.inf
        self._in_vain = 0
        self._idle: dict[str | int, float] = {}  # workers, or batch jobs, with nothing to do, and since when

    def gone(self) -> list[str | int]:
        """Local workers that have no process at this moment, or batch jobs that have ended with all their workers."""
        cluster = self._client.cluster
        if isinstance(cluster, LocalCluster):
            alive = {name for name, nanny in list(cluster.workers.items()) if nanny.is_alive()}
            return [name for name in cluster.worker_spec if name not in alive]
        if not isinstance(cluster, SpecCluster):
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
        cluster: Any = self._client.cluster
        command = _LISTED.get(getattr(getattr(cluster, "job_cls", None), "config_name", ""))
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

    def replace(self) -> None:
        """Start new workers, or submit new batch jobs, in place of those that are gone for good.

        Dask restarts a worker that dies, but not one that dies while it starts, as happens on a busy machine to one
        whose first job kills it; and it submits no batch job again that has reached its time. Then nobody works any
        more and nobody says so.
        """
        cluster: Any = self._client.cluster
        gone = self.gone()
        wanted = len(cluster.worker_spec)
        of_queue = not isinstance(cluster, LocalCluster)
        if of_queue and self._ended >= set(cluster.worker_spec):
            self._in_vain += 1
        if self._in_vain > _SUBMITTED_IN_VAIN:
            raise RunError(
                f"batch jobs ended {self._in_vain} times before a worker came of them; their output says why "
                "(log-directory in jobqueue.yaml, else the folder of this command)"
            )
        self._came.difference_update(gone)  # their names return
        self._ended.clear()
        # Dask has already dropped some of the local ones: those only have to be asked for again.
        dropped = [name for name in gone if name in cluster.workers]
        if dropped:
            listed = (
                "%d batch jobs have ended: as many are submitted again"
                if of_queue
                else "%d workers did not come back after their death: new ones start"
            )
            log.warning(listed, len(dropped))
            with contextlib.suppress(TimeoutError):  # the next look finds what is left to do
                self._client.sync(cluster.scale_down, dropped, callback_timeout=_REPLACE_TIMEOUT_S)
        cluster.scale(**{"jobs" if of_queue else "n": wanted})

    def grow(self, work_left_s: float) -> None:
        """Start more workers, or submit more batch jobs, if there is work for them and they are allowed.

        work_left_s: of one process.
        """
        cluster: Any = self._client.cluster
        # None, of a scheduler that others started.
        most = _SIZES[cluster][1] if cluster in _SIZES else 0
        if not most or len(cluster.worker_spec) >= most:
            return
        of_queue = not isinstance(cluster, LocalCluster)
        processes = max((len(spec.get("group", [""])) for spec in cluster.worker_spec.values()), default=1)
        worth_s = _WORTH_A_BATCH_JOB_S * processes if of_queue else _WORTH_A_WORKER_S
        wanted = min(most, math.ceil(work_left_s / worth_s))
        if wanted > len(cluster.worker_spec):
            tell("more workers", there=len(cluster.worker_spec), wanted=wanted)
            cluster.scale(**{"jobs" if of_queue else "n": wanted})

    def shrink(self, processing: Mapping[str, Collection[Any]]) -> None:
        """Let go of workers, or batch jobs, that have had nothing to do for a while, as far as the least allows.

        processing: what each worker has in hand, by its address.
        """
        cluster: Any = self._client.cluster
        spare = len(cluster.worker_spec) - _SIZES[cluster][0] if cluster in _SIZES else 0
        if spare <= 0:
            return
        workers = self._client.scheduler_info(n_workers=-1)["workers"]
        at_rest = {str(listed["name"]) for address, listed in workers.items() if not processing.get(address)}
        now = time.monotonic()
        self._idle = {
            name: self._idle.get(name, now)
            for name, spec in cluster.worker_spec.items()
            if all(f"{name}{suffix}" in at_rest for suffix in spec.get("group", [""]))
        }
        rested = [name for name, since in self._idle.items() if now - since > _IDLE_S][:spare]
        if rested:
            tell("fewer workers", there=len(cluster.worker_spec), let_go=len(rested))
            self._came.difference_update(map(str, rested))
            loop = self._client.loop
            assert loop is not None  # as long as the client is open
            loop.add_callback(cluster.scale_down, rested)  # which waits until they are gone
