"""Carry a plan out on a cluster: a bounded window of batches in flight, rows to the store, faults survived.

What to do next is decided in :mod:`orchestrator.dispatch`; here is all that talks to Dask and to the disk.
"""

import logging
import math
import os
import time
import uuid
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, Protocol

import numpy as np
from distributed import Client, Future, KilledWorker, LocalCluster, as_completed, performance_report
from distributed.comm import CommClosedError
from numpy.typing import NDArray

from toppling.models.errors import InputError
from toppling.orchestrator.answers import checked
from toppling.orchestrator.campaign import Campaign
from toppling.orchestrator.cluster import Upkeep
from toppling.orchestrator.delivery import offer
from toppling.orchestrator.dispatch import JOBS_IN_BATCH, USUAL_LIMITS, Batch, Dispatch, Limits, why_given_up
from toppling.orchestrator.folder import note, prepare, remarks, session
from toppling.orchestrator.interrupt import held_back
from toppling.orchestrator.journal import journal, tell
from toppling.orchestrator.leaving import leaving_in_order, was_told_to_leave
from toppling.orchestrator.plan import Plan, PlannedScene, plan_of
from toppling.orchestrator.processor import unlike
from toppling.orchestrator.rounds import AllJobs, JobsForPrecision, Wanted
from toppling.orchestrator.stands import Settled, settled_scenes
from toppling.orchestrator.stood import Recorded, weigh_bases
from toppling.orchestrator.task import Order, Row, UnfitWorkerError, check, lost_row, shake_batch, versions
from toppling.results.stood import FILE, FOLDER, Stood
from toppling.results.store import (
    RESULTS_FILE,
    attempts_with,
    compact,
    finished_ids,
    result_files,
    write_part,
)
from toppling.workers.engines import ENGINES
from toppling.workers.job import JobSpec

log = logging.getLogger(__name__)

BATCH_BUDGET_S = 2.0
"""Work of one task: a hundred times what handing it out costs, yet little to lose with a worker."""

ATLAS_BUDGET_S = 6.0
"""The same of many rocks: making one ready costs a third of a second."""

BATCHES_A_SECOND = 100
"""What a scheduler hands out and takes back without being late; on larger clusters a task's work grows."""

ROUNDS = 3
"""Goes at the plan: more than one only if a stored part was lost, to another program or a failing disk."""

LOST = "the connection to the scheduler is lost"
NOBODY = "every worker has died and none comes back"
POLL_S = 0.02
LOOK_S = 2.0
"""Time between looks at the cluster: how many threads it has, and whether a batch is overdue."""

REPLACE_AFTER_S = 10.0
"""Dask has this long to bring back a worker that died: several times what a start takes on a busy machine."""

NOBODY_AFTER_S = 90.0
"""A local run without any worker for this long ends instead of waiting for ever."""

FLUSH_S = (5.0, 60.0)
"""Least and greatest time between part files; it grows with the run, so that a weekend makes few thousand."""

Task = Callable[[Order, Sequence[JobSpec], float], list[Row]]


class RunError(RuntimeError):
    """The run cannot go on; what is stored stays, and the same command resumes."""


class Watcher(Protocol):
    """Who wants to see a run go on."""

    def __call__(self, tally: "Tally") -> None:
        """Take note of the state; called often, must return at once."""


@dataclass
class Tally:
    """How far a run has come.

    Parameters
    ----------
    total : int
        Jobs of the plan.
    before : int
        Jobs that had a row when this session began, those to be done again aside.
    again : int
        Jobs to be done again whose new row is not stored yet.
    what : str
        Is being done.
    """

    total: int
    before: int
    again: int = 0
    what: str = "shaking"
    done: int = 0
    stored: int = 0
    toppled: int = 0
    workers: int = 0
    deaths: int = 0
    work_s: float = 0.0
    status: Counter[str] = field(default_factory=Counter)
    began: float = field(default_factory=time.monotonic)
    ended: float | None = None

    @property
    def elapsed_s(self) -> float:
        """Time since the session's first job went out, until its last came back."""
        return (time.monotonic() if self.ended is None else self.ended) - self.began

    @property
    def rate(self) -> float:
        """Jobs a second in this session."""
        return self.done / self.elapsed_s

    @property
    def left_s(self) -> float | None:
        """Time left at the rate so far: jobs go out in balanced blocks, so that those left cost as those done."""
        left = self.total - self.before - self.done
        return max(left, 0) / self.rate if self.done else None

    @property
    def failed(self) -> int:
        """Jobs of this session that have no answer."""
        return self.done - self.status["ok"]

    def told(self) -> dict[str, Any]:
        """State in words that a program reads."""
        return {
            "done": self.done,
            "stored": self.stored,
            "total": self.total,
            "again": self.again,
            "toppled": self.toppled,
            "failed": self.failed,
            "workers": self.workers,
            "deaths": self.deaths,
            "elapsed_s": round(self.elapsed_s, 1),
        }

    def count(self, rows: Sequence[Row]) -> None:
        """Add rows."""
        self.done += len(rows)
        for row in rows:
            self.status[row["status"]] += 1
            self.toppled += row.get("toppled") is True
            self.work_s += row.get("wall_s") or 0.0


