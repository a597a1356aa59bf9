"""`toppling constrain`: what standing rocks say about past ground motion, and about its hazard."""

import hashlib
import json
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import click

from toppling.models.files.documents import without_machine
from toppling.orchestrator.terminal import bar
from toppling.orchestrator.verbs import shared_options as shared
from toppling.orchestrator.verbs.shared_options import SITE_HELP, SiteCommand, of, option, values_option


@click.command(cls=SiteCommand)
@click.argument("rocks", nargs=-1, required=True, type=shared.PATH, metavar="ROCK...")
@of("public.constraining.constrain", "--hazard", metavar="PATH[=WEIGHT]")
@of("public.constraining.constrain", "--age")
@of("public.constraining.Dates", "--common-date", parameter="common")
@of("public.constraining.Dates", "--common-error", type=click.FloatRange(0, 0.5))
@of("public.constraining.Dates", "--fragile-since", metavar="AGE[:FACTOR]")
@of("public.constraining.constrain", "--where")
@shared.trusted_option
@of("public.constraining.constrain", "--stood", type=shared.PATH, metavar="FILE")
@of("public.constraining.constrain", "--measure")
@of("public.constraining.EventOptions", "--correlation", type=click.FloatRange(0, 1))
@of("public.constraining.EventOptions", "--event-rate", type=shared.ABOVE_0)
@of("public.constraining.EventOptions", "--catalogue-years", type=shared.ABOVE_0)
@of("public.constraining.constrain", "--confidence", type=click.FloatRange(0.5, 1, max_open=True))
@option("--site", "sites", type=shared.SITE, multiple=True, metavar="LON LAT", help=SITE_HELP)
@option("--site-name", "site_names", multiple=True, hidden=True)
@of("public.constraining.constrain", "--ratio", type=shared.ABOVE_0)
@values_option
@option(
    "--out", type=shared.FOLDER,
    help="Folder for page, statement (JSON), tables, figures, and the hazard as OpenQuake's realisations (zipped).",
)  # fmt: skip
@shared.json_option()
def constrain(
    rocks: tuple[Path, ...],
    common_date: bool,
    sites: tuple[tuple[float, float], ...],
    site_names: tuple[str, ...],
    out: Path | None,
    as_json: bool,
    **asked: Any,
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
    from toppling.orchestrator.public.constraining import Dates, EventOptions
    from toppling.orchestrator.public.constraining import constrain as state

    with bar("bootstrap of records") as advance:
        stated = state(
            rocks, dates=shared.noun_of(Dates, asked, common=common_date), events=shared.noun_of(EventOptions, asked),
            sites=[*sites, *site_names], advance=advance, **asked,
        )  # fmt: skip
    for warning in stated.warnings:
        click.echo(warning, err=True)
    content = stated.content
    if out:
        content = content | {"choices": _choices(rocks, stated.hazard_files)}
        count = stated.write(out, content["choices"])
        if not as_json:
            click.echo(f"{out}: {count} files, of which {stated.page} is the page", err=True)
    click.echo(json.dumps(without_machine(content), indent=1, allow_nan=False) if as_json else stated.text)


def _choices(rocks: Sequence[Path], hazard_files: Sequence[Path]) -> dict[str, Any]:
    """Record of a statement's inputs for archiving: options, files with SHA-256, and program version."""
    asked = click.get_current_context().params
    files = [path for path in rocks if path.is_file()] + [*hazard_files]
    return {
        "program": f"toppling {version('toppling')}",
        "options": {name: _text(value) for name, value in asked.items() if value not in (None, (), False)},
        "files": [
            {"path": str(path), "sha256": hashlib.sha256(path.read_bytes()).hexdigest()} for path in files
        ],
    }


def _text(value: Any) -> Any:
    if isinstance(value, tuple):
        return [_text(entry) for entry in value]
    return value if isinstance(value, int | float | str) else str(value)
