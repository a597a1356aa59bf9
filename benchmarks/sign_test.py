"""Whether a preset leans: as many answers flipped to toppled as to standing, over thousands of short jobs.

    make demo && .venv/bin/python benchmarks/sign_test.py [JOBS [JOBS_OF_REFERENCE_AGAINST_ITSELF]]

Writes docs/sign_test.md. As benchmarks/accuracy.py, on the demo's scanned rock, but of each record only its strong part
shakes, and a job ends once its answer is known: thousands of jobs in hours where whole records take a day. Answers
are kept in benchmarks/answers/sign_test.parquet: a call that is interrupted, or one with more jobs, goes on, also on
another machine. The demo's scan is another one there, since rays and meshes differ on another processor: the answers of
all settings to one job come from one scan. Whoever changes the demo's rock or records removes the file.
"""

import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from textwrap import fill

import numpy as np
import pandas as pd
from accuracy import (
    ENSEMBLE,
    FINER,
    FLOOR_OF_MOTION,
    HALF_STEP,
    PGA_M_S2,
    ROOT,
    SCENE,
)
from rich.progress import Progress
from scipy.stats import binomtest

from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.motion import Motion
from toppling.models.motions.processing import end_at_rest, taper
from toppling.models.motions.record import Record
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
from toppling.workers.options import PHYSICS_VERSION, PRESETS, NumericalOptions

PAGE = ROOT / "docs" / "sign_test.md"
KEPT = ROOT / "benchmarks" / "answers" / "sign_test.parquet"
SHARES = (0.05, 0.75)
"""Of the record's horizontal Arias intensity, between which its strong part lies: the significant duration D5-75."""

AT_ONCE = 250
"""Jobs for which all settings answer before the next: what an interruption leaves compares."""

Asked = dict[str, tuple[list[Job], Setting]]


def strong_parts(ensemble: Ensemble, folder: Path) -> Ensemble:
    """The strong part of each record, tapered, the ground at rest after it; written to a folder."""
    return Ensemble.write(
        folder,
        [
            Record.of(
                name,
                end_at_rest(taper(_strong_part(ensemble.record(name).motion))),
                component_azimuths_deg=(0.0, 90.0),
            )
            for name in ensemble.record_ids
        ],
    )


def _strong_part(motion: Motion) -> Motion:
    growth = np.cumsum((motion.acceleration_m_s2[:, :2] ** 2).sum(axis=1))
    first, last = np.searchsorted(growth / growth[-1], SHARES)
    return Motion(motion.acceleration_m_s2[first : last + 1], motion.time_step_s)


def until_certain(options: NumericalOptions) -> NumericalOptions:
    """Only whether the rock topples is asked: it need not come to rest once its energy cannot overturn it any more."""
    return replace(options, termination=replace(options.termination, calmed_after=0.0))


