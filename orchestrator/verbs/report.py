"""`toppling report`: one page about a run."""

from pathlib import Path

import click
from rich.console import Console
from rich.progress import Progress

from toppling.orchestrator.folder import place_in
from toppling.results.drawing.report import SECTIONS, report_page, write_page
from toppling.results.run import open_run


@click.command()
@click.argument("run", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path, dir_okay=False), help="RUN/report.html if not given.")
@click.option(
    "--samples", type=click.IntRange(1), default=100, show_default=True, help="Bootstrap, of records."
)
def report(run: Path, out: Path | None, samples: int) -> None:
    """Write one HTML page about a run that can be read without a network.

    Scene, ensemble, maps, fits, failures, accuracy, provenance and the meaning of every column.

    \b
    toppling report runs/first
    """  # noqa: D301
    opened = open_run(run)
    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("report", total=len(SECTIONS))
        page = report_page(opened, samples, lambda title: progress.update(task, advance=1, description=title))
    click.echo(write_page(page, out or place_in(run, "report.html")))
