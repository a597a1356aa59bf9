"""A run's cluster: workers with the client's versions and content, batches and their results, size, replacement."""

import asyncio
import errno
import logging
import math
import queue
import socket
import ssl
import subprocess
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import CancelledError
from contextlib import suppress
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

from distributed import Client, Future, KilledWorker, SpecCluster
from distributed.deploy.adaptive import Adaptive

from toppling.models.errors import InputError
from toppling.orchestrator.context import Answer, RunError
from toppling.orchestrator.delivery import NotDeliveredError, StorageError, pieces
from toppling.orchestrator.dispatch import USUAL_LIMITS
from toppling.orchestrator.interrupt import LOOK_S, POLL_S, held_back
from toppling.orchestrator.leaving import announced_exit, let_leave_in_order
from toppling.orchestrator.local_workers import LocalWorkers
from toppling.orchestrator.task import COMPILING, RunKey, UnfitWorkerError, check, must_compile

log = logging.getLogger(__name__)

LOST = "the connection to the scheduler is lost"
BACK_WITHIN_S = 120.0
"""Time within which a lost external scheduler may be restarted, s."""

_UNREACHABLE = (errno.EHOSTUNREACH, errno.ENETUNREACH, errno.ENETDOWN, errno.EHOSTDOWN, errno.EADDRNOTAVAIL)
_WORTH_A_WORKER_S = 15.0
"""Remaining work that justifies another local process, s: a few times its start."""
_WORTH_A_BATCH_JOB_S = 300.0
"""Remaining work that justifies another batch job, s: a few times its waiting time."""
_ADAPT_PAUSE_S = "3s"
"""Interval between adaptations of the size."""
_IDLE_LOOKS = 10
"""Number of them in which a worker must be idle before it is stopped."""
_LISTED = {"slurm": ("squeue", "--me", "--noheader", "--format=%A")}
"""Commands that list the ids of a user's unfinished batch jobs."""
_BATCH_SYSTEM_S = 30.0
"""Interval between such lists and between resubmissions, and time that a batch system has to answer, s."""
CLOSED = "--no-dashboard --dashboard-address 127.0.0.1:0"
"""Options of a Dask worker without dashboard, which has no authentication."""
_WARN_AFTER_S = 60.0
"""Time without workers before a warning, s."""


def may_be_lost(error: BaseException) -> bool:
    """Whether an error may be due to a lost connection, rather than to files or limits of this machine."""
    if not isinstance(error, OSError):
        return isinstance(error, CancelledError)
    of_network = isinstance(error, ConnectionError | TimeoutError | socket.gaierror | ssl.SSLError)
    return of_network or error.errno is None or error.errno in _UNREACHABLE  # Dask's own have no number


def make_ready(client: Client, *run_keys: RunKey, report: Callable[[str], object] = lambda _: None) -> None:
    """Prepare a cluster for the jobs of runs: :func:`check_workers`, and workers that shut down gracefully.

    A lost external scheduler is awaited at its address.

    Raises InputError, RunError as `check_workers`; RunError also if the scheduler is lost.
    """
    end = None
    while client.status in ("running", "connecting"):
        try:
            if client.status == "running":
                # First, because it reports workers that cannot load the plugin for graceful shutdown.
                check_workers(client, *run_keys, report=report)
                return let_leave_in_order(client)
        except OSError as error:
            if not may_be_lost(error):
                raise
            # A worker that leaves during the check also raises; the client then keeps running.
            log.debug("%s", error)
        if client.cluster is not None and client.status != "running":  # our own scheduler is not restarted
            raise RunError(LOST)
        if end is None:
            end = time.monotonic() + BACK_WITHIN_S
            log.warning("%s: waiting %g s for it to come back", LOST, BACK_WITHIN_S)
        if time.monotonic() > end:
            break
        time.sleep(POLL_S)
    raise RunError(f"{LOST}, and none came back within {BACK_WITHIN_S:g} s")


