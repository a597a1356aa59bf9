"""Scheduling decisions: which jobs to submit next, and how to treat failures. No input, no output, no Dask.

Jobs are submitted in batches, so that computing outweighs the cluster's overhead. If a worker dies, any job of its
batch may be the cause: each is then tried alone, and given up if its workers die repeatedly while it runs alone.
"""

import math
from collections import Counter, deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from toppling.models.arrays import Array

FIRST_JOBS = 64
"""Number of jobs in a batch before their cost is known."""

_BATCHES_LEFT_PER_WORKER = 4
"""Number of batches per worker that the remaining jobs are divided into near the end, so that no worker idles."""

_LAST_PER_WORKER = 30
"""Number of jobs per worker at the end that are sorted by falling duration.

A long job that starts last would delay the end: costs of jobs differ by a factor of thirty.
"""
_LAST_FRACTION = 0.2
"""Maximum fraction of all jobs that are."""


@dataclass(frozen=True)
class Limits:
    """Limits beyond which a job is given up."""

    # Wall time of a job after which its worker counts as hanging, and ends itself.
    job_s: float = 300.0
    # Number of workers that may die under a job that runs alone: a job that crashes the engine always kills its
    # worker, whereas unrelated losses, such as of a node, rarely hit the same job repeatedly.
    tries: int = 3


USUAL_LIMITS = Limits()


@dataclass(frozen=True)
class Batch:
    """Jobs that are sent to a worker together."""

    jobs: tuple[int, ...]  # rows of the plan
    attempt: int = 1  # above 1 for a job that is tried alone after its worker died
    alone: bool = False  # whether it is the lone try of a suspect job


class Dispatch:
    """Queue of the jobs that are still to be submitted.

    pending: (n,), rows of the plan, in the order to start them.
    duration_s: (m,), duration of the record of every row of the plan.
    tries: number of deaths of workers under a lone job before it is given up.
    scene: (m,), index of the scene of every row of the plan, where there are several: a batch has a single scene.
    """

    def __init__(
        self,
        pending: NDArray[np.int64],
        duration_s: Array,
        tries: int = Limits.tries,
        scene: NDArray[np.int64] | None = None,
    ) -> None:
        self._tries = tries
        self._scene = np.zeros(len(duration_s), np.int64) if scene is None else scene
        self._segments = deque([pending] if len(pending) else [])
        self._suspects: deque[int] = deque()
        self._attempts: dict[int, int] = {}
        self._deaths: Counter[int] = Counter()
        self._waiting = len(pending)
        self._duration_s = duration_s
        self._last = int(_LAST_FRACTION * len(pending))  # of them as yet in the order given

    def __len__(self) -> int:
        """Number of jobs that are not submitted."""
        return self._waiting + len(self._suspects)

    def next_batch(self, workers: int, room: int = FIRST_JOBS) -> Batch | None:
        """Next batch, or None if no job is waiting.

        workers: number of workers of the cluster.
        room: estimated number of jobs within the time budget of a batch.
        """
        if self._suspects:
            job = self._suspects.popleft()
            return Batch((job,), self._attempts[job], alone=True)
        if not self._segments:
            return None
        if self._waiting <= min(self._last, _LAST_PER_WORKER * workers):
            left = np.concatenate(list(self._segments))
            self._segments = deque([left[np.lexsort((-self._duration_s[left], self._scene[left]))]])
            self._last = 0  # the longest records first
        segment = self._segments.popleft()
        size = min(room, math.ceil(self._waiting / (_BATCHES_LEFT_PER_WORKER * max(workers, 1))))
        elsewhere = np.flatnonzero(self._scene[segment[:size]] != self._scene[segment[0]])
        size = int(elsewhere[0]) if len(elsewhere) else size
        if size < len(segment):
            self._segments.appendleft(segment[size:])
        taken = segment[:size]
        self._waiting -= len(taken)
        return Batch(tuple(map(int, taken)))

    def came_back(self, batch: Batch, done: int) -> None:
        """Requeue the jobs of a batch beyond the first `done`, which did not fit its time budget."""
        rest = np.array(batch.jobs[done:], np.int64)
        if not len(rest):
            return
        if batch.alone:
            self._suspects.append(int(rest[0]))
        else:
            self._segments.appendleft(rest)
            self._waiting += len(rest)

    def died(self, batch: Batch) -> int | None:
        """Record that a batch's worker died; returns the job that is thereby given up, if any."""
        for job in batch.jobs:
            self._attempts[job] = batch.attempt + 1
        if batch.alone:
            (job,) = batch.jobs
            self._deaths[job] += 1
            if self._deaths[job] >= self._tries:
                return job
        self._suspects.extend(batch.jobs)
        return None