@dataclass(frozen=True)
class Work:
    """A run at work: what its jobs and stages share.

    Parameters
    ----------
    planned : Plan
    folder : Path
        The run's.
    order : Order
        What workers must find.
    client : Client
    watch : Watcher
    limits : Limits
    tally : Tally
        Of the run's own jobs.
    """

    planned: Plan
    folder: Path
    order: Order
    client: Client
    watch: Watcher
    limits: Limits
    tally: Tally


class Stage(Protocol):
    """What is done before or after the jobs of a run, on the same workers."""

    @property
    def before(self) -> bool:
        """Whether it comes before them."""

    def due(self, planned: Plan, folder: Path) -> bool:
        """Whether there is something to do now; asked again once the jobs are done."""

    def carry_out(self, work: Work) -> None:
        """Do it, or go on with it."""


def run(
    campaign: Campaign,
    folder: Path,
    cluster: AbstractContextManager[Client],
    watch: Watcher,
    limits: Limits = USUAL_LIMITS,
    report: Path | None = None,
    again: Collection[str] = (),
    stages: Sequence[Stage] = (),
) -> Tally:
    """Carry a campaign out, or go on with it; the folder then holds `results.parquet`.

    Parameters
    ----------
    campaign : Campaign
    folder : Path
        The run's folder, made if absent.
    cluster : context manager of Client
        Entered only if there is work.
    watch : Watcher
    limits : Limits
    report : Path or None
        Where to write Dask's performance report.
    again : collection of str
        Statuses whose jobs are done again; what they have counts until there is a newer row.
    stages : sequence of Stage
        Besides the weighing of bases, which a campaign asks for by itself.

    Returns
    -------
    Tally
        Of this session.

    Raises
    ------
    InputError
        If the campaign does not fit its scene, its ensemble or the folder, or workers are unfit for the run.
    RunError
        If the run cannot go on; what was done stays.
    """
    folder = folder.absolute()
    planned = plan_of(campaign)
    settled = {} if folder.exists() else settled_scenes(planned)
    ENGINES[campaign.engine].require()
    return carry_out(planned, folder, cluster, watch, limits, settled, report, again, [Weighing(), *stages])


def carry_out(
    planned: Plan,
    folder: Path,
    cluster: AbstractContextManager[Client],
    watch: Watcher,
    limits: Limits = USUAL_LIMITS,
    settled: Settled = MappingProxyType({}),
    report: Path | None = None,
    again: Collection[str] = (),
    stages: Sequence[Stage] = (),
) -> Tally:
    """Do what is left of a plan in its folder, as :func:`run` does of a campaign."""
    here = versions(planned.campaign.engine)
    prepare(folder, planned, dict(here), settled)
    order = order_of(planned.scenes[0], folder, here)
    with session(folder, {}) as notes, journal(folder):
        tell("session began", process=os.getpid(), jobs=len(planned), versions=dict(here), again=[*again])
        for sentence, told in remarks(folder):
            log.warning("%s", sentence, extra={"fields": told})
        try:

            @contextmanager
            def at_work(tally: Tally) -> Iterator[Work]:
                with cluster as client, client.as_current(), _reported(report):
                    check_workers(client, order, [order_of(scene, folder, here) for scene in planned.scenes])
                    with leaving_in_order(client):
                        yield Work(planned, folder, order, client, watch, limits, tally)

            tally = _until_complete(planned, folder, at_work, again, notes, stages)
        except BaseException as error:
            tell("session ended", how=type(error).__name__, why=str(error))
            raise
        tell("session ended", how="complete", **tally.told())
    return tally


