"""How much the share of jobs that topple depends on the numerical preset, and what each preset costs.

    python examples/accuracy.py demo/scene demo/ensemble --jobs 200 --out accuracy.png

Jobs of random record, level and azimuth are shaken with every preset. Single answers near a threshold are chaotic, so
the share of answers that differ is read beside the shift of the share that topples.
"""

import argparse
import time
from concurrent.futures import ProcessPoolExecutor
from functools import cache, partial
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from toppling import Ensemble, Scene, shake

PRESETS = ("fast", "standard", "reference")
CONVERGED = "reference"


@cache
def loaded(scene_folder: Path, ensemble_folder: Path) -> tuple[Scene, Ensemble]:
    """What all jobs of a process share."""
    return Scene.load(scene_folder), Ensemble.load(ensemble_folder)


def shaken(scene_folder: Path, ensemble_folder: Path, preset: str, job: tuple[str, float, float]) -> tuple:
    """Whether a job topples (nan without an answer), and its cost in seconds of the processor."""
    record_id, pga_m_s2, azimuth_deg = job
    scene, ensemble = loaded(scene_folder, ensemble_folder)
    motion = ensemble.motion(record_id, pga_m_s2=pga_m_s2, azimuth_deg=azimuth_deg)
    begun = time.process_time()
    toppled = shake(scene, motion, preset).toppled
    return np.nan if toppled is None else float(toppled), time.process_time() - begun


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scene", type=Path)
    parser.add_argument("ensemble", type=Path)
    parser.add_argument("--jobs", type=int, default=200)
    parser.add_argument("--pga", type=float, nargs=2, default=(3.0, 15.0), help="m/s2, drawn between these")
    parser.add_argument("--out", type=Path, default=Path("accuracy.png"))
    asked = parser.parse_args()
    random, ids = np.random.default_rng(7), Ensemble.load(asked.ensemble).record_ids
    jobs = [
        (ids[random.integers(len(ids))], random.uniform(*asked.pga), random.uniform(0.0, 360.0))
        for _ in range(asked.jobs)
    ]
    # Each process shakes one job before any is timed, so that loading compiled code does not count.
    ready = (asked.scene, asked.ensemble, CONVERGED, jobs[0])
    with ProcessPoolExecutor(initializer=shaken, initargs=ready) as pool:
        answers = {
            preset: np.array(list(pool.map(partial(shaken, asked.scene, asked.ensemble, preset), jobs)))
            for preset in PRESETS
        }
    rows = []
    for preset, answer in answers.items():
        both = np.isfinite(answer[:, 0]) & np.isfinite(answers[CONVERGED][:, 0])
        change = answer[both, 0] - answers[CONVERGED][both, 0]
        rows.append({
            "preset": preset, "processor_s_per_job": answer[:, 1].mean(), "share_toppled": answer[both, 0].mean(),
            "share_shift": change.mean(), "share_shift_std": change.std() / np.sqrt(len(change)),
            "only_this": int((change > 0).sum()), "only_reference": int((change < 0).sum()),
        })  # fmt: skip
    table = pd.DataFrame(rows)
    table.to_csv(asked.out.with_suffix(".csv"), index=False)
    figure, axes = plt.subplots(figsize=(4.0, 3.0), layout="constrained")
    axes.axhline(0.0, color="0.6", lw=0.8)
    for row in table.itertuples():
        error = 100.0 * row.share_shift_std
        axes.errorbar(
            row.processor_s_per_job, 100.0 * row.share_shift, error, fmt="o", capsize=2, label=row.preset
        )
    axes.set(
        xlim=(0.0, None),
        xlabel="cost (processor s per job)",
        ylabel="shift of the share\nthat topples (points)",
    )
    axes.legend(frameon=False)
    figure.savefig(asked.out, dpi=150)
    print(table.to_string(index=False, float_format="{:.3f}".format))


if __name__ == "__main__":
    main()
