"""Estimate of a plan's duration, from a few of its jobs that are timed in a separate process."""

import contextlib
import math
import os
import time
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from toppling.models.errors import InputError
from toppling.models.motions.ensemble import Ensemble
from toppling.models.scene import Scene
from toppling.orchestrator.plan import Plan, expected_s, plan_of
from toppling.orchestrator.processes import assets, pool_of
from toppling.orchestrator.progress import duration
from toppling.orchestrator.rocks_of_run import settlings_of
from toppling.workers.job import Assets, JobSpec, run_job

_TIMED_JOBS = 48
"""Maximum number of timed jobs: it gives the mean cost to some 20 % where jobs take from 1 ms to seconds."""
_TIMED_S = 20.0
"""Time after which no further job is timed, s."""
_LEAST_TIMED = 6
"""Minimum number of timed jobs, if the plan has as many."""
_JOBS_PER_TIMED = 8
"""Number of jobs of a small plan per timed one, so that the estimate costs less than the run."""
_ROCKS_TIMED = 3
"""Number of rocks of an atlas whose jobs are timed."""
_BRIEF_S = 60.0
"""Duration below which no number is given, s: the start of workers takes part of it."""


@dataclass(frozen=True)
class TimeEstimate:
    """Expected cost of a plan."""

    work_s: float  # time of a single worker
    timed: int  # number of timed jobs


def spread(count: int, wanted: int) -> NDArray[np.int64]:
    """Distinct numbers below `count` of which every prefix is evenly spread (multiples of the golden ratio).

    Unlike repeated bisection, the sequence does not resonate with periods of the numbered items.
    """
    golden = (math.sqrt(5.0) - 1.0) / 2.0
    places = np.floor((np.arange(2 * wanted) * golden % 1.0) * count).astype(int)
    return np.array(list(dict.fromkeys(places.tolist()))[:wanted])


def timed_jobs(pending: int) -> int:
    """Number of jobs to time, by the number of pending jobs."""
    return min(_TIMED_JOBS, max(_LEAST_TIMED, pending // _JOBS_PER_TIMED), pending)


def sampled_rows(planned: Plan) -> NDArray[np.int64]:
    """Rows to time; every prefix has about the distribution of levels and durations of all jobs."""
    level, duration = planned.jobs["pga_m_s2"].to_numpy(), planned.columns["duration_s"]
    # Sorted by level, and within it by duration alternately up and down, so that neighbours are similar throughout.
    turn = np.where(np.unique(level, return_inverse=True)[1] % 2, -1.0, 1.0)
    return np.lexsort((turn * duration, level))[spread(len(planned), timed_jobs(len(planned)))]


def words_of(estimated: TimeEstimate | None, jobs: int, workers: int | None) -> str:
    """Sentence on the expected duration of jobs on some workers, or on the local cores."""
    if estimated is None:
        return f"how long the {jobs:,} jobs take is not known: those that were timed ended this machine's process"
    count = workers or os.cpu_count() or 1
    if (wall_s := estimated.work_s / count) < _BRIEF_S:
        on = f"on {count} workers" if count > 1 else "on 1 worker"
        return f"{jobs:,} jobs are expected to take less than a minute {on} ({estimated.timed} timed)"
    return (
        f"{jobs:,} jobs are expected to take {duration(estimated.work_s)} of one worker, {duration(wall_s)} on {count} "
        f"workers like this machine's cores ({estimated.timed} timed)"
    )


def estimate(planned: Plan) -> TimeEstimate | None:
    """Time some jobs of a plan (for an atlas, of a few rocks), and extrapolate to all.

    Returns TimeEstimate or None: None where there are no jobs, and where they cannot be done here.
    """
    if planned.campaign.sites:
        return _by_few_rocks(planned)
    if not len(planned):
        return None
    assets_here = Assets(Scene.load(planned.campaign.scene), Ensemble.load(planned.campaign.ensemble))
    chosen = sampled_rows(planned)
    cost_s: list[float] = []
    try:
        with pool_of(1, assets_here) as pool:
            # The first job includes computations done once per process, and is timed again.
            pool.submit(_timed_s, planned.spec(int(chosen[0]))).result()
            end = time.monotonic() + _TIMED_S
            for row in chosen:
                cost_s.append(pool.submit(_timed_s, planned.spec(int(row))).result())
                if time.monotonic() > end:
                    break
    except BrokenProcessPool:
        return None
    # The cost of jobs is about proportional to the durations of records, which corrects a biased sample.
    duration_s = planned.columns["duration_s"]
    timed_s = duration_s[chosen[: len(cost_s)]]
    longer, sampled = (expected_s(float(of.mean()), 1) for of in (duration_s, timed_s))
    return TimeEstimate(float(np.mean(cost_s)) * len(planned) * longer / sampled, len(cost_s))


def _by_few_rocks(planned: Plan) -> TimeEstimate | None:
    found = []
    for number in spread(len(planned.scenes), _ROCKS_TIMED):
        alone = plan_of(planned.scenes[number].campaign)
        with contextlib.suppress(InputError):  # jobs of a rock that does not stand cost nothing
            settlings_of(alone)[0].checked()
            if (estimated := estimate(alone)) is not None:
                found.append((estimated, len(alone)))
    if not found:
        return None
    job_s = sum(estimated.work_s for estimated, _ in found) / sum(jobs for _, jobs in found)
    return TimeEstimate(job_s * len(planned), sum(estimated.timed for estimated, _ in found))


def _timed_s(spec: JobSpec) -> float:
    began = time.perf_counter()
    with contextlib.suppress(Exception):  # a failing job has a cost too
        run_job(spec, *assets())
    return time.perf_counter() - began