def _until_complete(
    planned: Plan,
    folder: Path,
    at_work: Callable[[Tally], AbstractContextManager[Work]],
    again: Collection[str],
    notes: dict[str, Any],
    stages: Sequence[Stage],
) -> Tally:
    finished = finished_ids(folder, planned.ids)  # first, as it sets rows of other runs aside
    redo = attempts_with(folder, again) if again else {}
    campaign = planned.campaign
    wanted: Wanted
    if campaign.precision is None:
        wanted = AllJobs(planned, folder)
    else:
        wanted = JobsForPrecision(planned, folder, campaign.precision, campaign.target)
    tally = Tally(wanted.total(), len(finished - redo.keys()), len(redo))

    def merge() -> set[str]:
        return _merged(wanted, planned, folder, notes, tally, redo)

    def due(*, before: bool) -> list[Stage]:
        return [one for one in stages if one.before == before and one.due(planned, folder)]

    if not due(before=True):
        left = wanted.pending(finished - redo.keys())
        if not len(left):
            left = wanted.pending(merge())
        tally.total = wanted.total()
        if not len(left) and not due(before=False):
            return tally
    tell("work began", **tally.told())
    with at_work(tally) as work:
        tally.began = time.monotonic()  # a batch system may have kept it waiting for hours
        for stage in due(before=True):
            stage.carry_out(work)
        work_off(wanted, work, redo, merge)
        tally.ended = time.monotonic()
        for stage in due(before=False):
            stage.carry_out(work)
    return tally


def work_off(
    wanted: Wanted,
    work: Work,
    redo: Mapping[str, int] = MappingProxyType({}),
    merge: Callable[[], set[str]] | None = None,
) -> None:
    """Shake until every job that is wanted has a row.

    Parameters
    ----------
    wanted : Wanted
    work : Work
        Whose tally is counted on.
    redo : mapping
        Jobs that have a row already, each with the number of its newest attempt.
    merge : callable or None
        What is done once all have a row; returns the ids of the jobs that still have one.

    Raises
    ------
    RunError
        If the run cannot go on, or rows are lost again and again.
    """
    folder, ids, tally = work.folder, work.planned.ids, work.tally
    sent: set[int] = set()
    in_vain = 0
    pending = wanted.pending(finished_ids(folder, ids, redo))
    if not len(pending) and merge:  # a stage before has done them all
        pending = wanted.pending(merge())
    while len(pending):
        if lost := len(sent.intersection(pending.tolist())):
            log.warning("%d rows were lost after they were stored", lost)
            in_vain += 1
        if in_vain >= ROUNDS:
            msg = f"rows are lost after they are stored: is the disk of {folder} sound?"
            raise RunError(msg)
        sent |= set(pending.tolist())
        tally.total, tally.what = wanted.total(), wanted.what
        Execution(
            work.planned, pending, work.client, folder, work.order, work.watch, tally, work.limits, redo=redo
        )()
        finished = finished_ids(folder, ids, redo)
        pending = wanted.pending(finished)
        if not len(pending) and merge:
            finished = merge()
            pending = wanted.pending(finished)
        tally.again = len(redo.keys() - finished)
    tally.total = wanted.total()


class Weighing:
    """Bases are weighed, before the jobs, by the motions that the campaign knows the rock to have stood."""

    before = True

    def due(self, planned: Plan, folder: Path) -> bool:
        """Whether there are such motions, and no weights yet; damaged ones are told before work is done."""
        if not planned.recorded:
            return False
        if (folder / FOLDER / FILE).exists():
            Stood.read(folder / FOLDER / FILE)
            return False
        return True

    def carry_out(self, work: Work) -> None:
        """Weigh them."""
        planned = work.planned
        assert planned.recorded is not None
        weigh(
            planned.campaign, planned.recorded, work.folder / FOLDER, work.client, work.watch, work.limits,
            planned.id,
        )  # fmt: skip


