"""The front of speed against error: how often each setting's answers differ from the converged ones, and its cost.

Answers near a threshold are chaotic. The share that flips is therefore read against a floor: the share that flips in
the converged setting when the motion is scaled by 1 + 1e-6.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from itertools import repeat
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.stats import binomtest

from models import Motion, Scene
from models.motions.ensemble import Ensemble
from models.motions.impose import impose
from results.fits import fit
from workers import shake
from workers.presets import PRESETS, Settings

DISTURBED = 1.0 + 1e-6
"""Factor on the motion that measures the floor of chaos."""

CONVERGED = "reference"
"""The preset that the others are compared with."""

EXPLORED = {
    **PRESETS,
    "1/32": replace(PRESETS["fast"], step_share=1 / 32, longest_step_s=np.inf),
    "fast, 10 iterations": replace(PRESETS["fast"], iterations=10),
    "fast, 50 iterations": replace(PRESETS["fast"], iterations=50),
    "fast, all landings": replace(PRESETS["fast"], resolved_landing=1e-3),
    "1/256": replace(PRESETS["standard"], step_share=1 / 256),
}
"""Points of the front: the presets, and what lies beside and between them."""


@dataclass(frozen=True)
class Job:
    """One shake of the comparison."""

    record_id: str
    pga_m_s2: float
    azimuth_deg: float


@dataclass(frozen=True, eq=False)
class Answers:
    """What one setting says to all jobs.

    Parameters
    ----------
    toppled : (n,) bool array
    cpu_s, simulated_s, largest_penetration_share : float
        Cost, time stepped through, and deepest penetration over R.
    """

    toppled: np.ndarray
    cpu_s: float
    simulated_s: float
    largest_penetration_share: float


def draw_jobs(ensemble: Ensemble, count: int, pga_m_s2: tuple[float, float], seed: int = 7) -> list[Job]:
    """Jobs of any record, level and azimuth, uniformly at random."""
    random = np.random.default_rng(seed)
    ids = ensemble.record_ids
    return [
        Job(ids[random.integers(len(ids))], random.uniform(*pga_m_s2), random.uniform(0.0, 360.0))
        for _ in range(count)
    ]


def answers(
    scene: Path,
    ensemble: Path,
    jobs: list[Job],
    settings: Settings,
    *,
    scale: float = 1.0,
    shortcuts: bool = True,
    processes: int = 2,
    seen: Callable[[], None] = lambda: None,
) -> Answers:
    """Shake every job with one setting, in some processes; `seen` is called after each job."""
    rows = []
    with ProcessPoolExecutor(processes, initializer=_load, initargs=(scene, ensemble)) as pool:
        for row in pool.map(_shake, jobs, repeat(settings), repeat(scale), repeat(shortcuts)):
            rows.append(row)
            seen()
    toppled, cost, simulated, depth = zip(*rows, strict=True)
    return Answers(np.array(toppled, bool), float(sum(cost)), float(sum(simulated)), float(max(depth)))


def compare(jobs: list[Job], said: Mapping[str, Answers], converged: Answers) -> pd.DataFrame:
    """One row a setting: flips against the converged answers, their sign test, shift of the median, cost."""
    rows = []
    median = _median(jobs, converged)
    for name, one in said.items():
        up = int((one.toppled & ~converged.toppled).sum())
        down = int((~one.toppled & converged.toppled).sum())
        rows.append(
            {
                "setting": name,
                "flips_share": (up + down) / len(jobs),
                "flips_to_toppled": up,
                "flips_to_standing": down,
                "sign_test_p": binomtest(up, up + down).pvalue if up + down else 1.0,
                "median_shift": _median(jobs, one) / median - 1.0,
                "cpu_s_per_simulated_s": one.cpu_s / one.simulated_s,
                "cpu_s_per_job": one.cpu_s / len(jobs),
                "largest_penetration_share": one.largest_penetration_share,
            }
        )
    return pd.DataFrame(rows)


def _median(jobs: list[Job], said: Answers) -> float:
    """PGA at which one in two topples; NaN where the answers allow no fit."""
    frame = pd.DataFrame(
        {
            "record_id": [job.record_id for job in jobs],
            "pga_m_s2": [job.pga_m_s2 for job in jobs],
            "toppled": said.toppled,
        }
    )
    fragility = fit(frame, ["pga_m_s2"]).lognormal
    return fragility.median if fragility else float("nan")


_ASSETS: list[tuple[Scene, Ensemble]] = []


def _load(scene: Path, ensemble: Path) -> None:
    _ASSETS.append((Scene.load(scene), Ensemble.load(ensemble)))


def _shake(job: Job, settings: Settings, scale: float, shortcuts: bool) -> tuple[bool, float, float, float]:
    scene, ensemble = _ASSETS[0]
    motion = impose(ensemble.record(job.record_id), job.pga_m_s2, job.azimuth_deg).motion
    scaled = Motion(motion.acceleration_m_s2 * scale, motion.time_step_s)
    result = shake(scene, scaled, settings, shortcuts=shortcuts)
    depth = result.penetration_m / scene.rock.half_diagonal_m
    return bool(result.toppled), result.wall_s, result.simulated_s, depth
