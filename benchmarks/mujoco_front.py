"""MuJoCo and the presets on the same front of error against cost, over cases with exact answers and a scanned rock.

    make demo && .venv/bin/python benchmarks/mujoco_front.py [FOLDER] [JOBS]

Writes mujoco.md into FOLDER (docs), its figure and its table as JSON into FOLDER/figures. About a quarter of an hour.
"""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import asdict
from functools import partial
from pathlib import Path
from textwrap import fill
from typing import Any

import mujoco
import numpy as np
import pandas as pd
import pybullet
import seaborn as sns
from exact_cases import CASES, TARGET_OF_STANDARD, case, slips, thresholds, worst_errors
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator, StrMethodFormatter
from mujoco_peer import Peer
from mujoco_peer import shake as shake_in_mujoco

from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.impose import impose
from toppling.models.motions.motion import Motion
from toppling.models.scene import Scene
from toppling.orchestrator.front import CONVERGED, Job, compare, draw_jobs
from toppling.results.figures import COLOURS, FULL_WIDTH_IN, save, style
from toppling.workers.options import PHYSICS_VERSION, PRESETS
from toppling.workers.seating import settled
from toppling.workers.shake import shake

ROOT = Path(__file__).parent.parent
SCENE, ENSEMBLE = ROOT / "demo" / "scene", ROOT / "demo" / "ensemble"
PGA_M_S2 = (3.0, 12.0)
STEP_SHARES = (1 / 512, 1 / 256, 1 / 128, 1 / 64, 1 / 32)
ROCK_STEP_SHARES = (1 / 2048, 1 / 512, 1 / 128, 1 / 64)
FINEST = "MuJoCo 1/2048"
COLUMNS = 3
"""Of the figure's panels."""

BLOCK_ROUNDS, BLOCK_STEPS = 3, 4000
LONG_S = 0.5
"""Shakes that cost less are repeated: the world of a new scene takes ten milliseconds, and is kept for a campaign."""


class Timed:
    """A shake that counts what it costs, without what it prepares once a scene.

    Parameters
    ----------
    shake_with : callable
        As `workers.shake`.
    shortcuts : bool
        Given instead of what the case asks for.
    bare_step_s : float
        Cost of a step of the bare loop.
    """

    def __init__(self, shake_with: Callable[..., Any], *, shortcuts: bool, bare_step_s: float) -> None:
        self._shake, self._shortcuts, self._bare_step_s = shake_with, shortcuts, bare_step_s
        self._prepared: Scene | None = None
        self.cpu_s = self.covered_s = self.bare_s = 0.0

    def __call__(self, scene: Scene, motion: Motion, preset: Any, **options: Any) -> Any:
        """Shake, once more where making the scene's world would weigh."""
        shake_once = partial(self._shake, scene, motion, preset, **{**options, "shortcuts": self._shortcuts})
        result, cpu_s = _timed(shake_once)
        if scene is not self._prepared and cpu_s < LONG_S:
            result, cpu_s = _timed(shake_once)
        self._prepared = scene
        self.cpu_s += cpu_s
        covered = result.simulated_s + result.skipped_s
        self.covered_s += covered
        self.bare_s += self._bare_step_s * covered / _step_s(preset, scene)
        return result


def _timed(run: Callable[[], Any]) -> tuple[Any, float]:
    began = time.thread_time()
    return run(), time.thread_time() - began


def _step_s(preset: Any, scene: Scene) -> float:
    share = preset.step_share if isinstance(preset, Peer) else PRESETS[preset].step_share
    return float(share * np.sqrt(scene.rock.half_diagonal_m / scene.gravity_m_s2))


@contextmanager
def cases_run_by(timed: Timed) -> Iterator[None]:
    """The cases ask the engine that their module names."""
    ours, case.shake = case.shake, timed
    try:
        yield
    finally:
        case.shake = ours


