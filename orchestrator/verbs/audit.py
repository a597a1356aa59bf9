"""`toppling audit`: repeat a sample of a run's jobs more finely, and state how far its answers may be off."""

import json
import logging
from pathlib import Path
from typing import Any

import click

from toppling.orchestrator.verbs import shared_options as shared
from toppling.orchestrator.verbs.shared_options import cluster_of, cluster_options, option


@click.command()
@shared.run_argument
@option("--jobs", type=click.IntRange(min=1), default=40, help="Size of the sample.")
@shared.take_over_option
@shared.json_option("Print the statement as JSON.")
@cluster_options
def audit(run: Path, jobs: int, take_over: bool, as_json: bool, **where: Any) -> None:
    """Repeat a random sample of RUN's jobs and state how far its answers may be off.

    The sample is shaken with the preset 'reference', and with the second engine where its extra is installed. The
    audit states, for this rock and these records, the shift of the median PGA and of the share toppled with intervals
    (95 %), the bias of single answers, and whether the second engine agrees; 'status', 'fragility' and 'report'
    repeat it from then on. The same command resumes an interrupted audit, and a larger --jobs extends it. A run in
    progress is audited on the jobs done so far.

    \b
    toppling audit runs/first --jobs 200 --workers 2
    """
    from toppling.models.errors import InputError
    from toppling.models.files.stores import sole_writer
    from toppling.orchestrator.campaign import Campaign
    from toppling.orchestrator.context import RunProgress, Work
    from toppling.orchestrator.dask_cluster import check_workers
    from toppling.orchestrator.journal import journal
    from toppling.orchestrator.plan import plan_of
    from toppling.orchestrator.studies.audit import audit as execute
    from toppling.orchestrator.studies.audit import check_versions, drawn
    from toppling.orchestrator.task import versions
    from toppling.orchestrator.terminal import watcher
    from toppling.results.analysis.audit_statistics import audits_json, audits_of
    from toppling.results.reader import open_run
    from toppling.results.run_integrity import LEAST_JOBS

    logging.basicConfig(level=logging.WARNING, format="%(levelname)s %(message)s")
    opened = open_run(run)
    check_versions(run)
    campaign = Campaign.read(run / "campaign.toml")
    planned = plan_of(campaign)
    rows = drawn(run)
    if min(jobs, len(rows)) < LEAST_JOBS:
        raise InputError(
            "audit.too_few_jobs",
            f"an audit of {min(jobs, len(rows))} of {len(rows)} answered jobs is too small",
            where=str(run),
            expected=f"at least {LEAST_JOBS} jobs",
            remedy="let the run go on, or give more --jobs",
        )
    with (
        sole_writer(run, take_over=take_over),
        watcher() as watch,
        journal(run),
        cluster_of(run, **where) as client,
        client.as_current(),
    ):
        work = Work(planned, run.absolute(), versions(), client, watch, RunProgress(jobs, 0))
        check_workers(client, *work.run_keys)
        execute(work, jobs)
    audits = audits_of(opened)
    if as_json:
        click.echo(json.dumps({"run": str(run), "preset": campaign.preset, **audits_json(audits)}))
        return
    for found in audits.values():
        click.echo(found.sentence)
    if not audits:
        click.echo(f"fewer than {LEAST_JOBS} repeated jobs have an answer: too few for an audit")
