"""`toppling atlas`: many rocks on one page, in one figure and one table."""

import json
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

import click

from toppling.models.errors import InputError
from toppling.models.files.folder import write_text
from toppling.models.files.table import write_csv
from toppling.models.motions.measures import COMPARED
from toppling.orchestrator.run_folder import place_in
from toppling.orchestrator.terminal import bar
from toppling.orchestrator.verbs import shared_options as shared
from toppling.orchestrator.verbs.shared_options import option
from toppling.results.analysis import HEADLINE_MEASURE, SAMPLES
from toppling.results.reader import Run, open_run

if TYPE_CHECKING:
    from toppling.results.analysis.side_by_side import RockResults


@click.command()
@click.argument("runs", nargs=-1, required=True, type=shared.PATH, metavar="RUN...")
@option("--out", type=shared.FOLDER, help="Folder; default RUN/atlas.")
@option(
    "--measure", type=click.Choice(COMPARED), default=HEADLINE_MEASURE, metavar="MEASURE",
    help="Intensity measure of all fragilities, a column of the results.",
)  # fmt: skip
@option("--shared", "only_common", is_flag=True, help="Use only the records and levels that all rocks share.")
@option("--reports", is_flag=True, help="Also write the report of each rock that has none.")
@shared.samples_option(SAMPLES)
@shared.json_option("Print the table as JSON.")
def atlas(
    runs: tuple[Path, ...],
    out: Path | None,
    measure: str,
    only_common: bool,
    reports: bool,
    samples: int,
    as_json: bool,
) -> None:
    """Show the rocks of RUN side by side: a gallery, their fragilities in one figure, and a table.

    RUN is an atlas, a run of a campaign of many rocks; several runs of one rock each are shown together too. It writes
    atlas.html, which needs no network, fragilities.png and .svg, rocks.csv, and rocks.geojson with the rocks whose
    place is known: by the campaign's table of sites, or by the coordinate system that their scan states.

    \b
    toppling atlas runs/atlas --reports
    toppling atlas runs/echo runs/lion --measure pga_m_s2 --out compared
    """
    from toppling.results.analysis.side_by_side import compare_rocks
    from toppling.results.drawing.report.gallery_page import gallery_page, summary

    opened = [open_run(path) for path in runs]
    of_rocks = _rocks_of(opened)
    folder = out or place_in(runs[0], "atlas")
    if reports:
        _write_reports(of_rocks, samples)
    with bar("rocks", 2 * len(of_rocks)) as advance:
        rocks, common = compare_rocks(of_rocks, measure, samples, only_common=only_common, advance=advance)
        title = ", ".join(run.name for run in opened) if len(opened) < 4 else f"{len(opened)} runs"
        text = gallery_page(title, opened, rocks, common, measure, folder, advance)
    write_text(text, folder / "atlas.html")
    _write_files(folder, rocks, measure)
    if as_json:
        click.echo(json.dumps([rock.row for rock in rocks], indent=1, allow_nan=False))
        return
    for sentence in summary(rocks, common, measure):
        click.echo(sentence)
    placed = sum(rock.place is not None for rock in rocks)
    where = f", rocks.geojson and directions.geojson with {placed} of {len(rocks)} rocks"
    where = where if placed else "; no rock's place is known"
    click.echo(f"{folder}: atlas.html, fragilities (PNG, SVG), rocks.csv{where}")


def _rocks_of(opened: list[Run]) -> list[Run]:
    """Distinct rocks of some runs; InputError if one occurs twice."""
    found = [rock for run in opened for rock in (run.rocks or (run,))]
    ids = [run.scene_id() for run in found]
    if twice := [name for name, count in Counter(ids).items() if count > 1]:
        raise InputError(
            "rock.given_twice",
            f"the rock of scene {twice[0]} is there twice",
            where=", ".join(str(run.path) for run, name in zip(found, ids, strict=True) if name == twice[0]),
            expected="each rock once",
            remedy="leave one of the runs out",
        )
    return found


def _write_reports(rocks: list[Run], samples: int) -> None:
    from toppling.results.drawing.report.content import Content
    from toppling.results.drawing.report.gallery_page import REPORT
    from toppling.results.drawing.report.page import report_page

    with bar("reports", len(rocks)) as advance:
        for rock in rocks:
            target = place_in(rock.path, REPORT)
            try:
                if not target.exists():
                    write_text(report_page(Content(rock, samples)), target)
            except InputError as error:
                click.echo(f"{rock.rock} has no report: {error.brief}", err=True)
            advance()


def _write_files(folder: Path, rocks: list["RockResults"], measure: str) -> None:
    import pandas as pd

    from toppling.results.analysis.side_by_side import directions_geojson, geojson
    from toppling.results.drawing.side_by_side_figures import fragilities_figure
    from toppling.results.drawing.style import save

    save(fragilities_figure(rocks, measure), folder / "fragilities")
    write_csv(pd.DataFrame([rock.row for rock in rocks]), folder / "rocks.csv")
    if any(rock.place for rock in rocks):
        for name, content in (("rocks", geojson(rocks)), ("directions", directions_geojson(rocks))):
            write_text(json.dumps(content, indent=1, allow_nan=False), folder / f"{name}.geojson")
