"""`toppling records`: from record files to an ensemble."""

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from toppling.models.errors import InputError
from toppling.orchestrator.progress import bar
from toppling.orchestrator.spelling import OneOf, Verbs
from toppling.orchestrator.verbs.options import (
    EXISTING_FILE,
    EXISTING_FOLDER,
    FILE,
    FOLDER,
    PATH,
    corner_option,
    ensemble_out,
    json_option,
    replace_option,
)

if TYPE_CHECKING:
    from toppling.models.motions.ensemble import Ensemble
    from toppling.models.motions.importing import Import, Refusal


MOST_NOTES = 20


MOST_EMPTY = 6
"""Bins of a deaggregation without a record that are named, at most; the heaviest."""


@click.group(cls=Verbs)
def records() -> None:
    """Import, fetch, synthesise, select and show ensembles of records.

    \b
    toppling records import records/ --out ensembles/quakes --metadata records/catalog.csv
    """


@records.command("import")
@click.argument("paths", nargs=-1, required=True, type=PATH, metavar="FILES-OR-FOLDERS...")
@ensemble_out
@click.option(
    "--metadata",
    type=EXISTING_FILE,
    help="CSV table, one row per record: h1, h2, v (paths relative to it), unit, event, mag, dist_km, station;"
    " processing (corrected or uncorrected) if the file does not state it; pga_h1, pga_h2, pga_v (m/s2) scale"
    " counts of unknown unit.",
)
@click.option("--missing-vertical", is_flag=True, help="Allow records without a vertical component.")
@click.option("--doubtful", is_flag=True, help="Allow peaks beyond 5 g, clipping, spikes and filled gaps.")
@click.option(
    "--process/--no-process",
    default=None,
    help="Process every record or none. The default is to process records that their agency has not corrected and,"
    " if that is not stated, those whose displacement drifts.",
)
@corner_option
@click.option(
    "--time-step", "time_step_s", type=click.FloatRange(0, 0.1, min_open=True), metavar="S",
    help="Resample every record to this step with an anti-alias filter.",
)  # fmt: skip
@replace_option
@json_option("Print what was read and left out as JSON.")
def import_(
    paths: tuple[Path, ...],
    out: Path,
    metadata: Path | None,
    missing_vertical: bool,
    doubtful: bool,
    process: bool | None,
    corner_hz: float | None,
    time_step_s: float | None,
    replace: bool,
    as_json: bool,
) -> None:
    """Read records of any agency's format into the ensemble OUT.

    The format is detected from the content. Files that cannot be read are left out and listed with the reason.

    \b
    toppling records import RSN1158_KOCAELI_DZC*.AT2 --out ensembles/duzce
    toppling records import records/ --out ensembles/quakes --metadata records/catalog.csv
    """
    _refuse_existing(out, replace)
    with bar("records") as advance:
        from toppling.models.motions.ensemble import Ensemble
        from toppling.models.motions.importing import ImportOptions, import_records, record_files
        from toppling.models.motions.metadata import looks_like_table, read_table

        table = read_table(metadata) if metadata else []
        files = record_files(paths)
        options = ImportOptions(missing_vertical, doubtful, process, corner_hz, time_step_s)
        advance(0, "reading", total=2 * len(files))
        outcome = import_records(files, table, options, advance)
    if not metadata:
        for path in (found for folder in paths if folder.is_dir() for found in sorted(folder.rglob("*.csv"))):
            if looks_like_table(path):
                click.echo(f"{path} looks like a metadata table: give it with --metadata", err=True)
    if not outcome.records:
        _show_refusals(outcome.refusals)
        raise _no_record(len(files), ", ".join(map(str, paths)))
    ensemble = Ensemble.write(out, outcome.records)
    if as_json:
        _print_json(ensemble, outcome)
        return
    _show_refusals(outcome.refusals)
    show_notes(outcome.warnings)
    click.echo(
        f"{len(outcome.records)} records from {len(files)} files in {out}, {len(outcome.refusals)} left out"
    )
    if outcome.unused_rows:
        click.echo(f"{outcome.unused_rows} of {len(table)} rows of {metadata} name files that were not given")


def _print_json(ensemble: "Ensemble", outcome: "Import") -> None:
    left_out = [
        {"subject": r.subject, "what": r.reason.what, "where": r.reason.where, "remedy": r.reason.remedy}
        for r in outcome.refusals
    ]
    document = {
        "ensemble": str(ensemble.folder),
        "id": ensemble.id,
        "records": ensemble.record_ids,
        "left_out": left_out,
        "notes": [{"record": name, "what": what} for name, what in outcome.warnings],
        "unused_rows": outcome.unused_rows,
    }
    click.echo(json.dumps(document))


