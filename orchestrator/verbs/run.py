"""`toppling run`: carry a campaign out, or go on with it."""

import json
import logging
import os
import shlex
import signal
import sys
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from toppling.orchestrator.cluster import QUEUES
from toppling.orchestrator.dispatch import Limits
from toppling.orchestrator.interrupt import INTERRUPTED, stop_once
from toppling.orchestrator.spelling import OneOf

FAILED_JOBS = 3
AGAIN = ("crashed", "timeout", "failed")
"""Statuses that something transient may cause. What is undecided or diverged would be so again."""

OF_ONE_CALL = ("again", "report", "as_json", "dry_run")
"""Options that a call which goes on does not repeat."""

FILE = click.Path(dir_okay=False, path_type=Path)
FOLDER = click.Path(file_okay=False, path_type=Path)


def _statuses(context: click.Context, parameter: click.Parameter, value: str | None) -> list[str]:  # noqa: ARG001
    """Read the value of --again, as click calls it."""
    names = [] if value is None else [name.strip() for name in value.split(",")]
    for name in names:
        if name not in AGAIN:
            msg = f"{name!r} is none of {', '.join(AGAIN)}"
            raise click.BadParameter(msg)
    return names


@click.command()
@click.argument("campaign", type=FILE)
@click.option("--out", "folder", type=FOLDER, help="Folder of the run.")
@click.option("--workers", type=click.IntRange(min=1), help="Local workers; one a core if not given.")
@click.option("--scheduler", help="Address of an existing scheduler; DASK_SCHEDULER_ADDRESS if set.")
@click.option("--scheduler-file", type=FILE, help="File that 'dask scheduler --scheduler-file' wrote.")
@click.option("--queue", type=OneOf(list(QUEUES)), help="Batch system to ask for workers.")
@click.option(
    "--queue-jobs", type=click.IntRange(min=1), default=1, show_default=True, help="Batch jobs to submit."
)
@click.option("--dry-run", is_flag=True, help="With --queue: print the job script and stop.")
@click.option("--tls-ca", type=FILE, help="Certificate of the cluster's authority (PEM).")
@click.option("--tls-cert", type=FILE, help="Certificate of this client (PEM).")
@click.option("--tls-key", type=FILE, help="Key of this client (PEM).")
@click.option(
    "--job-limit", type=click.FloatRange(1), default=Limits.job_s, show_default=True,
    help="Wall time in seconds after which a worker is taken to hang.",
)  # fmt: skip
@click.option(
    "--tries", type=click.IntRange(min=1), default=Limits.tries, show_default=True,
    help="Deaths of its worker after which a job is given up; more where workers are often taken away.",
)  # fmt: skip
@click.option(
    "--again", callback=_statuses, metavar="STATUS,...",
    help=f"Also do jobs again that ended without an answer: {', '.join(AGAIN)}.",
)  # fmt: skip
@click.option("--performance-report", "report", type=FILE, help="Write Dask's performance report (HTML).")
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON.")
def run(
    campaign: Path,
    folder: Path | None,
    workers: int | None,
    queue: str | None,
    dry_run: bool,
    job_limit: float,
    tries: int,
    again: list[str],
    report: Path | None,
    as_json: bool,
    **where: Any,
) -> None:
    """Shake: carry CAMPAIGN out on a cluster, or go on where an interrupted run stopped.

    \b
    toppling run campaign.toml --out runs/first --workers 2
    toppling run campaign.toml --out runs/first --scheduler tcp://node1:8786
    toppling run campaign.toml --queue slurm --dry-run
    toppling run campaign.toml --out runs/first --again crashed,timeout

    The same command again resumes: only jobs without a row are done. Exit code 3: some jobs have no answer, of
    this session or an earlier one; --again does them again, once what was in their way is mended.
    """  # noqa: D301  (\b keeps click from rewrapping the example)
    from toppling.orchestrator.advice import suggestions
    from toppling.orchestrator.campaign import Campaign
    from toppling.orchestrator.cluster import job_script
    from toppling.orchestrator.progress import duration, watcher
    from toppling.orchestrator.run import RunError
    from toppling.orchestrator.run import run as carry_out
    from toppling.orchestrator.status import shares_of, state_of

    if dry_run:
        if queue is None:
            raise click.UsageError("--dry-run needs --queue")
        click.echo(job_script(queue))
        return
    if folder is None:
        raise click.UsageError("Missing option '--out'.")
    logging.basicConfig(level=logging.WARNING, format="%(levelname)s %(message)s")
    signal.signal(signal.SIGTERM, stop_once)  # a batch system's warning
    chosen = Campaign.read(campaign)
    cluster = _cluster(folder, workers, queue, **where)
    command = _command(click.get_current_context())
    to_go_on = " ".join([f"To go on: {command}", *(["--again", ",".join(again)] if again else [])])
    try:
        with watcher() as watch:
            tally = carry_out(chosen, folder, cluster, watch, Limits(job_limit, tries), report, again)
    except RunError as error:
        message = f"{error}; the rows so far are kept. {to_go_on}"
        raise click.ClickException(message) from None
    except KeyboardInterrupt:
        click.echo(f"stopped; the rows so far are kept. {to_go_on}", err=True)
        sys.exit(INTERRUPTED)
    advice = suggestions(shares_of(folder))
    state = state_of(folder)  # of all sessions: what an earlier one left without an answer still has none
    summary = {
        "run": str(folder), "jobs": tally.total, "done_before": tally.before, "done": tally.done,
        "toppled": state["toppled"], "failed": state["failed"], "status": state["status"],
        "deaths": tally.deaths, "suggestions": advice,
        "wall_s": round(tally.elapsed_s, 2), "work_s": round(tally.work_s, 2),
    }  # fmt: skip
    if as_json:
        click.echo(json.dumps(summary))
    else:
        click.echo(
            f"{folder}: {tally.done} jobs done in {duration(tally.elapsed_s)} ({tally.rate:.1f}/s), "
            f"{tally.before} done before; in all {state['toppled']} toppled, {state['failed']} failed"
        )
        if state["failed"]:
            click.echo(f"why some failed: toppling status {folder}")
        if there := [name for name in AGAIN if name in state["status"]]:
            click.echo(f"to do them again: {command} --again {','.join(there)}")
        for sentence in advice:
            click.echo(sentence)
        click.echo(f"next: toppling fragility {folder}")
    if state["failed"]:
        sys.exit(FAILED_JOBS)


