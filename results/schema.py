"""Schema of results, one row per job: every column with its group, unit and description.

SI units throughout, in the names. Azimuths are degrees counter-clockwise from x (east). Null means unknown, never zero:
a job that crashed has no tilt.
"""

from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from typing import Any

import pyarrow as pa

from toppling.models.motions.measures import MEASURES, meaning

SCHEMA_VERSION = 2
"""Version of the schema of results."""

TOPPLED_OUTCOMES = ("toppled", "lodged")
"""Values of `outcome` of a rock that toppled."""

GROUPS = ("identity", "imposed", "outcome", "cost", "provenance")
"""Groups of columns: parameters, imposed motion, outcome, cost, and provenance.

A repeated campaign gives equal rows except for the groups cost and provenance.
"""

_TEXT, _REAL, _TRUTH, _COUNT, _NUMBER = pa.string(), pa.float64(), pa.bool_(), pa.int64(), pa.int32()
_TIME = pa.timestamp("us", tz="UTC")
_MUST, _MAY = False, True  # whether a column may be null

_LINE, _PAGE = (0, 200), (0, 20_000)
"""Ranges of the number of characters of a name and of a message."""

# Rounding may leave a size a little below 0.
_SIZE, _ANGLE, _TURN, _FRACTION = (-1e-6, 1e9), (-360.0, 360.0), (0.0, 180.0), (0.0, 1.0)
_MANY, _INDEX = (0, 2**53), (0, 2**31 - 1)
_ANY_TRUTH = (False, True)
_DATES = datetime(2000, 1, 1, tzinfo=UTC), datetime(2200, 1, 1, tzinfo=UTC)

# fmt: off
_COLUMNS: dict[str, list[tuple[Any, ...]]] = {
    "identity": [
        ("job_id", _TEXT, _MUST, _LINE, "", "hash of all that can change the job's answer"),
        ("scene_id", _TEXT, _MUST, _LINE, "", "hash of the scene's content"),
        ("rock", _TEXT, _MAY, _LINE, "", "name of the rock in a campaign of many; null in one of one"),
        ("record_id", _TEXT, _MUST, _LINE, "", "record in the ensemble's catalogue"),
        ("event", _TEXT, _MAY, _LINE, "", "earthquake of the record"),
        ("level_pga_m_s2", _REAL, _MUST, _SIZE, "m/s2", "level asked for: largest horizontal acceleration vector"),
        ("azimuth_deg", _REAL, _MUST, _ANGLE, "deg", "where the stronger recorded component was turned to"),
        ("friction_static", _REAL, _MUST, _SIZE, "1", "Coulomb's static coefficient"),
        ("friction_kinetic", _REAL, _MUST, _SIZE, "1", "Coulomb's kinetic coefficient"),
        ("restitution", _REAL, _MUST, _FRACTION, "1", "coefficient of restitution"),
        ("realisation", _NUMBER, _MUST, _INDEX, "1", "number of the random realisation; 0 is the nominal scene"),
        ("preset", _TEXT, _MUST, _LINE, "", "settings of the engine, by name"),
        ("engine", _TEXT, _MUST, _LINE, "", "physics engine that stepped the rock"),
        ("base", _NUMBER, _MAY, _INDEX, "1", "number of the drawn base (bases.json); null on the scene's own"),
        ("friction_factor", _REAL, _MAY, _SIZE, "1", "factor on both frictions that the realisation drew"),
    ],
    "imposed": [
        (name, _REAL, _MAY, _SIZE, meaning(name)["unit"] or "1", measure.description)
        for name, measure in MEASURES.items()
    ],
    "outcome": [
        ("status", _TEXT, _MUST, _LINE, "", "ok, undecided, diverged, failed or crashed"),
        ("outcome", _TEXT, _MAY, _LINE, "", "stands, moved (slid, turned), toppled or lodged (toppled, caught beside)"),
        ("toppled", _TRUTH, _MAY, _ANY_TRUTH, "", "whether the rock toppled; null unless status is ok"),
        ("topple_time_s", _REAL, _MAY, _SIZE, "s", "no return: centre of mass last highest, from the record's start"),
        ("falls_toward_deg", _REAL, _MAY, _ANGLE, "deg", "azimuth of the centre of mass at the time of no return"),
        ("falls_toward_bearing_deg", _REAL, _MAY, _ANGLE, "deg", "the same as a bearing, clockwise from north"),
        ("max_tilt_deg", _REAL, _MAY, _TURN, "deg", "largest angle of the rock to the normal it stood on"),
        ("residual_tilt_deg", _REAL, _MAY, _TURN, "deg", "angle of the rock to the normal it stood on, at the end"),
        ("residual_yaw_deg", _REAL, _MAY, _ANGLE, "deg", "turn about the interface's normal, at the end"),
        ("slip_m", _REAL, _MAY, _SIZE, "m", "displacement in the interface of what lay below the centre of mass"),
        ("penetration_m", _REAL, _MAY, _SIZE, "m", "deepest overlap of rock and pedestal, also in a fall"),
        ("ended_by", _TEXT, _MAY, _LINE, "", "rule that ended it: fallen, tilted, left_ground, rest ..."),
        ("message", _TEXT, _MAY, _PAGE, "", "why, where status is not ok"),
    ],
    "cost": [
        ("steps", _COUNT, _MAY, _MANY, "1", "time steps taken; parts cut at impacts or where slip turns count"),
        ("engine_steps", _COUNT, _MAY, _MANY, "1", "those that the engine took or checked"),
        ("simulated_s", _REAL, _MAY, _SIZE, "s", "time stepped through"),
        ("skipped_s", _REAL, _MAY, _SIZE, "s", "time not stepped through: the rock at rest, or its answer certain"),
        ("wall_s", _REAL, _MAY, _SIZE, "s", "time the job took on its worker"),
    ],
    "provenance": [
        ("time_step_s", _REAL, _MAY, _FRACTION, "s", "time step"),
        ("physics_version", _TEXT, _MAY, _LINE, "", "version of the physics that the answer comes from"),
        ("worker", _TEXT, _MAY, _LINE, "", "worker that did the job"),
        ("cpu", _TEXT, _MAY, _LINE, "", "model of the processor that did the job"),
        (
            "kernels", _TEXT, _MAY, _LINE, "",
            "kernels of BLAS and LLVM there: rows repeat bit for bit where these are alike",
        ),
        ("attempt", _NUMBER, _MAY, _INDEX, "1", "1 for the first try; the newest attempt counts"),
        ("finished_at", _TIME, _MAY, _DATES, "UTC", "when the job ended"),
    ],
}
# fmt: on

