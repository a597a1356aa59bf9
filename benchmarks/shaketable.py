"""A real rock on a real shaking table: the tests of a granite specimen against shakes of its mesh.

    .venv/bin/python benchmarks/shaketable.py FOLDER [--presets fast,standard] [--every N]

FOLDER holds `sp1.ply`, `tests.csv` (test_no, sp1_overturned) and `motions.parquet` (test_no, dt_s, acc_m_s2): 252 tests
along one axis. The settings were fixed before any outcome was looked at: friction .6 (dry granite on a rough table),
restitution 0, the mesh as it stands on a level plane. Which way the table's positive axis points in the mesh's frame is
not known, so both senses are reported.
"""

import argparse
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
import pyarrow.csv
import pyarrow.parquet

from toppling.models.motions.motion import Motion
from toppling.models.scene import Scene
from toppling.workers.shake import shake

FRICTION = 0.6
CPUS = 2


def outcome(folder: str, time_step_s: float, acceleration_m_s2: list[float], sense: int, preset: str) -> dict:
    """One test."""
    scene = scene_of(folder)
    along = sense * np.asarray(acceleration_m_s2, float)
    motion = Motion(np.outer(along, [1.0, 0.0, 0.0]), time_step_s)
    result = shake(scene, motion, preset)
    return {
        "toppled": bool(result.toppled),
        "status": result.status,
        "wall_s": result.wall_s,
        "simulated_s": result.simulated_s,
        "tilt": result.max_tilt_deg,
    }


_SCENES: dict[str, Scene] = {}


def scene_of(folder: str) -> Scene:
    """The specimen, one object a process, so that what is derived from it is kept."""
    if folder not in _SCENES:
        _SCENES[folder] = Scene.from_mesh(Path(folder) / "sp1.ply", friction=FRICTION)
    return _SCENES[folder]


def scores(said: np.ndarray, truth: np.ndarray) -> str:
    """Accuracy, balanced accuracy, recall and specificity."""
    recall, specificity = (said & truth).sum() / truth.sum(), (~said & ~truth).sum() / (~truth).sum()
    return (
        f"accuracy {(said == truth).mean():.3f}, balanced {0.5 * (recall + specificity):.3f}, "
        f"recall {recall:.3f}, specificity {specificity:.3f}"
    )


def main() -> None:
    """Shake every test in both senses with each preset and print the scores."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--presets", default="fast,standard")
    parser.add_argument("--every", type=int, default=1, help="take every n-th test")
    options = parser.parse_args()
    tests = {
        row["test_no"]: row["sp1_overturned"]
        for row in pyarrow.csv.read_csv(options.folder / "tests.csv").to_pylist()
    }
    motions = pyarrow.parquet.read_table(options.folder / "motions.parquet").to_pylist()[:: options.every]
    truth = np.array([tests[row["test_no"]] == 1 for row in motions])
    print(f"{len(motions)} tests, {truth.sum()} of which overturned the rock")
    said: dict[tuple[str, int], np.ndarray] = {}
    with ProcessPoolExecutor(CPUS) as pool:
        for preset in options.presets.split(","):
            for sense in (1, -1):
                began = time.perf_counter()
                folder = str(options.folder)
                rows = [
                    future.result()
                    for future in [
                        pool.submit(outcome, folder, row["dt_s"], row["acc_m_s2"], sense, preset)
                        for row in motions
                    ]
                ]
                answers = np.array([row["toppled"] for row in rows])
                said[preset, sense] = answers
                odd = sum(row["status"] != "ok" for row in rows)
                cost = sum(row["wall_s"] for row in rows) / sum(row["simulated_s"] for row in rows)
                print(
                    f"{preset}, sense {sense:+d}: {scores(answers, truth)}; {odd} without an answer; "
                    f"{cost:.4f} wall s per simulated s; {time.perf_counter() - began:.0f} s in all",
                    flush=True,
                )
    presets = options.presets.split(",")
    for preset in presets[1:]:
        for sense in (1, -1):
            share = (said[preset, sense] != said[presets[0], sense]).mean()
            print(
                f"sense {sense:+d}: {100 * share:.1f} % of the answers differ between {presets[0]} and {preset}"
            )


if __name__ == "__main__":
    main()
