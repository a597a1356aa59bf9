"""`toppling run`: carry out a campaign, or resume it."""

import json
import logging
import shlex
import sys
from contextlib import AbstractContextManager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from toppling.models.errors import InputError, counted
from toppling.orchestrator.dispatch import Limits
from toppling.orchestrator.interrupt import INTERRUPTED, signals_as_stop
from toppling.orchestrator.processes import started_ahead
from toppling.orchestrator.verbs import shared_options as shared
from toppling.orchestrator.verbs.shared_options import (
    cluster_of,
    cluster_options,
    local_workers,
    of_batch_job,
    option,
)

if TYPE_CHECKING:
    from distributed import Client

    from toppling.orchestrator.campaign import Campaign
    from toppling.orchestrator.public.running import FinishedRun

FAILED_JOBS = 3
"""Exit code of a complete run with jobs without an answer."""
_AGAIN = ("crashed", "failed")
"""Statuses that may have a transient cause. Undecided and diverged jobs would have the same result again."""
_GO_ON = "the rows so far are kept, and the same command goes on"


def _statuses(context: click.Context, parameter: click.Parameter, value: str | None) -> list[str]:  # noqa: ARG001
    """Parse --again (a click callback)."""
    names = [] if value is None else [name.strip() for name in value.split(",")]
    for name in names:
        if name not in _AGAIN:
            raise click.BadParameter(f"{name!r} is none of {', '.join(_AGAIN)}")
    return names


def _precision(context: click.Context, parameter: click.Parameter, value: str | None) -> float | None:  # noqa: ARG001
    """Parse --precision (a click callback)."""
    if value is None:
        return None
    try:
        share = float(value.removesuffix("%")) / (100.0 if value.endswith("%") else 1.0)
    except ValueError:
        raise click.BadParameter(f"{value!r} is not a fraction, such as 5% or 0.05") from None
    return share


@click.command()
@click.argument("campaign", type=shared.FILE)
@option("--out", "folder", type=shared.FOLDER, help="Folder of the run.")
@cluster_options
@option("--dry-run", is_flag=True, help="With --queue: print the job script and stop.")
@option(
    "--job-limit", type=click.FloatRange(1), default=Limits.job_s,
    help="Wall time in seconds of a job after which its worker is ended.",
)  # fmt: skip
@option(
    "--tries", type=click.IntRange(min=1), default=Limits.tries,
    help="Number of worker deaths after which a job is given up; raise it if workers are often preempted.",
)  # fmt: skip
@option(
    "--again", callback=_statuses, metavar="STATUS,...",
    help=f"Also repeat jobs that ended without an answer, by status: {', '.join(_AGAIN)}.",
)  # fmt: skip
@option(
    "--precision", callback=_precision, metavar="SHARE",
    help="End as soon as the shaking at which half topple is known to within SHARE (95 %), such as 5%; with the "
    "campaign's target, if it has one.",
)  # fmt: skip
@shared.take_over_option
@shared.json_option("Print the summary as JSON.")
def run(
    campaign: Path,
    folder: Path | None,
    dry_run: bool,
    job_limit: float,
    tries: int,
    again: list[str],
    precision: float | None,
    take_over: bool,
    as_json: bool,
    **where: Any,
) -> None:
    """Carry out CAMPAIGN on local or remote workers, or resume an interrupted run.

    \b
    toppling run campaign.toml --out runs/first --workers 2
    toppling run campaign.toml --out runs/first --scheduler tcp://node1:8786
    toppling run campaign.toml --out runs/first --precision 5%
    toppling run campaign.toml --queue slurm --dry-run
    toppling run campaign.toml --out runs/first --again crashed,failed

    The same command resumes an interrupted run: only jobs without a row are done. Exit code 3 means that some jobs,
    of this session or an earlier one, have no answer; --again repeats them once the cause is removed.
    """
    if dry_run:
        from toppling.orchestrator.cluster import job_script

        queue = where["queue_kind"]
        if queue is None:
            raise click.UsageError("--dry-run needs --queue")
        click.echo(job_script(queue, of_batch_job(where)))
        return
    if folder is None:
        raise click.UsageError("Missing option '--out'.")
    from toppling.orchestrator.campaign import Campaign
    from toppling.results.store import RESULTS_FILE

    chosen = Campaign.read(campaign)  # before what takes seconds to import: most campaigns are refused here
    if precision is not None:
        chosen = chosen.with_precision(precision)
    _refuse_moved(chosen, campaign, folder)
    limits = Limits(job_limit, tries)
    asked: dict[str, Any] = {"limits": limits, "again": again, "take_over": take_over}
    complete = (folder / RESULTS_FILE).exists() and not again
    with started_ahead(0 if complete else local_workers(where)):
        _run(chosen, folder, where, asked, as_json=as_json)


