"""Jobs in flight: a bounded window of batches on the cluster, rows to the store, faults survived.

What to do next is decided in :mod:`toppling.orchestrator.dispatch`; here is all that talks to Dask about jobs.
"""

import logging
import math
import time
import uuid
from collections.abc import Callable, Sequence
from concurrent.futures import CancelledError
from contextlib import suppress
from typing import Any

import numpy as np
from distributed import Future, KilledWorker, as_completed
from numpy.typing import NDArray

from toppling.orchestrator import admission
from toppling.orchestrator.answers import Asked
from toppling.orchestrator.cluster_supervisor import ClusterSupervisor
from toppling.orchestrator.context import JobSelection, RunError, RunProgress, Work
from toppling.orchestrator.delivery import NotDeliveredError
from toppling.orchestrator.dispatch import JOBS_IN_BATCH, Batch, Dispatch, why_given_up
from toppling.orchestrator.interrupt import held_back
from toppling.orchestrator.journal import tell
from toppling.orchestrator.leaving import was_told_to_leave
from toppling.orchestrator.task import Row, RunKey, UnfitWorkerError, lost_row, shake_batch
from toppling.results.store import finished_ids, write_part
from toppling.workers.job import JobSpec

log = logging.getLogger(__name__)

_BATCH_BUDGET_S = 2.0
"""Work of one task: a hundred times what handing it out costs, yet little to lose with a worker."""

_ATLAS_BUDGET_S = 6.0
"""The same of many rocks: making one ready costs a third of a second."""

_BATCHES_A_SECOND = 100
"""What a scheduler hands out and takes back without being late; on larger clusters a task's work grows."""

_POLL_S, _WAIT_S = 0.02, 0.5
"""Between looks for an answer, and until all else is looked after."""

_LOOK_S = 2.0
"""Time between looks at the cluster: how many threads it has, and whether a batch is overdue."""

_FLUSH_S = (5.0, 60.0)
"""Least and greatest time between part files; it grows with the run, so that a weekend makes few thousand."""

ROUNDS = 3
"""Times that the plan is gone through: more than once only if a stored part was lost to another program or a disk."""

_Task = Callable[[RunKey, Sequence[JobSpec], float], list[Row]]


def budget_s(workers: int, rocks: int = 1) -> float:
    """Work of one task on a cluster of so many workers, in seconds; of many rocks it begins with making one ready."""
    return max(_ATLAS_BUDGET_S if rocks > 1 else _BATCH_BUDGET_S, workers / _BATCHES_A_SECOND)


def room_for(rows: Sequence[Row], budget_s: float) -> int:
    """Jobs to send in the next batch: twice what fits at the pace of this one, so that few travel in vain."""
    spent_s = sum(row.get("wall_s") or 0.0 for row in rows)
    return math.ceil(min(2 * budget_s * len(rows) / max(spent_s, 1e-3), JOBS_IN_BATCH))


def work_off(selection: JobSelection, work: Work) -> None:
    """Shake until every job that is wanted has a row.

    Raises RunError if the run cannot go on, or rows are lost again and again.
    """
    progress, redo = work.progress, work.redo
    sent: set[int] = set()
    in_vain = 0
    while True:
        finished = finished_ids(work.folder, work.planned.ids, redo)
        pending = selection.pending(finished)
        progress.total, progress.again = len(selection), len(redo.keys() - finished)
        if not len(pending):
            return
        progress.what = selection.what
        if lost := len(sent.intersection(pending.tolist())):
            log.warning("%d rows were lost after they were stored", lost)
            in_vain += 1
        if in_vain >= ROUNDS:
            raise rows_lost(work)
        sent |= set(pending.tolist())
        Execution(work, pending)()


def rows_lost(work: Work) -> RunError:
    """Say that rows do not stay where they are stored."""
    return RunError(f"rows are lost after they are stored: is the disk of {work.folder} sound?")


