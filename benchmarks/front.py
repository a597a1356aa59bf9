"""Presets and engines on one front: what each moves of what users ask for, and what it costs.

    make demo && .venv/bin/python benchmarks/front.py [JOBS [SHORT_JOBS]]

Writes benchmarks/reports/accuracy.md and its figure. The same jobs on a block, a prism, the demo's scanned rock and a
rock on three feet, by the presets of both engines and by PyBullet alone, in turns; SHORT_JOBS of the records' strong
parts on the scanned rock, which show a small bias; and the cases with exact answers. About half an hour for 100 and
2000 jobs on two cores.
"""

import math
import sys
import tempfile
from collections.abc import Iterable
from dataclasses import replace
from datetime import date
from pathlib import Path
from textwrap import fill

import numpy as np
import pandas as pd
import seaborn as sns
import trimesh
from comparison import CONVERGED, Job, Setting, answers, compare, settings
from exact_cases import CASES, TARGET_OF_STANDARD, worst_errors
from matplotlib.figure import Figure
from rich.progress import track

from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.motion import Motion
from toppling.models.motions.processing import end_at_rest, taper
from toppling.models.motions.record import Record
from toppling.models.scene import Scene
from toppling.models.shapes import cylinder
from toppling.models.statics import quasi_static_toppling_m_s2
from toppling.results.drawing.style import COLOURS, FULL_WIDTH_IN, plain_log, save, style
from toppling.workers.options import PHYSICS_VERSION

ROOT = Path(__file__).parent.parent
PAGE, FIGURE = ROOT / "benchmarks" / "reports" / "accuracy.md", ROOT / "benchmarks" / "reports" / "front"
LEVELS = (-0.3, 1.6)
"""Logarithm of the jobs' PGA over the least static toppling acceleration of the rock, drawn uniformly."""

STRONG_PART = (0.05, 0.75)
"""Fractions of a record's horizontal Arias intensity that bound its significant duration D5-75."""

PRESETS = ("fast", "standard", "reference")
"""Whose errors against exact answers are told."""
SHORT = (
    "fast", "standard", "mujoco fast", "plain PyBullet 1/240 s", "plain PyBullet 1/1000 s",
)  # fmt: skip


def scenes() -> dict[str, Scene]:
    """The bodies that are shaken."""
    prism = cylinder(0.3, 0.6, sides=24)
    three = np.array([[0.25, 0.0], [-0.12, 0.22], [-0.15, -0.2]])
    top = np.array([[0.3, 0.3], [-0.3, 0.3], [-0.3, -0.3], [0.3, -0.3]])
    corners = np.vstack([np.column_stack([three, np.zeros(3)]), np.column_stack([top, np.full(4, 1.2)])])
    stool = trimesh.convex.convex_hull(corners)
    return {
        "block": Scene.block(0.2, 0.25, 0.6, friction=0.8),
        "prism of 24 sides": Scene.from_mesh((prism.vertices_m, prism.faces), friction=0.8),
        "demo's rock": Scene.load(ROOT / "demo" / "scene"),
        "rock on three feet": Scene.from_mesh((stool.vertices, stool.faces), friction=0.8),
    }


def draw(scene: Scene, ensemble: Ensemble, count: int, seed: int = 5) -> list[Job]:
    """Jobs of any record and azimuth, at levels around those that topple the rock."""
    random, ids = np.random.default_rng(seed), ensemble.record_ids
    azimuths = np.arange(0.0, 360.0, 15.0).tolist()
    least = min(
        value
        for _, value in quasi_static_toppling_m_s2(scene.rock, scene.pedestal, scene.gravity_m_s2, azimuths)
    )
    return [
        Job(
            ids[random.integers(len(ids))],
            float(least * np.exp(random.uniform(*LEVELS))),
            float(random.uniform(0.0, 360.0)),
        )
        for _ in range(count)
    ]


def strong_parts(ensemble: Ensemble, folder: Path) -> Ensemble:
    """The strong part of each record, tapered, the ground at rest after it; written to a folder."""
    records = []
    for name in ensemble.record_ids:
        motion = ensemble.record(name).motion
        growth = np.cumsum((motion.acceleration_m_s2[:, :2] ** 2).sum(axis=1))
        first, last = np.searchsorted(growth / growth[-1], STRONG_PART)
        part = Motion(motion.acceleration_m_s2[first : last + 1], motion.time_step_s)
        records.append(Record.of(name, end_at_rest(taper(part)), component_azimuths_deg=(0.0, 90.0)))
    return Ensemble.write(folder, records)


def compared(
    scene: Scene, ensemble: Ensemble, jobs: list[Job], asked: dict[str, Setting], by: str
) -> pd.DataFrame:
    """Settings against one of them, over the same jobs."""
    names = asked.keys() | {by}
    every = settings()
    answered = {
        name: answers(scene, ensemble, jobs, asked.get(name, every[name]))
        for name in track(sorted(names), f"{len(jobs)} jobs")
    }
    table = compare(answered, answered[by])
    covered = {
        name: entry.simulated_s.sum() / every[name].time_step_s(scene) for name, entry in answered.items()
    }
    table["us_per_step"] = [
        1e6 * answered[name].processor_s.sum() / covered[name] for name in table["setting"]
    ]
    table["toppled"] = [float(answered[name].toppled.mean()) for name in table["setting"]]
    return table


def to_the_end(setting: Setting) -> Setting:
    """Options by which no shake ends because it has calmed down."""
    end = replace(setting.settings.termination, calmed_after=0.0)
    return replace(setting, settings=replace(setting.settings, termination=end))


