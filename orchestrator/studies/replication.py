"""The whole study of Veeraraghavan, Hudnut and Krishnan (2017) on any rock and records, stage by stage, resumable."""

import contextlib
import dataclasses
import json
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from distributed import Client

from toppling.models.errors import InputError
from toppling.models.files.csv_text import write_csv
from toppling.models.files.digest import write_json
from toppling.models.files.documents import read_json
from toppling.models.files.folder import write_text
from toppling.models.frames import apart_deg
from toppling.models.motions.ensemble import Ensemble
from toppling.models.scene import Scene
from toppling.orchestrator.campaign import Campaign
from toppling.orchestrator.context import ProgressCallback, RunProgress
from toppling.orchestrator.plan import plan_of
from toppling.orchestrator.public.fragility_figures import Bins, fragility
from toppling.orchestrator.run import run
from toppling.orchestrator.studies import ramp
from toppling.orchestrator.studies.audit import Auditing
from toppling.results.analysis.audit_statistics import audits_of
from toppling.results.analysis.directions import SECTOR_DEG
from toppling.results.analysis.findings import Finding, findings
from toppling.results.analysis.fragility import PLANES
from toppling.results.drawing import study_figures
from toppling.results.drawing.run_figures import write_friction
from toppling.results.drawing.style import save
from toppling.results.reader import open_run
from toppling.workers.engines import DEFAULT

RUNS = MAIN, _FRICTION = "main", "friction"
"""Names of the study's two runs: friction 1 in all directions, and lower frictions in the weakest."""

_FRICTIONS = (0.6, 0.8)

_NUMBERED = {
    "pga_pgv_pga": "figure_06_all_directions",
    "pga_pgv_pga_by_direction": "figure_06",
    "pga_pgv_pga_by_direction_reference": "figure_06_reference_lines",
    "pga_pgv": "figure_09",
    "pga_pgv_by_direction": "figure_09_by_direction",
    "pgv_duration": "figure_10a",
    "pga_duration": "figure_10b",
    "friction": "figure_11",
    "friction_cells": "figure_11_cells",
    "friction_jobs": "figure_11_jobs",
    "directions": "toppling_azimuths",
    "sector": "toppling_azimuths_sector",
}
"""What the atlas draws, by the number that it has in the study."""

_Say = Callable[[str], None]
_ClusterOf = Callable[[], AbstractContextManager[Client]]


@dataclass(frozen=True)
class Study:
    """What is studied."""

    pga_m_s2: tuple[float, ...] = tuple(float(level) for level in range(1, 20))
    azimuth_deg: tuple[float, ...] = tuple(45.0 * number for number in range(8))
    preset: str = "standard"
    audit: int | None = None  # of both runs, as in a campaign
    engine: str = DEFAULT

    def check(self, out: Path) -> None:
        """Make sure that a folder is new or of this study.

        Raises
        ------
        InputError
            If it is another's.
        """
        path, protocol = out / "study.json", json.loads(json.dumps(dataclasses.asdict(self)))
        there = dataclasses.asdict(Study()) | (read_json(path) if path.exists() else protocol)
        differing = ", ".join(key for key in protocol if there.get(key) != protocol[key])
        if differing:
            raise InputError(
                f"the folder holds a study of other {differing}",
                where=str(out),
                expected="the options that it was begun with",
                remedy="give another folder, or the same options to go on",
            )
        write_json(path, protocol)

    def campaigns(self, out: Path) -> dict[str, Campaign]:
        """The two campaigns, on scene and ensemble in the study's folder."""
        weakest = _nearest_deg(_weakest_azimuth_deg(Scene.load(out / "scene")), self.azimuth_deg)
        main = Campaign(
            scene=out / "scene",
            ensemble=out / "ensemble",
            pga_m_s2=self.pga_m_s2,
            azimuth_deg=self.azimuth_deg,
            friction=((1.0, 1.0),),
            preset=self.preset,
            audit=self.audit,
            engine=self.engine,
        )
        lower = tuple((value, value) for value in _FRICTIONS)
        return {MAIN: main, _FRICTION: dataclasses.replace(main, azimuth_deg=(weakest,), friction=lower)}


def _weakest_azimuth_deg(scene: Scene) -> float:
    """Azimuth of the ground's acceleration with the least quasi-static toppling, as the scene's folder tells it."""
    table = {row["azimuth_deg"]: row["value"] for row in scene.to_json()["quasi_static_toppling_m_s2"]}
    finite = {azimuth: value for azimuth, value in table.items() if value is not None}
    return float(min(finite, key=lambda azimuth: finite[azimuth])) if finite else 0.0


def _nearest_deg(azimuth_deg: float, among: Sequence[float]) -> float:
    """Nearest of some azimuths around the circle."""
    return min(among, key=lambda one: float(apart_deg(one, azimuth_deg)))


