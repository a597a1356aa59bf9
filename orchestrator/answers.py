"""Whether a worker's rows answer the jobs that were asked.

A worker is another process, perhaps on another host: it may exchange the jobs of a batch, be of another version, or say
`ok` and nothing else, and such a row would count as an answer for ever. What the client knows of a job beforehand is
compared with it: what was asked, what the realisation drew, how strong the record is at that level. What happened is
known to the worker alone; it has its type and lies within the column's limits.
"""

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from datetime import datetime
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from toppling.models.contact import ContactProperties
from toppling.models.files.tables import read_table
from toppling.models.hidden_base.draws import draw_of
from toppling.models.motions.catalogue import CATALOG
from toppling.models.motions.impose import scaled_intensity
from toppling.orchestrator.plan import Plan
from toppling.orchestrator.task import Row
from toppling.results.schema import LIMITS, SCHEMA
from toppling.workers.job import ASKED, JobSpec, drawn_contact, identity
from toppling.workers.options import PHYSICS_VERSION
from toppling.workers.unmeasured import Unmeasured

_BY_THE_CLIENT = ("rock", "attempt")
"""Columns that the client writes."""

_TYPES = {
    pa.bool_(): frozenset({bool}),
    pa.float64(): frozenset({float, int, np.float64}),
    pa.int32(): frozenset({int}),
    pa.int64(): frozenset({int}),
}
_TIME = "finished_at"
_OTHERS = [field for field in SCHEMA if field.name not in (*_BY_THE_CLIENT, *ASKED, _TIME)]
"""Columns beside those that repeat what was asked."""
_TEXTS = [(field.name, LIMITS[field.name][1]) for field in _OTHERS if field.type == pa.string()]
_NUMBERS = [
    (field.name, _TYPES[field.type], *LIMITS[field.name]) for field in _OTHERS if field.type in _TYPES
]
_NAMES = frozenset(SCHEMA.names) - frozenset(_BY_THE_CLIENT)
_OUTCOMES = {"stands": False, "moved": False, "toppled": True, "lodged": True}
_STATUSES = ("ok", "undecided", "diverged", "failed")
_ANSWER = (
    "max_tilt_deg", "residual_tilt_deg", "residual_yaw_deg", "slip_m", "penetration_m", "ended_by", "steps",
    "simulated_s", "time_step_s",
)  # fmt: skip
"""Columns that every shake fills."""

_SAME = 1e-9
"""Relative difference up to which numbers that two machines work out are the same."""


