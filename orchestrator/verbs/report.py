"""`toppling report`: one page about a run."""

from pathlib import Path

import click

from toppling.orchestrator.folder import place_in
from toppling.orchestrator.progress import bar
from toppling.orchestrator.verbs.hazard import HAZARD_HELP, SITE_HELP, Asked, SiteCommand, read_tree
from toppling.orchestrator.verbs.options import FILE, run_argument, samples_option
from toppling.results.drawing.report.content import HEADLINE_MEASURE, Content
from toppling.results.drawing.report.sections import SECTIONS
from toppling.results.drawing.report.write import report_page, write_page, write_pdf
from toppling.results.hazard.ages import parse_age
from toppling.results.resampling import SAMPLES
from toppling.results.run import Run, open_run


@click.command(cls=SiteCommand)
@run_argument
@click.option("--out", type=FILE, help="Default: RUN/report.html.")
@click.option(
    "--pdf",
    is_flag=True,
    help="Also print the page to PDF, beside it (with WeasyPrint, Chromium, Chrome or Edge).",
)
@click.option(
    "--age",
    help="Years the rock has stood, as for 'toppling constrain': 20000, 15000..30000, 20000+-3000 or a CSV.",
)
@click.option(
    "--hazard",
    multiple=True,
    metavar="PATH[=WEIGHT]",
    help=f"{HAZARD_HELP} Needs --age.",
)
@click.option(
    "--site", type=float, nargs=2, metavar="LON LAT", help=SITE_HELP,
)  # fmt: skip
@click.option("--site-name", hidden=True)
@samples_option(SAMPLES)
def report(
    run: Path,
    out: Path | None,
    pdf: bool,
    age: str | None,
    hazard: tuple[str, ...],
    site: tuple[float, float] | None,
    site_name: str | None,
    samples: int,
) -> None:
    """Write a report on RUN as one HTML page that needs no network and can be attached to a paper.

    It begins with the result in three sentences and one picture. Then come scene, records, maps, fits, constraint,
    failures, accuracy, a paragraph on methods to copy, provenance, and the meaning of every column. Of a campaign of
    many rocks it shows all side by side, as 'toppling atlas' does.

    \b
    toppling report runs/first --pdf
    toppling report runs/first --age 15000..30000 --hazard mean.csv=0.6 --hazard high.csv=0.4
    """
    if hazard and not age:
        msg = "a hazard curve needs the rock's --age, to turn rates into probabilities"
        raise click.UsageError(msg)
    tree = read_tree(hazard, Asked(site or site_name)) if hazard else None
    opened, target = open_run(run), out or place_in(run, "report.html")
    if opened.rocks:
        _report_atlas(opened, target, samples, pdf=pdf)
        return
    content = Content(opened, samples, parse_age(age) if age else None, tree)
    with bar("report", len(SECTIONS) + pdf) as advance:
        text = report_page(content, lambda title: advance(doing=f"after {title}"))
        click.echo(write_page(text, target))
        if pdf:
            click.echo(write_pdf(text, target.with_suffix(".pdf")))


def _report_atlas(atlas: Run, target: Path, samples: int, *, pdf: bool) -> None:
    """Write one page about all rocks."""
    from toppling.results.drawing.report.gallery_page import gallery_page
    from toppling.results.side_by_side import beside_each_other

    with bar("report", 2 * len(atlas.rocks)) as advance:
        rocks, shared = beside_each_other(atlas.rocks, HEADLINE_MEASURE, samples, advance=advance)
        text = gallery_page(atlas.name, [atlas], rocks, shared, HEADLINE_MEASURE, target.parent, advance)
    click.echo(write_page(text, target))
    if pdf:
        click.echo(write_pdf(text, target.with_suffix(".pdf")))
