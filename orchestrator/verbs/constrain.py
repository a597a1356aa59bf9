"""`toppling constrain`: what standing rocks say about past ground motion, and about its hazard."""

import hashlib
import json
import math
from collections.abc import Sequence
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import click
import numpy as np

from toppling.orchestrator.progress import bar
from toppling.orchestrator.recorded import read_recorded
from toppling.orchestrator.verbs.by_events import (
    EventOptions,
    Rocks,
    check_event_options,
    event_set_of,
    judged_by_events,
)
from toppling.orchestrator.verbs.felt import EventStatement, measures_asked
from toppling.orchestrator.verbs.hazard import HAZARD_HELP, SITE_HELP, Asked, SiteCommand, read_tree, years_of
from toppling.orchestrator.verbs.options import FOLDER, PATH, json_option, trusted_option
from toppling.orchestrator.verbs.rocks import (
    names_of,
    of_atlases,
    of_bases,
    read_jobs,
    refuse_twins,
    standing_rock,
)
from toppling.results.constraint import Constraint
from toppling.results.drawing.constraint_folder import write_constraint
from toppling.results.drawing.constraint_words import all_words
from toppling.results.drawing.event_words import event_words
from toppling.results.exchange import read_curves
from toppling.results.fits import MEASURES
from toppling.results.hazard.ages import Since, fragile_years, joint_ages, parse_age, parse_since
from toppling.results.hazard.standing import Standing
from toppling.results.hazard.tree import HazardTree, sources
from toppling.results.hazard.update import Update
from toppling.results.resampling import SAMPLES