def _command(context: click.Context) -> str:
    """The command that goes on with this run where it ran, without what is of this call alone."""
    words = ["toppling", "run", str(context.params["campaign"])]
    for option in context.command.params:
        value = context.params.get(str(option.name))
        given = context.get_parameter_source(str(option.name)) is ParameterSource.COMMANDLINE
        if given and isinstance(option, click.Option) and option.name not in OF_ONE_CALL:
            words += [option.opts[0], str(value)]
    return shlex.join(words)


def _cluster(
    folder: Path,
    workers: int | None,
    queue_kind: str | None,
    queue_jobs: int,
    scheduler: str | None,
    scheduler_file: Path | None,
    tls_ca: Path | None,
    tls_cert: Path | None,
    tls_key: Path | None,
) -> AbstractContextManager:
    from toppling.orchestrator.cluster import existing, local, queue, tls_security

    given = {
        "--workers": workers, "--queue": queue_kind,
        "--scheduler": scheduler, "--scheduler-file": scheduler_file,
    }  # fmt: skip
    ways = [name for name, value in given.items() if value]
    if len(ways) > 1:
        msg = f"{' and '.join(ways)} exclude each other"
        raise click.UsageError(msg)
    joins = bool(scheduler or scheduler_file or (not ways and os.environ.get("DASK_SCHEDULER_ADDRESS")))
    tls = None
    if tls_ca or tls_cert or tls_key:
        if not joins:
            msg = "--tls-ca, --tls-cert and --tls-key are for a running scheduler: give --scheduler or --scheduler-file"
            raise click.UsageError(msg)
        if tls_ca is None or tls_cert is None or tls_key is None:
            msg = "--tls-ca, --tls-cert and --tls-key belong together"
            raise click.UsageError(msg)
        tls = tls_security(tls_ca, tls_cert, tls_key)
    if queue_kind:
        return queue(queue_kind, queue_jobs, folder.absolute())
    if joins:
        return existing(scheduler, scheduler_file, tls)
    return local(workers or os.cpu_count() or 1)