SCHEMA = pa.schema(
    [
        pa.field(name, kind, nullable, {"group": group, "unit": unit, "description": description})
        for group, rows in _COLUMNS.items()
        for name, kind, nullable, _, unit, description in rows
    ],
    metadata={
        "schema_version": str(SCHEMA_VERSION),
        "conventions": "SI units; azimuths in degrees counter-clockwise from x (east)",
    },
)
"""The table `results`."""

LIMITS: Mapping[str, tuple[Any, Any]] = {
    name: limits for rows in _COLUMNS.values() for name, _, _, limits, _, _ in rows
}
"""Range of a column's values, or of a text's length, wide enough for all valid results."""

SHORT_NAMES = {
    "level_pga_m_s2": "PGA",
    **{name: measure.short_name for name, measure in MEASURES.items() if measure.short_name},
}
"""Short names of measures, for print."""

SORT_ORDER = (
    *("record_id", "azimuth_deg", "level_pga_m_s2", "friction_static", "friction_kinetic", "restitution"),
    *("realisation", "scene_id", "engine", "preset", "job_id"),
)
"""Order of the rows in a finished run."""


def describe(field: pa.Field) -> dict[str, str]:
    """Name, type, group, unit and description of a column."""
    metadata = {key.decode(): text.decode() for key, text in (field.metadata or {}).items()}
    known = {key: metadata.get(key, "") for key in ("group", "unit", "description")}
    return {"column": field.name, "type": str(field.type), **known}


def described_table(columns: Iterable[tuple[str, pa.Array, str, str]], **metadata: str) -> pa.Table:
    """Table of columns given by name, values, unit and description, with further metadata of every field."""
    known = list(columns)
    fields = [
        pa.field(name, values.type, metadata={**metadata, "unit": unit, "description": text})
        for name, values, unit, text in known
    ]
    return pa.Table.from_arrays([values for _, values, _, _ in known], schema=pa.schema(fields))