def bare_step_s() -> float:
    """Cost of setGravity, stepSimulation and getBasePositionAndOrientation for a block on eight spheres."""
    client = pybullet.connect(pybullet.DIRECT)
    b, h, radius = 0.2, 0.6, 6e-4
    corners = [[x, y, z] for x in (-b, b) for y in (-b, b) for z in (radius - h, h - radius)]
    shape = pybullet.createCollisionShapeArray(
        shapeTypes=[pybullet.GEOM_SPHERE] * 8, radii=[radius] * 8, collisionFramePositions=corners,
        physicsClientId=client,
    )  # fmt: skip
    plane = pybullet.createCollisionShape(pybullet.GEOM_PLANE, physicsClientId=client)
    pybullet.createMultiBody(0.0, plane, physicsClientId=client)
    block = pybullet.createMultiBody(1.0, shape, basePosition=[0.0, 0.0, h], physicsClientId=client)
    pybullet.changeDynamics(
        block, -1, activationState=pybullet.ACTIVATION_STATE_DISABLE_SLEEPING, physicsClientId=client
    )
    pybullet.setPhysicsEngineParameter(fixedTimeStep=1e-3, physicsClientId=client)
    pulls = (3.0 * np.sin(6e-3 * np.arange(BLOCK_STEPS))).tolist()
    costs = []
    for _ in range(BLOCK_ROUNDS):
        began = time.thread_time()
        for pull in pulls:
            pybullet.setGravity(pull, 0.0, -case.G, client)
            pybullet.stepSimulation(client)
            pybullet.getBasePositionAndOrientation(block, client)
        costs.append((time.thread_time() - began) / BLOCK_STEPS)
    pybullet.disconnect(client)
    return float(np.median(costs))


def exact_cases() -> pd.DataFrame:
    """One row for each engine, setting and case: the worst error and the cost."""
    rows = []
    settings: list[tuple[str, Callable[..., Any], Any, bool]]
    settings = [(f"MuJoCo 1/{1 / share:.0f}", shake_in_mujoco, Peer(share), False) for share in STEP_SHARES]
    settings += [(preset, shake, preset, shortcuts) for shortcuts in (False, True) for preset in PRESETS]
    for name, shake_with, preset, shortcuts in settings:
        bare_s = bare_step_s()
        for labels, run in CASES:
            if shortcuts and run not in (thresholds, slips):
                continue  # they start in motion
            timed = Timed(shake_with, shortcuts=shortcuts, bare_step_s=bare_s)
            with cases_run_by(timed):
                errors = worst_errors(run(preset), labels)
            rows += [
                {
                    "engine": "MuJoCo" if isinstance(preset, Peer) else "toppling",
                    "setting": name,
                    "shortcuts": shortcuts,
                    "case": label,
                    "worst_error": float(error) if np.isfinite(error) else None,
                    "cpu_ms_per_simulated_s": 1e3 * timed.cpu_s / timed.covered_s,
                    "ratio_to_bare_loop": timed.cpu_s / timed.bare_s,
                    "bare_loop_us_per_step": 1e6 * bare_s,
                }
                for label, error in zip(labels, errors, strict=True)
            ]
    return pd.DataFrame(rows)


def scanned_rock(count: int) -> pd.DataFrame:
    """Answers on the demo's rock: flips against our converged preset and against MuJoCo's finest step."""
    jobs = draw_jobs(Ensemble.load(ENSEMBLE), count, PGA_M_S2)
    asked: dict[str, Callable[..., Any]] = {
        f"MuJoCo 1/{1 / share:.0f}": partial(shake_in_mujoco, preset=Peer(share))
        for share in ROCK_STEP_SHARES
    }
    asked |= {f"{name}, shortcuts": partial(shake, preset=name) for name in PRESETS}
    asked |= {name: partial(shake, preset=name, shortcuts=False) for name in ("fast", "standard")}
    with ProcessPoolExecutor(2, initializer=_load) as pool:
        said = {name: pd.DataFrame(pool.map(partial(_rock_job, ask), jobs)) for name, ask in asked.items()}
    table = compare(said, said[f"{CONVERGED}, shortcuts"])
    finest = compare(said, said[FINEST])
    for column in ("flips_share", "flips_to_toppled", "flips_to_standing"):
        table[f"{column}_against_finest_mujoco"] = finest[column]
    table["toppled"] = [int(said[name].toppled.sum()) for name in table["setting"]]
    return table.drop(
        columns=["median_shift", "tilt_log_ratio", "tilt_log_ratio_std", "largest_penetration_share"]
    )


