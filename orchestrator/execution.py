"""Execution of jobs: a bounded number of batches on the cluster, storage of rows, and recovery from failures.

Rows are checked before they are stored, since a worker may confuse the jobs of a batch, or return rows with status `ok`
but without results. What the client knows of a job in advance is compared with its row; the outcome, which only the
worker knows, is checked against the columns' limits.
"""

import logging
import math
import time
import uuid
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import CancelledError
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from toppling.models.arrays import Array, Flags
from toppling.models.files.digest import read_table
from toppling.models.files.documents import shown
from toppling.models.hidden_base.unseen_base import draw_of
from toppling.models.motions.measures import CATALOG, MEASURES, SCALING_POWER
from toppling.models.pedestal import ContactProperties
from toppling.orchestrator.context import Answer, JobSelection, RunError, RunProgress, Work
from toppling.orchestrator.dask_cluster import DaskCluster, may_be_lost
from toppling.orchestrator.dispatch import FIRST_JOBS, Batch, Dispatch
from toppling.orchestrator.interrupt import LOOK_S, held_back
from toppling.orchestrator.journal import log_event
from toppling.orchestrator.plan import Plan, Rows
from toppling.orchestrator.task import RunKey, lost_row, shake_batch
from toppling.results.schema import LIMITS, SCHEMA
from toppling.results.store import finished_ids, table_of, write_part
from toppling.workers.job import AXES, drawn_contact
from toppling.workers.options import PHYSICS_VERSION
from toppling.workers.unmeasured import Unmeasured

BY_THE_CLIENT = ("rock", "attempt")
"""Columns that the client fills."""

_TEXTS = [field.name for field in SCHEMA if field.type == pa.string() and field.name not in BY_THE_CLIENT]
_NUMBERS = [
    field.name
    for field in SCHEMA
    if field.type in (pa.float64(), pa.int32(), pa.int64()) and field.name not in BY_THE_CLIENT
]
_SHORTEST = min(LIMITS[name][1] for name in _TEXTS)
_PLACE = {name: place for place, name in enumerate(_NUMBERS)}
_LOW, _HIGH = (np.array([LIMITS[name][end] for name in _NUMBERS], float) for end in (0, 1))
_MAY_LACK = np.array([SCHEMA.field(name).nullable for name in _NUMBERS])
_TIME = "finished_at"
_OUTCOMES = {"stands": False, "moved": False, "toppled": True, "lodged": True}
_STATUSES = ("ok", "undecided", "diverged", "failed")
_ANSWER = (
    "max_tilt_deg", "residual_tilt_deg", "residual_yaw_deg", "slip_m", "penetration_m", "steps", "simulated_s",
    "time_step_s",
)  # fmt: skip
"""Numbers that every completed shake fills, as it does `ended_by`."""

SAME_NUMBER = 1e-9
"""Relative tolerance between numbers computed on two machines."""