@records.command()
@click.option(
    "--service",
    default="EARTHSCOPE",
    show_default=True,
    help="FDSN service: its name in ObsPy, or an address.",
)
@click.option("--event-service", help="Service that has the event, if another one (such as USGS).")
@click.option(
    "--event", "event_id", help="Event id at the service; sets the window and gives magnitude and distance."
)
@click.option(
    "--radius",
    "radius_km",
    type=click.FloatRange(min=0, min_open=True),
    help="All stations within this distance of the epicentre, km.",
)
@click.option("--stations", help="NET.STA, separated by commas, instead of a radius.")
@click.option("--start", help="Start of the window (UTC) if no event is given.")
@click.option("--end", help="End of the window (UTC) if no event is given.")
@ensemble_out
@corner_option
@replace_option
def fetch(
    service: str,
    event_service: str | None,
    event_id: str | None,
    radius_km: float | None,
    stations: str | None,
    start: str | None,
    end: str | None,
    out: Path,
    corner_hz: float | None,
    replace: bool,
) -> None:
    """Fetch records from an FDSN service.

    The instrument response is removed and the records are imported.

    The original waveforms and StationXML are kept in OUT/raw, where 'records import' can read them again.

    \b
    toppling records fetch --service SCEDC --event 38457511 --radius 50 --out ensembles/ridgecrest
    toppling records fetch --service SCEDC --stations CI.CLC,CI.CCC --start 2019-07-06T03:19:23 \\
        --end 2019-07-06T03:25:53 --out ensembles/two
    """
    from toppling.models.motions.ensemble import Ensemble
    from toppling.models.motions.fetch import connect, find_event, utc
    from toppling.models.motions.fetch import fetch as fetched
    from toppling.models.motions.importing import ImportOptions, import_records
    from toppling.models.motions.metadata import read_table

    _refuse_unclear_request(event_id, radius_km, stations, start, end)
    _refuse_existing(out, replace)
    window = (utc(start, "--start"), utc(end, "--end")) if start and end else None
    client = connect(service)
    event = find_event(connect(event_service) if event_service else client, event_id) if event_id else None
    names = [name.strip() for name in stations.split(",")] if stations else []
    with bar("fetching") as seen:

        def advance(total: int) -> None:
            seen(0, total=total) if total else seen()

        came = fetched(
            client,
            out / "raw",
            event=event,
            radius_km=radius_km,
            stations=names,
            window=window,
            advance=advance,
        )
    table = read_table(came.table) if came.table else []
    outcome = import_records(came.files, table, ImportOptions(corner_hz=corner_hz))
    for line in came.missing:
        click.echo(f"no record of {line}", err=True)
    _show_refusals(outcome.refusals)
    if not outcome.records:
        raise _no_record(len(came.files), str(out / "raw"))
    show_notes(outcome.warnings)
    Ensemble.write(out, outcome.records)
    click.echo(f"{len(outcome.records)} records in {out}, originals in {out / 'raw'}")


def _refuse_unclear_request(
    event_id: str | None, radius_km: float | None, stations: str | None, start: str | None, end: str | None
) -> None:
    if not (event_id and (radius_km or stations)) and not (stations and start and end):
        message = "give --event with --radius or --stations, or --stations with --start and --end"
        raise click.UsageError(message)
    if (radius_km and stations) or bool(start) != bool(end):
        message = "give --radius or --stations, and --start and --end together: one of them would be ignored"
        raise click.UsageError(message)


@records.command()
@click.argument("ensemble", type=EXISTING_FOLDER)
@click.option(
    "--figure",
    type=FILE,
    help="Draw spectra and scatter plots into this file.",
)
@json_option("Print the catalogue as JSON lines.")
def show(ensemble: Path, figure: Path | None, as_json: bool) -> None:
    """Show an ensemble as a table, and draw it.

    \b
    toppling records show ensembles/quakes --figure quakes.png
    """
    from toppling.models.motions.ensemble import Ensemble

    loaded = Ensemble.load(ensemble)
    if figure:
        from toppling.results.drawing.records import draw_records

        draw_records(loaded, figure)
    if as_json:
        for row in loaded.catalog.to_pylist():
            click.echo(json.dumps(row))
        return
    _show_catalog(loaded.catalog.to_pylist())
    if figure:
        click.echo(f"drawn in {figure}")


