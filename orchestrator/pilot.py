"""Trial jobs: the levels at which a rock topples, the cost of a job, and a plan's duration."""

import contextlib
import math
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from toppling.models.frames import STANDARD_GRAVITY_M_S2
from toppling.models.motions.ensemble import Ensemble
from toppling.models.scene import Scene
from toppling.orchestrator.plan import Plan, expected_s
from toppling.orchestrator.rocks_of_run import AZIMUTHS_DEG, Settlings
from toppling.orchestrator.terminal import duration
from toppling.workers.job import Assets, JobSpec, run_job
from toppling.workers.seating import settled

RECORDS = 10
"""Number of trial records: enough for an estimate, few enough to wait for."""
_MOST_FRACTION = 0.8
"""Fraction of the trial records that must topple the rock before trials end."""
_GROWTH = 1.35
"""Ratio of successive trial levels."""
_HIGHEST_OVER_LEAST = 4.0
"""Maximum trial level in multiples of the least static acceleration, of a squat rock; of others twice gravity."""


@dataclass(frozen=True)
class Statics:
    """Least constant ground acceleration that tips a settled rock, with its azimuth, and that slides it before."""

    least_m_s2: float
    azimuth_deg: float
    slides_m_s2: float = math.inf  # of all azimuths the least; infinite where it tips toward each


@dataclass(frozen=True)
class Pilot:
    """Results of trial jobs."""

    # Lowest trial level at which each record toppled the rock; infinite where none did.
    topples_at_m_s2: tuple[float, ...]
    highest_m_s2: float  # highest trial level
    job_s: float  # expected cost of a job of the whole ensemble on one core

    @property
    def toppled(self) -> int:
        """Number of records that toppled the rock."""
        return sum(map(math.isfinite, self.topples_at_m_s2))

    @property
    def most_at_m_s2(self) -> float:
        """Level at which most records had toppled it, or the highest trial level."""
        wanted = math.ceil(_MOST_FRACTION * len(self.topples_at_m_s2))
        return min(sorted(self.topples_at_m_s2)[wanted - 1], self.highest_m_s2)


def statics_of(scene: Scene) -> Statics:
    """Statics of the settled rock; infinite where no constant acceleration topples it."""
    found = settled(scene).statics(AZIMUTHS_DEG)
    weakest = min(found, key=lambda row: row.tips_m_s2)
    slides_m_s2 = min(row.slides_m_s2 for row in found)
    return Statics(weakest.tips_m_s2, weakest.ground_accelerates_toward_deg, slides_m_s2)


def _spread_records(ensemble: Ensemble, count: int) -> list[str]:
    """Select `count` records, evenly spaced in the ranks of PGV/PGA, from short to long pulses."""
    table = ensemble.catalog.sort_by([("pgv_pga_s", "ascending"), ("record_id", "ascending")])
    ids = table["record_id"].to_pylist()
    count = min(count, len(ids))
    return [ids[int((rank + 0.5) * len(ids) / count)] for rank in range(count)]


def levels_to_try(least_m_s2: float) -> list[float]:
    """Trial levels, from above the least static acceleration to the maximum."""
    highest = max(2.0 * STANDARD_GRAVITY_M_S2, _HIGHEST_OVER_LEAST * least_m_s2)
    count = int(math.log(highest / least_m_s2) / math.log(_GROWTH))
    return [*(least_m_s2 * _GROWTH**step for step in range(1, count + 1)), highest]


