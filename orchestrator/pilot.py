"""A few jobs shaken beforehand: from which level on a rock topples, and what a job costs."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from toppling.models.motions.ensemble import Ensemble
from toppling.models.scene import Scene
from toppling.orchestrator.plan import expected_s
from toppling.workers.job import Assets, JobSpec, run_job
from toppling.workers.seating import settled

_AZIMUTH_STEP_DEG = 10
RECORDS = 10
"""Enough to see where most topple, few enough to wait for."""

_MOST_SHARE = 0.8
_GROWTH = 1.35
"""Ratio of a level to the one below."""

_HIGHEST_M_S2, _HIGHEST_OVER_LEAST = 20.0, 4.0
"""Levels end at the first, twice gravity, or for a squat rock at so many times its least static acceleration."""


@dataclass(frozen=True)
class Statics:
    """The least constant ground acceleration that topples a rock as it stands, and the azimuth of it."""

    least_m_s2: float
    azimuth_deg: float


@dataclass(frozen=True)
class Pilot:
    """What a few jobs tell."""

    # For each record the least level tried at which it toppled the rock; infinite where none did.
    topples_at_m_s2: tuple[float, ...]
    highest_m_s2: float  # highest level tried
    job_s: float  # what a job of the whole ensemble is expected to cost on one core

    @property
    def toppled(self) -> int:
        """Records that toppled the rock."""
        return sum(map(math.isfinite, self.topples_at_m_s2))

    @property
    def most_at_m_s2(self) -> float:
        """Level at which most records had toppled it, or the highest that was tried."""
        wanted = math.ceil(_MOST_SHARE * len(self.topples_at_m_s2))
        return min(sorted(self.topples_at_m_s2)[wanted - 1], self.highest_m_s2)


def statics_of(scene: Scene) -> Statics:
    """Statics of the rock as it stands once it has settled; infinite where nothing topples it."""
    stands = settled(scene)
    azimuths = range(0, 360, _AZIMUTH_STEP_DEG)
    found = stands.quasi_static_toppling_m_s2(azimuths)
    azimuth_deg, least_m_s2 = min(found, key=lambda pair: pair[1])
    return Statics(least_m_s2, azimuth_deg)


def spread_records(ensemble: Ensemble, count: int) -> list[str]:
    """So many records, evenly over the ranks of PGV/PGA: from the shortest pulses to the longest."""
    table = ensemble.catalog.sort_by([("pgv_pga_s", "ascending"), ("record_id", "ascending")])
    ids = table["record_id"].to_pylist()
    count = min(count, len(ids))
    return [ids[int((rank + 0.5) * len(ids) / count)] for rank in range(count)]


def levels_to_try(least_m_s2: float) -> list[float]:
    """Levels from the least static acceleration up."""
    highest = max(_HIGHEST_M_S2, _HIGHEST_OVER_LEAST * least_m_s2)
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
    """Shake a few records harder and harder until most of them topple the rock.

    least_m_s2: level below the first one.
    azimuths_deg: each record has one of them.
    friction: static and kinetic.
    advance: called after each job.
    """
    assets = Assets(scene, ensemble)
    records = spread_records(ensemble, RECORDS)
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

    topples(0, records[0], least_m_s2)  # pays for what is computed once
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
        if sum(map(math.isfinite, topples_at.values())) >= _MOST_SHARE * len(records):
            break
    mean_s = float(np.mean([*duration.values()]))
    return Pilot(
        tuple(topples_at.values()), level, spent_s * expected_s(mean_s, 1) / expected_s(motion_s, jobs))  # fmt: skip
