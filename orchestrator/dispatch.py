"""Which jobs go out next, and what follows from what came back. Decides; no input, no output, no Dask.

Jobs travel in batches, so that the engine's own work outweighs the cluster's. A batch
whose worker died says only that one of its jobs may be to blame: each is then tried alone, and a job whose workers died
again and again while it ran alone is given up.
"""

import math
from collections import Counter, deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from toppling.models.arrays import Array

FIRST_JOBS = 64
"""In a batch as long as nothing is known of their pace."""

_BATCHES_LEFT_PER_WORKER = 4
"""Batches shrink near the end, so that every worker gets this many of the last ones and none idles."""

_LAST_PER_WORKER = 30
_LAST_SHARE = 0.2
"""So many of the last jobs a worker, at most such a share of all, go out the longest records first.

A long one that began last would keep the others waiting: job times differ by a factor of thirty.
"""


@dataclass(frozen=True)
class Limits:
    """When a job is given up."""

    # Wall time that no job needs: a worker that takes longer is taken to hang, and is replaced.
    job_s: float = 300.0
    # Deaths of a worker under one job that runs alone. Bad luck, such as a node taken away, hardly strikes
    # one job so often; one that crashes the engine always does. More cost time where workers are often taken
    # away.
    tries: int = 3


USUAL_LIMITS = Limits()


def why_given_up(limits: Limits, hung: int) -> tuple[str, str]:
    """Status and message of a job whose worker hung in so many of its lone tries, and died in the others."""
    slow, tries = f"took more than {limits.job_s:g} s", limits.tries
    if hung == tries:
        return "timeout", f"{slow} in each of {tries} lone tries"
    if not hung:
        return "crashed", f"its worker process died in each of {tries} lone tries"
    return "crashed", f"of {tries} lone tries {tries - hung} ended with its worker's death, {hung} {slow}"


@dataclass(frozen=True)
class Batch:
    """Jobs that go to a worker together."""

    jobs: tuple[int, ...]  # rows of the plan
    attempt: int = 1  # 1, or more for a job that is tried alone after its worker died
    alone: bool = False  # whether it is a suspect's lone try


class Dispatch:
    """The jobs that are still to be handed out.

    pending: (n,), rows of the plan, in the order to start them.
    duration_s: (m,), of the record of every row of the plan.
    tries: deaths of a worker under one lone job before the job is given up.
    scene: (m,), number of the scene of every row of the plan, where there are several: a batch is of one of them.
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
        self.hung: Counter[int] = Counter()  # of a job's deaths those of a worker that hung
        self._waiting = len(pending)
        self._duration_s = duration_s
        self._last = int(_LAST_SHARE * len(pending))  # of them as yet in the order given

    def __len__(self) -> int:
        """Jobs that are not handed out now."""
        return self._waiting + len(self._suspects)

    def next_batch(self, workers: int, room: int = FIRST_JOBS) -> Batch | None:
        """Hand out the next batch, or None if nothing waits.

        workers: of the cluster.
        room: jobs that the time budget of a batch leaves room for, as far as known.
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
        """Take back the jobs of a batch beyond the first `done`, which its time budget left no room for."""
        rest = np.array(batch.jobs[done:], np.int64)
        if not len(rest):
            return
        if batch.alone:
            self._suspects.append(int(rest[0]))
        else:
            self._segments.appendleft(rest)
            self._waiting += len(rest)

    def died(self, batch: Batch, *, hung: bool = False) -> int | None:
        """Take note that a batch cost its worker; returns the job that is thereby given up, if any."""
        for job in batch.jobs:
            self._attempts[job] = batch.attempt + 1
        if batch.alone:
            (job,) = batch.jobs
            self._deaths[job] += 1
            self.hung[job] += hung
            if self._deaths[job] >= self._tries:
                return job
        self._suspects.extend(batch.jobs)
        return None