def try_out(
    scene: Scene,
    ensemble: Ensemble,
    least_m_s2: float,
    azimuths_deg: Sequence[float],
    friction: tuple[float, float],
    preset: str,
    advance: Callable[[], object] = lambda: None,
) -> Pilot:
    """Shake a rock with a few records at increasing levels until most of them topple it.

    least_m_s2: level below the first trial level.
    azimuths_deg: azimuths, one per record in turn.
    friction: static and kinetic.
    advance: called after each job.
    """
    assets = Assets(scene, ensemble)
    records = _spread_records(ensemble, RECORDS)
    duration = dict(
        zip(*(ensemble.catalog[name].to_pylist() for name in ("record_id", "duration_s")), strict=True)
    )
    topples_at = dict.fromkeys(records, math.inf)
    spent_s, motion_s, jobs, level = 0.0, 0.0, 0, least_m_s2

    def topples(number: int, record: str, level_m_s2: float) -> bool:
        azimuth_deg = azimuths_deg[number % len(azimuths_deg)]
        sha = ensemble.sha(record)
        spec = JobSpec(scene.id, record, sha, level_m_s2, azimuth_deg, *friction, 0.0, 0, preset)
        return run_job(spec, assets)["toppled"] is True

    topples(0, records[0], least_m_s2)  # includes computations done once
    for level in levels_to_try(least_m_s2):
        for number, record in enumerate(records):
            if topples_at[record] < math.inf:
                continue
            began_s = time.perf_counter()
            if topples(number, record, level):
                topples_at[record] = level
            spent_s += time.perf_counter() - began_s
            motion_s += duration[record]
            jobs += 1
            advance()
        if sum(map(math.isfinite, topples_at.values())) >= _MOST_FRACTION * len(records):
            break
    mean_s = float(np.mean([*duration.values()]))
    return Pilot(
        tuple(topples_at.values()), level, spent_s * expected_s(mean_s, 1) / expected_s(motion_s, jobs))  # fmt: skip


_TIMED_JOBS = 48
"""Maximum number of timed jobs: it gives the mean cost to some 20 % where jobs take from 1 ms to seconds."""
_TIMED_S = 20.0
"""Time after which no further job is timed, s."""
_ROCKS_TIMED = 3
"""Number of rocks of an atlas whose jobs are timed."""
_BRIEF_S = 60.0
"""Duration below which no number is given, s: the start of workers takes part of it."""


@dataclass(frozen=True)
class TimeEstimate:
    """Expected cost of a plan."""

    work_s: float  # time of a single worker
    timed: int  # number of timed jobs


def timed_jobs(pending: int) -> int:
    """Number of jobs to time, by the number of pending jobs: the root, so that it costs less than the run."""
    return min(_TIMED_JOBS, math.isqrt(pending))


def words_of(estimated: TimeEstimate | None, jobs: int) -> str:
    """Sentence on the expected duration of jobs on one worker and on the local cores."""
    if estimated is None:
        return f"how long the {jobs:,} jobs take is not known: none could be timed"
    count = os.cpu_count() or 1
    if (wall_s := estimated.work_s / count) < _BRIEF_S:
        on = f"on {count} workers" if count > 1 else "on 1 worker"
        return f"{jobs:,} jobs are expected to take less than a minute {on} ({estimated.timed} timed)"
    return (
        f"{jobs:,} jobs are expected to take {duration(estimated.work_s)} of one worker, {duration(wall_s)} on {count} "
        f"workers like this machine's cores ({estimated.timed} timed)"
    )


def estimate(planned: Plan) -> TimeEstimate | None:
    """Time some jobs of a plan (of an atlas, of a few rocks), and extrapolate to all; None where none can be timed."""
    timed: list[int] = []
    cost_s: list[float] = []
    every = math.ceil(len(planned.scenes) / _ROCKS_TIMED)
    for number, scene in [*enumerate(planned.scenes)][::every]:
        rows = planned.order[planned.columns["scene_id"][planned.order] == number]
        rock = Scene.load(scene.campaign.scene)
        if not len(rows) or Settlings.of(scene.campaign, rock).problems:
            continue  # jobs of a rock that does not stand cost nothing
        assets = Assets(rock, Ensemble.load(scene.campaign.ensemble))
        chosen = rows[: timed_jobs(len(rows))].tolist()  # every beginning of the order is a balanced sample
        _timed_s(planned.spec(chosen[0]), assets)  # includes computations done once, and is timed again
        end = time.monotonic() + _TIMED_S
        for row in chosen:
            cost_s.append(_timed_s(planned.spec(row), assets))
            timed.append(row)
            if time.monotonic() > end:
                break
    if not timed:
        return None
    # The cost of jobs is about proportional to the durations of records, which corrects a biased sample.
    duration_s = planned.columns["duration_s"]
    longer, sampled = (expected_s(float(of.mean()), 1) for of in (duration_s, duration_s[timed]))
    return TimeEstimate(float(np.mean(cost_s)) * len(planned) * longer / sampled, len(timed))


def _timed_s(spec: JobSpec, assets: Assets) -> float:
    began = time.perf_counter()
    with contextlib.suppress(Exception):  # a failing job has a cost too
        run_job(spec, assets)
    return time.perf_counter() - began
