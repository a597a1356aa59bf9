"""How long a plan will take: a few of its jobs are done beforehand, in a process of their own, and timed."""

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


def spread(count: int, wanted: int) -> NDArray[np.int64]:
    """Numbers below a count, each once, of which every beginning is spread evenly: multiples of the golden ratio.

    In step with no period that the numbers may have, as halves of halves would be.
    """
    golden = (math.sqrt(5.0) - 1.0) / 2.0
    places = np.floor((np.arange(2 * wanted) * golden % 1.0) * count).astype(int)
    return np.array(list(dict.fromkeys(places.tolist()))[:wanted])


def timed_jobs(pending: int) -> int:
    """Jobs to time of so many that are pending."""
    return min(_TIMED_JOBS, max(_LEAST_TIMED, pending // _TIMED_SHARE), pending)


def sampled_rows(planned: Plan) -> NDArray[np.int64]:
    """Rows to time, of which each beginning holds levels and durations in the shares that all jobs have."""
    level, duration = planned.jobs["pga_m_s2"].to_numpy(), planned.columns["duration_s"]
    # By level, within each by duration there and back, so that neighbours are alike across the levels too.
    turn = np.where(np.unique(level, return_inverse=True)[1] % 2, -1.0, 1.0)
    return np.lexsort((turn * duration, level))[spread(len(planned), timed_jobs(len(planned)))]


def words_of(estimated: TimeEstimate | None, jobs: int, workers: int | None) -> str:
    """How long jobs are expected to take on so many workers, or on the cores here; or that it is not known."""
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
    """Time some jobs of a plan, of many rocks those of a few, and say what all cost.

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
            # The first one also pays for what is computed once in a process, and is timed again.
            pool.submit(_timed_s, planned.spec(int(chosen[0]))).result()
            end = time.monotonic() + _TIMED_S
            for row in chosen:
                cost_s.append(pool.submit(_timed_s, planned.spec(int(row))).result())
                if time.monotonic() > end:
                    break
    except BrokenProcessPool:
        return None
    # Jobs cost about as their records last: a sample of long records is not taken for all.
    duration_s = planned.columns["duration_s"]
    timed_s = duration_s[chosen[: len(cost_s)]]
    longer, sampled = (expected_s(float(of.mean()), 1) for of in (duration_s, timed_s))
    return TimeEstimate(float(np.mean(cost_s)) * len(planned) * longer / sampled, len(cost_s))


def _by_few_rocks(planned: Plan) -> TimeEstimate | None:
    found = []
    for number in spread(len(planned.scenes), _ROCKS_TIMED):
        alone = plan_of(planned.scenes[number].campaign)
        with contextlib.suppress(InputError):  # a rock that does not stand costs nothing
            settlings_of(alone)[0].checked()
            if (estimated := estimate(alone)) is not None:
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
