"""What the shortcuts of a shake change and save: every job with them and without.

    make demo && .venv/bin/python benchmarks/shortcuts.py [JOBS_OF_EACH_ROCK]

Writes benchmarks/reports/shortcuts.md. Jobs: blocks, turned against the axes and on a slope too, the demo's scanned
rock, and a rock that falls from facet to facet; any record of the demo's ensemble, level and azimuth, preset `fast`.
The floor is the same without shortcuts from a start disturbed by a millionth of the height. A job whose answer a
shortcut changes is shaken without shortcuts from 24 such starts: where none of them changes the answer, the job was not
near its threshold. Answers are kept in runs/shortcuts and not computed again.
"""

import sys
from collections.abc import Callable
from dataclasses import replace
from datetime import date
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import trimesh
from comparison import Job, Setting, answers, draw_jobs
from rich.progress import Progress
from scipy.spatial.transform import Rotation

from toppling.models.motions.ensemble import Ensemble
from toppling.models.scene import Scene
from toppling.models.shapes import box
from toppling.workers.options import PHYSICS_VERSION, PRESETS

ROOT = Path(__file__).parent.parent
PAGE = ROOT / "benchmarks" / "reports" / "shortcuts.md"
ENSEMBLE, SCANNED = ROOT / "demo" / "ensemble", ROOT / "demo" / "scene"
RETAINED = ROOT / "runs" / "shortcuts"
BLOCKS = (
    ((0.2, 0.2, 0.6), 5.0, 0.0),
    ((0.5, 0.35, 1.0), 0.0, 0.0),
    ((0.15, 0.6, 0.6), 20.0, 0.0),
    ((1.0, 0.8, 3.0), 0.0, 8.0),
)
"""Half sizes (m), turn about the normal and slope (deg)."""

FACETS = ((0.12, 0.0), (0.75, 0.3), (0.9, 0.56), (0.9, 2.2))
"""Half of a section (x, z), m: past its balance the rock lands on two facets and falls on."""

PGA_M_S2 = (1.0, 12.0)
PRESET = "fast"
SHORT = Setting(PRESETS[PRESET])
WHOLE = replace(SHORT, shortcuts=False)
FLOOR_OF = 4
"""Interval of jobs that are shaken from a disturbed start."""

DISTURBED = [replace(WHOLE, disturbed_toward_deg=15.0 * k) for k in range(24)]


def block(half_sizes_m: tuple[float, float, float], turn_deg: float, slope_deg: float) -> Scene:
    """A block on a plane."""
    turn = Rotation.from_euler("z", turn_deg, degrees=True).as_matrix()
    rock = box(*half_sizes_m).moved(turn)
    return Scene.from_mesh((rock.vertices_m, rock.faces), slope_deg=slope_deg)


def faceted() -> Scene:
    """A rock of that section, mirrored, 3 m long."""
    corners = [(side * x, y, z) for side in (1, -1) for y in (-1.5, 1.5) for x, z in FACETS]
    hull = trimesh.convex.convex_hull(np.array(corners))
    return Scene.from_mesh((hull.vertices, hull.faces))


def fates(stated: pd.DataFrame) -> pd.Series:
    """1 where the rock toppled, 0 where it stands, -1 without an answer."""
    return stated.toppled.astype("Int8").fillna(-1).astype(int)


