"""Error against cost of the presets: answers that flip, time, thresholds, cases with exact answers, hard cases.

    make demo && .venv/bin/python benchmarks/accuracy.py [JOBS [JOBS_OF_PRESETS]]

Writes docs/accuracy.md with its figure, and results/preset_budget.json for the report of a run. Thresholds are compared
with the exact integrator, answers with those of the preset `reference` on the demo's scanned rock and records. The
presets may be given more of the jobs than what is compared with them. Answers are kept in benchmarks/answers, a file a
setting: a later call with more jobs goes on, on another machine too where its demo makes the same scene.
"""

import json
import re
import subprocess
import sys
import tempfile
from dataclasses import replace
from functools import partial
from pathlib import Path
from textwrap import fill
from xml.etree import ElementTree

import numpy as np
import pandas as pd
from exact_cases import CASES, TARGET_OF_STANDARD, worst_errors
from representations import compared, threshold_errors
from rich.progress import Progress

from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.motion import Motion
from toppling.models.scene import Scene
from toppling.orchestrator.front import (
    CONVERGED,
    FLOOR,
    LEAST_TILT_DEG,
    Job,
    Setting,
    answers,
    compare,
    disturbed_motions,
    draw_jobs,
)
from toppling.results.figures import front_figure, save
from toppling.workers.options import PHYSICS_VERSION, PRESETS
from toppling.workers.shake import shake

ROOT = Path(__file__).parent.parent
PAGE, FIGURE = ROOT / "docs" / "accuracy.md", ROOT / "docs" / "figures" / "accuracy_front"
BUDGET = ROOT / "results" / "preset_budget.json"
SCENE, ENSEMBLE = ROOT / "demo" / "scene", ROOT / "demo" / "ensemble"
KEPT = ROOT / "benchmarks" / "answers"
PGA_M_S2 = (3.0, 12.0)
FINER = f"{CONVERGED}, half the step"
HALF_STEP = replace(PRESETS[CONVERGED], step_share=0.5 * PRESETS[CONVERGED].step_share)
FLOOR_OF_MOTION = f"{CONVERGED}, motion times 1 + 1e-6"
DISTURBANCES = (1e-6, 1e-5, 1e-4, 1e-3)


def case_errors() -> pd.DataFrame:
    """Worst error of each kind of exact case (index) with each preset (columns)."""
    return pd.DataFrame(
        {
            preset: {
                label: error
                for labels, run in CASES
                for label, error in zip(labels, worst_errors(run(preset), labels), strict=True)
            }
            for preset in PRESETS
        }
    )


def hard_cases() -> list[tuple[str, int, int]]:
    """Each law of the hard cases, how many cases it has, and in how many it holds: from their tests."""
    with tempfile.NamedTemporaryFile(suffix=".xml") as report:
        subprocess.run(
            [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-m", "slow or not slow",
             f"--junitxml={report.name}", str(ROOT / "tests" / "verification" / "hard")],
            check=False, cwd=ROOT, stdout=subprocess.DEVNULL,
        )  # fmt: skip
        tests = list(ElementTree.parse(report.name).iter("testcase"))
    laws: dict[str, list[bool]] = {}
    for test in tests:
        name = test.attrib["name"].split("[")[0].removeprefix("test_")
        name = re.sub(r"(\d)_(\d{3})", r"\1.\2", re.sub(r"(\de)_(\d)", r"\1-\2", name)).replace("_", " ")
        laws.setdefault(name, []).append(len(test) == 0)  # children: failure, error or an expected failure
    return [(law, len(held), sum(held)) for law, held in laws.items()]