class Execution:
    """Some jobs of a plan on their way through a cluster.

    work: whose plan, workers and store they have, and whose progress is counted on.
    pending: (n,) int, rows of the plan that need work, in the order to start them.
    task: what a worker does with a batch.
    """

    def __init__(self, work: Work, pending: NDArray[np.int64], task: _Task = shake_batch) -> None:
        self.work, self.plan, self.client, self.progress = work, work.planned, work.client, work.progress
        self.task = task
        columns = self.plan.columns
        self.dispatch = Dispatch(pending, columns["duration_s"], work.limits.tries, columns["scene_id"])
        self._asked = Asked(self.plan, work.folder)
        self._rocks = {scene.scene_id: scene.rock for scene in self.plan.scenes}
        self._session = uuid.uuid4().hex[:8]
        self.tasks = 0  # handed out so far
        self._room = JOBS_IN_BATCH
        self._looked = -math.inf
        self._upkeep = ClusterSupervisor(self.client)
        self._absence = admission.Absence(self.client)
        self._all_alive = time.monotonic()
        self._since: dict[tuple[str, str], float] = {}
        self._overdue: set[str] = set()
        self._flying: dict[Future, Batch] = {}
        self._unstored: list[Row] = []
        self._flushed = time.monotonic()

    def __call__(self) -> RunProgress:
        """Work until every job has a row in the store.

        Raises RunError if the scheduler is lost or no worker is fit.
        Raises OSError if a part cannot be written.
        """
        arriving = as_completed(loop=self.client.loop, with_results=True, raise_errors=False)
        try:
            while self.dispatch or self._flying:
                try:
                    self._look()
                    self._submit(arriving)
                    until = time.monotonic() + _WAIT_S
                    while not arriving.has_ready() and time.monotonic() < until:
                        time.sleep(_POLL_S)
                        if self.client.status != "running":
                            raise ConnectionError(admission.LOST)
                    for future, result in arriving.next_batch(block=False):
                        self._take(future, result)
                except (OSError, CancelledError) as error:
                    if not admission.may_be_lost(error):
                        raise
                    arriving.clear()
                    self._rejoin(error)
                self._flush()
                self.work.watch(self.progress)
        finally:
            with held_back():
                arriving.clear()
                self._flush(last=True)
                if self._flying and self.client.status == "running":
                    with suppress(OSError):
                        self.client.cancel(list(self._flying), force=True)
                self.work.watch(self.progress)
        return self.progress

    def _submit(self, arriving: as_completed) -> None:
        workers = max(self.progress.workers, 1)
        batches: list[Batch] = []
        # More than two a worker: Dask then keeps the waiting ones on the scheduler, out of reach of a crash.
        while len(self._flying) + len(batches) < 2 * workers + 2 and (
            batch := self.dispatch.next_batch(workers, self._room)
        ):
            batches.append(batch)
        if not batches:
            return
        specs = [[self.plan.spec(job) for job in batch.jobs] for batch in batches]
        # A key never returns, not even in another session: Dask would hand out the old answer.
        keys = []
        for batch_specs in specs:
            self.tasks += 1
            keys.append(("shake", batch_specs[0].job_id, f"{self._session}-{self.tasks}"))
        # In one graph: Dask takes its tasks for one group only if it sees them together.
        futures = self.client.map(
            self.task,
            [self.work.run_keys[self.plan.columns["scene_id"][batch.jobs[0]]] for batch in batches],
            specs,
            [budget_s(workers, len(self.plan.scenes))] * len(batches),
            key=keys,
            pure=False,
        )
        self._flying.update(zip(futures, batches, strict=True))
        arriving.update(futures)

    def _rejoin(self, error: BaseException) -> None:
        """Hand out again what is in flight, once the scheduler answers again or another does at its address."""
        if self.client.cluster is not None:  # a scheduler in this process is not started again
            raise RunError(admission.LOST) from error
        for batch in self._flying.values():
            self.dispatch.came_back(batch, done=0)
        self._flying.clear()
        tell("scheduler lost", error=repr(error))
        admission.make_ready(self.client, *self.work.run_keys)
        tell("scheduler came back")
        self._looked = -math.inf

    def _take(self, future: Future, result: Any) -> None:
        batch, status = self._flying[future], future.status
        if status == "finished":
            rows, wrong = self._asked.checked([self.plan.spec(job) for job in batch.jobs], result)
            self._keep(rows, batch.attempt)
            if rows:
                self._room = room_for(rows, budget_s(self.progress.workers, len(self.plan.scenes)))
            for place, problem in wrong.items():
                self._distrust(batch.jobs[place], batch, problem)
            self.dispatch.came_back(batch, done=len(rows) + len(wrong))
        elif status == "error":
            self._take_error(str(future.key), batch, result[1])
        elif status == "cancelled" and self.client.cluster is None:
            raise CancelledError  # as Dask does with all when the scheduler is gone
        else:
            log.warning("%d jobs came back unfinished (%s) and go out again", len(batch.jobs), status)
            self.dispatch.came_back(batch, done=0)
        del self._flying[future]
        future.release()

    def _take_error(self, key: str, batch: Batch, error: BaseException) -> None:
        if isinstance(error, KilledWorker):
            hung = key in self._overdue
            if not hung and was_told_to_leave(self.client, error.last_worker.address):
                tell("worker left", worker=error.last_worker.address, jobs=len(batch.jobs))
                self.dispatch.came_back(batch, done=0)
                return
            self.progress.deaths += 1
            details = {"worker": error.last_worker.address, "alone": batch.alone, "attempt": batch.attempt}
            log.warning(
                "a worker %s with %d jobs at hand",
                "hung" if hung else "died",
                len(batch.jobs),
                extra={"fields": details},
            )
            lost = self.dispatch.died(batch, hung=hung)
            if lost is not None:
                self._give_up(lost, batch)
        elif isinstance(error, NotDeliveredError):
            admission.offer_assets(self.client, self.work.run_keys)
            self.dispatch.came_back(batch, done=0)
        elif isinstance(error, UnfitWorkerError):
            log.warning("%s; it is sent away", error)
            if error.worker:
                self.client.retire_workers([error.worker], close_workers=True)
            if not self.client.nthreads():
                raise RunError(f"no fit worker is left: {error}")
            self.dispatch.came_back(batch, done=0)
        else:
            raise RunError(f"the cluster cannot do a task ({type(error).__name__}: {error})") from error

    def _distrust(self, job: int, batch: Batch, problem: str) -> None:
        """Have a job tried again, alone, whose row does not answer it, or give it up."""
        log.warning("a worker's row of job %s does not answer it: %s", self.plan.spec(job).job_id, problem)
        if self.dispatch.died(Batch((job,), batch.attempt, batch.alone)) is not None:
            self._give_up(job, batch, f"a worker's row does not answer it: {problem}")

    def _give_up(self, job: int, batch: Batch, problem: str = "") -> None:
        status, message = why_given_up(self.work.limits, self.dispatch.hung[job])
        if problem:
            status, message = "failed", problem
        spec = self.plan.spec(job)
        details = {"job_id": spec.job_id, "record_id": spec.record_id, "status": status}
        log.warning("job %s of record %s: %s, %s", *details.values(), message, extra={"fields": details})
        self._keep([lost_row(spec, status, message)], batch.attempt)

    def _look(self) -> None:
        """See how many threads there are, and replace workers that hang."""
        now = time.monotonic()
        if now - self._looked < _LOOK_S:
            return
        self._looked = now
        workers = sum(self.client.nthreads().values())
        if workers != self.progress.workers:
            tell("workers changed", workers=workers, before=self.progress.workers)
        self.progress.workers = workers
        self._absence.look()
        if not self._upkeep.gone():
            self._all_alive = now
        elif now - self._all_alive > admission.NOBODY_AFTER_S and not self.progress.workers:
            raise RunError(admission.NOBODY)
        elif now - self._all_alive > admission.REPLACE_AFTER_S:
            self._upkeep.replace()
        processing = self.client.processing()
        self._upkeep.grow(self.progress.work_left_s)
        self._upkeep.shrink(processing)
        working = {(worker, str(key)) for worker, keys in processing.items() for key in keys}
        self._since = {batch_key: self._since.get(batch_key, now) for batch_key in working}
        patience_s = budget_s(workers, len(self.plan.scenes)) + self.work.limits.job_s
        late = {batch_key for batch_key, since in self._since.items() if now - since > patience_s}
        if late:
            self._overdue |= {key for _, key in late}
            for batch_key in late:
                del self._since[batch_key]
            workers = sorted({worker for worker, _ in late})
            log.warning("no answer for %g s from %s: replaced", self.work.limits.job_s, ", ".join(workers))
            loop = self.client.loop
            assert loop is not None  # as long as the client is open
            # Called on the client's own loop it does not wait: a worker that hangs takes seconds to be gone.
            loop.add_callback(self.client.restart_workers, workers, raise_for_error=False)

    def _keep(self, rows: list[Row], attempt: int) -> None:
        self.progress.count(rows)
        # Of a job's rows the newest attempt counts: one that is done again goes on from where it was.
        for row in rows:
            newest = self.work.redo.get(row["job_id"], 0) + attempt
            self._unstored.append({**row, "rock": self._rocks[row["scene_id"]], "attempt": newest})

    def _flush(self, *, last: bool = False) -> None:
        now = time.monotonic()
        pause = min(max(self.progress.elapsed_s / 60, _FLUSH_S[0]), _FLUSH_S[1])
        if self._unstored and (last or now - self._flushed >= pause):
            write_part(self.work.store or self.work.folder, self._unstored)
            self.progress.stored += len(self._unstored)
            self.progress.again -= sum(row["job_id"] in self.work.redo for row in self._unstored)
            self._unstored = []
            tell("rows stored", **self.progress.summary())
            self._flushed = time.monotonic()
