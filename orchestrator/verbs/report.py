"""`toppling report`: one page about a run."""

from pathlib import Path
from typing import Any

import click

from toppling.orchestrator.progress import bar
from toppling.orchestrator.public.reporting import report as write_report
from toppling.orchestrator.verbs import shared_options as shared
from toppling.orchestrator.verbs.shared_options import SITE_HELP, SiteCommand, of, option, values_option
from toppling.results.analysis.resampling import SAMPLES


@click.command(cls=SiteCommand)
@shared.run_argument
@of(write_report, "--out", type=shared.FILE)
@of(write_report, "--pdf")
@of(write_report, "--age")
@of(write_report, "--hazard", metavar="PATH[=WEIGHT]")
@option("--site", type=float, nargs=2, metavar="LON LAT", help=SITE_HELP)
@option("--site-name", hidden=True)
@of(write_report, "--measure")
@of(write_report, "--ratio", type=shared.ABOVE_0)
@values_option
@shared.samples_option(SAMPLES)
def report(
    run: Path, out: Path | None, site: tuple[float, float] | None, site_name: str | None, **asked: Any
) -> None:
    """Write a report on RUN as one HTML page that needs no network and can be attached to a paper.

    Its first page has the answer, its curve, its interval with what that comes from, and what would change it. Then
    come scene, records, maps, fits, constraint, jobs, and methods. A JSON file beside it has ids, versions, campaign
    and the meaning of every column. Of a campaign of many rocks it shows all side by side, as 'toppling atlas' does.

    \b
    toppling report runs/first --pdf
    toppling report runs/first --age 15000..30000 --hazard mean.csv=0.6 --hazard high.csv=0.4
    """
    with bar("report") as advance:
        written = write_report(run, out, site=site or site_name, advance=advance, **asked)
    click.echo(written.page)
    if written.pdf:
        click.echo(written.pdf)
