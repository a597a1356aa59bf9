"""`toppling fragility`: the study's figures of a run, each with the table behind it."""

import contextlib
import itertools
from collections import Counter
from dataclasses import replace
from functools import partial
from pathlib import Path

import click
import pandas as pd
from click.core import ParameterSource

from toppling.models.contact import ContactProperties
from toppling.models.errors import InputError
from toppling.models.motions.ensemble import Ensemble
from toppling.models.scene import Scene
from toppling.orchestrator.folder import place_in
from toppling.orchestrator.progress import bar
from toppling.orchestrator.verbs.options import FOLDER, run_argument, samples_option, trusted_option
from toppling.results.audit import audits_of
from toppling.results.directions import least_sector
from toppling.results.drawing.fit_table import fit_words
from toppling.results.drawing.run_figures import (
    FIT_PARTS,
    write_audits,
    write_directions,
    write_fits,
    write_friction,
    write_maps,
)
from toppling.results.fits import answered
from toppling.results.fragility import (
    DURATION,
    FEW_BEYOND,
    LEVEL,
    PGV,
    PLANES,
    PULSE,
    Axis,
    by_contact,
    contact_words,
    planes_of,
)
from toppling.results.friction import by_surroundings, frictions
from toppling.results.plane_reference import reference_lines, simulate
from toppling.results.resampling import SAMPLES
from toppling.results.run import Run, open_run
from toppling.results.stood import records_weight, sentences, told_of
from toppling.workers.seating import settled

PGV_DURATION = PLANES["pgv_duration"]
STUDYS = f"Default: the study's {{0.below:g}}, or none if that leaves out more than {100 * FEW_BEYOND:g} % of the jobs."
WIDTH = click.FloatRange(0, min_open=True)


@click.command()
@run_argument
@click.option("--out", type=FOLDER, help="Folder; default RUN/fragility.")
@click.option("--where", help="Only jobs for which this SQL condition holds.")
@trusted_option
@click.option("--unweighted", is_flag=True, help="Ignore the weights of records and bases.")
@click.option("--pga-bin", type=WIDTH, help="m/s2; default one bin per level.")
@click.option("--pgv-bin", type=WIDTH, default=0.25, show_default=True, help="m/s")
@click.option("--pgv-pga-bin", type=WIDTH, default=0.05, show_default=True, help="s")
@click.option("--duration-bin", type=WIDTH, default=5.0, show_default=True, help="s")
@click.option(
    "--pgv-below", type=WIDTH,
    help=f"m/s; upper limit of PGV in the map of PGV and duration, 'inf' for none. {STUDYS.format(PGV_DURATION.y)}",
)  # fmt: skip
@click.option(
    "--duration-below", type=WIDTH, help=f"s; upper limit of duration in that map. {STUDYS.format(PGV_DURATION.x)}"
)  # fmt: skip
@click.option(
    "--directions", type=click.IntRange(1, 72), default=8, show_default=True, help="Direction bins."
)
@click.option(
    "--sector",
    type=float,
    nargs=2,
    metavar="FROM TO",
    help="Sector of azimuths, degrees counter-clockwise from east, whose share of topplings is stated. Default: 35 "
    "degrees around where the least constant acceleration topples the rock to.",
)
@click.option("--fit", is_flag=True, help="Also fit curves and surfaces, and rank the intensity measures.")
@click.option(
    "--reference",
    is_flag=True,
    help="Draw the lines of 1 and 99 % toppling of a plane section rocking on two corners without slip.",
)
@samples_option(SAMPLES)
def fragility(
    run: Path,
    out: Path | None,
    where: str | None,
    trusted: bool,
    unweighted: bool,
    pga_bin: float | None,
    pgv_bin: float,
    pgv_pga_bin: float,
    duration_bin: float,
    pgv_below: float | None,
    duration_below: float | None,
    directions: int,
    sector: tuple[float, float] | None,
    fit: bool,
    reference: bool,
    samples: int,
) -> None:
    """Draw the fragility maps and curves of RUN (PNG, SVG), with the table behind each (CSV).

    Maps show the toppling probability over PGA and PGV/PGA, PGA and PGV, PGV and duration, and PGA and duration.
    Further figures show where the rock topples to and, for runs with several frictions, compare these.

    The colour of a cell is the share of its jobs that toppled. Its width is its share of the jobs of its level (in
    the map of PGV and duration: of all jobs); the caption states from which share on a cell is full. A dot marks
    cells of fewer than 10 records.

    The default bins are those of the study by Veeraraghavan, Hudnut and Krishnan. Direction bins are of the azimuth of
    the vector PGA, degrees counter-clockwise from east. If there are several contacts (friction, restitution), each
    gets its own folder. Maps and fits weight each record if the ensemble has weights (records select
    --deaggregation), and each base if the campaign names motions that the rock survived (stood); the ranking of
    measures, the rose and the comparison of frictions are unweighted.

    \b
    toppling fragility runs/first --fit
    toppling fragility runs/first --where "pga_azimuth_deg between 292.5 and 337.5" --out figures
    """
    opened = open_run(run)
    if opened.rocks:
        _each_rock(opened, out)
        return
    done, jobs = opened.completeness(), opened.frame(where, trusted=trusted)
    if not fit and click.get_current_context().get_parameter_source("samples") != ParameterSource.DEFAULT:
        msg = "--samples applies to the fits: give --fit too"
        raise click.UsageError(msg)
    if not unweighted:
        jobs = opened.weighted(jobs)
    if not jobs["toppled"].notna().any():
        what = f"{len(jobs)} jobs, none with an answer"
        raise InputError(
            what,
            where=str(run),
            expected="finished jobs",
            remedy="loosen --where" if where else "'toppling status RUN' shows how far the run is",
        )
    widths = {
        LEVEL.column: pga_bin,
        PGV.column: pgv_bin,
        PULSE.column: pgv_pga_bin,
        DURATION.column: duration_bin,
    }
    ends = {PGV.column: pgv_below, DURATION.column: duration_below}

    def asked(axis: Axis) -> Axis:
        below = None if axis.below is None else ends[axis.column] or extended[axis.column]
        return replace(axis, width=widths[axis.column], below=below)

    placed = planes_of(jobs)[PGV_DURATION.name]
    extended = {axis.column: axis.below for axis in (placed.x, placed.y)}
    planes = {plane.name: replace(plane, x=asked(plane.x), y=asked(plane.y)) for plane in PLANES.values()}
    folder = out or place_in(run, "fragility")
    audits, quasi_static = audits_of(opened), opened.quasi_static()
    within = sector or least_sector(quasi_static)
    lines = _plane_reference(opened, jobs, directions) if reference else None
    # Each contact: maps of three files and one about all, directions of four, fits of eight. A comparison: four.
    maps = sum(1 + plane.by_direction for plane in planes.values())
    total = (
        len(by_contact(jobs)) * (3 * maps + 4 + bool(within) + (8 + FIT_PARTS) * fit + reference)
        + 4 * len(by_surroundings(jobs))
        + bool(audits)
    )
    if done.remark:
        click.echo(f"{run} is unfinished: {done.remark}")
    written = []
    with bar("figures", total) as advance:
        for path in itertools.chain(
            write_maps(jobs, folder, planes.values(), directions, lines, done),
            write_directions(jobs, quasi_static, folder, within, done),
            write_friction(jobs, folder, planes["pga_pgv"], done),
            write_fits(jobs, folder, opened.name, samples, partial(audits_of, opened), advance, done)
            if fit
            else (),
            write_audits(audits, folder),
        ):
            written.append(path)
            advance()
    click.echo(_files(folder, written))
    for contact, of_contact in by_contact(jobs).items() if fit else ():
        table = pd.read_csv(folder / contact / "fits" / "fits.csv", keep_default_na=True)
        known = answered(of_contact)
        click.echo(f"\nfragility by measure, {contact_words(of_contact, jobs)}, {_records(known)}:")
        click.echo(fit_words(table.assign(problem=table["problem"].fillna("")), known))
    for audit in audits.values():
        click.echo(audit.sentence)
    if not unweighted and (stood := opened.stood()):
        for sentence in sentences(told_of(stood, jobs)):
            click.echo(sentence)


