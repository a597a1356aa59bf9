"""`toppling run`: carry a campaign out, or go on with it."""

import json
import logging
import os
import signal
import sys
from pathlib import Path
from types import FrameType

import click

FAILED_JOBS = 3
INTERRUPTED = 130


@click.command()
@click.argument("campaign", type=click.Path(dir_okay=False, path_type=Path))
@click.option(
    "--out",
    "folder",
    required=True,
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder of the run.",
)
@click.option(
    "--workers", type=click.IntRange(min=1), default=None, help="Local workers [default: one a core]."
)
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON.")
def run(campaign: Path, folder: Path, workers: int | None, as_json: bool) -> None:
    """Shake: carry CAMPAIGN out on a cluster, or go on where an interrupted run stopped.

    \b
    toppling run campaign.toml --out runs/first --workers 2

    The same command again resumes: only jobs without a row are done. Exit code 3: some jobs have no answer.
    """  # noqa: D301  (\b keeps click from rewrapping the example)
    from orchestrator.campaign import Campaign
    from orchestrator.cluster import local
    from orchestrator.progress import duration, watcher
    from orchestrator.run import RunError
    from orchestrator.run import run as carry_out

    logging.basicConfig(level=logging.WARNING, format="%(levelname)s %(message)s")
    signal.signal(signal.SIGTERM, _stop)
    chosen = Campaign.read(campaign)
    try:
        with watcher() as watch:
            tally = carry_out(chosen, folder, local(workers or os.cpu_count() or 1), watch)
    except RunError as error:
        message = f"{error}; the rows so far are kept. To go on: toppling run {campaign} --out {folder}"
        raise click.ClickException(message) from None
    except KeyboardInterrupt:
        click.echo(
            f"stopped; the rows so far are kept. To go on: toppling run {campaign} --out {folder}",
            err=True,
        )
        sys.exit(INTERRUPTED)
    summary = {
        "run": str(folder), "jobs": tally.total, "done_before": tally.before, "done": tally.done,
        "toppled": tally.toppled, "failed": tally.failed, "status": dict(tally.status),
        "wall_s": round(tally.elapsed_s, 2), "work_s": round(tally.work_s, 2),
    }  # fmt: skip
    if as_json:
        click.echo(json.dumps(summary))
    else:
        click.echo(
            f"{folder}: {tally.done} jobs done in {duration(tally.elapsed_s)} ({tally.rate:.1f}/s), "
            f"{tally.before} done before; {tally.toppled} toppled, {tally.failed} failed"
        )
        click.echo(f"next: toppling fragility {folder}")
    if tally.failed:
        sys.exit(FAILED_JOBS)


def _stop(signum: int, frame: FrameType | None) -> None:  # noqa: ARG001  (a signal handler's signature)
    raise KeyboardInterrupt
