"""What comes back from a worker is compared with what was asked: rows of other jobs, or none, are no answers.

A worker is another process, perhaps on another host: it may exchange the jobs of a batch, or say `ok` and nothing else.
Such a row would count as an answer for ever. The job fails instead, its row says why, and `--again failed` repeats it.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from toppling.orchestrator.task import Row, lost_row
from toppling.results.store import table_of
from toppling.workers.job import JobSpec, identity

_ASKED = (
    "job_id", "scene_id", "record_id", "level_pga_m_s2", "azimuth_deg", "friction_static", "friction_kinetic",
    "restitution", "realisation", "preset", "engine",
)  # fmt: skip
"""Columns of a row that repeat what was asked."""

_OUTCOMES = {"stands": False, "moved": False, "toppled": True, "lodged": True}
_STATUSES = ("ok", "undecided", "diverged", "failed")
_SAME_PGA = 1e-6
"""Relative difference up to which a scaled motion has the PGA that was asked for."""


def checked(specs: Sequence[JobSpec], rows: Any) -> list[Row]:
    """Rows that a worker gave for the first jobs of a batch; a job whose row is none of it has failed.

    specs: the batch as it was sent.
    rows: meant to be a list of one row at least, in the batch's order.
    """
    if not isinstance(rows, list) or not 0 < len(rows) <= len(specs):
        what = f"{len(rows)} rows" if isinstance(rows, list) else f"a {type(rows).__name__}"
        return [_failed(specs[0], f"{what} for {len(specs)} jobs")]
    problems = [_problem(spec, row) for spec, row in zip(specs, rows, strict=False)]
    sound = [row for row, problem in zip(rows, problems, strict=True) if not problem]
    if sound and _unstorable(
        sound
    ):  # one by one only if need be: a table a row costs more than all else of a job
        problems = [problem or _unstorable([row]) for row, problem in zip(rows, problems, strict=True)]
    return [
        _failed(spec, problem) if problem else dict(row)
        for spec, row, problem in zip(specs, rows, problems, strict=False)
    ]


def _failed(spec: JobSpec, problem: str) -> Row:
    return lost_row(spec, "failed", f"what its worker answered is no answer to it: {problem}")


def _problem(spec: JobSpec, row: Any) -> str:
    """What is wrong with a row; nothing where it answers the job."""
    if not isinstance(row, Mapping):
        return f"a {type(row).__name__} and no row"
    asked = identity(spec)
    for name in _ASKED:
        if row.get(name) != asked[name]:
            return f"{name} is {row.get(name)!r}, asked was {asked[name]!r}"
    status, toppled, outcome = row.get("status"), row.get("toppled"), row.get("outcome")
    if status not in _STATUSES:
        return f"status is {status!r}"
    if status != "ok" and (toppled is not None or outcome is not None):
        return f"status is {status!r}, yet outcome is {outcome!r}"
    if status == "ok" and (not isinstance(toppled, bool) or _OUTCOMES.get(str(outcome)) is not toppled):
        return f"status is 'ok', yet outcome is {outcome!r} and toppled is {toppled!r}"
    pga, wall_s = row.get("pga_m_s2"), row.get("wall_s")
    # Holding the displacement of a motion takes some of its PGA.
    low = 0.0 if spec.peak_displacement_m is not None else spec.pga_m_s2 * (1.0 - _SAME_PGA)
    scaled = isinstance(pga, float) and low < pga < spec.pga_m_s2 * (1.0 + _SAME_PGA)
    if status != "failed" and not scaled:
        return f"pga_m_s2 is {pga!r}, asked was {spec.pga_m_s2!r}"
    if wall_s is not None and not (isinstance(wall_s, int | float) and 0.0 <= wall_s < math.inf):
        return f"wall_s is {wall_s!r}"
    return ""


def _unstorable(rows: list[Mapping[str, Any]]) -> str:
    """Why rows cannot be a table; empty where they can."""
    try:
        table_of(rows)
    except (ValueError, TypeError, OverflowError) as error:
        return str(error)[:300]
    return ""