def _each_rock(atlas: Run, out: Path | None) -> None:
    """Call the verb for every rock of an atlas; one without an answer is told."""
    context = click.get_current_context()
    for rock in atlas.rocks:
        given = {**context.params, "run": rock.path, "out": out and out / rock.rock}
        try:
            assert fragility.callback is not None
            fragility.callback(**given)
        except InputError as error:
            click.echo(f"{rock.rock}: {error.what}", err=True)


def _files(folder: Path, written: list[Path]) -> str:
    """What was written, counted."""
    count = Counter(path.suffix for path in written)
    figures, tables = count[".png"], count[".csv"]
    return f"{folder}: {figures} figures (PNG, SVG), {tables} tables (CSV)" + (
        ", curves for other programs (CSV, JSON, NRML)"
        if any(path.stem == "curves" for path in written)
        else ""
    )


def _records(known: pd.DataFrame) -> str:
    records = known["record_id"].nunique()
    return f"{len(known):,} jobs of {records:,} {'record' if records == 1 else 'records'}"


def at_rest(scene: Scene, jobs: pd.DataFrame) -> Scene:
    """The scene as jobs shake it, settled with their highest friction: a scanned rock is seldom exactly at rest."""
    static, kinetic = frictions(jobs)[-1]
    with contextlib.suppress(InputError):  # then it has no rest, and its section is that of the scan
        return settled(scene.with_contact(ContactProperties(static, kinetic)))
    return scene


def _plane_reference(run: Run, jobs: pd.DataFrame, directions: int) -> pd.DataFrame:
    scene, ensemble = at_rest(Scene.load(run.scene_folder), jobs), Ensemble.load(run.ensemble_folder)
    records, levels = (sorted(jobs[name].unique()) for name in ("record_id", "level_pga_m_s2"))
    azimuths = [number * 360.0 / directions for number in range(directions)]
    with bar(f"plane reference: {len(azimuths)} sections, {len(levels)} levels"):
        simulated = simulate(scene, ensemble, records, levels, azimuths)
    # Each record counts in the lines as in the cells that they are drawn over.
    weight = records_weight(jobs)  # the reference has one base
    if weight is None:
        return reference_lines(simulated)
    weights = jobs[["record_id"]].assign(record_weight=weight).drop_duplicates("record_id")
    return reference_lines(answered(simulated.merge(weights)))
