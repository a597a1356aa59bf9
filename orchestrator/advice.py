"""Advice on a campaign: trial jobs for its levels and cost, warnings before it runs, suggestions after it."""

import contextlib
import math
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from toppling.models.errors import counted
from toppling.models.files.documents import listed
from toppling.models.frames import STANDARD_GRAVITY_M_S2, quadrant_of
from toppling.models.hidden_base.intervals import median_width
from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.quality import LIMITS_WORDS, is_beyond, words
from toppling.models.pedestal import ContactProperties
from toppling.models.scene import Scene
from toppling.orchestrator.campaign import Campaign
from toppling.orchestrator.plan import Plan, expected_s
from toppling.orchestrator.rocks_of_run import AZIMUTHS_DEG, Settlings
from toppling.orchestrator.status import LevelCount
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


_LARGEST_FRICTION = 1.5
"""Friction coefficient of rock on rock above which a value is more likely an angle in degrees."""
_G_AT_MOST = 1.5
"""Level below which all levels are more likely in g than in m/s²."""
REALISATIONS = 25
"""Recommended number of realisations of a rock with drawn bases: the nominal base and enough others for a spread."""
HARDLY_FRACTION = 0.05
"""Maximum fraction toppled at the lowest level for levels to cover the transition."""
MOSTLY_FRACTION = 0.5
"""Minimum fraction toppled at the highest."""
_LEAST_WITHIN = 3
"""Minimum number of levels within the transition that resolves it."""


def warnings_of(campaign: Campaign, scene: Scene) -> list[str]:
    """Probable mistakes in a campaign that is formally valid.

    Examples
    --------
    >>> from pathlib import Path
    >>> from toppling import Scene
    >>> axes = {"pga_m_s2": [0.2, 0.9], "azimuth_deg": [0], "friction": [35]}
    >>> slips = Campaign.of({"scene": "s", "ensemble": "e", **axes}, Path("."))
    >>> for sentence in warnings_of(slips, Scene.block(0.2, 0.2, 0.6)):
    ...     print(sentence)
    friction 35 is above 1.5: is it in degrees? tan(35°) is 0.7
    all levels are below 1.5 m/s2: are they in g? 0.9 g is 8.83 m/s2
    """
    found = []
    for static, _ in campaign.friction:
        if static > _LARGEST_FRICTION:
            angle = f": is it in degrees? tan({static:g}°) is {math.tan(math.radians(static)):.2g}"
            usual = ": rock on rock has 0.6 to 1.0"
            found.append(
                f"friction {static:g} is above {_LARGEST_FRICTION:g}{angle if 10 <= static < 80 else usual}"
            )
    if scene.unseen is not None and campaign.first_realisation == 0 and campaign.realisations == 1:
        found.append(
            f"only one of the rock's possible bases is shaken, but the base is hidden; {_width_sentence(scene)}"
            f"'realisations = {REALISATIONS}' spreads the jobs over others too"
        )
    statics = statics_of(scene.with_contact(ContactProperties.of(campaign.friction[0])))
    return found + _of_statics(campaign, statics, scene)


def shaking_warnings(campaign: Campaign, ensemble: Ensemble) -> list[str]:
    """Warning of levels at which scaled records exceed all recorded ground motions; empty if there are none."""
    catalog, chosen = ensemble.catalog, set(campaign.records or ensemble.record_ids)
    used = catalog.filter(pa.array([name in chosen for name in ensemble.record_ids]))
    own, pgv_m_s, pgd_m = (used[name].to_numpy()[:, None] for name in ("pga_m_s2", "pgv_m_s", "pgd_m"))
    levels = np.array(campaign.pga_m_s2 or [np.nan])
    factor = levels / own if campaign.pga_m_s2 else np.ones((len(used), 1))
    pgv_m_s, pgd_m = pgv_m_s * factor, pgd_m * factor
    pgd_m = np.minimum(pgd_m, campaign.peak_displacement_m or np.inf)
    beyond = is_beyond(factor, pgv_m_s, pgd_m)
    if not beyond.any():
        return []
    worst = sorted(zip(-pgv_m_s.max(axis=1), range(len(used)), strict=True))
    names = used["record_id"].to_pylist()
    named = [
        f"{names[row]} ({words(factor[row].max(), -speed, pgd_m[row].max())})"
        for speed, row in worst
        if beyond[row].any()
    ]
    at = f" at {levels.max():g} m/s2" if campaign.pga_m_s2 else ""
    return [
        f"{100 * beyond.mean():.0f} % of the jobs shake beyond what was ever recorded ({LIMITS_WORDS}):"
        f"{at} {listed(named)}; lower levels, stronger records (toppling records select --pga) or those "
        "with less PGV for their PGA avoid it, and the report shows the effect of leaving these jobs out"
    ]