def _run(
    chosen: "Campaign", folder: Path, where: dict[str, Any], asked: dict[str, Any], *, as_json: bool
) -> None:
    """Execute the campaign and print the result; contains slow imports."""
    logging.basicConfig(level=logging.WARNING, format="%(levelname)s %(message)s")
    cluster = cluster_of(folder, **where)
    if chosen.precision:
        from toppling.orchestrator.studies.precision import borne_words

        click.echo(borne_words(chosen), err=True)
    elif not (folder.exists() or chosen.sites):
        _warn(chosen)
    shaken = _execute(chosen, folder, cluster, asked)
    _print_result(chosen, folder, shaken, as_json=as_json)


def _warn(chosen: "Campaign") -> None:
    """Warn of shaking beyond all recorded motions; an invalid campaign is refused later by the run itself."""
    from toppling.models.motions.ensemble import Ensemble
    from toppling.orchestrator.advice import shaking_warnings

    with suppress(InputError):
        for sentence in shaking_warnings(chosen, Ensemble.load(chosen.ensemble)):
            click.echo(f"warning: {sentence}", err=True)


def _refuse_moved(chosen: "Campaign", campaign: Path, folder: Path) -> None:
    """Refuse a campaign whose scene or records are missing, naming the copies in the run."""
    copy = folder / "campaign.toml"
    missing = next((path for path in (chosen.scene, chosen.ensemble) if not path.exists()), None)
    if missing is None or not copy.is_file() or copy.samefile(campaign):
        return
    again = shlex.join(["toppling", "run", str(copy), "--out", str(folder)])
    raise InputError(
        "file.absent",
        f"{missing} is not there",
        where=str(campaign),
        expected="the folders that it names",
        remedy=f"put it back, or go on with the copy that the run keeps: {again}",
    )


def _execute(
    chosen: "Campaign", folder: Path, cluster: AbstractContextManager["Client"], asked: dict[str, Any]
) -> "FinishedRun":
    """Do the jobs; if that ends early, say how to resume the run."""
    from toppling.orchestrator.context import RunError
    from toppling.orchestrator.public.running import run as execute
    from toppling.orchestrator.terminal import watcher

    try:
        with signals_as_stop(), watcher() as watch:
            return execute(chosen, folder, cluster=cluster, watch=watch, **asked)
    except RunError as error:
        raise click.ClickException(f"{error}; {_GO_ON}") from None
    except OSError as error:
        if folder.exists():
            error.add_note(_GO_ON)
        raise
    except KeyboardInterrupt:
        click.echo(f"stopped; {_GO_ON}", err=True)
        sys.exit(INTERRUPTED)


def _print_result(chosen: "Campaign", folder: Path, shaken: "FinishedRun", *, as_json: bool) -> None:
    """Print what was done and the results; the exit code indicates jobs without an answer."""
    from toppling.orchestrator.advice import suggestions
    from toppling.orchestrator.status import level_counts, state_of
    from toppling.orchestrator.terminal import duration, pace
    from toppling.results.analysis.unphysical import unphysical_of

    advice = [] if chosen.precision or chosen.sites else suggestions(level_counts(folder))
    progress, unphysical = shaken.session, unphysical_of(shaken)
    state = state_of(folder)  # of all sessions, including unanswered jobs of earlier ones
    summary = {
        "run": str(folder), "jobs": progress.total, "done_before": progress.before, "done": progress.done,
        "toppled": state["toppled"], "failed": state["failed"], "status": state["status"],
        "deaths": progress.deaths, "suggestions": advice, "audit": state["audit"],
        "stood": state["stood"], "statements": state["statements"],
        "unphysical": unphysical.to_json() if unphysical else None,
        "wall_s": round(progress.elapsed_s, 2), "work_s": round(progress.work_s, 2),
    }  # fmt: skip
    if as_json:
        click.echo(json.dumps(summary))
    else:
        now = f"{counted(progress.done, 'job')} done in {duration(progress.elapsed_s)} ({pace(progress.rate)}), "
        done = f"{now}{progress.before:,}" if progress.done else f"all {counted(progress.before, 'job')}"
        ended = f"in all {state['toppled']:,} toppled, {state['failed']:,} failed"
        click.echo(f"{folder}: {done} done before; {ended}")
        if state["failed"]:
            click.echo(f"why some failed: toppling status {shlex.quote(str(folder))}")
        for sentence in [*state["statement_sentences"], *state["audit_sentences"], *state["stood_sentences"]]:
            click.echo(sentence)
        if unphysical:
            click.echo(unphysical.sentence)
        if state["again"]:
            click.echo(f"to do them again, add to the command: --again {','.join(state['again'])}")
        for sentence in advice:
            click.echo(sentence)
        click.echo(f"next: toppling {'atlas' if chosen.sites else 'fragility'} {shlex.quote(str(folder))}")
    if state["failed"]:
        sys.exit(FAILED_JOBS)