def check_workers(
    client: Client, *run_keys: RunKey, report: Callable[[str], object] = lambda _: None
) -> None:
    """Let every worker load the assets of the first run key; hosts that lack assets of any key receive them.

    report: receives the activity if workers must compile first.
    Raises InputError if a worker has other versions, or no access to the run's scene and ensemble.
    Raises RunError if the workers of a local cluster repeatedly die at their start.
    """
    _wait_for_a_worker(client)
    if True in client.run(must_compile, on_error="return").values():
        report(COMPILING)
    answers = client.run(check, run_keys[0], on_error="return")
    lacking = {
        worker: NotDeliveredError(answer.host, worker)
        for worker, answer in answers.items()
        if isinstance(answer, NotDeliveredError)
    }
    if lacking:
        problem = deliver(client, lacking.values(), run_keys)
        answers |= client.run(check, run_keys[0], on_error="return", workers=list(lacking))
        answers |= {worker: StorageError(problem) for worker in lacking if problem and worker in answers}
    # A worker that is dying or joining (OSError) is checked by its first task. One without this program cannot
    # deserialise the request, which Dask reports.
    unfit = [
        found for found in answers.values() if isinstance(found, Exception) and not isinstance(found, OSError)
    ]
    if reasons := sorted(set(map(str, unfit))):
        raise InputError(
            "cluster.workers_unfit",
            f"{len(reasons)} of {len(answers)} workers are unfit for this run: " + "; ".join(reasons[:5]),
            where="cluster",
            expected="the client's versions, and a folder in which each host can keep what it is sent",
            remedy="install the same toppling everywhere; name a folder that workers can write with TOPPLING_CACHE",
        )


def deliver(client: Client, lacking: Iterable[NotDeliveredError], run_keys: Iterable[RunKey]) -> str:
    """Send the scenes and ensembles of run keys to one worker of each host that lacks them.

    Returns why a host cannot store them, empty otherwise; raises RunError if they are missing in the run's folder.
    """
    folders: dict[str, Path] = {}
    for key in run_keys:
        folders[key.scene_id] = Path(key.folder) / key.scene_place
        folders[key.ensemble_id] = Path(key.folder) / key.ensemble_place
    if missing := [str(folder) for folder in folders.values() if not folder.is_dir()]:
        raise RunError(f"{missing[0]} is gone: was the run's folder removed or renamed?")
    for worker in {error.host: error.worker or "" for error in lacking}.values():
        for function, *given in pieces(folders):
            try:
                client.run(function, *given, workers=[worker])
            except StorageError as error:
                return str(error)
            except (OSError, ValueError, KeyError):  # the worker has left: another will ask
                break
    return ""


def _wait_for_a_worker(client: Client) -> None:
    """Wait for the first worker, without limit where an external system starts it."""
    supervisor = DaskCluster(client)
    while not client.nthreads():
        with suppress(TimeoutError):
            client.wait_for_workers(1, timeout=LOOK_S)
            return
        supervisor.look(0.0, 0)


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