_ASSETS: list[tuple[Scene, Ensemble]] = []


def _load() -> None:
    _ASSETS[:] = [(settled(Scene.load(SCENE)), Ensemble.load(ENSEMBLE))]


def _rock_job(ask: Callable[..., Any], job: Job) -> dict[str, Any]:
    scene, ensemble = _ASSETS[0]
    motion = impose(ensemble.record(job.record_id), job.pga_m_s2, job.azimuth_deg).motion
    result, cpu_s = _timed(partial(ask, scene, motion))
    return asdict(job) | {
        "toppled": bool(result.toppled),
        "max_tilt_deg": result.max_tilt_deg,
        "processor_s": cpu_s,
        "simulated_s": result.simulated_s,
        "penetration_share": np.nan,
    }


def figure_of(cases: pd.DataFrame, rock: pd.DataFrame, count: int) -> Figure:
    """A panel for each case, and one for the scanned rock."""
    labels = [label for labels, _ in CASES for label in labels]
    looks = {
        ("MuJoCo", False): {"color": "0.45", "marker": "s", "label": "MuJoCo, steps 1/512 to 1/32"},
        ("toppling", False): {"color": COLOURS(0.3), "marker": "o", "label": "presets"},
        ("toppling", True): {
            "color": COLOURS(0.3), "marker": "o", "mfc": "white", "ls": ":", "label": "presets with shortcuts"
        },
    }  # fmt: skip
    with style():
        figure = Figure(figsize=(FULL_WIDTH_IN, 8.5))
        panels = figure.subplots(math.ceil((len(labels) + 1) / COLUMNS), COLUMNS).ravel()
        for axes, label in zip(panels, labels, strict=False):
            shown = cases[(cases["case"] == label) & cases["worst_error"].notna()]
            for key, line in shown.groupby(["engine", "shortcuts"]):
                error = np.maximum(100.0 * line["worst_error"].astype(float), 1e-3)
                axes.plot(line["cpu_ms_per_simulated_s"], error, ms=3.5, lw=0.9, **looks[key])
            if label in TARGET_OF_STANDARD:
                axes.axhline(100.0 * TARGET_OF_STANDARD[label], color="0.7", lw=0.7, ls="--", zorder=0)
            axes.set(xscale="log", yscale="log", title=label)
            axes.margins(x=0.1, y=0.15)
            _few_numbers(axes.yaxis)
        axes = panels[len(labels)]
        shortcuts = rock["setting"].str.contains("shortcuts")
        engine = np.where(rock["setting"].str.startswith("MuJoCo"), "MuJoCo", "toppling")
        for key, line in rock.groupby([engine, shortcuts]):
            axes.plot(
                line["processor_s_per_job"], 100.0 * line["toppled"] / count, ms=3.5, lw=0.9, **looks[key]
            )
        axes.set(xscale="log", title=f"scanned rock, {count} jobs", xlabel="processor s per job")
        axes.set(ylim=(0.0, None), ylabel="jobs that topple (%)")
        for axes in panels[len(labels) - COLUMNS : len(labels)]:
            axes.set_xlabel("processor ms per simulated s")
        for axes in panels[0 : len(labels) : COLUMNS]:
            axes.set_ylabel("worst error (%)")
        for axes in panels[: len(labels) + 1]:
            _few_numbers(axes.xaxis)
        for axes in panels[len(labels) + 1 :]:
            axes.set_axis_off()
        all_looks = panels[labels.index("overturning threshold")].get_legend_handles_labels()
        figure.legend(*all_looks, ncols=3, loc="upper center", frameon=False)
        sns.despine(figure)
        figure.tight_layout(rect=(0.0, 0.0, 1.0, 0.97))
    return figure


