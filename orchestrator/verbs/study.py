"""`toppling study`: the whole published study on any rock, with one command."""

import json
import logging
import shutil
import sys
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from toppling.orchestrator.misspelt import OneOf
from toppling.orchestrator.verbs import shared_options as shared
from toppling.orchestrator.verbs.shared_options import option
from toppling.orchestrator.verbs.where import cluster_of, cluster_options

if TYPE_CHECKING:
    import pandas as pd

    from toppling.orchestrator.studies.ramp import Ramp
    from toppling.orchestrator.studies.replication import Study

_SEED = 1
_ECHO_CLIFFS = "echo-cliffs"


@click.command()
@click.argument("out", type=shared.FOLDER)
@option(
    "--scan",
    multiple=True,
    type=shared.PATH,
    help="Laser scans of the rock. Default: the demo's virtual rock.",
)
@option("--scene", type=shared.PATH, help="Folder of a scene, instead of scans.")
@option(
    "--rock", type=OneOf([_ECHO_CLIFFS]),
    help="The study's own rock, as far as it is printed, instead of scans.",
)  # fmt: skip
@option(
    "--records", type=shared.PATH, help="Ensemble, or folder of record files. Default: synthetic records."
)
@option("--metadata", type=shared.FILE, help="Metadata table of the record files.")
@option("--count", type=click.IntRange(5), default=140, help="Synthetic records.")
@option(
    "--pga-step", type=click.FloatRange(0.5, 9), default=1.0, help="Step of the levels from 1 to 19 m/s2."
)
@option("--directions", type=click.Choice(["2", "4", "8", "16"]), default="8")
@shared.preset_option
@shared.engine_option
@option("--audit", type=click.IntRange(0), help="Jobs of each run that are repeated with 'reference'.")
@shared.json_option("Print findings and counts as JSON.")
@cluster_options
def study(
    out: Path,
    scan: tuple[Path, ...],
    scene: Path | None,
    rock: str | None,
    records: Path | None,
    metadata: Path | None,
    count: int,
    pga_step: float,
    directions: str,
    preset: str,
    engine: str,
    audit: int | None,
    as_json: bool,
    **where: Any,
) -> None:
    """Repeat the study of Veeraraghavan, Hudnut and Krishnan on a rock: runs, figures, findings, report.

    It runs 21,280 jobs at friction 1 (140 records, 19 levels, 8 directions), 2,660 each at 0.6 and 0.8, and the ramp of
    figure 4. It writes every figure by its number with its table, the constraint, a report, and a checklist of the
    study's findings. The same command resumes an interrupted study.

    \b
    toppling study study --workers 2
    toppling study study --scan station1.laz --scan station2.laz --records ensembles/quakes
    """
    from toppling.orchestrator.context import RunError
    from toppling.orchestrator.interrupt import INTERRUPTED, signals_as_stop
    from toppling.orchestrator.progress import duration, watcher
    from toppling.orchestrator.studies import replication as stages
    from toppling.orchestrator.verbs.run import FAILED_JOBS

    say = partial(click.echo, err=True)
    if sum(map(bool, (scan, scene, rock))) > 1:
        raise click.UsageError("--scan, --scene and --rock exclude each other")
    logging.basicConfig(level=logging.WARNING, format="%(levelname)s %(message)s")
    chosen = replace(_study_of(pga_step, int(directions)), preset=preset, audit=audit, engine=engine)
    cluster_of(out, **where)  # wrong options are said before any work
    try:
        with signals_as_stop():
            chosen.check(out)
            _have_scene(out, scan, scene, rock, say)
            _have_records(out, records, metadata, count, say)
            _say_time(chosen, out, where, say)
            progresses = stages.carry_out(chosen, out, lambda: cluster_of(out, **where), watcher, say)
            climbed = stages.climb(chosen, out, lambda: cluster_of(out, **where), say)
            say("figures, findings, constraint, report")
            found, page = _report(chosen, out, climbed, as_json)
    except RunError as error:
        raise click.ClickException(f"{error}; finished work is kept, and the same command resumes") from None
    except KeyboardInterrupt:
        click.echo("stopped; finished work is kept, and the same command resumes", err=True)
        sys.exit(INTERRUPTED)
    done, worked_s = sum(one.done for one in progresses), sum(one.elapsed_s for one in progresses if one.done)
    lines = [str(page), *(one.line for one in found), f"{done} jobs in this session, {duration(worked_s)}"]
    runs = dict(zip(stages.RUNS, (one.summary() for one in progresses), strict=True))
    content = {"study": str(out), "runs": runs, "findings": [asdict(one) for one in found]}
    click.echo(json.dumps(content) if as_json else "\n".join(lines))
    if any(progress.failed for progress in progresses):
        sys.exit(FAILED_JOBS)