def exact_errors() -> Iterable[str]:
    """Rows of the worst errors against exact answers by the presets."""
    for labels, cases in track(CASES, "exact cases"):
        worst = {preset: worst_errors(cases(preset), labels) for preset in PRESETS}
        for number, label in enumerate(labels):
            target = TARGET_OF_STANDARD.get(label)
            cells = " | ".join(f"{100 * worst[preset][number]:.3g} %" for preset in PRESETS)
            yield f"| {label} | {cells} | {f'{100 * target:g} %' if target else '-'} |"


PANELS = {
    "median_shift": "median PGA (%)",
    "share_shift": "share toppled (points)",
    "tilt_log_ratio": "tilt where both stand (%)",
}


def front_figure(table: pd.DataFrame) -> Figure:
    """Shift of the answers by each setting against its cost; bars of one standard deviation over jobs."""
    with style():
        figure = Figure(figsize=(FULL_WIDTH_IN, 2.9))
        for axes, (column, label) in zip(figure.subplots(1, 3, sharex=True), PANELS.items(), strict=True):
            axes.axhline(0.0, color="0.5", linewidth=0.8)
            for number, (_, row) in enumerate(table.iterrows()):
                axes.errorbar(
                    row["processor_s_per_job"], 100.0 * row[column], 100.0 * row[f"{column}_std"],
                    fmt="osD^vPX"[number % 7], ms=4.5, elinewidth=0.7, capsize=2, label=row["setting"],
                    color=COLOURS(number / len(table)), zorder=3,
                )  # fmt: skip
            axes.set_xscale("log")
            plain_log(axes.xaxis)
            axes.margins(x=0.15)
            axes.set_xlabel("cost (processor s per job)")
            axes.set_ylabel(f"shift of the\n{label}")
        figure.legend(*axes.get_legend_handles_labels(), loc="upper center", ncols=3, frameon=False)
        sns.despine(figure)
        figure.tight_layout(rect=(0.0, 0.0, 1.0, 1.0 - 0.07 * math.ceil(len(table) / 3)))
    return figure


def rows_of(table: pd.DataFrame, against: str) -> Iterable[str]:
    """Rows of a table of settings."""
    yield (
        "| setting | s a job | of MuJoCo 1/128 | µs a step | toppled | median PGA | share toppled | tilt | "
        "answers that differ |"
    )
    yield "|---|---|---|---|---|---|---|---|---|"
    peer = table.loc[table["setting"] == "mujoco fast", "processor_s_per_job"]
    for row in table.itertuples():
        times = f"{row.processor_s_per_job / peer.iloc[0]:.1f}" if len(peer) else "-"
        moved = (
            "- | - | - | -"
            if row.setting == against
            else f"{100 * row.median_shift:+.1f} ± {100 * row.median_shift_std:.1f} % "
            f"| {100 * row.share_shift:+.1f} ± {100 * row.share_shift_std:.1f} "
            f"| {100 * row.tilt_log_ratio:+.1f} ± {100 * row.tilt_log_ratio_std:.1f} % "
            f"| {row.flips_to_toppled} up, {row.flips_to_standing} down"
        )
        yield (
            f"| {row.setting} | {row.processor_s_per_job:.3f} | {times} | {row.us_per_step:.0f} "
            f"| {100 * row.toppled:.0f} % | {moved} |"
        )


def main() -> None:
    count, short = (
        int(sys.argv[n]) if len(sys.argv) > n else default for n, default in ((1, 100), (2, 2000))
    )
    ensemble = Ensemble.load(ROOT / "demo" / "ensemble")
    every = settings()
    parts = [
        "# Accuracy and cost\n",
        fill(
            f"Written by `benchmarks/front.py`, {date.today():%B %Y}, physics version "
            f"{PHYSICS_VERSION}; do not edit. The presets of "
            "both engines, and plain PyBullet with its own contacts and friction at steps of 1/240 to 1/4,000 s, "
            f"shake each body with the same {count} jobs (any record of the demo's ensemble, any "
            "azimuth, levels from .7 to 5 times the least static toppling acceleration). The tables give, "
            "relative to Bullet's `reference`, the shift of the PGA at which half topple, of the share that "
            "topples (points) and of the largest tilt of rocks that stand (mean log ratio), ± one standard "
            "deviation over jobs; single answers near a threshold are chaotic. Costs are processor time, and only "
            "their ratios are meaningful; MuJoCo's `fast` takes steps of 1/128 of sqrt(R/g).",
            110,
        )
        + "\n",
    ]
    for name, scene in scenes().items():
        jobs = draw(scene, ensemble, count)
        table = compared(scene, ensemble, jobs, every, CONVERGED)
        parts += [f"## {name[0].upper()}{name[1:]}\n", *rows_of(table, CONVERGED), ""]
    with tempfile.TemporaryDirectory() as folder:
        strong, rock = strong_parts(ensemble, Path(folder)), scenes()["demo's rock"]
        ends = {name: to_the_end(every[name]) for name in SHORT}
        table = compared(rock, strong, draw(rock, strong, short, seed=6), ends, "standard")
        save(front_figure(table), FIGURE)
        parts += [
            f"## {short} short jobs\n",
            "The demo's rock under the records' strong parts (5 to 75 % of the Arias intensity), against `standard`.\n",
            "![Shift of the answers against cost](front.png)\n",
            *rows_of(table, "standard"),
            "",
        ]
    parts += [
        "## Cases with exact answers\n",
        "The largest error over the cases of `benchmarks/exact_cases.py`, without shortcuts. `tests/verification`",
        "checks these cases, and harder ones, on every change.\n",
        f"| case | {' | '.join(PRESETS)} | target of `standard` |\n|---|---|---|---|---|",
        *exact_errors(),
    ]
    PAGE.write_text("\n".join(parts).rstrip() + "\n")
    print(PAGE.read_text())


if __name__ == "__main__":
    main()
