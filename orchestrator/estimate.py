"""How long a plan will take: a few of its jobs are done beforehand, in a process of their own, and timed."""

from __future__ import annotations

import contextlib
import math
import os
import time
from collections.abc import Callable
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from toppling.models.errors import InputError
from toppling.models.motions.ensemble import Ensemble
from toppling.models.scene import Scene
from toppling.orchestrator.plan import Plan, expected_s, plan
from toppling.orchestrator.processes import assets, pool_of
from toppling.orchestrator.progress import duration
from toppling.orchestrator.rocks_of_run import Settlings
from toppling.workers.job import Assets, JobSpec, run_job

_TIMED_JOBS = 48
"""At most; of a campaign like the study's, whose jobs cost from a thousandth of a second to seconds, their mean is
known to some 20 %."""

_TIMED_S = 20.0
"""Time for them, beyond which no other one is begun."""

_LEAST_TIMED = 6
"""Of a plan of fewer jobs all."""

_TIMED_SHARE = 8
"""Of a smaller plan one in so many jobs is timed: an estimate must not cost as much as the run."""

_ROCKS_TIMED = 3
"""Of an atlas."""

_BRIEF_S = 60.0
"""Of less than this no seconds are told: workers take some to start."""


@dataclass(frozen=True)
class TimeEstimate:
    """What a plan is expected to take."""

    work_s: float  # of one worker that does all of it
    timed: int  # jobs that it is known from

    def wall_s(self, workers: int) -> float:
        """Time on so many workers."""
        return self.work_s / workers

    def words(self, jobs: int, workers: int | None) -> str:
        """Say it; of the cores here unless a number of workers is given."""
        count = workers or os.cpu_count() or 1
        if self.wall_s(count) < _BRIEF_S:
            on = f"on {count} workers" if count > 1 else "on 1 worker"
            return f"{jobs:,} jobs are expected to take less than a minute {on} ({self.timed} timed)"
        here = f"{duration(self.wall_s(count))} on {count} workers like this machine's cores"
        return f"{jobs:,} jobs are expected to take {duration(self.work_s)} of one worker, {here} ({self.timed} timed)"


def _spread(count: int, wanted: int) -> NDArray[np.int64]:
    """Numbers below a count, each once, of which every beginning is spread evenly: multiples of the golden ratio.

    In step with no period that the numbers may have, as halves of halves would be.
    """
    golden = (math.sqrt(5.0) - 1.0) / 2.0
    places = np.floor((np.arange(2 * wanted) * golden % 1.0) * count).astype(int)
    return np.array(list(dict.fromkeys(places.tolist()))[:wanted])


def _timed_jobs(pending: int) -> int:
    """Jobs to time of so many that are pending."""
    return min(_TIMED_JOBS, max(_LEAST_TIMED, pending // _TIMED_SHARE), pending)


def _sampled_rows(planned: Plan, pending: NDArray[np.int64]) -> NDArray[np.int64]:
    """Rows to time, of which each beginning holds levels and durations in the shares that all pending jobs have."""
    level = planned.jobs["pga_m_s2"].to_numpy()[pending]
    duration = planned.columns["duration_s"][pending]
    # By level, within each by duration there and back, so that neighbours are alike across the levels too.
    turn = np.where(np.unique(level, return_inverse=True)[1] % 2, -1.0, 1.0)
    return pending[np.lexsort((turn * duration, level))][_spread(len(pending), _timed_jobs(len(pending)))]


def words_of(estimated: TimeEstimate | None, jobs: int, workers: int | None) -> str:
    """How long jobs are expected to take, or why that is not known."""
    if estimated is not None:
        return estimated.words(jobs, workers)
    return f"how long the {jobs:,} jobs take is not known: those that were timed ended this machine's process"


def estimate(
    planned: Plan,
    scene: Scene,
    ensemble: Ensemble,
    pending: NDArray[np.int64] | None = None,
    advance: Callable[[], None] = lambda: None,
) -> TimeEstimate | None:
    """Time some jobs of a plan and say what all cost.

    scene, ensemble: the plan's.
    pending: (n,), rows of the jobs that are left; all unless given.
    advance: called for each job that was timed.
    Returns TimeEstimate or None: None where nothing is pending, and where jobs cannot be done here.
    """
    rows = np.arange(len(planned)) if pending is None else pending
    if not len(rows):
        return None
    chosen = _sampled_rows(planned, rows)
    cost_s: list[float] = []
    timed_rows: list[int] = []
    try:
        with pool_of(1, Assets(scene, ensemble)) as pool:
            # The first one also pays for what is computed once in a process, and is timed again.
            pool.submit(_timed_s, planned.spec(int(chosen[0]))).result()
            end = time.monotonic() + _TIMED_S
            for row in chosen:
                cost_s.append(pool.submit(_timed_s, planned.spec(int(row))).result())
                timed_rows.append(int(row))
                advance()
                if time.monotonic() > end:
                    break
    except BrokenProcessPool:
        return None
    # Jobs cost about as their records last: a sample of long records is not taken for all.
    duration_s = planned.columns["duration_s"]
    longer, sampled = (expected_s(float(duration_s[of].mean()), 1) for of in (rows, timed_rows))
    return TimeEstimate(float(np.mean(cost_s)) * len(rows) * longer / sampled, len(cost_s))


def estimate_atlas(planned: Plan) -> TimeEstimate | None:
    """The same of many rocks, by the jobs of a few of them."""
    found = []
    for number in _spread(len(planned.scenes), _ROCKS_TIMED):
        campaign = planned.scenes[number].campaign
        scene, ensemble = Scene.load(campaign.scene), Ensemble.load(campaign.ensemble)
        alone = plan(campaign, scene, ensemble)
        with contextlib.suppress(InputError):  # a rock that does not stand costs nothing
            Settlings.of(campaign, scene).checked()
            if (estimated := estimate(alone, scene, ensemble)) is not None:
                found.append((estimated, len(alone)))
    if not found:
        return None
    job_s = sum(estimated.work_s for estimated, _ in found) / sum(jobs for _, jobs in found)
    return TimeEstimate(job_s * len(planned), sum(estimated.timed for estimated, _ in found))


def _timed_s(spec: JobSpec) -> float:
    began = time.perf_counter()
    with contextlib.suppress(Exception):  # a job that fails is a row of the run, and costs what it costs
        run_job(spec, *assets())
    return time.perf_counter() - began
