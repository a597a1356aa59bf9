"""`toppling records`: from record files to an ensemble."""

import json
from pathlib import Path
from typing import Any

import click

from toppling.models.errors import InputError
from toppling.models.files.folder import instead
from toppling.models.spelling import counted
from toppling.orchestrator.misspelt import Verbs
from toppling.orchestrator.progress import bar
from toppling.orchestrator.verbs import shared_options as shared
from toppling.orchestrator.verbs.records_select import refuse_existing_ensemble, select
from toppling.orchestrator.verbs.records_shown import import_json, show_catalog, show_notes, show_refusals
from toppling.orchestrator.verbs.shared_options import option


@click.group(cls=Verbs)
def records() -> None:
    """Import, fetch, synthesise, select and show ensembles of records.

    \b
    toppling records import records/ --out ensembles/quakes --metadata records/catalog.csv
    """


records.add_command(select)


@records.command("import")
@click.argument("paths", nargs=-1, required=True, type=shared.PATH, metavar="FILES-OR-FOLDERS...")
@shared.ensemble_out
@option(
    "--metadata", type=shared.EXISTING_FILE,
    help="CSV table, one row per record: h1, h2, v (paths relative to it), unit, event, mag, dist_km, station;"
    " processing (corrected or uncorrected) if the file does not state it; pga_h1, pga_h2, pga_v (m/s2) scale"
    " counts of unknown unit.",
)  # fmt: skip
@option("--missing-vertical", is_flag=True, help="Allow records without a vertical component.")
@option("--doubtful", is_flag=True, help="Allow peaks beyond 5 g, clipping, spikes and filled gaps.")
@option(
    "--place", type=click.Choice(["free-field", "any"]), default="free-field", show_default=True,
    help="Import records of the free field, or those of boreholes and structures too.",
)  # fmt: skip
@option(
    "--process/--no-process", default=None,
    help="Process every record or none. The default is to process records that their agency has not corrected and,"
    " if that is not stated, those whose displacement drifts.",
)  # fmt: skip
@shared.corner_option
@option(
    "--time-step", "time_step_s", type=click.FloatRange(0, 0.1, min_open=True), metavar="S",
    help="Resample every record to this step with an anti-alias filter.",
)  # fmt: skip
@shared.replace_option
@shared.json_option("Print what was read and left out as JSON.")
def _import(
    paths: tuple[Path, ...], out: Path, metadata: Path | None, replace: bool, as_json: bool, **asked: Any
) -> None:
    """Read records of any agency's format into the ensemble OUT.

    The format is detected from the content. Files that cannot be read are left out and listed with the reason.

    \b
    toppling records import RSN1158_KOCAELI_DZC*.AT2 --out ensembles/duzce
    toppling records import records/ --out ensembles/quakes --metadata records/catalog.csv
    """
    refuse_existing_ensemble(out, replace)
    with bar("records") as advance:
        from toppling.models.motions.ensemble import Ensemble
        from toppling.models.motions.importing import ImportOptions, import_records, record_files
        from toppling.models.motions.metadata import looks_like_table, read_table

        table = read_table(metadata) if metadata else []
        files = record_files(paths)
        advance(0, "reading", total=2 * len(files))
        outcome = import_records(files, table, ImportOptions(**asked), advance)
    if not metadata:
        for path in (found for folder in paths if folder.is_dir() for found in sorted(folder.rglob("*.csv"))):
            if looks_like_table(path):
                click.echo(f"{path} looks like a metadata table: give it with --metadata", err=True)
    if not outcome.records:
        show_refusals(outcome.refusals)
        raise _no_record(len(files), ", ".join(map(str, paths)))
    ensemble = Ensemble.write(out, outcome.records)
    if as_json:
        import_json(ensemble, outcome)
        return
    show_refusals(outcome.refusals)
    show_notes(outcome.warnings)
    click.echo(
        f"{counted(len(outcome.records), 'record')} from {counted(len(files), 'file')} in {out}, "
        f"{len(outcome.refusals)} left out"
    )
    if outcome.unused_rows:
        click.echo(f"{outcome.unused_rows} of {len(table)} rows of {metadata} name files that were not given")


