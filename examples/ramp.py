"""Waveforms made stronger step by step until a rock topples: the shake-table protocol of Purvance et al. (2008).

    python examples/ramp.py demo/scene demo/ensemble --out ramp.png

Veeraraghavan, Hudnut and Krishnan (2017, figure 4) validated their method by it: PGA from 0.981 m/s2 in steps of
0.245 m/s2, displacement held within 0.3 m of the table's stroke by a high-pass, friction 2 so that nothing slides.
"""

import argparse
import csv
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from toppling import Ensemble, InputError, Motion, Scene, shake

START_M_S2, STEP_M_S2, END_M_S2 = 0.981, 0.245, 20.0
STROKE_M, FRICTION = 0.3, 2.0


def chosen(ensemble: Ensemble, count: int) -> list[str]:
    """Records spread evenly over PGV/PGA, which decides how much acceleration topples a rock."""
    catalog = ensemble.catalog.to_pandas().sort_values(["pgv_pga_s", "record_id"])
    ids = catalog["record_id"].tolist()
    return [ids[round(rank)] for rank in np.linspace(0, len(ids) - 1, min(count, len(ids)))]


def pgv_m_s(motion: Motion) -> float:
    """Largest horizontal velocity of the ground."""
    return float(np.hypot(*motion.velocity_at(motion.time_s)[:, :2].T).max())


def climbed(
    scene_folder: Path, ensemble_folder: Path, azimuth_deg: float, preset: str, record_id: str
) -> dict[str, Any]:
    """Shake with one waveform, level by level until the rock topples."""
    scene, ensemble = Scene.load(scene_folder).with_friction(FRICTION), Ensemble.load(ensemble_folder)
    ratios, standing, toppling = [], 0.0, None
    for level in np.arange(START_M_S2, END_M_S2, STEP_M_S2):
        try:
            motion = ensemble.motion(
                record_id, pga_m_s2=level, azimuth_deg=azimuth_deg, peak_displacement_m=STROKE_M
            )
        except InputError:  # no high-pass holds so strong a motion within the stroke
            break
        pga = float(np.hypot(*motion.acceleration_m_s2[:, :2].T).max())
        ratios.append(pgv_m_s(motion) / pga)
        if shake(scene, motion, preset).toppled:
            toppling = pga
            break
        standing = pga
    return {
        "record_id": record_id, "pgv_pga_s": float(np.mean(ratios)), "toppling_pga_m_s2": toppling,
        "strongest_standing_m_s2": standing,
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scene", type=Path)
    parser.add_argument("ensemble", type=Path)
    parser.add_argument("--count", type=int, default=10, help="waveforms")
    parser.add_argument("--preset", default="standard")
    parser.add_argument("--out", type=Path, default=Path("ramp.png"))
    asked = parser.parse_args()
    scene = Scene.load(asked.scene).with_friction(FRICTION)
    azimuth_deg, static_m_s2 = min(
        scene.quasi_static_toppling_m_s2(np.arange(0.0, 360.0, 15.0)), key=lambda pair: pair[1]
    )
    climb = partial(climbed, asked.scene, asked.ensemble, azimuth_deg, asked.preset)
    with ProcessPoolExecutor() as pool:
        rows = list(pool.map(climb, chosen(Ensemble.load(asked.ensemble), asked.count)))
    with asked.out.with_suffix(".csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    toppled = [row for row in rows if row["toppling_pga_m_s2"] is not None]
    stood = [row for row in rows if row["toppling_pga_m_s2"] is None]
    figure, axes = plt.subplots(figsize=(4.0, 3.2), layout="constrained")
    axes.plot(
        [r["pgv_pga_s"] for r in toppled], [r["toppling_pga_m_s2"] for r in toppled], "ko", label="topples"
    )
    if stood:
        highest = [r["strongest_standing_m_s2"] for r in stood]
        axes.plot([r["pgv_pga_s"] for r in stood], highest, "k^", mfc="none", label="stands up to here")
    axes.axhline(static_m_s2, color="k", lw=0.8, ls="--", label="constant acceleration")
    axes.set(
        xlabel="PGV/PGA, mean over the levels (s)", ylabel="least PGA that topples (m/s²)", ylim=(0.0, None)
    )
    axes.set_title(f"{len(rows)} waveforms along azimuth {azimuth_deg:g}°")
    axes.legend(frameon=False)
    figure.savefig(asked.out, dpi=150)
    print(f"{len(toppled)} of {len(rows)} waveforms topple the rock; {asked.out}")


if __name__ == "__main__":
    main()
