"""`toppling fragility`: the study's figures of a run, each with the table behind it."""

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from toppling.models.errors import InputError, counted
from toppling.orchestrator.terminal import bar
from toppling.orchestrator.verbs import shared_options as shared
from toppling.orchestrator.verbs.shared_options import of
from toppling.results.analysis import DIRECTION_BINS, HEADLINE_MEASURE, SAMPLES
from toppling.results.reader import Run, open_run
from toppling.results.weights import sentences

if TYPE_CHECKING:
    from toppling.orchestrator.public.reporting import Fragility

_DRAW = "public.reporting.fragility"


@click.command()
@shared.run_argument
@of(_DRAW, "--out", type=shared.FOLDER)
@of(_DRAW, "--where")
@shared.trusted_option
@of(_DRAW, "--directions", default=DIRECTION_BINS, type=click.IntRange(1, 72))
@of(_DRAW, "--sector", type=(shared.AZIMUTH, shared.AZIMUTH), metavar="FROM TO")
@of(_DRAW, "--fit")
@shared.samples_option(SAMPLES)
def fragility(run: Path, out: Path | None, **asked: Any) -> None:
    """Draw the fragility maps and curves of RUN (PNG, SVG), with the table behind each (CSV).

    Maps show the toppling probability over PGA and PGV/PGA, PGA and PGV, PGV and duration, and PGA and duration.
    Further figures show where the rock topples to and, for runs with several frictions, compare these.

    The colour of a cell is the share of its jobs that toppled; it is pale in cells of fewer than 10 independent
    records.

    The bins are those of the study by Veeraraghavan, Hudnut and Krishnan; its bounds of PGV and duration are left out
    where more than a few jobs lie beyond. Direction bins are of the azimuth of
    the vector PGA, degrees counter-clockwise from east. If there are several contacts (friction, restitution), each
    gets its own folder. Maps and fits weight each record if the ensemble has weights (records select
    --deaggregation), and each base if the campaign names motions that the rock survived (stood); the ranking of
    measures, the rose and the comparison of frictions are unweighted.

    \b
    toppling fragility runs/first --fit
    toppling fragility runs/first --where "ground_accelerates_toward_deg between 292.5 and 337.5" --out figures
    """
    from toppling.orchestrator.public.reporting import fragility as draw

    opened = open_run(run)
    if opened.rocks:
        _for_all_rocks(opened, out)
        return
    source = click.get_current_context().get_parameter_source
    if not asked["fit"] and source("samples") != ParameterSource.DEFAULT:
        raise click.UsageError("--samples applies to the fits: give --fit too")
    if remark := opened.completeness().remark:
        click.echo(f"{run} is unfinished: {remark}")
    with bar("figures") as advance:
        drawn = draw(opened, out, advance=advance, **asked)
    _print_result(drawn)


def _print_result(drawn: "Fragility") -> None:
    """Print what was written, and the results of fits and audits."""
    from toppling.results.analysis.fits import answered
    from toppling.results.analysis.fragility import by_contact, contact_words
    from toppling.results.analysis.resampling import narrowed_by
    from toppling.results.drawing.run_figures import fit_words
    from toppling.results.drawing.sentences import what_topples

    jobs = drawn.jobs
    click.echo(_files(drawn.folder, drawn.files))
    for contact, of_contact in by_contact(jobs).items() if drawn.fits else ():
        known = answered(of_contact)
        records = counted(known["record_id"].nunique(), "record")
        resting = f"{contact_words(of_contact, jobs)}, {counted(len(known), 'job')} of {records}"
        click.echo(f"\nfragility by measure, {resting}:")
        click.echo(fit_words(drawn.fits[contact], known))
        if curves := drawn.curves[contact]:
            curve = curves.get(HEADLINE_MEASURE) or next(iter(curves.values()))
            click.echo(
                what_topples(curve, contact_words(of_contact, jobs), drawn.run.on_single_base(of_contact))
            )
            if narrowed := narrowed_by(curve.interval_parts, drawn.run.scene_report()):
                click.echo(narrowed)
    for audit in drawn.audits.values():
        click.echo(audit.sentence)
    if weights := drawn.run.weights():
        for sentence in sentences(weights.summary(jobs)):
            click.echo(sentence)


def _for_all_rocks(atlas: Run, out: Path | None) -> None:
    """Run the command for every rock of an atlas; rocks without an answer are reported."""
    context = click.get_current_context()
    for rock in atlas.rocks:
        given = {**context.params, "run": rock.path, "out": out and out / rock.rock}
        try:
            assert fragility.callback is not None
            fragility.callback(**given)
        except InputError as error:
            click.echo(f"{rock.rock}: {error.brief}", err=True)


def _files(folder: Path, written: list[Path]) -> str:
    """Summary of the numbers of written files."""
    count = Counter(path.suffix for path in written)
    figures, tables = count[".png"], count[".csv"]
    has_curves = any(path.stem == "curves" for path in written)
    curves = ", curves for other programs (CSV, JSON, NRML)" if has_curves else ""
    return f"{folder}: {figures} figures (PNG, SVG), {tables} tables (CSV){curves}"