class Asked:
    """Values of a plan's rows that the client knows in advance; the run's folder contains the records."""

    def __init__(self, plan: Plan, folder: Path) -> None:
        self._plan, self.folder = plan, folder

    def checked(self, jobs: Rows, answer: Any) -> tuple[pa.Table, dict[int, str]]:
        """Valid rows, and the problems of the others by their position in the batch.

        jobs: rows of the plan, of one scene, as they were sent.
        answer: expected to be a table with `SCHEMA` of one or more of the first jobs.
        """
        if not isinstance(answer, pa.Table) or not answer.schema.equals(SCHEMA):
            return SCHEMA.empty_table(), {0: f"a {type(answer).__name__} that is no table of results"}
        if not 0 < len(answer) <= len(jobs):
            return SCHEMA.empty_table(), {0: f"{len(answer)} rows for {len(jobs)} jobs"}
        answer, jobs = answer.combine_chunks(), jobs[: len(answer)]
        wrong: dict[int, str] = {}
        for name, bad in self._problems(jobs, answer):
            for place in np.flatnonzero(bad):
                wrong.setdefault(int(place), f"{name} is {shown(answer[name][place].as_py())}")
        right = np.array([place not in wrong for place in range(len(answer))])
        return (answer.filter(right) if wrong else answer), wrong

    def _problems(self, jobs: Rows, answer: pa.Table) -> Iterator[tuple[str, Flags]]:
        """Yield columns with a mask of the rows whose value is invalid."""
        numbers = answer.select(_NUMBERS).to_batches()[0].to_tensor(null_to_nan=True).to_numpy()
        yield from _beyond_limits(answer, numbers)
        failed = np.array(answer["status"].to_pylist(), object) == "failed"
        expected = self.expected(jobs)
        names = [name for name, value in expected.items() if isinstance(value, np.ndarray)]
        for name in expected.keys() - set(names):
            if (given := answer[name].to_pylist()) != expected[name]:
                lacks = failed & SCHEMA.field(name).nullable & (_objects(given) == None)  # noqa: E711
                yield name, (_objects(given) != _objects(expected[name])) & ~lacks
        columns = [_PLACE[name] for name in names]
        values, found = np.column_stack([expected[name] for name in names]), numbers[:, columns]
        lacks = failed[:, None] & _MAY_LACK[columns] & np.isnan(found)
        unlike = ~np.isclose(found, values, rtol=SAME_NUMBER, atol=0.0) & ~np.isnan(values) & ~lacks
        # A limit on displacement (high-pass) reduces the PGA of a motion.
        pga, level = numbers[:, _PLACE["pga_m_s2"]], expected["level_pga_m_s2"]
        yield "pga_m_s2", ~((pga > 0.0) & (pga <= level * (1.0 + SAME_NUMBER))) & ~(failed & np.isnan(pga))
        yield from ((names[column], unlike[:, column]) for column in np.flatnonzero(unlike.any(axis=0)))
        yield from _contradictions(answer, numbers)

    def expected(self, jobs: Rows) -> dict[str, Any]:
        """Columns of rows of one scene that the client can compute: arrays of numbers, NaN where unknown, or lists."""
        plan, count = self._plan, len(jobs)
        scene = plan.scenes[plan.columns["scene_id"][jobs[0]]]
        columns = {name: plan.columns[name][jobs] for name in ("record_id", *AXES)}
        records = _records_of(self.folder / scene.ensemble_place, plan.records)
        record, unmeasured = columns.pop("record_id"), plan.campaign.unmeasured or Unmeasured()
        contacts = [*zip(*(columns[name].tolist() for name in AXES[2:]), strict=True)]
        drawn = {contact: _drawn(scene.scene_id, unmeasured, *contact) for contact in set(contacts)}
        factor, turn_deg = np.array([drawn[contact] for contact in contacts]).T
        scale = columns["pga_m_s2"] / records["pga_m_s2"][record]
        measures = {
            name: records[name][record] * scale**power
            for name, power in SCALING_POWER.items()
            if name in records
        }
        turned = turn_deg + columns["azimuth_deg"] - records["strong_azimuth_deg"][record]
        measures["ground_accelerates_toward_deg"] = (
            records["ground_accelerates_toward_deg"][record] + turned
        ) % 360.0
        if plan.campaign.peak_displacement_m is not None:
            held = scale * np.nan_to_num(records["pgd_m"][record]) > plan.campaign.peak_displacement_m
            measures = {name: np.where(held, np.nan, value) for name, value in measures.items()}
        realisations = columns["realisation"].tolist()
        same = {
            "scene_id": scene.scene_id, "preset": plan.campaign.preset, "engine": plan.campaign.engine,
            "physics_version": PHYSICS_VERSION,
        }  # fmt: skip
        return {
            "job_id": plan.jobs["job_id"].take(jobs).to_pylist(),
            "record_id": [plan.records[number] for number in record.tolist()],
            "event": records["event"][record].tolist(),
            **{name: [value] * count for name, value in same.items()},
            "base": [draw_of(number, scene.bases) if scene.bases else None for number in realisations],
            "level_pga_m_s2": columns.pop("pga_m_s2"), **columns, "friction_factor": factor, **measures,
        }  # fmt: skip


@lru_cache(maxsize=4)
def _records_of(folder: Path, records: tuple[str, ...]) -> dict[str, NDArray[Any]]:
    """Columns of an ensemble's catalogue for given records, in order; missing values are NaN."""
    table = read_table(folder / CATALOG)
    rows = table.take(pc.index_in(pa.array(records), value_set=table["record_id"].combine_chunks()))
    names = [name for name in (*MEASURES, "strong_azimuth_deg") if name in rows.schema.names]
    return {name: rows[name].to_numpy() for name in names} | {"event": _objects(rows["event"].to_pylist())}


@lru_cache(maxsize=2**16)
def _drawn(
    scene_id: str, unmeasured: Unmeasured, static: float, kinetic: float, restitution: float, realisation: int
) -> tuple[float, float]:
    """Factor on friction and rotation of the motion (degrees) that a realisation draws."""
    contact = ContactProperties(static, kinetic, restitution)
    friction = drawn_contact(scene_id, contact, unmeasured, realisation).friction_static
    return friction / static if static > 0.0 else 1.0, unmeasured.turn_deg(realisation)


