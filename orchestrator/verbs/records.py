"""`toppling records`: from record files to an ensemble, and fewer records, or records weighted by a hazard."""

import json
from collections.abc import Collection, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from toppling.models.errors import InputError, counted
from toppling.models.files.documents import MOST_SHOWN
from toppling.models.files.folder import instead
from toppling.orchestrator.cli import SuggestingChoice, Verbs
from toppling.orchestrator.terminal import bar
from toppling.orchestrator.verbs import shared_options as shared
from toppling.orchestrator.verbs.shared_options import option

if TYPE_CHECKING:
    from toppling.models.motions.ensemble import Ensemble
    from toppling.models.motions.importing import Import, Refusal
    from toppling.models.motions.selection import Deaggregation


@click.command()
@click.argument("ensemble", type=shared.EXISTING_FOLDER)
@option("--out", required=True, type=shared.FOLDER, help="Folder of the new ensemble.")
@option("--magnitude", type=float, nargs=2, metavar="LOW HIGH", help="Least and largest.")
@option("--distance", "distance_km", type=float, nargs=2, metavar="LOW HIGH", help="Least and largest, km.")
@option("--event", help="Part of the name of the event.")
@option(
    "--per-event", "most_per_event", type=click.IntRange(min=0), default=0,
    help="Largest number of records per event; the nearest are kept.",
)  # fmt: skip
@option(
    "--quality", multiple=True, type=SuggestingChoice(["corrected", "processed", "drifting", "sound", "uncorrected",
    "made"]),
    help="Only records of this quality; repeatable.",
)  # fmt: skip
@option(
    "--pga", "pga_m_s2", type=float, nargs=2, metavar="LOW HIGH",
    help="Least and largest PGA as recorded, m/s2.",
)  # fmt: skip
@option(
    "--pgv-pga", "pgv_pga_s", type=float, nargs=2, metavar="LOW HIGH", help="Least and largest PGV/PGA, s."
)
@option(
    "--count", type=click.IntRange(min=0), default=0,
    help="Largest number of records, spread evenly over the ranks of PGV/PGA of those that the other conditions leave.",
)  # fmt: skip
@option(
    "--deaggregation", type=shared.EXISTING_FILE,
    help="Table that weights the records: CSV with magnitude_low, magnitude_high, distance_low_km, distance_high_km,"
    " contribution; nshmp-haz's data.csv; or OpenQuake's Mag_Dist.",
)  # fmt: skip
@option("--imt", help="Measure of OpenQuake's deaggregation, such as PGV, where it has several.")
@option(
    "--poe", type=float,
    help="Its probability, where it has several; default the least, of the strongest motion.",
)  # fmt: skip
@shared.replace_option
def select(
    ensemble: Path,
    out: Path,
    deaggregation: Path | None,
    imt: str | None,
    poe: float | None,
    replace: bool,
    **asked: Any,
) -> None:
    """Select records of an ensemble, or weight them by a hazard.

    Each condition reports how many records remain.

    \b
    toppling records select ensembles/quakes --out ensembles/near --distance 0 20 --per-event 3
    toppling records select ensembles/quakes --out ensembles/forty --pgv-pga 0.05 0.5 --count 40
    """
    import dataclasses

    from toppling.models.motions.ensemble import Ensemble
    from toppling.models.motions.selection import Choice, read_deaggregation
    from toppling.models.motions.selection import select as chosen

    _refuse_existing_ensemble(out, replace)
    loaded = Ensemble.load(ensemble)
    choice = Choice(**asked)
    names, conditions = chosen(loaded, choice)
    click.echo(f"{counted(len(loaded.record_ids), 'record')} in {ensemble}")
    for condition, left in conditions:
        click.echo(f"{condition}: {left} left")
    if 0 < len(names) < choice.count:
        click.echo(f"fewer than the {choice.count} requested: all that are left were taken", err=True)
    weights = dict(zip(loaded.record_ids, loaded.catalog["weight"].to_pylist(), strict=True))
    if deaggregation:
        weights = _hazard_weights(loaded, names, read_deaggregation(deaggregation, imt, poe))
        names = [name for name in names if weights[name] > 0]
    written = Ensemble.write(
        out, [dataclasses.replace(loaded.record(name), weight=weights[name]) for name in names]
    )
    click.echo(f"{len(written.record_ids)} of {counted(len(loaded.record_ids), 'record')} in {out}")


def _hazard_weights(ensemble: "Ensemble", names: list[str], hazard: "Deaggregation") -> dict[str, float]:
    """Weights of records from a deaggregation; prints the bins that no record represents."""
    from toppling.models.motions.selection import hazard_weights

    if hazard.of:
        click.echo(f"weighted for {hazard.of}")
    weights, empty = hazard_weights(ensemble, names, hazard.bins)
    for b in empty.sort_values("contribution", ascending=False, kind="stable")[:MOST_SHOWN].itertuples():
        magnitude, distance_km = (b.magnitude_low, b.magnitude_high), (b.distance_low_km, b.distance_high_km)
        click.echo(f"no record for magnitude {magnitude}, distance {distance_km} km", err=True)
    if len(empty):
        share = empty["contribution"].sum() / hazard.bins["contribution"].sum()
        more = f"and {len(empty) - MOST_SHOWN} more bins: " if len(empty) > MOST_SHOWN else ""
        click.echo(f"{more}{100 * share:.3g} % of the hazard has no record", err=True)
    return weights