@records.command()
@option("--service", default="EARTHSCOPE", help="FDSN service: its name in ObsPy, or an address.")
@option("--event-service", help="Service that has the event, if another one (such as USGS).")
@option(
    "--event", "event_id", help="Event id at the service; sets the window and gives magnitude and distance."
)
@option(
    "--radius", "radius_km", type=shared.ABOVE_0,
    help="All stations within this distance of the epicentre, km.",
)  # fmt: skip
@option("--stations", help="NET.STA, separated by commas, instead of a radius.")
@option("--start", help="Start of the window (UTC) if no event is given.")
@option("--end", help="End of the window (UTC) if no event is given.")
@shared.ensemble_out
@shared.corner_option
@shared.replace_option
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
    refuse_existing_ensemble(out, replace)
    window = (utc(start, "--start"), utc(end, "--end")) if start and end else None
    client = connect(service)
    event = find_event(connect(event_service) if event_service else client, event_id) if event_id else None
    names = [name.strip() for name in stations.split(",")] if stations else []
    with bar("fetching") as shown:

        def advance(total: int) -> None:
            shown(0, total=total) if total else shown()

        came = fetched(
            client,
            out / "raw",
            event=event,
            radius_km=radius_km,
            stations=names,
            window=window,
            advance=advance,
        )
    outcome = import_records(came.files, read_table(came.table), ImportOptions(corner_hz=corner_hz))
    for line in came.missing:
        click.echo(f"no record of {line}", err=True)
    show_refusals(outcome.refusals)
    if not outcome.records:
        raise _no_record(len(came.files), str(out / "raw"))
    show_notes(outcome.warnings)
    Ensemble.write(out, outcome.records)
    click.echo(f"{counted(len(outcome.records), 'record')} in {out}, originals in {out / 'raw'}")


def _refuse_unclear_request(
    event_id: str | None, radius_km: float | None, stations: str | None, start: str | None, end: str | None
) -> None:
    if not (event_id and (radius_km or stations)) and not (stations and start and end):
        raise click.UsageError(
            "give --event with --radius or --stations, or --stations with --start and --end"
        )
    if (radius_km and stations) or bool(start) != bool(end):
        raise click.UsageError(
            "give --radius or --stations, and --start and --end together: one of them would be ignored"
        )


@records.command()
@click.argument("ensemble", type=shared.EXISTING_FOLDER)
@option("--figure", type=shared.FILE, help="Draw spectra and scatter plots into this file.")
@shared.json_option("Print the catalogue as JSON lines.")
def show(ensemble: Path, figure: Path | None, as_json: bool) -> None:
    """Show an ensemble as a table, and draw it.

    \b
    toppling records show ensembles/quakes --figure quakes.png
    """
    from toppling.models.motions.ensemble import Ensemble

    loaded = Ensemble.load(ensemble)
    if figure:
        from toppling.results.drawing.record_figures import draw_records

        draw_records(loaded, figure)
    if as_json:
        for row in loaded.catalog.to_pylist():
            click.echo(json.dumps(row))
        return
    show_catalog(loaded.catalog.to_pylist())
    if figure:
        click.echo(f"drawn in {figure}")


@records.command()
@shared.ensemble_out
@option("--count", type=click.IntRange(min=1), default=140)
@option("--seed", type=int, default=1)
@option(
    "--pulse-share", type=click.FloatRange(0, 1), default=0.15,
    help="Share of records with near-fault pulses.",
)  # fmt: skip
@shared.replace_option
def synthesise(out: Path, count: int, seed: int, pulse_share: float, replace: bool) -> None:
    """Make an ensemble of synthetic records.

    Its statistics are printed beside their targets.

    Magnitudes are 6 to 8, distances 5 to 100 km.

    \b
    toppling records synthesise --count 140 --seed 1 --out ensembles/synthetic
    """
    from toppling.models.motions.ensemble import Ensemble
    from toppling.models.motions.synthetic import against_targets, synthetic_ensemble

    refuse_existing_ensemble(out, replace)
    with bar("making", count) as advance:
        made = synthetic_ensemble(count, seed, pulse_share, advance)
    Ensemble.write(out, made)
    for line in against_targets(made):
        click.echo(line)
    click.echo(f"{counted(count, 'record')} in {out}")


def _no_record(files: int, where: str) -> InputError:
    return InputError(
        "record.none_found",
        f"none of {files} files gave a record{instead(Path(where))}",
        where=where,
        expected="three-component records",
        remedy="see the table above",
    )
