"""`toppling records`: from record files to an ensemble."""

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from models.errors import InputError

if TYPE_CHECKING:
    from models.motions.importing import Refusal


@click.group()
def records() -> None:
    r"""Ground motions: import files into an ensemble.

    \b
    toppling records import records/ --out ensembles/quakes --metadata records/catalog.csv
    """


@records.command("import")
@click.argument(
    "paths", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="FILES-OR-FOLDERS..."
)
@click.option(
    "--out", required=True, type=click.Path(path_type=Path, file_okay=False), help="Folder of the ensemble."
)
@click.option(
    "--metadata",
    type=click.Path(path_type=Path, dir_okay=False, exists=True),
    help="CSV table, a row a record: h1, h2, v, unit, event, mag, dist_km, station (paths relative to the table).",
)
@click.option("--missing-vertical", is_flag=True, help="Allow records without a vertical component.")
@click.option("--doubtful", is_flag=True, help="Allow peaks beyond 5 g, clipping, spikes and filled gaps.")
@click.option(
    "--process/--no-process",
    default=None,
    help="Process every record or none; by default those that their agency has not corrected.",
)
@click.option(
    "--corner", "corner_hz", type=click.FloatRange(min=0, min_open=True), help="High-pass corner in Hz."
)
@click.option("--replace", is_flag=True, help="Replace an ensemble that is there.")
@click.option("--json", "as_json", is_flag=True, help="Print what was read and left out as JSON.")
def import_(
    paths: tuple[Path, ...],
    out: Path,
    metadata: Path | None,
    missing_vertical: bool,
    doubtful: bool,
    process: bool | None,
    corner_hz: float | None,
    replace: bool,
    as_json: bool,
) -> None:
    r"""Read records of any agency's format into the ensemble OUT.

    The format is found by content. What cannot be read is left out and listed with its reason; the rest goes on.

    \b
    toppling records import RSN1158_KOCAELI_DZC*.AT2 --out ensembles/duzce
    toppling records import records/ --out ensembles/quakes --metadata records/catalog.csv
    """
    from rich.console import Console
    from rich.progress import Progress

    from models.motions.ensemble import CATALOG, Ensemble
    from models.motions.importing import Wishes, import_records, record_files
    from models.motions.metadata import read_table

    if (out / CATALOG).exists() and not replace:
        raise InputError(
            "an ensemble is there already",
            where=str(out),
            expected="a new folder",
            remedy="choose another --out, or replace it with --replace",
        )
    table = read_table(metadata) if metadata else []
    files = record_files(paths)
    wishes = Wishes(missing_vertical, doubtful, process, corner_hz)
    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("reading", total=len(files))
        outcome = import_records(files, table, wishes, lambda: progress.advance(task))
    if not outcome.records:
        _show_refusals(outcome.refusals)
        raise InputError(
            f"none of {len(files)} files became a record",
            where=", ".join(map(str, paths)),
            expected="three-component records",
            remedy="see the table above",
        )
    ensemble = Ensemble.write(out, outcome.records)
    if as_json:
        left_out = [
            {"subject": r.subject, "what": r.reason.what, "where": r.reason.where, "remedy": r.reason.remedy}
            for r in outcome.refusals
        ]
        click.echo(
            json.dumps(
                {
                    "ensemble": str(out),
                    "id": ensemble.id,
                    "records": ensemble.record_ids,
                    "left_out": left_out,
                }
            )
        )
        return
    _show_refusals(outcome.refusals)
    click.echo(
        f"{len(outcome.records)} records of {len(files)} files in {out}, {len(outcome.refusals)} left out"
    )


def _show_refusals(refusals: "list[Refusal]") -> None:
    if not refusals:
        return
    from rich import box
    from rich.console import Console
    from rich.table import Table

    table = Table(
        "left out", "why", "where", "remedy", box=box.SIMPLE, title="Left out", title_justify="left"
    )
    for refusal in refusals:
        reason = refusal.reason
        table.add_row(refusal.subject, reason.what, reason.where, reason.remedy)
    Console(width=None if Console().is_terminal else 160).print(table)