def _beyond_limits(answer: pa.Table, numbers: Array) -> Iterator[tuple[str, Flags]]:
    """Yield columns with a mask of the rows whose value is outside the column's limits."""
    for name in BY_THE_CLIENT:
        if answer[name].null_count < len(answer):
            yield name, ~_nulls(answer, name)
    no_number = np.isnan(numbers)
    beyond = ~(no_number | ((numbers >= _LOW) & (numbers <= _HIGH)))
    for column, (name, many) in enumerate(zip(_NUMBERS, no_number.sum(axis=0).tolist(), strict=True)):
        if answer[name].null_count != many:  # NaN is a number to Arrow
            beyond[:, column] |= no_number[:, column] & ~_nulls(answer, name)
    yield from ((_NUMBERS[column], beyond[:, column]) for column in np.flatnonzero(beyond.any(axis=0)))
    texts = pa.chunked_array([chunk for name in _TEXTS for chunk in answer[name].chunks])
    if pc.max(pc.utf8_length(texts)).as_py() > _SHORTEST:
        for name in _TEXTS:
            longer = pc.greater(pc.utf8_length(answer[name]), LIMITS[name][1])
            yield name, np.array(pc.fill_null(longer, False))
    first, last = (pa.scalar(limit, SCHEMA.field(_TIME).type) for limit in LIMITS[_TIME])
    within = pc.and_(pc.greater_equal(answer[_TIME], first), pc.less_equal(answer[_TIME], last))
    yield _TIME, ~np.array(pc.fill_null(within, True))


def _contradictions(answer: pa.Table, numbers: Array) -> Iterator[tuple[str, Flags]]:
    """Yield columns with a mask of the rows in which they contradict others or lack a required value."""
    status, outcome, toppled = (
        _objects(answer[name].to_pylist()) for name in ("status", "outcome", "toppled")
    )
    yield "status", ~np.isin(status.astype(str), _STATUSES)
    ok = status == "ok"
    meant = _objects([_OUTCOMES.get(name) for name in outcome.tolist()])
    none = toppled == None  # noqa: E711  (by element)
    yield "outcome", np.where(ok, none | (meant != toppled), ~none | ~_nulls(answer, "outcome"))
    for name in ("topple_time_s", "falls_toward_deg", "falls_toward_bearing_deg"):
        yield name, np.isnan(numbers[:, _PLACE[name]]) == (toppled == True)  # noqa: E712  (by element)
    shaken = ok | (status == "undecided")
    yield "ended_by", shaken & _nulls(answer, "ended_by")
    for name in _ANSWER:
        yield name, shaken & np.isnan(numbers[:, _PLACE[name]])


def _nulls(table: pa.Table, name: str) -> Flags:
    return table[name].is_null().to_numpy()


def _objects(values: list[Any]) -> NDArray[np.object_]:
    found = np.empty(len(values), object)
    found[:] = values
    return found


log = logging.getLogger(__name__)

_BATCH_BUDGET_S = 2.0
"""Time budget of a task, s: a hundred times the cost of submitting it, yet little to lose with a worker."""

_FIRST_FRACTION = 0.1
"""Fraction of the budget for the first tasks, whose rows are stored immediately and give the cost of jobs."""

_ATLAS_BUDGET_S = 6.0
"""Time budget of a task of an atlas, s: preparing a rock takes a third of a second."""
_BATCHES_A_SECOND = 100
"""Maximum rate of tasks of a scheduler, Hz; on larger clusters the time budget grows."""
_LEAST_JOB_S = 2e-4
"""Overhead of a job on a worker besides its shake, s."""
_FLUSH_S = (5.0, 60.0)
"""Minimum and maximum interval between part files, s; it grows during the run, so that a weekend makes few thousand."""
Task = Callable[[RunKey, Mapping[str, Any], pa.Table, float], pa.Table]
"""Function of a worker that does the jobs of a batch within a time budget (`task.shake_batch`)."""


def budget_s(workers: int, rocks: int = 1) -> float:
    """Time budget of a task, s, by the numbers of workers and of rocks."""
    return max(_ATLAS_BUDGET_S if rocks > 1 else _BATCH_BUDGET_S, workers / _BATCHES_A_SECOND)