def carry_out(
    study: Study,
    out: Path,
    cluster_of: _ClusterOf,
    watcher: Callable[[], AbstractContextManager[ProgressCallback]],
    say: _Say,
) -> list[RunProgress]:
    """Shake: the two runs and the ramp, each going on where it was stopped."""
    progresses = []
    for name, campaign in study.campaigns(out).items():
        path = out / "runs" / name
        path.parent.mkdir(exist_ok=True)
        values = ", ".join(f"{static:g}" for static, _ in campaign.friction)
        say(f"run {name}: {len(campaign.azimuth_deg)} azimuths, friction {values}")
        with watcher() as watch:
            progresses.append(run(plan_of(campaign), path, cluster_of(), watch, stages=[Auditing()]))
    return progresses


def climb(study: Study, out: Path, cluster_of: _ClusterOf, say: _Say) -> tuple[pd.DataFrame, ramp.Ramp]:
    """Figure 4's ramp: ten of the records, in the direction in which the rock lifts first."""
    scene, ensemble = Scene.load(out / "scene"), Ensemble.load(out / "ensemble")
    protocol = ramp.Ramp(azimuth_deg=ramp.weakest_azimuth_deg(scene), preset=study.preset)
    names = ramp.chosen_waveforms(ensemble)
    say(
        f"ramp: {len(names)} waveforms from {protocol.start_m_s2:g} m/s2 by {protocol.step_m_s2:g} until toppling"
    )
    with cluster_of() as client:
        levels = ramp.carry_out(
            (out / "scene").absolute(), (out / "ensemble").absolute(), names, protocol,
            out / "ramp" / "waveforms", client.get_executor(pure=False), lambda name: say(f"ramp: {name} done"),
        )  # fmt: skip
    return levels, protocol


def draw(study: Study, out: Path, levels: pd.DataFrame, protocol: ramp.Ramp) -> Iterator[Path]:
    """Every figure of the study by its number, each with the table behind it.

    Yields each file once it is complete.
    """
    folder = out / "figures"
    opened, climbed = open_run(out / "runs" / MAIN), ramp.summary(levels)
    yield write_csv(climbed, folder / "figure_04.csv")
    quasi_static = opened.quasi_static()
    static_m_s2 = np.inf
    if quasi_static is not None:
        nearest = _nearest_deg(protocol.azimuth_deg, quasi_static["azimuth_deg"].tolist())
        static_m_s2 = float(quasi_static.set_index("azimuth_deg")["value"].astype(float).get(nearest, np.inf))
    yield from save(
        study_figures.ramp_figure(climbed, protocol.azimuth_deg, static_m_s2), folder / "figure_04"
    )
    with _staged(folder) as staging:
        bounded = PLANES["pgv_duration"]  # figure 10a, whatever its bounds leave out
        bins = Bins(
            pgv_below_m_s=bounded.y.below, duration_below_s=bounded.x.below, directions=len(study.azimuth_deg)
        )
        drawn = fragility(opened, staging, bins=bins, sector=SECTOR_DEG, reference=True)
        main, done = drawn.jobs, drawn.completeness
        compared = write_friction(_friction_rows(study, out), staging, PLANES["pga_pgv"], done)
        for path in (*drawn.files, *compared):
            target = folder / f"{_NUMBERED.get(path.stem, path.stem)}{path.suffix}"
            path.replace(target)
            yield target
    table = study_figures.topple_by_direction(main)
    yield write_csv(table, folder / "toppling_azimuths_by_direction.csv")
    if len(table):
        yield from save(
            study_figures.topple_direction_figure(table),
            folder / "toppling_azimuths_by_direction",
            done.remark,
        )
    motions = opened.motions()
    if motions is not None and "directionality" in motions.column_names:
        directionality = motions.select(["record_id", "directionality"]).to_pandas()
        yield write_csv(directionality, folder / "directionality.csv")
        yield from save(
            study_figures.directionality_figure(directionality), folder / "directionality", done.remark
        )


def check_findings(study: Study, out: Path) -> list[Finding]:
    """The study's findings, looked for in the runs; written as a checked list and as JSON."""
    opened = open_run(out / "runs" / MAIN)
    main = opened.frame()
    lines = pd.read_csv(out / "figures" / "figure_06_reference_lines.csv")
    scene = Scene.load(out / "scene")
    checked = findings(
        main, _friction_rows(study, out), _weakest_azimuth_deg(scene), lines, len(study.azimuth_deg)
    )
    audit = "".join(f"\n{one.sentence}.\n" for one in audits_of(opened).values())
    page = "\n".join(["# Findings of the study, looked for on this rock", "", *(one.line for one in checked)])
    write_text(f"{page}\n{audit}", out / "findings.md")
    write_json(out / "findings.json", {"findings": [dataclasses.asdict(one) for one in checked]})
    return checked


def _friction_rows(study: Study, out: Path) -> pd.DataFrame:
    """Rows of one direction with every friction, those of friction 1 from the main run."""
    lower, main = (open_run(out / "runs" / name).frame() for name in (_FRICTION, MAIN))
    azimuth = study.campaigns(out)[_FRICTION].azimuth_deg[0]
    return pd.concat([lower, main[main["azimuth_deg"] == azimuth]], ignore_index=True)


@contextlib.contextmanager
def _staged(folder: Path) -> Iterator[Path]:
    staging = folder / ".atlas"
    shutil.rmtree(staging, ignore_errors=True)
    staging.mkdir()
    try:
        yield staging
    finally:
        shutil.rmtree(staging, ignore_errors=True)
