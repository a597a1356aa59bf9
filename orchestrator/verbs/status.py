"""`toppling status`: the progress of a run, from its folder alone."""

import json
from pathlib import Path

import click

from toppling.orchestrator.verbs import shared_options as shared


@click.command()
@shared.run_argument
@shared.json_option("Print the state as JSON.")
def status(run: Path, as_json: bool) -> None:
    """Show the progress of RUN, during the run and after it.

    Jobs count once their rows are stored, a few seconds after they end.

    \b
    toppling status runs/first
    """
    from toppling.models.errors import counted
    from toppling.orchestrator.status import state_of
    from toppling.orchestrator.terminal import duration, pace
    from toppling.results.reader import atlas_of

    run = atlas_of(run) or run
    state = state_of(run)
    if as_json:
        click.echo(json.dumps(state))
        return
    remark = state["unfinished"]
    detail = f": {remark}" if remark else f", {state['stored']:,} of {state['jobs']:,} jobs stored"
    click.echo(f"{run}: {state['state']}{detail}")
    if state["writer"]:
        click.echo(
            f"held by {state['writer']}; if that was killed, go on with 'toppling run ... --take-over'"
        )
    if state["rate_per_s"]:
        click.echo(f"rate {pace(state['rate_per_s'])} over the last minute, {duration(state['left_s'])} left")
    if state["workers"] is not None:
        deaths = counted(state["deaths"], "worker death")
        click.echo(f"{counted(state['workers'], 'worker')}, {deaths} in this session")
    counts = ", ".join(f"{name} {count:,}" for name, count in state["status"].items()) or "none yet"
    click.echo(f"toppled {state['toppled']:,}, failed {state['failed']:,} ({counts})")
    for sentence in [*state["statement_sentences"], *state["audit_sentences"], *state["stood_sentences"]]:
        click.echo(sentence)
    for failure in state["failures"]:
        click.echo(
            f"  {failure['jobs']} {failure['status']}, such as {failure['job_id']} ({failure['record_id']}): "
            f"{failure['message']}"
        )