def main() -> None:
    """Measure and write the page."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 300
    of_presets = int(sys.argv[2]) if len(sys.argv) > 2 else count
    scene, ensemble = Scene.load(SCENE), Ensemble.load(ENSEMBLE)
    all_jobs = draw_jobs(ensemble, of_presets, PGA_M_S2)
    jobs = all_jobs[:count]
    settings = {name: Setting(one) for name, one in PRESETS.items()} | {
        "fast, no shortcuts": Setting(PRESETS["fast"], shortcuts=False),
        FLOOR: Setting(PRESETS[CONVERGED], disturbed_toward_deg=0.0),
        FLOOR_OF_MOTION: Setting(PRESETS[CONVERGED]),
        FINER: Setting(HALF_STEP),
    }
    with Progress() as progress:
        asked = {name: all_jobs if name in PRESETS else jobs for name in settings}
        asked[FLOOR_OF_MOTION] = disturbed_motions(jobs)
        task = progress.add_task("shaking", total=sum(map(len, asked.values())))
        said = {
            name: answers(scene, ensemble, asked[name], one, kept=KEPT, seen=lambda: progress.advance(task))
            for name, one in settings.items()
        }
    table = compare(said, said[CONVERGED])
    errors = {name: np.array(threshold_errors(partial(_topples, name))) for name in PRESETS}
    worst = {name: float(np.abs(error).max()) for name, error in errors.items()}
    table["largest_threshold_error"] = table["setting"].map(worst)
    save(front_figure(table, FLOOR), FIGURE)
    page = _page(table, count, float(said[CONVERGED].toppled.mean()))
    PAGE.write_text(page)
    flips = table.set_index("setting")
    told = {
        "physics_version": PHYSICS_VERSION,
        "jobs": of_presets,
        "toppled_share": round(float(said[CONVERGED].toppled.mean()), 4),
        "floor_of_chaos": round(float(flips.loc[FLOOR, "flips_share"]), 4),
        "floor_of_chaos_of_motion": round(float(flips.loc[FLOOR_OF_MOTION, "flips_share"]), 4),
        "flips_of_half_the_step": round(float(flips.loc[FINER, "flips_share"]), 4),
        "presets": {
            name: {
                "flips_to_toppled": int(flips.loc[name, "flips_to_toppled"]),
                "flips_to_standing": int(flips.loc[name, "flips_to_standing"]),
                "largest_threshold_error": round(worst[name], 6),
            }
            for name in PRESETS
        },
    }
    BUDGET.write_text(json.dumps(told, indent=1) + "\n")
    # Each takes minutes: what was measured before one that fails is on the page already.
    sections = (
        partial(_disturbances, scene, ensemble, jobs, said["fast"].iloc[:count]),
        partial(_representations, errors),
        _hard_cases,
        _exact_cases,
    )
    for section in sections:
        page += section()
        PAGE.write_text(page)
    print(PAGE.read_text())


def _topples(preset: str, scene: Scene, motion: Motion) -> bool:
    return bool(shake(scene, motion, preset).toppled)


def _disturbances(scene: Scene, ensemble: Ensemble, jobs: list[Job], at_rest: pd.DataFrame) -> str:
    undisturbed = Setting(PRESETS["fast"])
    asked: dict[str, tuple[list[Job], Setting]] = {}
    for share in DISTURBANCES:
        start = replace(undisturbed, disturbed_toward_deg=0.0, disturbed_share=share)
        asked |= {f"start {share}": (jobs, start)}
        asked |= {f"motion {share}": (disturbed_motions(jobs, share), undisturbed)}
    with Progress() as progress:
        task = progress.add_task("disturbing", total=len(jobs) * len(asked))
        said = {
            name: answers(scene, ensemble, some, one, kept=KEPT, seen=lambda: progress.advance(task))
            for name, (some, one) in asked.items()
        }
    told = {
        row.setting: f"{100 * row.flips_share:.1f} % ({row.flips_to_toppled} up, {row.flips_to_standing} down)"
        for row in compare(said, at_rest).itertuples()
    }
    return "\n".join(
        [
            "\n## Flips against the size of a disturbance\n",
            f"The same {len(jobs)} jobs with `fast` against `fast` itself. Start: the rock is raised by a share of its",
            "height and tilted by as much; it falls back and lies flat before it is shaken, so much is forgotten.",
            "Motion: multiplied by 1 + the share, as errors made on the way, such as a step's, last.\n",
            "| disturbed by | start: answers that flip | motion: answers that flip |",
            "|---|---|---|",
            *(
                f"| {share:.0e} | {told[f'start {share}']} | {told[f'motion {share}']} |"
                for share in DISTURBANCES
            ),
            "",
        ]
    )


def _representations(ours: dict[str, np.ndarray]) -> str:
    return "\n".join(
        [
            "\n## Contact representations\n",
            "The same thresholds in a bare loop of Bullet over its own shapes, and with the presets, whose points are",
            "the vertices of the rock's convex hull and whose steps end at landings. Steps are shares of sqrt(R/g).\n",
            "| representation | step | mean error | largest |",
            "|---|---|---|---|",
            *(
                f"| {row.representation} | 1/{1 / row.step:.0f} | {100 * row.mean:+.3f} % | {100 * row.largest:.3f} % |"
                for row in compared().itertuples()
            ),
            *(
                f"| points, landings resolved (`{name}`) | 1/{1 / PRESETS[name].step_share:.0f} "
                f"| {100 * error.mean():+.3f} % | {100 * np.abs(error).max():.3f} % |"
                for name, error in ours.items()
            ),
            "",
        ]
    )


def _hard_cases() -> str:
    return "\n".join(
        [
            "\n## Hard cases\n",
            "The laws of `tests/verification/hard`, and in how many of their cases they hold.\n",
            "| law | cases | held |",
            "|---|---|---|",
            *(f"| {law} | {count} | {held} |" for law, count, held in hard_cases()),
            "",
        ]
    )


def _exact_cases() -> str:
    cases = case_errors()
    finer = np.log(PRESETS["standard"].step_share / PRESETS["reference"].step_share)
    lines = [
        "\n## Cases with exact answers\n",
        "The worst error over the cases of `benchmarks/exact_cases.py`, without shortcuts. Order: of the error in the",
        "time step, between `standard` and `reference`; where an error is that of the case (sides of a polygon, the",
        "bracket of a bisection) and not of the step it is low, and where the rock starts at rest: until it has lifted",
        "`standard` takes steps as short as those of `reference`.\n",
        f"| case | {' | '.join(PRESETS)} | order | target of `standard` |",
        "|---" * (len(PRESETS) + 3) + "|",
    ]
    for label, row in cases.iterrows():
        order = np.log(row["standard"] / row["reference"]) / finer
        target = f"{100 * TARGET_OF_STANDARD[label]:g} %" if label in TARGET_OF_STANDARD else "-"
        told = " | ".join(f"{100 * row[name]:.3g} %" for name in PRESETS)
        lines.append(f"| {label} | {told} | {order:.1f} | {target} |")
    return "\n".join([*lines, ""])


def _page(table: pd.DataFrame, count: int, toppled: float) -> str:
    told = fill(
        f"Written by `benchmarks/accuracy.py` with physics version {PHYSICS_VERSION}; do not edit. Thresholds: least "
        "full sine that overturns a block of alpha 9.5, 18.4 and 33.7 degrees (half height 0.6 m, periods 1 and "
        "1.5 s), against the exact integrator of `workers/reference`. Flips: jobs on the demo's scanned rock "
        f"(any record of its ensemble, {PGA_M_S2[0]:g} to {PGA_M_S2[1]:g} m/s2, any azimuth) against the preset "
        f"`{CONVERGED}`, {100 * toppled:.0f} % of which topple; after ± one standard deviation. *Disturbed* is "
        f"`{CONVERGED}` itself from a start disturbed by a millionth of the rock's height: the floor of chaos, dashed "
        "in the figure; *motion times* disturbs the motion instead, which is not forgotten; *half the step* says how "
        "far it is itself from converged. Median: the PGA at which one in two topples. Tilt: mean log ratio of the "
        f"largest tilts where both stand (those below {LEAST_TILT_DEG:g} degrees count as that), ± its standard error. "
        f"Costs: the processor's, of the first {count} jobs, on a machine of two cores; only their "
        "ratios mean anything.",
        110,
    )
    head = (
        f"# Accuracy and cost of the presets\n\n{told}\n\n![Flips against cost](figures/accuracy_front.png)\n\n"
        "| setting | largest threshold error | jobs | answers that flip | sign test p | shift of the median | tilt "
        "| ms per simulated s | s per job | deepest penetration / R |\n|---|---|---|---|---|---|---|---|---|---|\n"
    )
    rows = []
    for row in table.itertuples():
        error = row.largest_threshold_error
        threshold = "-" if np.isnan(error) else f"{100 * error:.3f} %"
        rows.append(
            f"| {row.setting} | {threshold} | {row.jobs}{f' ({row.no_answer} more have none)' * (row.no_answer > 0)} "
            f"| {100 * row.flips_share:.1f} ± {100 * row.flips_share_std:.1f} % "
            f"({row.flips_to_toppled} up, {row.flips_to_standing} down) | {row.sign_test_p:.2f} "
            f"| {100 * row.median_shift:+.2f} % | {row.tilt_log_ratio:+.2f} ± {row.tilt_log_ratio_std:.2f} "
            f"| {1e3 * row.processor_s_per_simulated_s:.1f} "
            f"| {row.processor_s_per_job:.2f} | {row.largest_penetration_share:.1e} |"
        )
    return head + "\n".join(rows) + "\n"


if __name__ == "__main__":
    main()
