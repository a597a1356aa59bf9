"""The front of speed against error: how often each setting's answers differ from the converged ones, and its cost.

Answers near a threshold are chaotic. The share that flips is therefore read against a floor: the share that flips in
the converged setting when the rock's start is disturbed by a millionth of its height.
"""

import hashlib
import logging
import math
import time
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from itertools import repeat
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
from plain_bullet import STEPS_A_SECOND, topples
from scipy.stats import binomtest

from toppling.models.errors import InputError
from toppling.models.files.digest import read_table, write_table
from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.imposing import impose
from toppling.models.scene import Scene
from toppling.results.analysis.lognormal import fit
from toppling.workers.engines import DEFAULT, ENGINES
from toppling.workers.options import PHYSICS_VERSION, PRESETS, NumericalOptions
from toppling.workers.seating import settled
from toppling.workers.shaking import shake
from toppling.workers.start import State

LEAST_TILT_DEG = 0.1
"""Tilts below count as this one: rocks that are hardly lifted would outweigh those that rock."""

log = logging.getLogger(__name__)

_DISTURBED_FRACTION = 1e-6
"""Fraction of the height by which the rock's start is disturbed to measure the floor of chaos."""

_WRITTEN_AT_ONCE = 50
"""Answers written together."""

_GROUPS = 20
"""Maximum number of jobs that are left out in turn."""

CONVERGED = "reference"
"""The preset that the others are compared with."""

_Row = dict[str, object]


@dataclass(frozen=True)
class Job:
    """Shake of the comparison."""

    record_id: str
    pga_m_s2: float
    azimuth_deg: float


@dataclass(frozen=True)
class Setting:
    """Settings with which all jobs are shaken."""

    settings: NumericalOptions
    engine: str = DEFAULT
    shortcuts: bool = True
    # Azimuth toward which the start is disturbed as `_disturbed_start` says; None for a start at rest.
    disturbed_toward_deg: float | None = None
    # Steps a second of PyBullet alone, in place of a preset.
    plain_bullet: int | None = None

    def time_step_s(self, scene: Scene) -> float:
        """Length of a step for the rock of a scene."""
        if self.plain_bullet:
            return 1.0 / self.plain_bullet
        return self.settings.time_step_s(scene.rock.half_diagonal_m, scene.gravity_m_s2)


def settings() -> dict[str, Setting]:
    """Presets of every engine that is installed, and PyBullet alone at several steps, by their names."""
    presets = {name: Setting(found) for name, found in PRESETS.items()}
    presets |= {
        f"plain PyBullet 1/{steps} s": Setting(PRESETS[CONVERGED], plain_bullet=steps)
        for steps in STEPS_A_SECOND
    }
    for engine in ENGINES.values():
        if engine.name != DEFAULT and engine.version is not None:
            presets |= {
                f"{engine.name} {name}": Setting(options, engine.name)
                for name, options in engine.presets.items()
            }
    return presets


def draw_jobs(ensemble: Ensemble, count: int, pga_m_s2: tuple[float, float], seed: int = 7) -> list[Job]:
    """Jobs of any record, level and azimuth, uniformly at random; more of them begin with the same ones."""
    random = np.random.default_rng(seed)
    ids = ensemble.record_ids
    return [
        Job(ids[random.integers(len(ids))], random.uniform(*pga_m_s2), random.uniform(0.0, 360.0))
        for _ in range(count)
    ]


def answers(
    scene: Scene,
    ensemble: Ensemble,
    jobs: list[Job],
    setting: Setting,
    *,
    processes: int = 2,
    advance: Callable[[], None] = lambda: None,
    folder: Path | None = None,
) -> pd.DataFrame:
    """Shake every job with one setting, in some processes; `advance` is called for each job.

    Answers are written to `folder` and taken from there when the same jobs are asked for again: a comparison
    may be interrupted, or grow. Another physics version, scene, ensemble or setting makes another file there.

    Returns pandas.DataFrame: a row a job: its fields, toppled (null without an answer), max_tilt_deg, ended_by,
    processor_s, simulated_s and penetration_share (of R).
    Raises InputError if the rock does not stand.
    """
    stands = settled(scene)  # here, as an error in a process that starts would not reach the user
    name = (PHYSICS_VERSION, scene.id, scene.contact, ensemble.id, setting)
    path = folder / f"{hashlib.sha256(repr(name).encode()).hexdigest()[:16]}.parquet" if folder else None
    rows = _read(path) if path and path.exists() else []
    known = {Job(row["record_id"], row["pga_m_s2"], row["azimuth_deg"]): row for row in rows}
    missing = [job for job in jobs if job not in known]
    for _ in range(len(jobs) - len(missing)):
        advance()
    with ProcessPoolExecutor(processes, initializer=_begin, initargs=(stands, ensemble)) as pool:
        for job, row in zip(missing, pool.map(_shake, missing, repeat(setting)), strict=True):
            known[job] = row
            advance()
            if path and (len(known) % _WRITTEN_AT_ONCE == 0 or job == missing[-1]):
                write_table(pa.Table.from_pandas(_frame(known.values())), path)
    return _frame(known[job] for job in jobs)


def _frame(rows: Iterable[_Row]) -> pd.DataFrame:
    return pd.DataFrame(rows).astype({"toppled": "boolean"})


def _read(path: Path) -> list[dict[Any, Any]]:
    try:
        return read_table(path).to_pandas().to_dict("records")
    except InputError as error:
        log.warning("%s %s: its jobs are done again", path, error.what)
        return []


