"""A session of a run: its folder held, its stages and its jobs done in turn, its parts merged at the end."""

import logging
import os
import time
from collections.abc import Collection, Sequence
from contextlib import AbstractContextManager, ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from distributed import Client

from toppling.orchestrator.admission import make_ready
from toppling.orchestrator.context import (
    JobSelection,
    ProgressCallback,
    RunProgress,
    Stage,
    Work,
)
from toppling.orchestrator.dispatch import USUAL_LIMITS, Limits
from toppling.orchestrator.execution import ROUNDS, rows_lost, work_off
from toppling.orchestrator.folder import note, prepare, remarks, session, set_jobs
from toppling.orchestrator.journal import journal, tell
from toppling.orchestrator.leaving import leaving_in_order
from toppling.orchestrator.plan import Plan
from toppling.orchestrator.task import versions
from toppling.results.store import RESULTS_FILE, attempts_with, compact, finished_ids, result_files

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Session:
    """What carries a run out, or goes on with it."""

    cluster: AbstractContextManager[Client]  # entered only if there is work
    watch: ProgressCallback
    limits: Limits = USUAL_LIMITS
    # Statuses whose jobs are done again; what they have counts until there is a newer row.
    again: Collection[str] = ()
    stages: Sequence[Stage] = ()

    def carry_out(self, planned: Plan, folder: Path, selection: JobSelection | None = None) -> RunProgress:
        """Do what is left of a plan in its folder, which then holds `results.parquet`.

        folder: the run's, absolute; made if absent.
        selection: the jobs wanted; all unless given.
        Returns RunProgress: of this session.
        Raises InputError if the folder is of another campaign, or workers are unfit for the run.
        Raises RunError if the run cannot go on; what was done stays.
        """
        here = versions(planned.campaign.engine)
        prepare(folder, planned, dict(here))
        with session(folder, {}) as notes, journal(folder):
            tell(
                "session began",
                process=os.getpid(),
                jobs=len(planned),
                versions=dict(here),
                again=[*self.again],
            )
            for sentence, fields in remarks(folder):
                log.warning("%s", sentence, extra={"fields": fields})
            try:
                goal = _Goal(planned, folder, notes, self.again, planned if selection is None else selection)
                progress = self._until_complete(goal, here)
            except BaseException as error:
                tell("session ended", how=type(error).__name__, why=str(error))
                raise
            tell("session ended", how="complete", **progress.summary())
        return progress

    def _until_complete(self, goal: "_Goal", here: tuple[tuple[str, str], ...]) -> RunProgress:
        planned, progress = goal.planned, goal.progress
        if not self._due(goal, before=True):
            left = goal.selection.pending(goal.finished - goal.redo.keys())
            if not len(left):
                left = goal.selection.pending(goal.merge())
            progress.total = len(goal.selection)
            if not len(left) and not self._due(goal, before=False):
                return progress
        tell("work began", **progress.summary())
        with ExitStack() as until_done:
            client = until_done.enter_context(self.cluster)
            until_done.enter_context(client.as_current())
            until_done.enter_context(leaving_in_order(client))
            work = Work(planned, goal.folder, here, client, self.watch, progress, self.limits, goal.redo)
            make_ready(client, *work.run_keys)
            progress.began = time.monotonic()  # a batch system may have kept it waiting for hours
            for stage in self._due(goal, before=True):
                stage.carry_out(work)
            for _ in range(ROUNDS):
                work_off(goal.selection, work)
                lost = goal.selection.pending(goal.merge())
                if not len(lost):
                    break
                log.warning("%d rows were lost after they were stored", len(lost))
            else:
                raise rows_lost(work)
            progress.ended = time.monotonic()
            for stage in self._due(goal, before=False):
                stage.carry_out(work)
        return progress

    def _due(self, goal: "_Goal", *, before: bool) -> list[Stage]:
        return [one for one in self.stages if one.before == before and one.due(goal.planned, goal.folder)]


class _Goal:
    """The rows that a run is to have, and what becomes of its folder once they are there."""

    def __init__(
        self,
        planned: Plan,
        folder: Path,
        notes: dict[str, Any],
        again: Collection[str],
        selection: JobSelection,
    ) -> None:
        self.planned, self.folder, self.notes = planned, folder, notes
        self.finished = finished_ids(folder, planned.ids)  # first, as it sets rows of other runs aside
        self.redo = attempts_with(folder, again) if again else {}
        self.selection = selection
        if selection is planned:  # a run that was to end with a statement may go on to all of its jobs
            set_jobs(folder, len(planned))
        self.progress = RunProgress(
            len(self.selection), len(self.finished - self.redo.keys()), len(self.redo)
        )

    def merge(self) -> set[str]:
        """Merge the parts of a complete run; its finished jobs, of which some lack if a part was cut meanwhile.

        The session's notes come first: what `compact` puts into the results tells of this session too.
        """
        progress, folder = self.progress, self.folder
        ended = {
            "ended": "complete",
            "done": progress.done,
            "status": dict(progress.status),
            "deaths": progress.deaths,
        }
        note(folder, self.notes | ended)
        if result_files(folder) != [folder / RESULTS_FILE]:
            with suppress(FileNotFoundError):  # no part is left that can be read
                compact(folder)
        finished = finished_ids(folder, self.planned.ids, self.redo)
        if not len(self.selection.pending(finished)):
            self.notes |= ended
        return finished
