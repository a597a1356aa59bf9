"""Error against cost of the presets: overturning thresholds, answers that flip, time.

Writes docs/accuracy.md, and results/preset_budget.json for the report of a run.

    .venv/bin/python benchmarks/accuracy.py [JOBS]

Answers near a threshold are chaotic, so the share that flips between presets is read against a floor: the share that
flips in the reference preset when the motion is scaled by 1 + 1e-6.
"""

import json
import sys
import time
from pathlib import Path

import numpy as np

from models import Motion, Scene
from models.motions.impose import impose
from models.motions.synthetic import synthetic_ensemble
from workers import shake
from workers.presets import PHYSICS_VERSION, PRESETS
from workers.reference.rocking import Ground, PlaneBody, overturns

PAGE = Path(__file__).parent.parent / "docs" / "accuracy.md"
BUDGET = Path(__file__).parent.parent / "results" / "preset_budget.json"
BLOCKS = ((0.1, 0.6), (0.2, 0.6), (0.4, 0.6))
SCENES = {
    "block 0.5 x 0.4 x 1.2 m": Scene.block(0.25, 0.2, 0.6, friction=0.7),
    "block 5 x 4 x 14 m": Scene.block(2.5, 2.0, 7.0, friction=0.8),
}


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


def answers(
    jobs: list[tuple[Scene, Motion]], preset: str, scale: float = 1.0
) -> tuple[np.ndarray, float, float]:
    """Whether each job topples, wall seconds, and simulated seconds."""
    toppled, simulated, began = [], 0.0, time.perf_counter()
    for scene, motion in jobs:
        result = shake(scene, Motion(motion.acceleration_m_s2 * scale, motion.time_step_s), preset)
        toppled.append(bool(result.toppled))
        simulated += result.simulated_s
    return np.array(toppled), time.perf_counter() - began, simulated


def main() -> None:
    """Measure and write the page."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 300
    random = np.random.default_rng(7)
    records = synthetic_ensemble(20, 11)
    jobs = []
    for k in range(count):
        scene = list(SCENES.values())[k % len(SCENES)]
        record = records[random.integers(len(records))]
        jobs.append((scene, impose(record, random.uniform(3.0, 14.0), random.uniform(0.0, 360.0)).motion))
    reference, _, _ = answers(jobs, "reference")
    floor = float((answers(jobs, "reference", 1.0 + 1e-6)[0] != reference).mean())
    rows, budget = [], {}
    for preset, settings in PRESETS.items():
        errors = np.array(threshold_errors(preset))
        toppled, wall_s, simulated_s = answers(jobs, preset)
        up, down = int((toppled & ~reference).sum()), int((~toppled & reference).sum())
        budget[preset] = {
            "flips_to_toppled": up, "flips_to_standing": down,
            "largest_threshold_error": round(float(np.abs(errors).max()), 6),
        }  # fmt: skip
        rows.append(
            f"| `{preset}` | 1/{1 / settings.step_share:.0f} | {100 * np.abs(errors).max():.3f} % "
            f"| {100 * errors.mean():+.3f} % | {100 * (up + down) / count:.1f} % ({up} up, {down} down) "
            f"| {wall_s / simulated_s:.4f} | {count / wall_s:.1f} |"
        )
    head = (
        "# Accuracy and cost of the presets\n\n"
        "Written by `benchmarks/accuracy.py`; do not edit. Thresholds: least full sine that overturns a block of\n"
        "alpha 9.5, 18.4 and 33.7 degrees (half height 0.6 m, periods 1 and 1.5 s), against the exact integrator of\n"
        f"`workers/reference`. Flips: {count} jobs ({', '.join(SCENES)}; 20 synthetic records, 3 to 14 m/s2, any\n"
        f"azimuth) against the preset `reference`, {100 * reference.mean():.0f} % of which topple. The floor of chaos, "
        "flips of\n`reference` itself under a motion scaled by 1 + 1e-6, is "
        f"{100 * floor:.1f} %. Times are of a busy two-core machine: only\ntheir ratios mean anything.\n\n"
        "| preset | step over sqrt(R/g) | largest threshold error | mean | answers that flip | wall s / simulated s "
        "| jobs / s |\n|---|---|---|---|---|---|---|\n"
    )
    PAGE.write_text(head + "\n".join(rows) + "\n")
    told = {
        "physics_version": PHYSICS_VERSION, "jobs": count, "toppled_share": round(float(reference.mean()), 4),
        "floor_of_chaos": round(floor, 4), "presets": budget,
    }  # fmt: skip
    BUDGET.write_text(json.dumps(told, indent=1) + "\n")
    print(PAGE.read_text())


if __name__ == "__main__":
    main()