def weigh(
    campaign: Campaign,
    recorded: Recorded,
    place: Path,
    client: Client,
    watch: Watcher,
    limits: Limits = USUAL_LIMITS,
    plan_id: str | None = None,
) -> Stood:
    """Weigh the draws of a base by the motions that the rock is known to have stood (`orchestrator.stood`).

    Raises
    ------
    InputError, RunError
        As :func:`run`, and if a motion gets no answer.
    """

    def weighing(tally: Tally) -> None:
        tally.what = "shaking each base with what the rock stood"
        watch(tally)

    def shake(one: Campaign, target: Path) -> None:
        planned = plan_of(one)
        carry_out(planned, target.absolute(), nullcontext(client), weighing, limits)

    tell("weighing the bases", records=[one.record_id for one in recorded.records])
    return weigh_bases(campaign, recorded, place, shake, plan_id)


def _merged(
    wanted: Wanted,
    planned: Plan,
    folder: Path,
    notes: dict[str, Any],
    tally: Tally,
    redo: Mapping[str, int],
) -> set[str]:
    """Merge the parts of a run that is complete; its finished jobs, of which some lack if a part was cut meanwhile.

    The session's notes come first: what `compact` puts into the results tells of this session too.
    """
    ended = {"ended": "complete", "done": tally.done, "status": dict(tally.status), "deaths": tally.deaths}
    note(folder, notes | ended)
    if result_files(folder) != [folder / RESULTS_FILE]:
        with suppress(FileNotFoundError):  # no part is left that can be read
            compact(folder)
    finished = finished_ids(folder, planned.ids, redo)
    if not len(wanted.pending(finished)):
        notes |= ended
    return finished


def _reported(report: Path | None) -> AbstractContextManager:
    return performance_report(str(report)) if report else nullcontext()


def order_of(scene: PlannedScene, folder: Path, here: tuple[tuple[str, str], ...]) -> Order:
    """What a worker must find before it does jobs of one scene."""
    return Order(
        str(folder), scene.scene_id, scene.ensemble_id, here, scene.scene_place, scene.ensemble_place
    )


def check_workers(client: Client, order: Order, offered: Sequence[Order] = ()) -> None:
    """Let every worker present load the assets of an order; others are offered too to those that see no folder.

    Raises
    ------
    InputError
        If one cannot, because of another version or because it has no way to the run's scene and ensemble.
    RunError
        If the workers of a local cluster die whenever they start.
    """
    _wait_for_a_worker(client)
    shared = {}
    for one in (order, *offered):
        shared[one.scene_id] = Path(one.folder) / one.scene_place
        shared[one.ensemble_id] = Path(one.folder) / one.ensemble_place
    if not isinstance(client.cluster, LocalCluster):
        offer(client, {name: place for name, place in shared.items() if place.is_dir()})
    answers = client.run(check, order, on_error="return")
    # Of a worker that just dies or just comes (OSError), its first task will tell. One that lacks the program cannot
    # even read what it is asked, and Dask says so.
    unfit = (
        answer
        for answer in answers.values()
        if isinstance(answer, Exception) and not isinstance(answer, OSError)
    )
    reasons = sorted({str(answer) for answer in unfit})
    if reasons:
        raise InputError(
            f"{len(reasons)} of {len(answers)} workers are unfit for this run: " + "; ".join(reasons[:5]),
            where="cluster",
            expected="the client's versions, and a folder in which each host can keep what it is sent",
            remedy="install the same toppling everywhere; name a folder that workers can write with TOPPLING_CACHE",
        )
    if remark := unlike([answer for answer in answers.values() if isinstance(answer, str)]):
        log.warning("%s", remark)


def _wait_for_a_worker(client: Client) -> None:
    """Wait for the first: for ever where somebody else starts it, such as a batch system."""
    began, told, upkeep = time.monotonic(), False, Upkeep(client)
    while not client.nthreads():
        with suppress(TimeoutError):
            client.wait_for_workers(1, timeout=REPLACE_AFTER_S)
            return
        if not told:
            log.warning("no worker has come yet: waiting")
            told = True
        if upkeep.gone():
            if time.monotonic() - began > NOBODY_AFTER_S:
                raise RunError(NOBODY)
            upkeep.replace()


def budget_s(workers: int) -> float:
    """Work of one task on a cluster of so many workers, in seconds."""
    return max(BATCH_BUDGET_S, workers / BATCHES_A_SECOND)


