"""`toppling demo`: the whole workflow, from laser scan to maps, on inputs that the program makes itself."""

import os
import shutil
import sys
import time
from collections.abc import Iterable
from pathlib import Path

import click

from toppling.models import caching
from toppling.orchestrator.verbs import shared_options as shared
from toppling.orchestrator.verbs.shared_options import option

_MARK = ".demo"
_RECORDS = 24
"""Number of synthetic records."""
_SEED = 1
"""Seed of the virtual scan and the records."""
_CAMPAIGN = """\
# As many levels and azimuths as the time allowed. The study has 140 records, 19 levels and 8 azimuths.
scene = "scene"
ensemble = "ensemble"
pga_m_s2 = {{ start = 1, stop = 19, step = {step} }}
azimuth_deg = {azimuths}
friction = [1.0]
restitution = [0.0]
realisations = {realisations}
preset = "fast"
"""
_DESIGNS = ((1, 8), (1, 4), (2, 4), (2, 2), (3, 2), (3, 1), (6, 1))
"""Step of the levels in m/s2 and number of azimuths, from the study's own to coarser ones."""

_QUERY = """\
select level_pga_m_s2, count(toppled) as jobs, round(avg(toppled::int), 2) as p_toppled,
       round(avg(toppled::int) filter (pgv_pga_s >= 0.1), 2) as p_toppled_long_pulse
from results where level_pga_m_s2::int % 6 = 1 group by all order by all"""


@click.command()
@option(
    "--out", type=shared.FOLDER, default=Path("demo"), help="Folder; that of an earlier demo is replaced."
)
@option("--workers", type=click.IntRange(min=1), default=2, help="Local workers.")
@option(
    "--seconds", type=click.FloatRange(min=0.0), default=75.0,
    help="Time for shaking; the campaign is as large as it allows.",
)  # fmt: skip
def demo(out: Path, workers: int, seconds: float) -> None:
    """Scan a virtual rock, make earthquakes, shake the rock and draw the maps: minutes on two cores.

    \b
    toppling demo --out demo
    """
    from toppling.models.motions.ensemble import Ensemble
    from toppling.models.motions.synthetic import synthetic_ensemble

    began = time.monotonic()
    _clear(out)
    _make_scene(out)
    _print(f"records: {_RECORDS} stochastic ground motions, M 6 to 8 at 5 to 100 km")
    Ensemble.write(out / "ensemble", synthetic_ensemble(_RECORDS, _SEED))
    _plan(out, workers, seconds)
    failed = _run(out, workers)
    figures = _draw(out)
    _print_result(out, figures, time.monotonic() - began)
    if failed:
        sys.exit(3)


def _clear(out: Path) -> None:
    if out.exists() and any(out.iterdir()):
        if not (out / _MARK).is_file():
            raise FileExistsError(f"{out} exists and is not an earlier demo's: give another --out")
        shutil.rmtree(out)
    out.mkdir(parents=True, exist_ok=True)
    (out / _MARK).write_text("made by 'toppling demo', which replaces this folder\n", encoding="utf-8")


def _make_scene(out: Path) -> None:
    """Scan the demo's virtual rock into the subfolder `scene`."""
    import numpy as np

    from toppling.models.files.mesh_files import write_ply
    from toppling.models.scan.virtual import demo_scan
    from toppling.orchestrator.public.making import scan
    from toppling.orchestrator.verbs.scan import summary

    _print("scan: ray-casting a rock like the one at Echo Cliffs from six stations")
    stations, _ = demo_scan(_SEED)
    folder = out / "scan"
    folder.mkdir(exist_ok=True)
    files = [folder / f"station{number}.ply" for number in range(1, len(stations) + 1)]
    for file, station in zip(files, stations, strict=True):
        write_ply(file, station.points_m, np.empty((0, 3), np.int64))
    made = scan(files, out / "scene", advance=lambda _, stage: _print(f"scan: {stage}"))
    points = sum(len(station.points_m) for station in stations)
    _print(f"scan: of {points} points came {summary(made.scene, made.folder)}")


def _plan(out: Path, workers: int, seconds: float) -> None:
    """Write the largest campaign that should finish in time, estimated from a few trial jobs."""
    from toppling.models.motions.ensemble import Ensemble
    from toppling.models.scene import Scene
    from toppling.orchestrator.advice import statics_of, try_out

    shared.compile_first()
    scene, ensemble = Scene.load(out / "scene"), Ensemble.load(out / "ensemble")
    pilot = try_out(scene, ensemble, statics_of(scene).least_m_s2, [45.0], (1.0, 1.0), "fast")
    affordable = min(workers, os.cpu_count() or 1) * seconds / pilot.job_s
    jobs_of = {design: _RECORDS * (1 + 18 // design[0]) * design[1] for design in _DESIGNS}
    step, sides = next((design for design in _DESIGNS if jobs_of[design] <= affordable), _DESIGNS[-1])
    azimuths = [45 + 360 * side / sides for side in range(sides)]
    # The base is unknown: use as many draws as each record has jobs, up to the number that a worker caches.
    realisations = 1 if scene.unseen is None else min(caching.MOST, (1 + 18 // step) * sides)
    turned = [azimuth % 360 for azimuth in azimuths]
    text = _CAMPAIGN.format(step=step, azimuths=turned, realisations=realisations)
    (out / "campaign.toml").write_text(text, encoding="utf-8")


def _run(out: Path, workers: int) -> int:
    from toppling.orchestrator.public.running import run
    from toppling.orchestrator.terminal import watcher

    _print(f"run: starting {workers} workers")
    with watcher() as watch:
        progress = run(out / "campaign.toml", out / "run", workers=workers, watch=watch).session
    _print(
        f"run: {progress.done} jobs, {progress.rate:.1f}/s, {progress.toppled} toppled, {progress.failed} unanswered"
    )
    return progress.failed


def _draw(out: Path) -> list[Path]:
    from toppling.results.analysis.fragility import planes_of
    from toppling.results.drawing.run_figures import write_maps
    from toppling.results.reader import open_run

    _print("fragility: drawing")
    frame = open_run(out / "run").frame()
    planes = planes_of(frame)
    return list(write_maps(frame, out / "fragility", [planes["pga_pgv_pga"], planes["pga_pgv"]]))


def _print_result(out: Path, figures: Iterable[Path], took_s: float) -> None:
    from toppling.orchestrator.terminal import duration
    from toppling.results.drawing.report.content import Content
    from toppling.results.drawing.report.headline import answer
    from toppling.results.reader import open_run

    for sentence in answer(Content(open_run(out / "run"))):
        click.echo(sentence)
    maps = [path for path in figures if path.suffix == ".png"]
    click.echo(f"\nThe demo took {duration(took_s)} and made")
    for what, path in (
        ("scene picture", out / "scene" / "scene.png"),
        *(("fragility map", path) for path in maps),
        ("Parquet run", out / "run" / "results.parquet"),
    ):
        click.echo(f"  {what:14s} {path}")
    click.echo(f'\nAsk it: toppling query {out / "run"} "{_QUERY}"\n')
    click.echo(open_run(out / "run").sql(_QUERY).to_pandas().to_string(index=False, na_rep=""))


def _print(line: str) -> None:
    click.echo(line, err=True)
