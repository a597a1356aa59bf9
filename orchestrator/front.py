"""The front of speed against error: how often each setting's answers differ from the converged ones, and its cost.

Answers near a threshold are chaotic. The share that flips is therefore read against a floor: the share that flips in
the converged setting when the rock starts a millionth of its height above where it rests.
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

from models import Scene
from models.motions.ensemble import Ensemble
from models.motions.impose import impose
from results.fits import fit
from workers import shake
from workers.presets import PRESETS, Settings
from workers.shake import State, settled

RAISED_SHARE = 1e-6
"""Of its height, by which the rock is raised at the start to measure the floor of chaos."""

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
    disturbed: bool = False,
    shortcuts: bool = True,
    processes: int = 2,
    seen: Callable[[], None] = lambda: None,
) -> Answers:
    """Shake every job with one setting, in some processes; `seen` is called after each job.

    Where `disturbed`, the rock starts as :func:`raised` says.
    """
    rows = []
    with ProcessPoolExecutor(processes, initializer=_load, initargs=(scene, ensemble)) as pool:
        for row in pool.map(_shake, jobs, repeat(settings), repeat(disturbed), repeat(shortcuts)):
            rows.append(row)
            seen()
    toppled, cost, simulated, depth = zip(*rows, strict=True)
    return Answers(np.array(toppled, bool), float(sum(cost)), float(sum(simulated)), float(max(depth)))


def raised(scene: Scene) -> State:
    """The rock of a settled scene a millionth of its height above where it rests."""
    return State(position_m=scene.rock.com_m + np.array([0.0, 0.0, RAISED_SHARE * scene.rock.height_m]))


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
    _ASSETS.append((settled(Scene.load(scene)), Ensemble.load(ensemble)))


def _shake(
    job: Job, settings: Settings, disturbed: bool, shortcuts: bool
) -> tuple[bool, float, float, float]:
    scene, ensemble = _ASSETS[0]
    motion = impose(ensemble.record(job.record_id), job.pga_m_s2, job.azimuth_deg).motion
    start = raised(scene) if disturbed else None
    result = shake(scene, motion, settings, shortcuts=shortcuts, initial=start)
    depth = result.penetration_m / scene.rock.half_diagonal_m
    return bool(result.toppled), result.wall_s, result.simulated_s, depth
