"""The study of Veeraraghavan, Hudnut and Krishnan (2017) on any rock and records.

    python examples/study.py demo/scene demo/ensemble runs/study

With 140 records these are 21,280 jobs at friction 1 (19 levels, 8 directions), and 2,660 at each of three frictions in
the direction that topples the rock most easily. The same command goes on where it was stopped. It draws the study's
figures 6, 9, 10 and 11 with their tables, the two-dimensional reference beside them, writes a report, and says what was
found of the study's statements.
"""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from plane_sections import draw as draw_sections
from scipy.stats import spearmanr

from toppling import Campaign, Ensemble, Scene, fragility, open_run, report, run

FRICTIONS = (1.0, 0.8, 0.6)


def campaigns(
    scene: Path, ensemble: Path, step_m_s2: float, directions: int, preset: str
) -> dict[str, Campaign]:
    """The main run, and that of lower frictions in the direction that topples most easily."""
    levels = tuple(float(level) for level in np.arange(1.0, 19.0 + 1e-9, step_m_s2))
    azimuths = tuple(360.0 * number / directions for number in range(directions))
    static = Scene.load(scene).quasi_static_toppling_m_s2(azimuths)
    weakest = min(static, key=lambda pair: pair[1])[0]
    main = Campaign(
        scene=scene, ensemble=ensemble, pga_m_s2=levels, azimuth_deg=azimuths, friction=((1.0, 1.0),), preset=preset
    )  # fmt: skip
    lower = Campaign(
        scene=scene, ensemble=ensemble, pga_m_s2=levels, azimuth_deg=(weakest,), preset=preset,
        friction=tuple((value, value) for value in FRICTIONS),
    )  # fmt: skip
    return {"main": main, "friction": lower}


def toppling_levels(jobs: pd.DataFrame) -> pd.DataFrame:
    """Least PGA and PGV that topple, by record: the median over azimuths, infinite where no level topples."""
    job = ["record_id", "azimuth_deg"]
    toppled = jobs[jobs["toppled"].astype(bool)].groupby(job)[["pga_m_s2", "pgv_m_s"]].min()
    every = jobs.groupby(job)[["pgv_pga_s", "duration_energy_s"]].first()
    return every.join(toppled).fillna({"pga_m_s2": np.inf, "pgv_m_s": np.inf}).groupby("record_id").median()


def statements(main: pd.DataFrame, lower: pd.DataFrame) -> list[str]:
    """What the study says of its rock, looked for on this one."""
    levels = toppling_levels(main)
    weak = main[(main["pga_m_s2"] < 3.0) & (main["pgv_m_s"] < 0.75)]
    lines = [
        f"PGA below 3 m/s2 and PGV below 0.75 m/s: {weak['toppled'].mean():.3f} topple (the study: below 0.2)"
    ]
    for name, other in (
        ("pga_m_s2", "pgv_pga_s"),
        ("pga_m_s2", "duration_energy_s"),
        ("pgv_m_s", "duration_energy_s"),
    ):
        found = spearmanr(levels[name].rank(), levels[other])
        lines.append(
            f"rank correlation of the least {name} that topples with {other}: {found.statistic:+.2f} "
            f"(p {found.pvalue:.2g}, {len(levels)} records)"
        )
    parts = lower.groupby("friction_static")["toppled"].mean()
    lines.append("share that topples by friction: " + ", ".join(f"{f:g}: {s:.3f}" for f, s in parts.items()))
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scene", type=Path)
    parser.add_argument("ensemble", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--pga-step", type=float, default=1.0, help="m/s2, from 1 to 19")
    parser.add_argument("--directions", type=int, default=8)
    parser.add_argument("--preset", default="standard")
    asked = parser.parse_args()
    for name, campaign in campaigns(
        asked.scene, asked.ensemble, asked.pga_step, asked.directions, asked.preset
    ).items():
        done = run(campaign, asked.out / name).session
        print(f"{name}: {done.done} jobs in this session")
        fragility(asked.out / name, asked.out / "figures" / name, directions=asked.directions)
    draw_sections(Scene.load(asked.scene), Ensemble.load(asked.ensemble), asked.out / "figures" / "main")
    main_jobs, lower_jobs = (
        open_run(asked.out / name).frame().dropna(subset=["toppled"]) for name in ("main", "friction")
    )
    levels = toppling_levels(main_jobs).replace(np.inf, np.nan)
    figure, panels = plt.subplots(1, 2, figsize=(7.0, 3.0), layout="constrained")
    panels[0].plot(levels["pgv_pga_s"], levels["pga_m_s2"], "k.", ms=4)
    panels[0].set(xlabel="PGV/PGA (s)", ylabel="least PGA that topples (m/s²)")
    panels[1].plot(levels["duration_energy_s"], levels["pgv_m_s"], "k.", ms=4)
    panels[1].set(xlabel="duration (s)", ylabel="least PGV that topples (m/s)")
    toppling = levels["pga_m_s2"].count()
    figure.suptitle(
        f"{toppling} of {len(levels)} records topple it, median over {asked.directions} directions"
    )
    figure.savefig(asked.out / "figures" / "study.png", dpi=150)
    found = statements(main_jobs, lower_jobs)
    (asked.out / "findings.txt").write_text("\n".join(found) + "\n", encoding="utf-8")
    print("\n".join(found))
    print(report(asked.out / "main", asked.out / "report.html").page)


if __name__ == "__main__":  # workers are processes of their own, which import this file
    main()