@records.command()
@click.argument("ensemble", type=EXISTING_FOLDER)
@click.option(
    "--out",
    required=True,
    type=FOLDER,
    help="Folder of the new ensemble.",
)
@click.option("--magnitude", type=float, nargs=2, metavar="LOW HIGH", help="Least and largest.")
@click.option(
    "--distance", "distance_km", type=float, nargs=2, metavar="LOW HIGH", help="Least and largest, km."
)
@click.option("--event", help="Part of the name of the event.")
@click.option("--components", type=click.IntRange(2, 3), default=2, help="Least number of components.")
@click.option(
    "--per-event",
    type=click.IntRange(min=0),
    default=0,
    help="Largest number of records per event; the nearest are kept.",
)
@click.option(
    "--quality",
    multiple=True,
    type=OneOf(["corrected", "processed", "drifting", "sound", "uncorrected", "made"]),
    help="Only records of this quality; repeatable.",
)
@click.option(
    "--pga", type=float, nargs=2, metavar="LOW HIGH", help="Least and largest PGA as recorded, m/s2."
)
@click.option("--pgv-pga", type=float, nargs=2, metavar="LOW HIGH", help="Least and largest PGV/PGA, s.")
@click.option(
    "--count",
    type=click.IntRange(min=0),
    default=0,
    help="Largest number of records, spread evenly over the ranks of PGV/PGA of those that the other conditions leave.",
)
@click.option(
    "--deaggregation",
    type=EXISTING_FILE,
    help="Table that weights the records: CSV with magnitude_low, magnitude_high, distance_low_km, distance_high_km,"
    " contribution; nshmp-haz's data.csv; or OpenQuake's Mag_Dist.",
)
@click.option("--imt", help="Measure of OpenQuake's deaggregation, such as PGV, where it has several.")
@click.option(
    "--poe",
    type=float,
    help="Its probability, where it has several; default the least, of the strongest motion.",
)
@replace_option
def select(
    ensemble: Path,
    out: Path,
    magnitude: tuple[float, float] | None,
    distance_km: tuple[float, float] | None,
    event: str | None,
    components: int,
    per_event: int,
    quality: tuple[str, ...],
    pga: tuple[float, float] | None,
    pgv_pga: tuple[float, float] | None,
    count: int,
    deaggregation: Path | None,
    imt: str | None,
    poe: float | None,
    replace: bool,
) -> None:
    """Select records of an ensemble, or weight them by a hazard.

    Each condition reports how many records remain.

    \b
    toppling records select ensembles/quakes --out ensembles/near --distance 0 20 --per-event 3
    toppling records select ensembles/quakes --out ensembles/forty --pgv-pga 0.05 0.5 --count 40
    """
    import dataclasses

    from toppling.models.motions.deaggregation import read_deaggregation
    from toppling.models.motions.ensemble import Ensemble
    from toppling.models.motions.selection import Choice, hazard_weights
    from toppling.models.motions.selection import select as chosen

    _refuse_existing(out, replace)
    loaded = Ensemble.load(ensemble)
    choice = Choice(
        magnitude or None, distance_km or None, event, components, per_event, quality, pga, pgv_pga, count
    )
    selection = chosen(loaded, choice)
    names = list(selection.record_ids)
    click.echo(f"{len(loaded.record_ids)} records in {ensemble}")
    for told, left in selection.left:
        click.echo(f"{told}: {left} left")
    if 0 < len(names) < count:
        click.echo(f"fewer than the {count} requested: all that are left were taken", err=True)
    weights = dict(zip(loaded.record_ids, loaded.catalog["weight"].to_pylist(), strict=True))
    if deaggregation:
        read = read_deaggregation(deaggregation, imt, poe)
        if read.of:
            click.echo(f"weighted for {read.of}")
        weights, empty = hazard_weights(loaded, names, read.bins)
        empty.sort(key=lambda b: -b.contribution)
        for b in empty[:MOST_EMPTY]:
            click.echo(f"no record for magnitude {b.magnitude}, distance {b.distance_km} km", err=True)
        if empty:
            share = sum(b.contribution for b in empty) / sum(b.contribution for b in read.bins)
            more = f"and {len(empty) - MOST_EMPTY} more bins: " if len(empty) > MOST_EMPTY else ""
            click.echo(f"{more}{100 * share:.3g} % of the hazard has no record", err=True)
        names = [name for name in names if weights[name] > 0]
    written = Ensemble.write(
        out, [dataclasses.replace(loaded.record(name), weight=weights[name]) for name in names]
    )
    click.echo(f"{len(written.record_ids)} of {len(loaded.record_ids)} records in {out}")


