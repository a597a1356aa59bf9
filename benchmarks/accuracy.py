"""Error against cost of the presets: overturning thresholds, answers that flip, time.

    make demo && .venv/bin/python benchmarks/accuracy.py [JOBS]

Writes docs/accuracy.md with its figure, and results/preset_budget.json for the report of a run. Thresholds are compared
with the exact integrator, answers with those of the preset `reference` on the demo's scanned rock and records.
"""

import json
import sys
from pathlib import Path

import numpy as np
import pandas as pd
from rich.progress import Progress

from models import Motion, Scene
from models.motions.ensemble import Ensemble
from orchestrator.front import CONVERGED, FLOOR, Setting, answers, compare, draw_jobs
from results.figures import front_figure, save
from workers import shake
from workers.presets import PHYSICS_VERSION, PRESETS
from workers.reference.rocking import Ground, PlaneBody, overturns

ROOT = Path(__file__).parent.parent
PAGE, FIGURE = ROOT / "docs" / "accuracy.md", ROOT / "docs" / "figures" / "accuracy_front"
BUDGET = ROOT / "results" / "preset_budget.json"
SCENE, ENSEMBLE = ROOT / "demo" / "scene", ROOT / "demo" / "ensemble"
KEPT = ROOT / "runs" / "accuracy"
PGA_M_S2 = (3.0, 12.0)
BLOCKS = ((0.1, 0.6), (0.2, 0.6), (0.4, 0.6))


def full_sine(amplitude_m_s2: float, period_s: float, samples: int = 400) -> Motion:
    """One sine along x."""
    phase = np.linspace(0.0, 2 * np.pi, samples + 1)
    return Motion(np.outer(amplitude_m_s2 * np.sin(phase), [1.0, 0.0, 0.0]), period_s / samples)


def least(low: float, high: float, topples: object) -> float:
    """Least amplitude within 1e-4 that topples, from one that does not and one that does."""
    while high - low > 1e-4 * low:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if topples(middle) else (middle, high)  # type: ignore[operator]
    return 0.5 * (low + high)


def threshold_errors(preset: str) -> list[float]:
    """Relative errors of the least full sine that overturns, over blocks and periods."""
    errors = []
    for b, h in BLOCKS:
        scene, body = Scene.block(b, b, h, friction=10.0), PlaneBody.rectangle(b, h)
        uplift = 9.81 * b / h
        for period in (1.0, 1.5):
            grid = uplift * np.arange(1.02, 8.0, 0.02)
            first = next(a for a in grid if overturns(body, Ground.sine(a, period)))
            exact = least(
                first - 0.02 * uplift, first, lambda a, t=period, o=body: overturns(o, Ground.sine(a, t))
            )
            found = least(
                0.97 * exact,
                1.03 * exact,
                lambda a, t=period, s=scene: bool(shake(s, full_sine(a, t), preset).toppled),
            )
            errors.append(found / exact - 1.0)
    return errors


def main() -> None:
    """Measure and write the page."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 300
    scene, ensemble = Scene.load(SCENE), Ensemble.load(ENSEMBLE)
    jobs = draw_jobs(ensemble, count, PGA_M_S2)
    compared = {name: Setting(settings) for name, settings in PRESETS.items()} | {
        "fast, no shortcuts": Setting(PRESETS["fast"], shortcuts=False),
        FLOOR: Setting(PRESETS[CONVERGED], disturbed_toward_deg=0.0),
    }
    with Progress() as progress:
        task = progress.add_task("shaking", total=count * len(compared))
        said = {
            name: answers(scene, ensemble, jobs, one, kept=KEPT, seen=lambda: progress.advance(task))
            for name, one in compared.items()
        }
    table = compare(said, said[CONVERGED])
    save(front_figure(table, FLOOR), FIGURE)
    errors = {name: np.array(threshold_errors(name)) for name in PRESETS}
    PAGE.write_text(_page(table, errors, count, float(said[CONVERGED].toppled.mean())))
    flips = table.set_index("setting")
    told = {
        "physics_version": PHYSICS_VERSION,
        "jobs": count,
        "toppled_share": round(float(said[CONVERGED].toppled.mean()), 4),
        "floor_of_chaos": round(float(flips.loc[FLOOR, "flips_share"]), 4),
        "presets": {
            name: {
                "flips_to_toppled": int(flips.loc[name, "flips_to_toppled"]),
                "flips_to_standing": int(flips.loc[name, "flips_to_standing"]),
                "largest_threshold_error": round(float(np.abs(errors[name]).max()), 6),
            }
            for name in PRESETS
        },
    }
    BUDGET.write_text(json.dumps(told, indent=1) + "\n")
    print(PAGE.read_text())


def _page(table: pd.DataFrame, errors: dict[str, np.ndarray], count: int, toppled: float) -> str:
    head = (
        "# Accuracy and cost of the presets\n\n"
        f"Written by `benchmarks/accuracy.py` with physics version {PHYSICS_VERSION}; do not edit. Thresholds: least\n"
        "full sine that overturns a block of alpha 9.5, 18.4 and 33.7 degrees (half height 0.6 m, periods 1 and\n"
        "1.5 s), against the exact integrator of `workers/reference`. "
        f"Flips: {count} jobs on the demo's scanned rock\n(any record of its ensemble, "
        f"{PGA_M_S2[0]:g} to\n{PGA_M_S2[1]:g} m/s2, any azimuth) against the preset `{CONVERGED}`, "
        f"{100 * toppled:.0f} % of which topple. *Disturbed* is `{CONVERGED}`\n"
        "itself from a start disturbed by a millionth of the rock's height: the floor of chaos. Median: the\n"
        "PGA at which one in two topples. Costs are of a two-core machine; only their ratios mean anything.\n\n"
        "![Flips against cost](figures/accuracy_front.png)\n\n"
        "| setting | largest threshold error | answers that flip | sign test p | shift of the median "
        "| ms per simulated s | s per job | deepest penetration / R |\n|---|---|---|---|---|---|---|---|\n"
    )
    rows = []
    for row in table.itertuples():
        threshold = f"{100 * np.abs(errors[row.setting]).max():.3f} %" if row.setting in errors else "-"
        rows.append(
            f"| {row.setting} | {threshold} | {100 * row.flips_share:.1f} % ({row.flips_to_toppled} up, "
            f"{row.flips_to_standing} down) | {row.sign_test_p:.2f} | {100 * row.median_shift:+.2f} % "
            f"| {1e3 * row.wall_s_per_simulated_s:.1f} | {row.wall_s_per_job:.2f} "
            f"| {row.largest_penetration_share:.1e} |"
        )
    return head + "\n".join(rows) + "\n"


if __name__ == "__main__":
    main()
