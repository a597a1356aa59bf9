"""What the shortcuts of a shake change and save: every job with them and without.

    make demo && .venv/bin/python benchmarks/shortcuts.py [JOBS]

Writes docs/shortcuts.md. Jobs: blocks of three shapes and the demo's scanned rock, any record of the demo's ensemble,
level and azimuth, preset `fast`. The floor is the same without shortcuts from a start a millionth of the height above
rest. A job whose answer a shortcut changes is shaken again at 2 % less and 2 % more: where these answer alike it was
not near its threshold.
"""

import sys
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from pathlib import Path

import numpy as np
from rich.progress import track

from models import Motion, Scene
from models.motions.ensemble import Ensemble
from models.motions.impose import impose
from orchestrator.front import Job, draw_jobs, raised
from workers import ShakeResult, shake
from workers.presets import PHYSICS_VERSION
from workers.shake import settled

ROOT = Path(__file__).parent.parent
PAGE, ENSEMBLE, SCANNED = ROOT / "docs" / "shortcuts.md", ROOT / "demo" / "ensemble", ROOT / "demo" / "scene"
BLOCKS = ((0.2, 0.2, 0.6), (0.5, 0.35, 1.0), (1.0, 0.8, 3.0))
PGA_M_S2 = (1.0, 12.0)
PRESET = "fast"
CPUS = 2
NEAR = 0.02


def compare(number: int, job: Job) -> dict[str, object]:
    """One job with shortcuts, without, and without but from a disturbed start."""
    scene = _scene(number % (len(BLOCKS) + 1))
    motion = impose(_ensemble().record(job.record_id), job.pga_m_s2, job.azimuth_deg).motion

    def whole_at(scale: float) -> ShakeResult:
        scaled = Motion(motion.acceleration_m_s2 * scale, motion.time_step_s)
        return shake(scene, scaled, PRESET, shortcuts=False)

    short, whole = shake(scene, motion, PRESET), whole_at(1.0)
    disturbed = shake(scene, motion, PRESET, shortcuts=False, initial=raised(scene))
    changed = short.toppled != whole.toppled
    return {
        "ended_by": short.ended_by,
        "changed": changed,
        "far": changed and len({whole_at(1 + s).toppled for s in (-NEAR, NEAR)}) == 1,
        "floor": disturbed.toppled != whole.toppled,
        "toppled": whole.toppled,
        "short_s": short.wall_s,
        "whole_s": whole.wall_s,
    }


@cache
def _scene(number: int) -> Scene:
    return Scene.block(*BLOCKS[number]) if number < len(BLOCKS) else settled(Scene.load(SCANNED))


@cache
def _ensemble() -> Ensemble:
    return Ensemble.load(ENSEMBLE)


def main() -> None:
    """Measure and write the page."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 2000
    jobs = draw_jobs(Ensemble.load(ENSEMBLE), count, PGA_M_S2, seed=11)
    with ProcessPoolExecutor(CPUS) as pool:
        rows = list(track(pool.map(compare, range(count), jobs), "shaking", total=count))
    PAGE.write_text(page(rows))


def page(rows: list[dict[str, object]]) -> str:
    """The page as Markdown."""
    total = {name: np.sum([row[name] for row in rows]) for name in rows[0] if name != "ended_by"}
    lines = [
        "# What the shortcuts change and save",
        "",
        "Written by `benchmarks/shortcuts.py`; do not edit.",
        "",
        f"{len(rows)} random jobs on blocks (half sizes {', '.join(str(block) for block in BLOCKS)} m) and",
        "the demo's scanned rock, a quarter each, under any record of the demo's ensemble at",
        f"{PGA_M_S2[0]:.0f} to {PGA_M_S2[1]:.0f} m/s2 and any azimuth, preset `{PRESET}`, physics version "
        f"{PHYSICS_VERSION};",
        f"{100 * total['toppled'] / len(rows):.0f} % topple. Each with shortcuts, without, and without from a start a "
        "millionth of the",
        "height above rest: the floor of chaos.",
        "",
        f"- Answers that the shortcuts change: {total['changed']} ({100 * total['changed'] / len(rows):.2f} %).",
        f"- Answers that the disturbance changes: {total['floor']} ({100 * total['floor'] / len(rows):.2f} %).",
        f"- Changed by a shortcut, but the same at {100 * NEAR:.0f} % more and less: {total['far']}.",
        f"- Time saved: {100 * (1 - total['short_s'] / total['whole_s']):.0f} % of the time of the jobs without.",
        "",
        "| ended by | jobs | answers changed | time saved, share of their own | of all |",
        "|---|---|---|---|---|",
    ]
    for rule, jobs in Counter(str(row["ended_by"]) for row in rows).most_common():
        of = [row for row in rows if row["ended_by"] == rule]
        short, whole = (np.sum([row[name] for row in of]) for name in ("short_s", "whole_s"))
        changed = np.sum([row["changed"] for row in of])
        lines.append(
            f"| {rule} | {jobs} | {changed} | {100 * (1 - short / whole):.0f} % | "
            f"{100 * (whole - short) / total['whole_s']:.0f} % |"
        )
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()
