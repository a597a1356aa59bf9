"""Validation of rows that workers return.

A worker is another process, perhaps on another host: it may confuse the jobs of a batch, or return rows with status
`ok` but without results, which would be stored permanently. What the client knows of a job in advance is compared with
its row; the outcome, which only the worker knows, is checked against the columns' limits.
"""

from collections.abc import Iterator
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
from toppling.orchestrator.plan import Plan, Rows
from toppling.results.schema import LIMITS, SCHEMA
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
