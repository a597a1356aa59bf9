"""Session of a run: locks its folder, weights its bases, does its jobs, merges its parts, and audits them."""

import logging
import os
import time
from collections.abc import Collection, Mapping
from contextlib import AbstractContextManager, ExitStack, nullcontext, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from distributed import Client

from toppling.orchestrator.context import JobSelection, ProgressCallback, RunProgress, Work
from toppling.orchestrator.dask_cluster import make_ready
from toppling.orchestrator.dispatch import USUAL_LIMITS, Limits
from toppling.orchestrator.execution import work_off
from toppling.orchestrator.journal import journal, log_event
from toppling.orchestrator.leaving import leaving_in_order
from toppling.orchestrator.plan import Plan
from toppling.orchestrator.run_folder import note, prepare, remarks, session, set_jobs
from toppling.orchestrator.studies.audit import audit_due, audit_run
from toppling.orchestrator.studies.conditioning import lacks_weights, weigh_bases
from toppling.orchestrator.task import COMPILING, is_compiled, versions
from toppling.results.store import RESULTS_FILE, attempts_with, compact, finished_ids, result_files
from toppling.workers.compile_once import compile_apart
from toppling.workers.engines import ENGINES

log = logging.getLogger(__name__)


def run(
    planned: Plan,
    folder: Path,
    cluster: Client | AbstractContextManager[Client],
    watch: ProgressCallback,
    limits: Limits = USUAL_LIMITS,
    again: Collection[str] = (),
) -> RunProgress:
    """Execute or resume a plan in a folder, which then contains `results.parquet`.

    A new run first settles its rocks, and weights the bases where the campaign requests it; its end is its audit.

    folder: the run's folder, created if absent.
    cluster: a client, or a context manager of one, which is entered only if there is work.
    again: statuses whose jobs are repeated; their old rows are valid until there are newer ones.
    Returns RunProgress: progress of this session.

    Raises InputError if a rock does not stand, the folder is of another campaign, or workers cannot do the run.
    Raises RunError if the run cannot continue; stored rows are kept.
    """
    campaign, folder = planned.campaign, folder.absolute()
    ENGINES[campaign.engine].require()
    selection: JobSelection = planned
    if campaign.precision is not None:
        from toppling.orchestrator.studies.precision import JobsForPrecision  # with pandas: .4 s

        selection = JobsForPrecision(planned, folder, campaign.precision, campaign.target)
    here = dict(versions(campaign.engine))
    if not (folder.exists() or is_compiled()):  # a new run settles its rocks here
        watch(RunProgress(len(selection), 0, what=COMPILING))
        compile_apart()
    prepare(folder, planned, here)
    with session(folder) as notes, journal(folder):
        log_event("session began", process=os.getpid(), jobs=len(planned), versions=here, again=[*again])
        for sentence, fields in remarks(folder):
            log.warning("%s", sentence, extra={"fields": fields})
        try:
            finished = finished_ids(folder, planned.ids)  # first, because it sets damaged parts aside
            redo = attempts_with(folder, again) if again else {}
            if selection is planned:  # a run with a target may be resumed for all of its jobs
                set_jobs(folder, len(planned))
            progress = RunProgress(len(selection), len(finished - redo.keys()))
            begun = _Session(planned, folder, notes, selection, redo, progress)
            begun.execute(cluster, watch, limits, finished)
        except BaseException as error:
            log_event("session ended", how=type(error).__name__, why=str(error))
            raise
        log_event("session ended", how="complete", **progress.summary())
    return progress


@dataclass
class _Session:
    """Execution of a selection of jobs, and merging of the results."""

    planned: Plan
    folder: Path
    notes: dict[str, Any]
    selection: JobSelection
    redo: Mapping[str, int]
    progress: RunProgress

    def execute(
        self,
        cluster: Client | AbstractContextManager[Client],
        watch: ProgressCallback,
        limits: Limits,
        finished: set[str],
    ) -> None:
        """Do the remaining work until all rows exist; `finished` are jobs with rows when the session began."""
        planned, folder, selection, progress = self.planned, self.folder, self.selection, self.progress
        weighs = lacks_weights(planned, folder)
        if not weighs:
            left = selection.pending(finished - self.redo.keys())
            if not len(left):
                left = selection.pending(self.merge())
            progress.total = len(selection)
            if not len(left) and not audit_due(planned, folder):
                return

        def report(activity: str) -> None:
            progress.what = activity
            watch(progress)

        log_event("work began", **progress.summary())
        with ExitStack() as until_done:
            # A client passed by the caller stays open.
            client = until_done.enter_context(
                nullcontext(cluster) if isinstance(cluster, Client) else cluster
            )
            until_done.enter_context(client.as_current())
            until_done.enter_context(leaving_in_order(client))
            work = Work(
                planned, folder, versions(planned.campaign.engine), client, watch, progress, limits, self.redo
            )
            make_ready(client, *work.run_keys, report=report)
            progress.began = time.monotonic()  # a batch system may have kept it waiting for hours
            if weighs:
                weigh_bases(work, run)
            work_off(selection, work, self.merge)
            progress.ended = time.monotonic()
            audit_run(work)

    def merge(self) -> set[str]:
        """Merge the parts of a complete run, and return its finished jobs: fewer than all if a part was damaged.

        The session's notes are written first, because `compact` includes them in the results.
        """
        progress, folder = self.progress, self.folder
        counts = {"done": progress.done, "status": dict(progress.status), "deaths": progress.deaths}
        ended = {"ended": "complete", **counts}
        note(folder, self.notes | ended)
        if result_files(folder) != [folder / RESULTS_FILE]:
            with suppress(FileNotFoundError):  # no readable part is left
                compact(folder)
        finished = finished_ids(folder, self.planned.ids, self.redo)
        if not len(self.selection.pending(finished)):
            self.notes |= ended
        return finished