def _disturbed_start(scene: Scene, toward_deg: float) -> State:
    """The rock of a settled scene raised by a millionth of its height, and tilted by as much (rad) toward an azimuth.

    Raised alone, a block would land flat and go on as if nothing had been.
    """
    up = np.array([0.0, 0.0, _DISTURBED_FRACTION * scene.rock.height_m])
    half, azimuth = 0.5 * _DISTURBED_FRACTION, np.deg2rad(toward_deg)
    turn = (-half * np.sin(azimuth), half * np.cos(azimuth), 0.0, 1.0)  # about the vertical cross the azimuth
    return State(position_m=scene.rock.com_m + up, quaternion_xyzw=turn)


def compare(results: Mapping[str, pd.DataFrame], converged: pd.DataFrame) -> pd.DataFrame:
    """Rows by setting, cheapest first: how far it moves what users ask for, and its cost.

    That is the PGA at which half topple, the share that topples and the tilt of those that stand. Single answers that
    differ from the converged ones say little: near a threshold chaos decides them.

    A setting may have been asked for the first of the jobs only; costs are those of the jobs that all were asked for. A
    job counts where both have an answer. Largest tilts tell a lean with fewer jobs than flips do: the mean of the
    logarithm of their ratio, where both stand.
    """
    rows = []
    shared = min(len(found) for found in results.values())
    for name, asked in results.items():
        answered = (asked.toppled.notna() & converged.toppled.iloc[: len(asked)].notna()).to_numpy()
        found, same = (frame.iloc[: len(asked)][answered] for frame in (asked, converged))
        up = int((found.toppled & ~same.toppled).sum())
        down = int((~found.toppled & same.toppled).sum())
        timed = asked.iloc[:shared]
        share = (up + down) / len(found) if len(found) else math.nan
        stand = ~(found.toppled | same.toppled)
        tilt, tilt_same = (part.max_tilt_deg[stand].clip(lower=LEAST_TILT_DEG) for part in (found, same))
        log_ratio = np.log(tilt / tilt_same)
        rows.append(
            {
                "setting": name,
                "jobs": len(found),
                "no_answer": int((~answered).sum()),
                "flips_share": share,
                "flips_share_std": math.sqrt(share * (1.0 - share) / max(len(found), 1)),
                "flips_to_toppled": up,
                "flips_to_standing": down,
                "sign_test_p": binomtest(up, up + down).pvalue if up + down else 1.0,
                "share_shift": float(found.toppled.mean() - same.toppled.mean()) if len(found) else math.nan,
                "share_shift_std": math.sqrt(max(up + down - (up - down) ** 2 / max(len(found), 1), 0.0))
                / max(len(found), 1),
                "median_shift": _median(found) / _median(same) - 1.0,
                "median_shift_std": _median_shift_std(found, same),
                "tilt_log_ratio": log_ratio.mean(),
                "tilt_log_ratio_std": log_ratio.sem(),
                "processor_s_per_simulated_s": timed.processor_s.sum() / timed.simulated_s.sum(),
                "processor_s_per_job": timed.processor_s.mean(),
                "largest_penetration_share": asked.penetration_share.max(),
            }
        )
    return pd.DataFrame(rows).sort_values("processor_s_per_job", ignore_index=True)


def _median(results: pd.DataFrame) -> float:
    """PGA at which one in two topples; NaN where the answers allow no fit."""
    fragility = fit(results, ["pga_m_s2"]).lognormal
    return fragility.median if fragility else float("nan")


def _median_shift_std(results: pd.DataFrame, converged: pd.DataFrame) -> float:
    """Standard deviation of the shift, by leaving out every n-th job in turn (a jackknife); NaN as the shift."""
    groups = min(_GROUPS, len(results))
    if groups < 2:
        return math.nan
    group = np.arange(len(results)) % groups
    shifts = [_median(results[group != left]) / _median(converged[group != left]) for left in range(groups)]
    return math.sqrt(groups - 1) * float(np.std(shifts))


_ASSETS: list[Any] = []
"""Scene and ensemble that a process of the pool was started with."""


def _begin(*assets: Any) -> None:
    _ASSETS[:] = assets


def _shake(job: Job, setting: Setting) -> _Row:
    scene, ensemble = _ASSETS
    motion = impose(ensemble.record(job.record_id), job.pga_m_s2, job.azimuth_deg).motion
    if setting.plain_bullet:
        began_s = time.process_time()
        toppled, tilt, simulated_s, depth_m = topples(scene, motion, setting.plain_bullet)
        return asdict(job) | {
            "toppled": toppled,
            "max_tilt_deg": tilt,
            "ended_by": "",
            "processor_s": time.process_time() - began_s,
            "simulated_s": simulated_s,
            "penetration_share": depth_m / scene.rock.half_diagonal_m,
        }
    toward = setting.disturbed_toward_deg
    start = None if toward is None else _disturbed_start(scene, toward)
    began_s = time.process_time()  # of the processor: what a job costs also on a machine with other work
    result = shake(
        scene, motion, setting.settings, shortcuts=setting.shortcuts, initial=start, engine=setting.engine
    )
    return asdict(job) | {
        "toppled": result.toppled,
        "max_tilt_deg": result.max_tilt_deg,
        "ended_by": result.ended_by,
        "processor_s": time.process_time() - began_s,
        "simulated_s": result.simulated_s,
        "penetration_share": result.penetration_m / scene.rock.half_diagonal_m,
    }