def room_for(rows: Sequence[Row], budget_s: float) -> int:
    """Jobs to send in the next batch: twice what fits at the pace of this one, so that few travel in vain."""
    spent_s = sum(row.get("wall_s") or 0.0 for row in rows)
    return math.ceil(min(2 * budget_s * len(rows) / max(spent_s, 1e-3), JOBS_IN_BATCH))


class Execution:
    """One session of a run.

    Parameters
    ----------
    plan : Plan
    pending : (n,) int array
        Rows of the plan that need work, in the order to start them.
    client : Client
    folder : Path
        The run's folder.
    order : Order
        What workers must find.
    watch : Watcher
    tally : Tally
        Counted on.
    limits : Limits
    task : callable
        What a worker does with a batch.
    redo : mapping
        Of the pending jobs those that have a row already, each with the number of its newest attempt.
    store : Path or None
        Where rows go; the run's folder unless given.
    """

    def __init__(
        self,
        plan: Plan,
        pending: NDArray[np.int64],
        client: Client,
        folder: Path,
        order: Order,
        watch: Watcher,
        tally: Tally,
        limits: Limits = USUAL_LIMITS,
        task: Task = shake_batch,
        redo: Mapping[str, int] = MappingProxyType({}),
        store: Path | None = None,
    ) -> None:
        self.store = store or folder
        self.plan, self.client, self.folder, self.order = plan, client, folder, order
        self.watch, self.tally, self.limits, self.task = watch, tally, limits, task
        self.redo = redo
        self.dispatch = Dispatch(pending, plan.durations_s, limits.tries, plan.scene_of)
        self._rocks = {scene.scene_id: scene.rock for scene in plan.scenes}
        self._orders = [order_of(scene, folder, order.versions) for scene in plan.scenes]
        self._session = uuid.uuid4().hex[:8]
        self.tasks = 0  # handed out so far
        self._room = JOBS_IN_BATCH
        self._looked = -math.inf
        self._upkeep = Upkeep(client)
        self._all_alive = time.monotonic()
        self._since: dict[tuple[str, str], float] = {}
        self._overdue: set[str] = set()
        self._flying: dict[Future, Batch] = {}
        self._unstored: list[Row] = []
        self._flushed = time.monotonic()

    def __call__(self) -> Tally:
        """Work until every job has a row in the store.

        Raises
        ------
        RunError
            If the scheduler is lost or no worker is fit.
        OSError
            If a part cannot be written.
        """
        arriving = as_completed(loop=self.client.loop, with_results=True, raise_errors=False)
        try:
            while self.dispatch.waiting or self._flying:
                self._look()
                self._submit(arriving)
                self._wait(arriving)
                for future, result in arriving.next_batch(block=False):
                    self._take(future, result)
                self._flush()
                self.watch(self.tally)
        except (CommClosedError, TimeoutError) as error:
            raise RunError(LOST) from error
        finally:
            with held_back():
                arriving.clear()
                self._flush(last=True)
                if self._flying and self.client.status == "running":
                    with suppress(CommClosedError, TimeoutError):
                        self.client.cancel(list(self._flying), force=True)
                self.watch(self.tally)
        return self.tally

    def _budget_s(self, workers: int) -> float:
        """Work of one task, which of many rocks begins with a rock that is not at hand."""
        return max(budget_s(workers), ATLAS_BUDGET_S if len(self.plan.scenes) > 1 else 0.0)

    def _submit(self, arriving: as_completed) -> None:
        workers = max(self.tally.workers, 1)
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
            [self._orders[self.plan.scene_of[batch.jobs[0]]] for batch in batches],
            specs,
            [self._budget_s(workers)] * len(batches),
            key=keys,
            pure=False,
        )
        self._flying.update(zip(futures, batches, strict=True))
        arriving.update(futures)

    def _wait(self, arriving: as_completed) -> None:
        until = time.monotonic() + 0.5
        while not arriving.has_ready() and time.monotonic() < until:
            time.sleep(POLL_S)
            if self.client.status not in ("running", "connecting"):
                raise RunError(LOST)

    def _take(self, future: Future, result: Any) -> None:
        batch = self._flying.pop(future)
        status = future.status
        future.release()
        if status == "finished":
            rows = checked([self.plan.spec(job) for job in batch.jobs], result)
            self._keep(rows, batch.attempt)
            self._room = room_for(rows, self._budget_s(self.tally.workers))
            self.dispatch.came_back(batch, done=len(rows))
        elif status == "error":
            self._take_error(str(future.key), batch, result[1])
        else:
            log.warning("%d jobs came back unfinished (%s) and go out again", len(batch.jobs), status)
            self.dispatch.came_back(batch, done=0)

    def _take_error(self, key: str, batch: Batch, error: BaseException) -> None:
        if isinstance(error, KilledWorker):
            hung = key in self._overdue
            if not hung and was_told_to_leave(self.client, error.last_worker.address):
                tell("worker left", worker=error.last_worker.address, jobs=len(batch.jobs))
                self.dispatch.came_back(batch, done=0)
                return
            self.tally.deaths += 1
            told = {"worker": error.last_worker.address, "alone": batch.alone, "attempt": batch.attempt}
            log.warning(
                "a worker %s with %d jobs at hand",
                "hung" if hung else "died",
                len(batch.jobs),
                extra={"fields": told},
            )
            lost = self.dispatch.died(batch, hung=hung)
            if lost is not None:
                self._give_up(lost, batch)
        elif isinstance(error, UnfitWorkerError):
            log.warning("%s; it is sent away", error)
            self.dispatch.came_back(batch, done=0)
            if error.worker:
                self.client.retire_workers([error.worker], close_workers=True)
            if not self.client.nthreads():
                msg = f"no fit worker is left: {error}"
                raise RunError(msg)
        else:
            msg = f"the cluster cannot do a task ({type(error).__name__}: {error})"
            raise RunError(msg) from error

    def _give_up(self, job: int, batch: Batch) -> None:
        status, message = why_given_up(self.limits, self.dispatch.hung[job])
        spec = self.plan.spec(job)
        told = {"job_id": spec.job_id, "record_id": spec.record_id, "status": status}
        log.warning("job %s of record %s: %s, %s", *told.values(), message, extra={"fields": told})
        self._keep([lost_row(spec, status, message)], batch.attempt)

    def _look(self) -> None:
        """See how many threads there are, and replace workers that hang."""
        now = time.monotonic()
        if now - self._looked < LOOK_S:
            return
        self._looked = now
        workers = sum(self.client.nthreads().values())
        if workers != self.tally.workers:
            tell("workers changed", workers=workers, before=self.tally.workers)
        self.tally.workers = workers
        if not self._upkeep.gone():
            self._all_alive = now
        elif now - self._all_alive > NOBODY_AFTER_S and not self.tally.workers:
            raise RunError(NOBODY)
        elif now - self._all_alive > REPLACE_AFTER_S:
            self._upkeep.replace()
        working = {(worker, str(key)) for worker, keys in self.client.processing().items() for key in keys}
        self._since = {place: self._since.get(place, now) for place in working}
        late = {
            place
            for place, since in self._since.items()
            if now - since > self._budget_s(self.tally.workers) + self.limits.job_s
        }
        if late:
            self._overdue |= {key for _, key in late}
            for place in late:
                del self._since[place]
            workers = sorted({worker for worker, _ in late})
            log.warning("no answer for %g s from %s: replaced", self.limits.job_s, ", ".join(workers))
            loop = self.client.loop
            assert loop is not None  # as long as the client is open
            # Called on the client's own loop it does not wait: a worker that hangs takes seconds to be gone.
            loop.add_callback(self.client.restart_workers, workers, raise_for_error=False)

    def _keep(self, rows: list[Row], attempt: int) -> None:
        self.tally.count(rows)
        # Of a job's rows the newest attempt counts: one that is done again goes on from where it was.
        self._unstored += [
            {
                **row,
                "rock": self._rocks[row["scene_id"]],
                "attempt": self.redo.get(row["job_id"], 0) + attempt,
            }
            for row in rows
        ]

    def _flush(self, *, last: bool = False) -> None:
        now = time.monotonic()
        pause = min(max(self.tally.elapsed_s / 60, FLUSH_S[0]), FLUSH_S[1])
        if self._unstored and (last or now - self._flushed >= pause):
            write_part(self.store, self._unstored)
            self.tally.stored += len(self._unstored)
            self.tally.again -= sum(row["job_id"] in self.redo for row in self._unstored)
            self._unstored = []
            tell("rows stored", **self.tally.told())
            self._flushed = time.monotonic()