def _few_numbers(axis: Axis) -> None:
    low, high = axis.get_view_interval()
    axis.set_major_locator(LogLocator(subs=(1.0,) if high > 40.0 * low else (1.0, 3.0)))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_locator(NullLocator())


def _page(cases: pd.DataFrame, rock: pd.DataFrame, count: int) -> str:
    bare = cases["bare_loop_us_per_step"]
    told = fill(
        f"Written by `benchmarks/mujoco_front.py`; do not edit. MuJoCo {mujoco.__version__} with the best settings "
        "found for hard contact (`benchmarks/mujoco_peer.py` names them and what else was tried), in calls of 256 "
        f"steps of C, against the presets of physics version {PHYSICS_VERSION} in the program's own loop. Steps are "
        "shares of sqrt(R/g). Errors are the worst over the cases named in the benchmark, against exact answers; "
        "without shortcuts unless said. Costs are processor time on a shared two-core machine: only their ratios mean "
        "anything. The bare loop is PyBullet's step of a block on eight spheres, "
        f"{bare.min():.1f} to {bare.max():.1f} us, at the same time step. The dashed lines are the targets of "
        "`standard`. Left out is what MuJoCo has not: Newton's restitution, and a kinetic friction unlike the static "
        "one.",
        110,
    )
    head = f"# MuJoCo and the presets\n\n{told}\n\n![Error against cost](figures/mujoco_front.png)\n\n"
    wide = cases.assign(
        setting=cases["setting"] + np.where(cases["shortcuts"], ", shortcuts", ""),
        text=[
            f"{100 * e:.3g} % / {m:.1f} ms / {r:.1f}" if pd.notna(e) else f"fails / {m:.1f} ms / {r:.1f}"
            for e, m, r in zip(
                cases["worst_error"].astype(float),
                cases["cpu_ms_per_simulated_s"],
                cases["ratio_to_bare_loop"],
                strict=True,
            )
        ],
    )
    names = [label for labels, _ in CASES for label in labels]
    lines = ["Worst error / cost of a simulated second / cost over that of the bare loop:\n"]
    lines += ["| setting | " + " | ".join(names) + " |", "|---" * (len(names) + 1) + "|"]
    for setting, part in wide.groupby("setting", sort=False):
        texts = part.set_index("case")["text"]
        lines.append(f"| {setting} | " + " | ".join(texts.get(name, "-") for name in names) + " |")
    lines += [
        f"\nThe demo's scanned rock, {count} jobs of {PGA_M_S2[0]:g} to {PGA_M_S2[1]:g} m/s2. Flips to toppled and "
        f"to standing, against the preset `{CONVERGED}` and\nagainst MuJoCo at a step of 1/2048:\n",
        "| setting | toppled | unlike ours | unlike MuJoCo's | processor s per job | ms per simulated s |",
        "|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {row.setting} | {row.toppled} | {row.flips_to_toppled} up, {row.flips_to_standing} down "
        f"| {row.flips_to_toppled_against_finest_mujoco} up, {row.flips_to_standing_against_finest_mujoco} down "
        f"| {row.processor_s_per_job:.2f} | {1e3 * row.processor_s_per_simulated_s:.1f} |"
        for row in rock.itertuples()
    ]
    return head + "\n".join(lines) + "\n"


def main() -> None:
    """Measure, draw and write."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs"
    count = int(sys.argv[2]) if len(sys.argv) > 2 else 60
    (folder / "figures").mkdir(parents=True, exist_ok=True)
    cases = exact_cases()
    rock = scanned_rock(count)
    save(figure_of(cases, rock, count), folder / "figures" / "mujoco_front")
    told = {
        "mujoco": mujoco.__version__,
        "cases": json.loads(cases.to_json(orient="records", double_precision=6)),
        "scanned_rock_jobs": count,
        "scanned_rock": json.loads(rock.to_json(orient="records", double_precision=6)),
    }
    (folder / "figures" / "mujoco_front.json").write_text(json.dumps(told, indent=1) + "\n")
    page = _page(cases, rock, count)
    (folder / "mujoco.md").write_text(page)
    print(page)


if __name__ == "__main__":
    main()