def _width_sentence(scene: Scene) -> str:
    interval = scene.report.get("unseen_base", {}).get("toppling")
    if not interval:
        return ""
    return f"the interval of the toppling acceleration is {100 * median_width(interval):.0f} % of its median wide; "


def _of_statics(campaign: Campaign, statics: Statics, scene: Scene) -> list[str]:
    """Warnings of levels and frictions that do not fit the static toppling acceleration."""
    found, least = [], statics.least_m_s2
    highest = max(campaign.pga_m_s2, default=math.inf)  # no levels: unscaled records
    if highest < min(least, _G_AT_MOST):
        return [  # the next warning would have the same cause
            f"all levels are below {_G_AT_MOST:g} m/s2: are they in g? "
            f"{highest:g} g is {highest * STANDARD_GRAVITY_M_S2:.3g} m/s2"
        ]
    if highest <= least:
        found.append(
            f"all levels are below the least constant acceleration that topples the rock ({least_static(statics)}): "
            "hardly any job will topple it; 'toppling init' writes levels that suit it"
        )
    return found + [
        f"with friction {static:g} the rock slides in every direction before it tips: few jobs will topple it"
        for static, _ in campaign.friction
        if static * scene.gravity_m_s2 < least
    ]


def least_static(statics: Statics) -> str:
    """Describe the least static toppling acceleration with its azimuth, and where the rock slides before it tips."""
    slides = statics.slides_m_s2
    found = f"{statics.least_m_s2:.3g} m/s2, ground toward {quadrant_of(statics.azimuth_deg)}"
    return (
        found
        if math.isinf(slides)
        else f"{found}; toward some azimuths it slides before, from {slides:.3g} m/s2"
    )


def suggestions(levels: Sequence[LevelCount]) -> list[str]:
    """Suggestions for the next campaign from the fractions toppled at each level of a run.

    shares: one per level.

    Examples
    --------
    >>> suggestions([LevelCount(9.0, 78, 0), LevelCount(13.0, 78, 7)])
    ['7 of 156 toppled, 9 % at the highest level: add levels above 13 m/s2']
    """
    rising = sorted((level for level in levels if level.jobs), key=lambda level: level.level_m_s2)
    if not rising:
        return []
    low, high = rising[0], rising[-1]
    jobs, toppled = sum(level.jobs for level in rising), sum(level.toppled for level in rising)
    found = []
    if high.fraction < MOSTLY_FRACTION:
        at = f", {100 * high.fraction:.0f} % at the highest level" if toppled else ""
        found.append(f"{toppled} of {jobs} toppled{at}: add levels above {high.level_m_s2:g} m/s2")
    if low.fraction > HARDLY_FRACTION:
        at = f"{low.toppled} of {low.jobs} toppled at the lowest level"
        found.append(f"{at}: add levels below {low.level_m_s2:g} m/s2")
    within = [level for level in rising if HARDLY_FRACTION < level.fraction < 1.0 - HARDLY_FRACTION]
    if not found and len(within) < _LEAST_WITHIN:
        below = max(level.level_m_s2 for level in rising if level.fraction <= HARDLY_FRACTION)
        above = [level.level_m_s2 for level in rising if level.fraction >= 1.0 - HARDLY_FRACTION]
        top = min(above, default=high.level_m_s2)
        found.append(
            f"the share that topples rises within {counted(len(within), 'level')}: "
            f"add levels between {below:g} and {top:g} m/s2"
        )
    return found