def _report(chosen: "Study", out: Path, climbed: "tuple[pd.DataFrame, Ramp]", as_json: bool) -> Any:
    """Draw the figures, check the findings, write constraint and report: the findings, and the report's file."""
    from toppling.models.files.folder import write_text
    from toppling.orchestrator.progress import each
    from toppling.orchestrator.studies import replication as stages
    from toppling.results.drawing.report.content import Content
    from toppling.results.drawing.report.write import report_page
    from toppling.results.reader import open_run

    for path in each(stages.draw(chosen, out, *climbed), "figures", 60):
        if path.suffix == ".png" and not as_json:
            click.echo(path)
    found = stages.check_findings(chosen, out)
    opened = open_run(out / "runs" / stages.MAIN)
    _have_figure_8(out)
    _have_constraint(out, opened.path)
    return found, write_text(report_page(Content(opened)), out / "report.html")


def _study_of(pga_step: float, directions: int) -> "Study":
    """The study with levels from 1 to 19 m/s2 and directions all around."""
    from toppling.orchestrator.studies.replication import Study

    steps = round(18.0 / pga_step)
    levels = (round(1.0 + step * pga_step, 9) for step in range(steps + 1) if step * pga_step <= 18.0)
    azimuths = tuple(360.0 * number / directions for number in range(directions))
    return Study(pga_m_s2=tuple(levels), azimuth_deg=azimuths)


def _have_scene(out: Path, scan: tuple[Path, ...], scene: Path | None, rock: str | None, say: Any) -> None:
    if (out / "scene").exists():
        return
    if rock is not None:
        from toppling.models.echo_cliffs import echo_cliffs
        from toppling.results.drawing.scene_figures import draw_scene

        made = echo_cliffs()
        draw_scene(made, made.save(out / "scene") / "scene.png")
        return
    if scene is not None:
        from toppling.models.files.folder import new_folder
        from toppling.models.scene import Scene

        Scene.load(scene)
        with new_folder(out / "scene") as staging:
            shutil.copytree(scene, staging, dirs_exist_ok=True)
        return
    if not scan:
        from toppling.orchestrator.verbs.demo import make_scene

        make_scene(out)
        return
    from toppling.orchestrator.public.making import scan as scanned

    found = scanned(scan, out / "scene", bootstrap=0, advance=lambda _, stage: say(f"scan: {stage}"))
    for note in found.notes:
        say(f"scan: {note}")


def _have_records(out: Path, records: Path | None, metadata: Path | None, count: int, say: Any) -> None:
    from toppling.models.files.folder import new_folder
    from toppling.models.motions.ensemble import Ensemble

    if (out / "ensemble").exists():
        return
    if records is None:
        from toppling.models.motions.synthetic import synthetic_ensemble

        say(f"records: {count} stochastic ground motions")
        Ensemble.write(out / "ensemble", synthetic_ensemble(count, _SEED))
    elif (records / "catalog.parquet").exists():
        Ensemble.load(records)
        with new_folder(out / "ensemble") as staging:
            shutil.copytree(records, staging, dirs_exist_ok=True)
    else:
        from toppling.orchestrator.studies.seismograms import read_seismograms

        say(f"records: reading {records}")
        read = read_seismograms([records], metadata, missing_vertical=False)
        for remark in (*read.remarks, *(f"note on {name}: {what}" for name, what in read.notes)):
            say(remark)
        Ensemble.write(out / "ensemble", list(read.records()))


def _say_time(chosen: Any, out: Path, where: dict[str, Any], say: Any) -> None:
    from toppling.orchestrator.verbs.run import time_words

    for name, campaign in chosen.campaigns(out).items():
        if not (out / "runs" / name).exists() and (words := time_words(campaign, where.get("workers"))):
            say(f"run {name}: {words}")


def _have_figure_8(out: Path) -> None:
    from toppling.orchestrator.verbs.pulse import pulse

    if not (out / "figures" / "figure_08").exists():
        context = click.get_current_context()
        context.invoke(
            pulse, scene=out / "scene", out=out / "figures" / "figure_08", shape="sawtooth", pgv_m_s=5.0, period_s=3.5,
            azimuth=0.0, friction=1.0, preset="standard",
        )  # fmt: skip


def _have_constraint(out: Path, run: Path) -> None:
    from toppling.models.errors import InputError
    from toppling.orchestrator.verbs.constrain import constrain

    context = click.get_current_context()
    try:
        context.invoke(constrain, rocks=(run,), out=out / "constraint")
    except InputError as error:
        click.echo(f"no constraint: {error}", err=True)