@records.command()
@ensemble_out
@click.option("--count", type=click.IntRange(min=1), default=140, show_default=True)
@click.option("--seed", type=int, default=1, show_default=True)
@click.option(
    "--pulse-share",
    type=click.FloatRange(0, 1),
    default=0.15,
    show_default=True,
    help="Share of records with near-fault pulses.",
)
@replace_option
def synthesise(out: Path, count: int, seed: int, pulse_share: float, replace: bool) -> None:
    """Make an ensemble of synthetic records.

    Its statistics are printed beside their targets.

    Magnitudes are 6 to 8, distances 5 to 100 km.

    \b
    toppling records synthesise --count 140 --seed 1 --out ensembles/synthetic
    """
    from toppling.models.motions.ensemble import Ensemble
    from toppling.models.motions.synthetic import against_targets, synthetic_ensemble

    _refuse_existing(out, replace)
    with bar("making", count) as advance:
        made = synthetic_ensemble(count, seed, pulse_share, advance)
    Ensemble.write(out, made)
    for line in against_targets(made):
        click.echo(line)
    click.echo(f"{count} records in {out}")


def _no_record(files: int, where: str) -> InputError:
    return InputError(
        f"none of {files} files gave a record",
        where=where,
        expected="three-component records",
        remedy="see the table above",
    )


def _refuse_existing(out: Path, replace: bool) -> None:
    from toppling.models.motions.ensemble import CATALOG

    if (out / CATALOG).exists() and not replace:
        raise InputError(
            "an ensemble exists there already",
            where=str(out),
            expected="a new folder",
            remedy="choose another --out, or replace it with --replace",
        )


def _show_catalog(rows: list[dict]) -> None:
    from rich import box
    from rich.console import Console
    from rich.table import Table

    table = Table(box=box.SIMPLE, title=f"{len(rows)} records", title_justify="left")
    heads = (
        "record",
        "event",
        "station",
        "M",
        "R km",
        "PGA m/s²",
        "toward °",
        "PGV m/s",
        "PGV/PGA s",
        "D s",
        "2nd dir.",
    )
    for index, head in enumerate(heads):
        table.add_column(head, justify="left" if index < 3 else "right", max_width=28, no_wrap=True)
    for row in rows:
        table.add_row(
            row["record_id"],
            row["event"],
            row["station"],
            "?" if row["magnitude"] is None else f"{row['magnitude']:.1f}",
            "?" if row["distance_km"] is None else f"{row['distance_km']:.1f}",
            f"{row['pga_m_s2']:.2f}",
            f"{row['pga_azimuth_deg']:.0f}" if row["north_known"] else "?",
            f"{row['pgv_m_s']:.3f}",
            f"{row['pgv_pga_s']:.3f}",
            f"{row['duration_energy_s']:.1f}",
            f"{row['directionality']:.2f}",
        )
    console = Console()
    Console(width=None if console.is_terminal else 150).print(table)
    undirected = sum(row["directionality"] > 0.9 for row in rows)
    click.echo(
        "toward: azimuth of the vector PGA, counter-clockwise from east;\n"
        "D: 5 to 95 % of the integral of squared velocity;\n"
        f"2nd dir.: share of PGA reached more than 22.5 degrees away ({undirected} records above 0.9)"
    )


def show_notes(notes: list[tuple[str, str]]) -> None:
    """Tell what was odd in records that were read: on the standard error, a line each."""
    for name, what in notes[:MOST_NOTES]:
        click.echo(f"note on {name}: {what}", err=True)
    if len(notes) > MOST_NOTES:
        rest = len(notes) - MOST_NOTES
        click.echo(f"{rest} more notes: each record's history has its own ('records show --json')", err=True)


def _show_refusals(refusals: "list[Refusal]") -> None:
    """Table of what was left out, by reason; places beyond the first few of one reason are counted."""
    if not refusals:
        return
    from rich import box
    from rich.console import Console
    from rich.table import Table

    by_reason: dict[tuple[str, str], list[Refusal]] = {}
    for refusal in refusals:
        by_reason.setdefault((refusal.reason.what, refusal.reason.remedy), []).append(refusal)
    table = Table(box=box.SIMPLE, show_lines=True, title=f"{len(refusals)} left out", title_justify="left")
    for head in ("left out", "why, and what to do"):
        table.add_column(head, overflow="fold", ratio=1)
    for (what, remedy), group in by_reason.items():
        subjects = [
            r.reason.where if r.subject in r.reason.where else f"{r.subject} ({r.reason.where})"
            for r in group
        ]
        table.add_row("\n".join(subjects), f"{what}\n-> {remedy}")
    console = Console()
    Console(width=None if console.is_terminal else 200).print(table)