def room_for(jobs: int, spent_s: float, budget_s: float) -> int:
    """Number of jobs for the next batch: twice as many as fit the budget at the last batch's pace."""
    return math.ceil(2 * budget_s * jobs / max(spent_s, _LEAST_JOB_S * jobs))


def work_off(selection: JobSelection, work: Work, merge: Callable[[], set[str]]) -> None:
    """Shake until every selected job has a row; RunError if the run cannot continue, or rows are lost repeatedly.

    merge: merges the rows of a complete run, and returns the jobs that have one.
    """
    progress = work.progress
    sent: set[int] = set()
    in_vain = 0
    while True:
        pending = selection.pending(finished_ids(work.folder, work.planned.ids, work.redo))
        if not len(pending):
            pending = selection.pending(merge())
        progress.total = len(selection)
        if not len(pending):
            return
        progress.what = selection.what
        if lost := len(sent.intersection(pending.tolist())):
            log.warning("%d rows were lost after they were stored", lost)
            in_vain += 1
        if in_vain >= work.limits.tries:
            raise RunError(f"rows are lost after they are stored: is the disk of {work.folder} sound?")
        sent |= set(pending.tolist())
        Execution(work, pending)()


class Execution:
    """Executes jobs of a plan on a cluster, that of the work's client unless given.

    pending: rows of the plan to do, in the order to start them.
    task: function that a worker applies to a batch.
    """

    def __init__(
        self, work: Work, pending: Rows, task: Task = shake_batch, cluster: DaskCluster | None = None
    ) -> None:
        self.work, self.plan, self.progress = work, work.planned, work.progress
        self.task, self.cluster = task, cluster or DaskCluster(work.client)
        columns = self.plan.columns
        self.dispatch = Dispatch(pending, columns["duration_s"], work.limits.tries, columns["scene_id"])
        self._asked = Asked(self.plan, work.folder)
        self._rocks = {scene.scene_id: scene.rock for scene in self.plan.scenes}
        self._session = uuid.uuid4().hex[:8]
        self.tasks = 0  # number of submitted tasks
        self._room = FIRST_JOBS
        self._looked = -math.inf
        self._flying: dict[str, Batch] = {}
        self._unstored: list[pa.Table] = []
        self._flushed = -math.inf  # the first rows are stored immediately

    def __call__(self) -> RunProgress:
        """Execute until every job has a row in the store.

        Raises RunError if the scheduler is lost or no worker can do the jobs.
        Raises OSError if a part cannot be written.
        """
        try:
            while self.dispatch or self._flying:
                try:
                    self._look()
                    self._submit()
                    for answer in self.cluster.answers(LOOK_S):
                        self._take(answer)
                except (OSError, CancelledError) as error:
                    if not may_be_lost(error):
                        raise
                    self._rejoin(error)
                self._flush()
                self.work.watch(self.progress)
        finally:
            with held_back():
                self._flush(last=True)
                self.cluster.cancel()
                self.work.watch(self.progress)
        return self.progress

    @property
    def _budget_s(self) -> float:
        full_s = budget_s(self.progress.workers, len(self.plan.scenes))
        return full_s if self.progress.done else _FIRST_FRACTION * full_s

    def _submit(self) -> None:
        workers = max(self.progress.workers, 1)
        batches: dict[str, Batch] = {}
        # More than two per worker: Dask then keeps waiting tasks on the scheduler, safe from a worker's crash.
        while len(self._flying) + len(batches) < 2 * workers + 2 and (
            batch := self.dispatch.next_batch(workers, self._room)
        ):
            self.tasks += 1
            # Keys are never reused, not even in another session: Dask would return the old result.
            batches[f"{self._session}-{self.tasks}"] = batch
        if batches:
            budget, scenes = self._budget_s, self.plan.columns["scene_id"]
            settings = self.plan.campaign.settings
            calls = {}
            for key, batch in batches.items():
                jobs = self.plan.batch(np.array(batch.jobs))
                calls[key] = self.work.run_keys[scenes[batch.jobs[0]]], settings, jobs, budget
            self.cluster.submit(self.task, calls)
            self._flying |= batches

    def _rejoin(self, error: BaseException) -> None:
        """Resubmit all batches in flight once the scheduler, or another at its address, answers."""
        log_event("scheduler lost", error=repr(error))
        self.cluster.rejoin(self.work.run_keys, error)
        for batch in self._flying.values():
            self.dispatch.came_back(batch, done=0)
        self._flying.clear()
        log_event("scheduler came back")
        self._looked = -math.inf

    def _take(self, answer: Answer) -> None:
        batch, done = self._flying[answer.key], 0
        if answer.kind == "rows":
            rows, wrong = self._asked.checked(np.array(batch.jobs), answer.value)
            if len(rows):
                self._store_rows(rows, batch.attempt)
                spent_s = pc.sum(rows["wall_s"]).as_py() or 0.0
                self._room = room_for(len(rows), spent_s, self._budget_s)
            for place, problem in wrong.items():
                self._distrust(batch.jobs[place], batch, problem)
            done = len(rows) + len(wrong)
        elif answer.kind == "died":
            self._take_death(answer, batch)
            done = len(batch.jobs)
        elif answer.kind == "left":
            log_event("worker left", worker=answer.worker, jobs=len(batch.jobs))
        elif answer.kind == "undelivered":
            if problem := self.cluster.deliver(answer.value, self.work.run_keys):
                self._dismiss(answer.worker, problem)
        elif answer.kind == "unfit":
            self._dismiss(answer.worker, answer.value)
        elif answer.kind == "cancelled":
            log.warning("%d jobs came back unfinished and go out again", len(batch.jobs))
        else:
            error = answer.value
            raise RunError(f"the cluster cannot do a task ({type(error).__name__}: {error})") from error
        self.dispatch.came_back(batch, done)
        del self._flying[answer.key]

    def _take_death(self, answer: Answer, batch: Batch) -> None:
        self.progress.deaths += 1
        details = {"worker": answer.worker, "alone": batch.alone, "attempt": batch.attempt}
        log.warning("a worker died with %d jobs at hand", len(batch.jobs), extra={"fields": details})
        if (lost := self.dispatch.died(batch)) is not None:
            limits = self.work.limits
            why = f"its worker process died, or took more than {limits.job_s:g} s, in each of {limits.tries} lone tries"
            self._give_up(lost, batch, "crashed", why)

    def _dismiss(self, worker: str, why: object) -> None:
        log.warning("%s; it is sent away", why)
        if worker:
            self.cluster.dismiss(worker)
        if not self.cluster.threads():
            raise RunError(f"no fit worker is left: {why}")

    def _distrust(self, job: int, batch: Batch, problem: str) -> None:
        """Retry a job with an invalid row alone, or give it up."""
        log.warning("a worker's row of job %s does not answer it: %s", self.plan.spec(job).job_id, problem)
        if self.dispatch.died(Batch((job,), batch.attempt, batch.alone)) is not None:
            self._give_up(job, batch, "failed", f"a worker's row does not answer it: {problem}")

    def _give_up(self, job: int, batch: Batch, status: str, message: str) -> None:
        spec = self.plan.spec(job)
        details = {"job_id": spec.job_id, "record_id": spec.record_id, "status": status}
        log.warning("job %s of record %s: %s, %s", *details.values(), message, extra={"fields": details})
        self._store_rows(table_of([lost_row(spec, status, message)]), batch.attempt)

    def _look(self) -> None:
        """Update the number of threads."""
        now = time.monotonic()
        if now - self._looked < LOOK_S:
            return
        self._looked = now
        self.cluster.look(self.progress.work_left_s, len(self._flying))
        workers = self.cluster.threads()
        if workers != self.progress.workers:
            log_event("workers changed", workers=workers, before=self.progress.workers)
        self.progress.workers = workers

    def _store_rows(self, rows: pa.Table, attempt: int) -> None:
        self.progress.count(rows)
        # The newest attempt of a job counts: attempts of repeated jobs continue from the last number.
        redo = self.work.redo
        attempts = [redo.get(job, 0) + attempt for job in rows["job_id"].to_pylist()]
        rock = self._rocks[rows["scene_id"][0].as_py()]
        for name, values in (("rock", [rock] * len(rows)), ("attempt", attempts)):
            field = SCHEMA.field(name)
            rows = rows.set_column(SCHEMA.get_field_index(name), field, pa.array(values, field.type))
        self._unstored.append(rows)

    def _flush(self, *, last: bool = False) -> None:
        now = time.monotonic()
        pause = min(max(self.progress.elapsed_s / 60, _FLUSH_S[0]), _FLUSH_S[1])
        if self._unstored and (last or now - self._flushed >= pause):
            rows = pa.concat_tables(self._unstored).combine_chunks()
            write_part(self.work.store or self.work.folder, rows)
            self.progress.stored += len(rows)
            self._unstored = []
            log_event("rows stored", **self.progress.summary())
            self._flushed = time.monotonic()
