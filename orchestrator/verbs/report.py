"""`toppling report`: one page about a run."""

from pathlib import Path
from typing import Any

import click

from toppling.orchestrator.terminal import bar
from toppling.orchestrator.verbs import shared_options as shared
from toppling.orchestrator.verbs.shared_options import SITE_HELP, SiteCommand, of, option, values_option
from toppling.results.analysis import SAMPLES

_REPORT = "public.reporting.report"


@click.command(cls=SiteCommand)
@shared.run_argument
@of(_REPORT, "--out", type=shared.FILE)
@of(_REPORT, "--pdf")
@of(_REPORT, "--age")
@of(_REPORT, "--hazard", metavar="PATH[=WEIGHT]")
@option("--site", type=shared.SITE, metavar="LON LAT", help=SITE_HELP)
@option("--site-name", hidden=True)
@of(_REPORT, "--measure")
@of(_REPORT, "--ratio", type=shared.ABOVE_0)
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
    from toppling.orchestrator.public.reporting import report as write_report

    with bar("report") as advance:
        written = write_report(run, out, site=site or site_name, advance=advance, **asked)
    click.echo(written.page)
    if written.pdf:
        click.echo(written.pdf)