def compare(shaken: Callable[[list[Job], Setting], pd.DataFrame], jobs: list[Job]) -> pd.DataFrame:
    """What the shortcuts did to the jobs of one scene: a row a job."""
    short, whole = shaken(jobs, SHORT), shaken(jobs, WHOLE)
    was, disturbed = fates(whole), fates(shaken(jobs[: len(jobs) // FLOOR_OF], DISTURBED[0]))
    changed = fates(short) != was
    suspects = [job for job, is_changed in zip(jobs, changed, strict=True) if is_changed]
    shaky = [fates(shaken(suspects, setting)) for setting in DISTURBED] if suspects else []
    away = np.zeros(len(jobs), bool)
    away[changed] = [len(set(value)) == 1 for value in np.transpose([was[changed], *shaky])]
    return pd.DataFrame(
        {
            "ended_by": short.ended_by,
            "to_toppled": changed & (fates(short) == 1),
            "to_standing": changed & (fates(short) == 0),
            "away": away,
            "floor": (disturbed != was[: len(disturbed)]).reindex(whole.index),
            "toppled": was == 1,
            "short_s": short.processor_s,
            "whole_s": whole.processor_s,
        }
    )


def main() -> None:
    entry = int(sys.argv[1]) if len(sys.argv) > 1 else 400
    ensemble = Ensemble.load(ENSEMBLE)
    scenes = [*(block(*entry) for entry in BLOCKS), Scene.load(SCANNED), faceted()]
    first = len(scenes) - 1
    jobs = draw_jobs(ensemble, entry * len(scenes), PGA_M_S2, seed=11)
    fractions = [*(jobs[number : first * entry : first] for number in range(first)), jobs[first * entry :]]
    with Progress() as progress:
        task = progress.add_task("shaking", total=(2 + 1 / FLOOR_OF) * len(jobs))
        rows = pd.concat(
            compare(
                partial(answers, scene, ensemble, folder=RETAINED, advance=partial(progress.advance, task)),
                share,
            )
            for scene, share in zip(scenes, fractions, strict=True)
        )
    PAGE.write_text(page(rows))
    print(page(rows))


def page(rows: pd.DataFrame) -> str:
    """The page as Markdown."""
    changed = rows.to_toppled.sum() + rows.to_standing.sum()
    saved_s, whole_s = rows.whole_s - rows.short_s, rows.whole_s.sum()
    lines = [
        "# What the shortcuts change and save",
        "",
        f"Written by `benchmarks/shortcuts.py`, {date.today():%B %Y}; do not edit.",
        "",
        f"{len(rows)} random jobs, equally many on each of: blocks (half sizes, turn and slope: "
        + "; ".join(f"{size} m, {turn:g}°, {slope:g}°" for size, turn, slope in BLOCKS)
        + "),",
        "the demo's scanned rock, and a rock that falls from facet to facet. Records are those of the demo's "
        f"ensemble, at {PGA_M_S2[0]:.0f} to {PGA_M_S2[1]:.0f} m/s2",
        f"and any azimuth; preset `{PRESET}`, physics version {PHYSICS_VERSION}; "
        f"{100 * rows.toppled.mean():.0f} % topple. Each job is shaken with and without",
        f"shortcuts, and one in {FLOOR_OF} also without them from a start disturbed by a millionth of the height, "
        "which gives the floor set by chaos.",
        "",
        f"- Answers changed by the shortcuts: {changed} ({100 * changed / len(rows):.2f} %): "
        f"{rows.to_toppled.sum()} to toppled, {rows.to_standing.sum()} to standing.",
        f"- Answers changed by the disturbance: {rows.floor.sum()} of {rows.floor.count()} "
        f"({100 * rows.floor.mean():.2f} %).",
        f"- Changed by a shortcut but by none of {len(DISTURBED)} disturbances: {rows.away.sum()}.",
        f"- Processor time saved: {100 * saved_s.sum() / whole_s:.0f} %, measured on {saved_s.count()} jobs.",
        "",
        "| ended by | jobs | answers changed | time saved, share of their own | of all |",
        "|---|---|---|---|---|",
    ]
    for rule, of in rows.assign(saved_s=saved_s).groupby("ended_by"):
        lines.append(
            f"| {rule} | {len(of)} | {of.to_toppled.sum() + of.to_standing.sum()} "
            f"| {100 * of.saved_s.sum() / of.whole_s.sum():.0f} % | {100 * of.saved_s.sum() / whole_s:.0f} % |"
        )
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()