@click.command(cls=SiteCommand)
@click.argument("rocks", nargs=-1, required=True, type=PATH, metavar="ROCK...")
@click.option(
    "--hazard",
    multiple=True,
    metavar="PATH[=WEIGHT]",
    help=HAZARD_HELP,
)
@click.option(
    "--age", multiple=True,
    help="Years for which each rock has stood: 20000, 15000..30000 (uniform), 20000+-3000 (normal, one sigma) or a "
    "CSV; or 20000*/1.2 (lognormal). One age for several rocks counts as an independent date of each, which rejects "
    "more than one common date would (--common-date).",
)  # fmt: skip
@click.option(
    "--common-date",
    is_flag=True,
    help="All rocks were uncovered together: one draw of their one age for all.",
)
@click.option(
    "--common-error", type=click.FloatRange(0, 0.5), default=0.0,
    help="Standard deviation of a relative error that the rocks' dates share, such as 0.08 of a production rate.",
)  # fmt: skip
@click.option(
    "--fragile-since", multiple=True, metavar="AGE[:FACTOR]",
    help="Since when each rock has been as fragile as it is: before, it was buried, or its medians a FACTOR higher.",
)  # fmt: skip
@click.option("--where", help="Only jobs for which this SQL condition holds, such as those of one friction.")
@trusted_option
@click.option(
    "--stood", multiple=True, type=PATH, metavar="FILE",
    help="Recorded motion that the rock is known to have survived (one --stood per file), or an ensemble's folder; it "
    "weights the draws of the base.",
)  # fmt: skip
@click.option(
    "--measure",
    help="Intensity measure (a column of the results), or pga_m_s2+pgv_m_s, both together. Default: that of the "
    "hazard, or pgv_m_s.",
)
@click.option(
    "--correlation", type=click.FloatRange(0, 1),
    help="Of the residuals of PGA and PGV in one earthquake, for their two curves; 0.733 if not given.",
)  # fmt: skip
@click.option(
    "--event-rate",
    type=click.FloatRange(0, min_open=True),
    help="Annual rate of a scenario, which states none.",
)
@click.option(
    "--catalogue-years", type=click.FloatRange(0, min_open=True),
    help="Years that each branch's events were simulated for, where no file states them.",
)  # fmt: skip
@click.option(
    "--confidence", type=click.FloatRange(0.5, 1, max_open=True), default=0.95, show_default=True,
    help="Confidence of all bounds; a branch is rejected if its survival is below 1 - confidence.",
)  # fmt: skip
@click.option(
    "--site", "sites", type=float, nargs=2, multiple=True, metavar="LON LAT", help=SITE_HELP,
)  # fmt: skip
@click.option("--site-name", "site_names", multiple=True, hidden=True)
@click.option(
    "--ratio", type=click.FloatRange(0, min_open=True), default=1.0, show_default=True,
    help="Ratio of the peak of the horizontal vector to the hazard's horizontal component.",
)  # fmt: skip
@click.option(
    "--values", metavar="rate|YEARS",
    help="What the hazard's values are, where its files do not say: annual rates, or probabilities over some years.",
)  # fmt: skip
@click.option(
    "--out",
    type=FOLDER,
    help="Folder for page, statement (JSON), tables, figures, and the hazard as OpenQuake's realisations.",
)
@json_option()
def constrain(
    rocks: tuple[Path, ...],
    hazard: tuple[str, ...],
    age: tuple[str, ...],
    common_date: bool,
    common_error: float,
    fragile_since: tuple[str, ...],
    where: str | None,
    trusted: bool,
    stood: tuple[Path, ...],
    measure: str | None,
    correlation: float | None,
    event_rate: float | None,
    catalogue_years: float | None,
    confidence: float,
    sites: tuple[tuple[float, float], ...],
    site_names: tuple[str, ...],
    ratio: float,
    values: str | None,
    out: Path | None,
    as_json: bool,
) -> None:
    """State which ground motions one or several standing rocks reject.

    A ROCK is a run, an atlas with all of its rocks (their ages those of its table, unless --age is given), or a file
    of fragility curves (CSV, JSON or NRML) as 'toppling fragility --fit' writes it. Without an age the statement is
    about a single event; with ages, about rates of exceedance; with hazard curves, about the rocks' survival under each
    curve and the weights of the branches. Several rocks share the same events.

    An earthquake recorded near a standing rock tells about its unseen base: with --stood every draw of the base is
    shaken with that record, unscaled and in its own orientation, and weighted by how likely the rock survives it.
    The run must have realisations on a scene with draws.

    \b
    toppling constrain runs/first --where "friction_static = 0.8"
    toppling constrain runs/first --age 15000..30000 --hazard mean.csv=0.6 --hazard high.csv=0.4
    toppling constrain runs/first --stood quake_e.AT2 --stood quake_n.AT2 --stood quake_up.AT2
    """
    rocks, age = of_atlases(rocks, age, "pgv_m_s" if measure is None or "+" in measure else measure)
    if not rocks:
        raise click.UsageError("no rock of the atlas has topplings and survivals to tell its fragility by")
    if age and len(age) not in (1, len(rocks)):
        msg = f"give one --age, or one per rock: got {len(age)} for {len(rocks)} rocks"
        raise click.UsageError(msg)
    if hazard and not age:
        msg = "a hazard curve needs the rocks' --age, to turn rates into probabilities"
        raise click.UsageError(msg)
    if fragile_since and len(fragile_since) not in (1, len(rocks)):
        msg = f"give one --fragile-since, or one per rock: got {len(fragile_since)} for {len(rocks)} rocks"
        raise click.UsageError(msg)
    if not age and (common_date or common_error or fragile_since):
        option = "--common-date" if common_date else "--common-error" if common_error else "--fragile-since"
        msg = f"{option} applies to ages: give the rocks' --age too"
        raise click.UsageError(msg)
    if not hazard and (sites or site_names or ratio != 1.0 or values):
        option = "--site" if sites or site_names else "--ratio" if ratio != 1.0 else "--values"
        msg = f"{option} applies to hazard curves: give --hazard too"
        raise click.UsageError(msg)
    if where and not all(path.is_dir() for path in rocks):
        msg = "--where selects jobs of runs; a file of curves has none"
        raise click.UsageError(msg)
    if stood and not all(path.is_dir() for path in rocks):
        msg = "--stood weights the bases of runs; a file of curves has none"
        raise click.UsageError(msg)
    measures = measures_asked(measure)
    options = EventOptions(event_rate, catalogue_years, correlation)
    check_event_options(options, event_set_of(hazard), measures)
    late = [parse_since(text) for text in fragile_since]
    sinces: list[Since | None] = [*(late * len(rocks) if len(late) == 1 else late)] or [None] * len(rocks)
    ages = [parse_age(text) for text in age] or [np.array([np.nan])]
    dated = joint_ages(ages * len(rocks) if len(ages) == 1 else ages, common_date, common_error)
    places: list[tuple[float, float] | str] = [*sites, *site_names]
    event_set = event_set_of(hazard)
    if len(places) > 1 and not event_set:
        msg = "several --site apply to a set of events; hazard curves are of one site"
        raise click.UsageError(msg)
    asked = Asked(places[0] if places else None, ratio, measure, years_of(values))
    recorded = read_recorded(stood) if stood else None
    if hazard and (
        event_set or len(measures) > 1 or any(one and math.isfinite(one.factor) for one in sinces)
    ):
        jobs = {path: read_jobs(path, where, trusted, recorded) for path in rocks if path.is_dir()}
        named = Rocks(names_of(rocks), rocks, dated, sinces, jobs, places)
        with bar("bootstrap of records", SAMPLES * len(jobs)) as advance:
            felt = judged_by_events(named, hazard, asked, options, confidence, advance)
        _tell_events(felt, rocks, ratio, out, as_json)
        return
    if len(measures) > 1 or any(one and math.isfinite(one.factor) for one in sinces):
        msg = "two measures together, and a factor of --fragile-since, need the --hazard"
        raise click.UsageError(msg)
    known = [
        name for name in MEASURES if all(name in read_curves(path) for path in rocks if not path.is_dir())
    ]
    tree = read_tree(hazard, asked, known) if hazard else None
    over = tree.measure if tree else measure or "pgv_m_s"
    together = common_date or common_error > 0
    years = fragile_years(dated, sinces) if together or any(sinces) else None
    runs = {path: read_jobs(path, where, trusted, recorded) for path in rocks if path.is_dir()}
    with bar("bootstrap of records", SAMPLES * len(runs)) as advance:
        standing = [
            standing_rock(name, path, over, runs.get(path), of_rock, seen=advance)
            for name, path, of_rock in zip(
                names_of(rocks), rocks, ages * len(rocks) if len(ages) == 1 else ages, strict=True
            )
        ]
    if years is not None:
        standing = [
            replace(rock, years=years[:, number], together=True) for number, rock in enumerate(standing)
        ]
    refuse_twins(rocks, standing)
    for warning in (warnings := _warnings(rocks, standing)):
        click.echo(warning, err=True)
    statement = Constraint(
        standing, confidence, Update(standing, tree, confidence) if tree else None, bool(age)
    )
    told = statement.told(ratio, sites[0] if sites else None)
    if together:
        told["ages_independent"] = False
    if bases := [
        {"rock": rock.name, **of_bases(runs[path], rock.curve)}
        for path, rock in zip(rocks, standing, strict=True)
        if path in runs and runs[path].stood
    ]:
        told["stood"] = bases
    told["warnings"] = warnings
    if out:
        told["choices"] = _choices(rocks, tree)
        count = sum(1 for _ in write_constraint(statement, told, out, ratio))
        if not as_json:
            click.echo(f"{out}: {count} files, of which constraint.html is the page", err=True)
    click.echo(json.dumps(told, indent=1, allow_nan=False) if as_json else all_words(told))


