"""Shake-table tests of a rock predicted as probabilities, and scored against their outcomes.

    python examples/validation.py FOLDER --mesh sp1.ply --outcome sp1_overturned --out validation

FOLDER holds tests.csv (`test_no`, `ground_motion`, a column of outcomes 0 or 1, empty where the specimen was not on the
table) and motions.parquet (`test_no`, `dt_s`, `acc_m_s2` along the table's axis, low-passed at 25 Hz). The mesh is
closed, in metres, z up as the rock stood, x along the table. What nobody measured is drawn before any outcome is
looked at: the base (error of the mesh, a thousandth of the height), friction of granite on steel or concrete,
restitution, yaw, the sense of the table's axis, and the motion above the band. The prediction is the share of the
draws that topple.
"""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from scipy.stats import beta

from toppling import (
    Campaign,
    Ensemble,
    Motion,
    Record,
    Scene,
    Standing,
    Unmeasured,
    open_run,
    run,
    with_rough_base,
)

FRICTION, RESTITUTION, YAW_DEG = (0.5, 1.0), (0.0, 0.3), 5.0
BAND_HZ, ABOVE_BAND = 25.0, (0.0, 0.6)
STANDING = Standing(attitude_std_deg=3.0, least_toppling_m_s2=0.25)


def specimen(mesh: Path, draws: int) -> Scene:
    """The rock on a level table, with draws of its base on which it stands."""
    scene = Scene.from_mesh(mesh, sum(FRICTION) / 2.0)
    height_m = scene.rock.height_m
    return with_rough_base(
        scene, std_m=(height_m / 2000, height_m / 500), wavelength_m=0.2 * height_m, band_m=0.1 * height_m,
        draws=draws, standing=STANDING,
    )  # fmt: skip


def tests_of(folder: Path, outcome: str) -> tuple[pd.DataFrame, list[Record]]:
    """Tests that have an outcome and a motion, and their motions along x."""
    tests = pd.read_csv(folder / "tests.csv").dropna(subset=[outcome]).set_index("test_no")
    motions = pd.read_parquet(folder / "motions.parquet").set_index("test_no")
    tests = tests[tests.index.isin(motions.index)]
    records = []
    for number in tests.index:
        acceleration = np.outer(motions.at[number, "acc_m_s2"], [1.0, 0.0, 0.0])
        motion = Motion(acceleration, float(f"{motions.at[number, 'dt_s']:.6g}"))
        records.append(Record.of(f"test_{number:04d}", motion, component_azimuths_deg=(0.0, 90.0)))
    return tests, records


def predicted(scene: Path, ensemble: Path, draws: int, preset: str, out: Path) -> pd.Series:
    """Probability of toppling by record: (k + 1/2) / (n + 1) of its draws (Jeffreys' prior)."""
    campaign = Campaign(
        scene=scene, ensemble=ensemble, pga_m_s2=(), azimuth_deg=(0.0,), friction=((sum(FRICTION) / 2.0,) * 2,),
        first_realisation=1, realisations=draws, preset=preset, audit=0,
        unmeasured=Unmeasured(FRICTION, RESTITUTION, YAW_DEG, True, BAND_HZ, ABOVE_BAND),
    )  # fmt: skip
    run(campaign, out)
    rows = open_run(out).frame().dropna(subset=["toppled"])
    counted = rows.groupby("record_id")["toppled"].agg(["sum", "count"]).astype(float)
    return (counted["sum"] + 0.5) / (counted["count"] + 1.0)


def scores(overturned: np.ndarray, probability: np.ndarray) -> dict[str, float]:
    """Accuracy and balanced accuracy of calls at one half, and the Brier score."""
    called = probability >= 0.5
    return {
        "tests": len(overturned),
        "accuracy": float((called == overturned).mean()),
        "balanced_accuracy": float(0.5 * (called[overturned].mean() + (~called[~overturned]).mean())),
        "brier": float(((probability - overturned) ** 2).mean()),
    }


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--mesh", required=True, help="a path, or a name in FOLDER")
    parser.add_argument("--outcome", required=True)
    parser.add_argument("--draws", type=int, default=24)
    parser.add_argument("--preset", default="fast")
    parser.add_argument("--out", type=Path, default=Path("validation"))
    asked = parser.parse_args()
    mesh, out = Path(asked.mesh), asked.out
    if not (out / "scene").exists():
        specimen(mesh if mesh.exists() else asked.folder / mesh, asked.draws).save(out / "scene")
    tests, records = tests_of(asked.folder, asked.outcome)
    Ensemble.write(out / "ensemble", records)
    share = predicted(out / "scene", out / "ensemble", asked.draws, asked.preset, out / "run")
    names = [f"test_{number:04d}" for number in tests.index]
    table = pd.DataFrame({
        "test_no": tests.index, "overturned": tests[asked.outcome].astype(bool).to_numpy(),
        "probability": share.reindex(names).to_numpy(),
    }).dropna()  # fmt: skip
    table.to_csv(out / "tests.csv", index=False)
    found = scores(table["overturned"].to_numpy(bool), table["probability"].to_numpy(float))
    bins = table.groupby(np.minimum((6.0 * table["probability"]).astype(int), 5))
    called = bins[["probability", "overturned"]].mean().assign(tests=bins.size())
    figure, axes = plt.subplots(figsize=(3.6, 3.4), layout="constrained")
    axes.plot([0, 1], [0, 1], color="0.7", lw=0.8)
    hits = called["overturned"] * called["tests"]
    low, high = beta.ppf([[0.025], [0.975]], hits + 0.5, called["tests"] - hits + 0.5)  # 95 %, Jeffreys
    error = np.abs(np.vstack([low, high]) - called["overturned"].to_numpy())
    axes.errorbar(called["probability"], called["overturned"], error, fmt="ko", capsize=2)
    for row in called.itertuples():
        axes.annotate(str(row.tests), (row.probability, row.overturned), (5, -10), textcoords="offset points")
    axes.set(xlabel="predicted probability", ylabel="share that overturned", xlim=(0, 1), ylim=(-0.05, 1.05))
    axes.set_title(f"{found['tests']} tests, Brier score {found['brier']:.3f}")
    figure.savefig(out / "calibration.png", dpi=150)
    print(", ".join(f"{name.replace('_', ' ')} {value:.3g}" for name, value in found.items()))


if __name__ == "__main__":  # workers are processes of their own, which import this file
    main()