class Asked:
    """What the client knows of the rows of a plan's jobs before they come.

    folder: of the run, which holds the records of each rock.
    """

    def __init__(self, plan: Plan, folder: Path) -> None:
        self._bases = {scene.scene_id: scene.bases for scene in plan.scenes}
        self._records = {scene.scene_id: folder / scene.ensemble_place for scene in plan.scenes}

    def checked(self, specs: Sequence[JobSpec], rows: Any) -> tuple[list[Row], dict[int, str]]:
        """Rows that answer their jobs, and what is wrong with the others by their places in the batch.

        specs: the batch as it was sent.
        rows: meant to be a list of rows of its first jobs, of one at least.
        """
        if not isinstance(rows, list) or not 0 < len(rows) <= len(specs):
            what = f"{len(rows)} rows" if isinstance(rows, list) else f"a {type(rows).__name__}"
            return [], {0: f"{what} for {len(specs)} jobs"}
        problems = {place: self._problem(specs[place], row) for place, row in enumerate(rows)}
        wrong = {place: problem for place, problem in problems.items() if problem}
        return [dict(row) for place, row in enumerate(rows) if place not in wrong], wrong

    def _problem(self, spec: JobSpec, row: Any) -> str:
        """What is wrong with a row; nothing where it answers the job."""
        if not isinstance(row, Mapping):
            return f"a {type(row).__name__} and no row"
        if not row.keys() <= _NAMES:
            return f"unknown columns {_shown(sorted(map(str, row.keys() - _NAMES)))}"
        value: Any
        for name, types, low, high in _NUMBERS:
            value = row.get(name)
            if value is not None and not (type(value) in types and low <= value <= high):
                if value != value and row.get("status") == "diverged":  # a null in the table
                    continue
                return f"{name} is {_shown(value)}"
        for name, longest in _TEXTS:
            value = row.get(name)
            if value is not None and not (type(value) is str and len(value) <= longest):
                return f"{name} is {_shown(value)}"
        value, (first, last) = row.get(_TIME), LIMITS[_TIME]
        if value is not None and not (type(value) is datetime and value.tzinfo and first <= value <= last):
            return f"{_TIME} is {_shown(value)}"
        for name, asked in identity(spec).items():
            value = row.get(name)
            if value != asked or type(value) is bool:
                return f"{name} is {_shown(value)}, asked was {asked!r}"
        return self._unlike(spec, row) or _contradiction(row)

    def _unlike(self, spec: JobSpec, row: Mapping[str, Any]) -> str:
        """In what a row differs from what is known of the job; a job that failed may not say it."""
        failed = row.get("status") == "failed"
        for name, known in self.known(spec).items():
            value = row.get(name)
            if not (_same(value, known) or (failed and value is None)):
                return f"{name} is {_shown(value)}, known is {known!r}"
        pga = row.get("pga_m_s2")  # of a motion whose displacement is held: that takes some of it
        if not (failed and pga is None) and not (pga and pga <= spec.pga_m_s2 * (1.0 + _SAME)):
            return f"pga_m_s2 is {_shown(pga)}, asked was {spec.pga_m_s2!r}"
        return ""

    def known(self, spec: JobSpec) -> dict[str, Any]:
        """Columns of a job's row that the client can work out, beside those that repeat what was asked."""
        record = _records_of(self._records[spec.scene_id])[spec.record_id]
        unmeasured = spec.unmeasured or Unmeasured()
        contact = spec.friction_static, spec.friction_kinetic, spec.restitution
        factor, turn_deg = _drawn(spec.scene_id, contact, unmeasured, spec.realisation)
        bases = self._bases[spec.scene_id]
        known = {
            "event": record["event"],
            "physics_version": PHYSICS_VERSION,
            "base": draw_of(spec.realisation, bases) if bases else None,
            "friction_factor": factor,
        }
        scale = spec.pga_m_s2 / record["pga_m_s2"]
        if spec.peak_displacement_m is None or scale * (record["pgd_m"] or 0.0) <= spec.peak_displacement_m:
            turn_deg += spec.azimuth_deg - record["strong_azimuth_deg"]
            with suppress(KeyError, TypeError):  # a measure that the catalogue lacks: the job fails by that
                known |= scaled_intensity(record, scale, turn_deg)
        return known


@lru_cache(maxsize=4)
def _records_of(folder: Path) -> dict[str, dict[str, Any]]:
    """Catalogue of an ensemble by records."""
    return {row["record_id"]: row for row in read_table(folder / CATALOG).to_pylist()}


@lru_cache(maxsize=2**16)
def _drawn(
    scene_id: str, contact: tuple[float, float, float], unmeasured: Unmeasured, realisation: int
) -> tuple[float, float]:
    """Factor on friction and turn of the motion (degrees) that a realisation draws."""
    friction = drawn_contact(scene_id, ContactProperties(*contact), unmeasured, realisation).friction_static
    return friction / contact[0] if contact[0] > 0.0 else 1.0, unmeasured.turn_deg(realisation)


def _contradiction(row: Mapping[str, Any]) -> str:
    """In what a row contradicts itself, or says less than every shake does."""
    status, outcome, toppled = row.get("status"), row.get("outcome"), row.get("toppled")
    if status not in _STATUSES:
        return f"status is {_shown(status)}"
    if status != "ok" and (toppled is not None or outcome is not None):
        return f"status is {status!r}, yet outcome is {_shown(outcome)}"
    if status == "ok" and (toppled is None or _OUTCOMES.get(str(outcome)) is not toppled):
        return f"status is 'ok', yet outcome is {_shown(outcome)} and toppled is {toppled!r}"
    for name in ("topple_time_s", "topple_azimuth_deg"):
        if (row.get(name) is not None) is not (toppled is True):
            return f"{name} is {_shown(row.get(name))}, and toppled is {toppled!r}"
    lacking = [name for name in _ANSWER if row.get(name) is None] if status in ("ok", "undecided") else []
    return f"{', '.join(lacking)} is not there" if lacking else ""


def _same(value: Any, known: Any) -> bool:
    if value == known:
        return True
    return type(known) is float and value is not None and math.isclose(value, known, rel_tol=_SAME)


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 200 else f"{text[:200]} ..."