def main() -> None:
    """Measure and write the page."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 5000
    of_itself = int(sys.argv[2]) if len(sys.argv) > 2 else min(count, 500)
    scene = Scene.load(SCENE)
    with tempfile.TemporaryDirectory() as folder, Progress() as progress:
        ensemble = strong_parts(Ensemble.load(ENSEMBLE), Path(folder))
        jobs = draw_jobs(ensemble, count, PGA_M_S2)
        first_jobs, converged = jobs[:of_itself], until_certain(PRESETS[CONVERGED])
        asked: Asked = {name: (jobs, Setting(until_certain(one))) for name, one in PRESETS.items()}
        asked[FLOOR] = first_jobs, Setting(converged, disturbed_toward_deg=0.0)
        asked[FLOOR_OF_MOTION] = disturbed_motions(first_jobs), Setting(converged)
        asked[FINER] = first_jobs, Setting(until_certain(HALF_STEP))
        kept = _kept()
        elsewhere = set(of_one_scan(kept, asked)["number"])
        task = progress.add_task("shaking", total=sum(len(some) for some, _ in asked.values()))
        for first in range(0, count, AT_ONCE):
            for name, (some, setting) in asked.items():
                here = set(range(first, min(first + AT_ONCE, len(some))))
                known = kept["number"][(kept["setting"] == name) & (kept["scene_id"] == scene.id)]
                missing = sorted(here - elsewhere - set(known))
                progress.advance(task, len(here) - len(missing))
                if missing:
                    said = answers(
                        scene,
                        ensemble,
                        [some[number] for number in missing],
                        setting,
                        seen=lambda: progress.advance(task),
                    ).assign(number=missing, setting=name, scene_id=scene.id, physics=PHYSICS_VERSION)
                    kept = pd.concat([kept, said], ignore_index=True)
                    kept.to_parquet(part := KEPT.with_suffix(".part"))
                    part.rename(KEPT)
        duration_s = float(
            np.median([ensemble.record(name).motion.duration_s for name in ensemble.record_ids])
        )
    whole = of_one_scan(kept, asked)
    of_setting = {
        name: whole[whole["setting"] == name].sort_values("number", ignore_index=True) for name in asked
    }
    table = compare(of_setting, of_setting[CONVERGED])
    scans = whole.groupby("scene_id")["number"].nunique()
    PAGE.write_text(_page(table, float(of_setting[CONVERGED].toppled.mean()), duration_s, scans))
    print(PAGE.read_text())


def _kept() -> pd.DataFrame:
    """Answers of this physics version; of presets too, since who changes one of them counts the version up."""
    if not KEPT.exists():
        return pd.DataFrame({"number": [], "setting": [], "scene_id": []})
    kept = pd.read_parquet(KEPT)
    return kept[kept["physics"] == PHYSICS_VERSION]


def of_one_scan(kept: pd.DataFrame, asked: Asked) -> pd.DataFrame:
    """Of each job the answers on the first of the scans on which every setting that is asked has answered it."""
    sizes = {name: len(some) for name, (some, _) in asked.items()}
    kept = kept[kept["number"] < kept["setting"].map(sizes)]
    settings = kept["number"].map(lambda number: sum(number < size for size in sizes.values()))
    whole = kept[kept.groupby(["number", "scene_id"])["setting"].transform("size") == settings]
    return whole[whole["scene_id"] == whole.groupby("number")["scene_id"].transform("first")]


def _page(table: pd.DataFrame, toppled: float, duration_s: float, scans: pd.Series) -> str:
    low, high = (f"{100 * share:.0f}" for share in SHARES)
    told = fill(
        f"Written by `benchmarks/sign_test.py` with physics version {PHYSICS_VERSION}; do not edit. Jobs on the demo's "
        f"rock ({' and '.join(map(str, scans))} on {len(scans)} of its scans; on another processor its mesh is another "
        f"one): the part of any record of its ensemble between {low} and {high} % of its Arias intensity "
        f"(median {duration_s:.0f} s), {PGA_M_S2[0]:g} to {PGA_M_S2[1]:g} m/s2, any azimuth; {100 * toppled:.0f} % "
        f"topple. Answers are compared with those of `{CONVERGED}`; *disturbed* is itself from a start disturbed by a "
        "millionth of the rock's height, which is forgotten as the rock lies flat again; *motion times* disturbs the "
        "motion instead; *half the step* says how far it is itself from converged. Share of up: of the flips those to "
        "toppled, with the interval that holds it at 95 %; without a lean it is a half. Tilt: mean log ratio of the "
        f"largest tilts where both stand (those below {LEAST_TILT_DEG:g} degrees count as that), ± its standard error: "
        "it tells a lean with far fewer jobs.",
        110,
    )
    head = (
        f"# Do the presets lean?\n\n{told}\n\n"
        "| setting | jobs | answers that flip | to toppled | to standing | share of up | sign test p "
        "| shift of the median | tilt |\n|---|---|---|---|---|---|---|---|---|\n"
    )
    rows = []
    for row in table[table["setting"] != CONVERGED].itertuples():
        up, down = row.flips_to_toppled, row.flips_to_standing
        bounds = binomtest(up, up + down).proportion_ci() if up + down else None
        share = f"{up / (up + down):.2f} ({bounds.low:.2f} to {bounds.high:.2f})" if bounds else "-"
        rows.append(
            f"| {row.setting} | {row.jobs} | {100 * row.flips_share:.1f} ± {100 * row.flips_share_std:.1f} % "
            f"| {up} | {down} | {share} | {row.sign_test_p:.2f} | {100 * row.median_shift:+.2f} ± "
            f"{100 * row.median_shift_std:.2f} % "
            f"| {row.tilt_log_ratio:+.3f} ± {row.tilt_log_ratio_std:.3f} |"
        )
    return head + "\n".join(rows) + "\n"


if __name__ == "__main__":
    main()