def _tell_events(
    felt: EventStatement, rocks: Sequence[Path], ratio: float, out: Path | None, as_json: bool
) -> None:
    """Write and print what rocks say event by event."""
    told = felt.told() | {"hazard_ratio": ratio}
    if out:
        told["choices"] = _choices(rocks, None, Path(felt.update.events.source))
        count = len(felt.write(out, told))
        if not as_json:
            click.echo(f"{out}: {count} files, of which constraint.json states all", err=True)
    click.echo(json.dumps(told, indent=1, allow_nan=False) if as_json else event_words(told))


def _warnings(rocks: Sequence[Path], standing: Sequence[Standing]) -> list[str]:
    """What has to be known before one relies on the rocks: runs that were not finished."""
    return [
        f"{path}: {rock.curve.basis.unfinished}, and the others are not a random sample: finish the run with "
        "'toppling run' before you rely on it"
        for path, rock in zip(rocks, standing, strict=True)
        if rock.curve.basis and rock.curve.basis.unfinished
    ]


def _choices(rocks: Sequence[Path], tree: HazardTree | None, events: Path | None = None) -> dict[str, Any]:
    """What was asked for and read, for who files the statement: options, files and their SHA-256, the program."""
    asked = click.get_current_context().params
    files = [path for path in rocks if path.is_file()]
    if tree:
        files += [Path(one) for one in sources(tree)]
    if events:
        files += sorted(events.glob("*.csv")) if events.is_dir() else [events] * events.is_file()
    return {
        "program": f"toppling {version('toppling')}",
        "options": {name: _text(value) for name, value in asked.items() if value not in (None, (), False)},
        "files": [
            {"path": str(path), "sha256": hashlib.sha256(path.read_bytes()).hexdigest()} for path in files
        ],
    }


def _text(value: Any) -> Any:
    if isinstance(value, tuple):
        return [_text(one) for one in value]
    return value if isinstance(value, int | float | str) else str(value)