def _refuse_existing_ensemble(out: Path, replace: bool) -> None:
    """Refuse a folder that contains an ensemble, unless it is to be replaced."""
    from toppling.models.motions.ensemble import CATALOG

    if (out / CATALOG).exists() and not replace:
        raise InputError(
            "ensemble.exists",
            "an ensemble exists there already",
            where=str(out),
            expected="a new folder",
            remedy="choose another --out, or replace it with --replace",
        )


def _import_json(ensemble: "Ensemble", outcome: "Import") -> None:
    """Print the records read and the files left out as JSON."""
    fields = ("code", "what", "where", "remedy")
    left_out = [
        {"subject": r.subject} | {name: getattr(r.reason, name) for name in fields} for r in outcome.refusals
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


def show_table(
    heads: Sequence[str], rows: Iterable[Sequence[str]], left: Collection[int], title: str | None = None
) -> None:
    """Print a table of words; of the left-aligned columns, `left`, long entries wrap, and no number is shortened."""
    from rich import box
    from rich.console import Console
    from rich.measure import Measurement
    from rich.table import Table

    table = Table(box=box.SIMPLE, title=title, title_justify="left")
    for index, head in enumerate(heads):
        words = index in left
        table.add_column(
            head, justify="left" if words else "right", max_width=28, no_wrap=not words, overflow="fold"
        )
    for row in rows:
        table.add_row(*row)
    console = Console(width=None if Console().is_terminal else 150, markup=False)
    unlimited = console.options.update(max_width=10_000)
    console.width = max(console.width, Measurement.get(console, unlimited, table).minimum)
    console.print(table)


def _show_catalog(rows: list[dict]) -> None:
    """Print an ensemble's records as a table."""
    heads = ("record", "event", "station", "M", "R km", "PGA m/s²", "toward °", "PGV m/s", "PGV/PGA s", "D s",
             "2nd dir.", "quality")  # fmt: skip
    words = [
        (
            row["record_id"], row["event"], row["station"],
            "?" if row["magnitude"] is None else f"{row['magnitude']:.1f}",
            "?" if row["distance_km"] is None else f"{row['distance_km']:.1f}",
            f"{row['pga_m_s2']:.2f}", f"{row['ground_accelerates_toward_deg']:.0f}" if row["north_known"] else "?",
            f"{row['pgv_m_s']:.3f}", f"{row['pgv_pga_s']:.3f}", f"{row['duration_energy_s']:.1f}",
            f"{row['directionality']:.2f}", row["quality"],
        )
        for row in rows
    ]  # fmt: skip
    show_table(heads, words, range(3), counted(len(rows), "record"))
    undirected = sum(row["directionality"] > 0.9 for row in rows)
    click.echo(
        "toward: azimuth of the vector PGA, counter-clockwise from east;\n"
        "D: 5 to 95 % of the integral of squared velocity;\n"
        f"2nd dir.: share of PGA reached more than 22.5 degrees away ({undirected} above 0.9)"
    )


def show_notes(notes: list[tuple[str, str]]) -> None:
    """Print warnings on records to standard error, one per line."""
    for name, what in notes[:MOST_SHOWN]:
        click.echo(f"note on {name}: {what}", err=True)
    if len(notes) > MOST_SHOWN:
        rest = len(notes) - MOST_SHOWN
        click.echo(f"{rest} more notes: each record's history has its own ('records show --json')", err=True)


def _show_refusals(refusals: "list[Refusal]") -> None:
    """Print the files left out, by reason; of a reason only the first few places."""
    by_reason: dict[tuple[str, str], list[str]] = {}
    for refusal in refusals:
        reason, subject = refusal.reason, refusal.subject
        place = reason.where if subject in reason.where else f"{subject} ({reason.where})"
        by_reason.setdefault((reason.brief, reason.remedy), []).append(place)
    for (what, remedy), places in by_reason.items():
        click.echo(f"left out: {what}\n  -> {remedy}")
        for place in places:
            click.echo(f"  {place}")


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
    _refuse_existing_ensemble(out, replace)
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
        _show_refusals(outcome.refusals)
        raise _no_record(len(files), ", ".join(map(str, paths)))
    ensemble = Ensemble.write(out, outcome.records)
    if as_json:
        _import_json(ensemble, outcome)
        return
    _show_refusals(outcome.refusals)
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
    _refuse_existing_ensemble(out, replace)
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
    _show_refusals(outcome.refusals)
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
    _show_catalog(loaded.catalog.to_pylist())
    if figure:
        click.echo(f"drawn in {figure}")


@records.command()
@shared.ensemble_out
@option("--count", type=click.IntRange(min=1), default=140)
@option("--seed", type=int, default=1)
@shared.replace_option
def synthesise(out: Path, count: int, seed: int, replace: bool) -> None:
    """Make an ensemble of synthetic records.

    Its statistics are printed beside their targets.

    Magnitudes are 6 to 8, distances 5 to 100 km.

    \b
    toppling records synthesise --count 140 --seed 1 --out ensembles/synthetic
    """
    from toppling.models.motions.ensemble import Ensemble
    from toppling.models.motions.synthetic import against_targets, synthetic_ensemble

    _refuse_existing_ensemble(out, replace)
    with bar("making", count) as advance:
        made = synthetic_ensemble(count, seed, advance=advance)
    Ensemble.write(out, made)
    for line in against_targets(made):
        click.echo(line)
    click.echo(f"{counted(count, 'record')} in {out}")


def _no_record(files: int, where: str) -> InputError:
    return InputError(
        "record.none_found",
        f"{counted(files, 'file')} gave no record{instead(Path(where)) if Path(where).is_dir() else ''}",
        where=where,
        expected="three-component records",
        remedy="see the reasons above",
    )