class DaskCluster:
    """Workers of a client's scheduler, started by this program, which then maintains their number, or externally."""

    def __init__(self, client: Client) -> None:
        self._client, self._cluster = client, client.cluster
        self._came: set[str] = set()  # batch jobs whose workers have joined
        self._ended: set[str] = set()  # batch jobs that left the queue without a worker
        self._listed = -math.inf
        self._in_vain = 0
        self._all_there = self._worked = time.monotonic()
        self._warned = False
        self._futures: dict[str, Future] = {}
        self._answers: queue.SimpleQueue[Answer] = queue.SimpleQueue()

    def look(self, work_left_s: float, at_hand: int) -> None:
        """Adapt the size to the remaining work (of one process) and the batches in flight; resubmit batch jobs.

        Raises RunError if local workers repeatedly die at their start, or batch jobs end before a worker joins.
        """
        if isinstance(self._cluster, LocalWorkers) and (why := self._cluster.fatal):
            raise RunError(f"worker processes die as they start: {why}")
        self._warn_of_absence()
        if adaptive := _ADAPTIVE.get(self._cluster) if isinstance(self._cluster, SpecCluster) else None:
            adaptive.work_left_s, adaptive.at_hand = work_left_s, at_hand
        if not self.ended_jobs():
            self._all_there = time.monotonic()
        elif time.monotonic() - self._all_there > _BATCH_SYSTEM_S:
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

    def ended_jobs(self) -> list[str]:
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
        if command is None or not waiting or time.monotonic() - self._listed < _BATCH_SYSTEM_S:
            return
        self._listed = time.monotonic()
        with suppress(OSError, subprocess.SubprocessError):
            listed = subprocess.run(
                command, capture_output=True, text=True, check=True, timeout=_BATCH_SYSTEM_S
            )
            there = set(listed.stdout.split())
            self._ended = {name for name, number in waiting.items() if number and number not in there}

    def resubmit(self) -> None:
        """Replace batch jobs that have ended, which Dask does not; RunError after repeated failures."""
        cluster: Any = self._cluster
        ended = self.ended_jobs()
        wanted = len(cluster.worker_spec)
        if self._ended >= set(cluster.worker_spec):
            self._in_vain += 1
        if self._in_vain > USUAL_LIMITS.tries:
            raise RunError(
                f"batch jobs ended {self._in_vain} times before a worker came of them; their output says why "
                "(log-directory in jobqueue.yaml, else the folder of this command)"
            )
        self._came.difference_update(ended)  # their names are reused
        self._ended.clear()
        # Dask has already dropped some, which need only be requested again.
        if dropped := [name for name in ended if name in cluster.workers]:
            log.warning("%d batch jobs have ended: as many are submitted again", len(dropped))
            with suppress(TimeoutError):  # repeated at the next look
                self._client.sync(cluster.scale_down, dropped, callback_timeout=_BATCH_SYSTEM_S)
        cluster.scale(jobs=wanted)

    def submit(self, task: Callable[..., Any], calls: Mapping[str, Sequence[Any]]) -> None:
        """Submit calls of a task with their arguments, by keys that were never used before."""
        # In one graph, so that Dask treats them as one group, named by a key's first word.
        futures = self._client.map(
            task, *zip(*calls.values(), strict=True), key=[("shake", key) for key in calls], pure=False
        )
        loop = self._client.loop
        assert loop is not None  # as long as the client is open
        for key, future in zip(calls, futures, strict=True):
            self._futures[key] = future
            loop.add_callback(self._follow, key, future)

    async def _follow(self, key: str, future: Future) -> None:
        try:
            answer = Answer(key, "rows", await self._client.gather(future, asynchronous=True))
        except (asyncio.CancelledError, CancelledError) as error:
            answer = Answer(key, "cancelled", error)
        except Exception as error:
            answer = Answer(key, "error", error)
        self._answers.put(answer)

    def answers(self, timeout_s: float) -> list[Answer]:
        """Available results, after waiting for the first; OSError or CancelledError if the scheduler is lost."""
        found: list[Answer] = []
        with suppress(queue.Empty):
            found.append(self._answers.get(timeout=timeout_s))
            while True:
                found.append(self._answers.get_nowait())
        if self._client.status != "running":
            raise ConnectionError(LOST)
        return [known for answer in found if (known := self._known(answer))]

    def _known(self, answer: Answer) -> Answer | None:
        """Classify the result of a batch; None for a batch that was forgotten."""
        future = self._futures.pop(answer.key, None)
        if future is None:
            return None
        future.release()
        error = answer.value
        if answer.kind == "cancelled":
            if self._client.cluster is None:
                raise CancelledError  # Dask cancels all futures when the scheduler is lost
            return answer
        if answer.kind == "error" and isinstance(error, KilledWorker):
            address = error.last_worker.address
            left = announced_exit(self._client, address)
            return Answer(answer.key, "left" if left else "died", error, address)
        if isinstance(error, NotDeliveredError | UnfitWorkerError):
            kind = "undelivered" if isinstance(error, NotDeliveredError) else "unfit"
            return Answer(answer.key, kind, error, error.worker or "")
        return answer

    def threads(self) -> int:
        """Number of threads of all workers."""
        return sum(self._client.nthreads().values())

    def dismiss(self, worker: str) -> None:
        """Remove a worker from the cluster."""
        self._client.retire_workers([worker], close_workers=True)

    def deliver(self, lacking: NotDeliveredError, run_keys: Sequence[RunKey]) -> str:
        """Send a host the assets of runs; returns why it cannot store them."""
        return deliver(self._client, [lacking], run_keys)

    def rejoin(self, run_keys: Sequence[RunKey], error: BaseException) -> None:
        """Wait for a restarted scheduler, after all submitted work was lost; RunError if there is none."""
        if self._client.cluster is not None:  # a scheduler in this process is not restarted
            raise RunError(LOST) from error
        self._futures.clear()
        make_ready(self._client, *run_keys)

    def cancel(self) -> None:
        """Cancel all submitted work."""
        with held_back():
            if self._futures and self._client.status == "running":
                with suppress(OSError):
                    self._client.cancel(list(self._futures.values()), force=True)
            self._futures.clear()
