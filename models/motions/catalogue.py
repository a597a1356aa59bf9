"""What the columns of an ensemble's catalogue mean, and in which unit they are."""

import hashlib
import re
from collections.abc import Iterable

from toppling.models.motions.measures import MEASURES

CATALOG, MOTIONS = "catalog.parquet", "motions.parquet"
"""Files of an ensemble."""

_MEANINGS = {
    "record_id": "name of the record, unique in the ensemble",
    "event": "earthquake",
    "station": "station, or what stands for it",
    "magnitude": "moment magnitude, or what the source states",
    "distance_km": "distance to the source, of the kind that the source states",
    "time_step_s": "time between samples",
    "duration_s": "time of the last sample",
    "samples": "samples of each component",
    "north_known": "whether the components' azimuths are known; if not, the first horizontal is x",
    "components": "3, or 2 where the vertical is missing and zero",
    "quality": "corrected by its agency, processed here, drifting after it, sound as it came, uncorrected, or made",
    "sensor_depth_m": "depth of the sensor below the ground's surface, where its file states one",
    "structure": "where the sensor stands, if not in the free field: floor 12 of a building, a borehole, a dam",
    "weight": "share of the record in a weighted ensemble; 1 in one without weights",
    "history": "what was done to the motion, step by step",
    "files": "paths as read",
    "sha": "hash of samples, time step and azimuth of the strong component",
    "strong_azimuth_deg": "azimuth of the stronger horizontal component as recorded",
    "duration_energy_vector_s": "5 to 95 % of the horizontal vector's integrated squared velocity",
}

_PATTERNS = {
    r"pg([av])_h([12])_": "peak {0} of horizontal component {1} as recorded",
    r"pgv_vertical_": "peak of the vertical velocity's size",
    r"pg([av])_rotd(50|100)_": "{1} % quantile over all azimuths of the peak {0} (RotD{1}, Boore 2010)",
    r"sa_rotd(50|100)_([0-9.]+)s_": "pseudo-spectral acceleration at {1} s, 5 % damping, RotD{0}",
}
"""Families of measures, by the beginning of their names."""

_UNITS = {"_m_s2": "m/s2", "_m_s": "m/s", "_km": "km", "_deg": "deg", "_s": "s", "_m": "m"}
"""Unit by the end of a name, the longest first."""


def meaning(name: str) -> dict[str, str]:
    """Unit and description of a column; both empty where the name says nothing.

    name: With its unit at the end where it has one.
    """
    unit = next((unit for ending, unit in _UNITS.items() if name.endswith(ending)), "")
    text = MEASURES[name].description if name in MEASURES else _MEANINGS.get(name, "")
    for pattern, template in () if text else _PATTERNS.items():
        if found := re.match(pattern, name):
            words = ({"a": "acceleration", "v": "velocity"}.get(part, part) for part in found.groups())
            text = template.format(*words)
    return {"unit": unit, "description": text}


def ensemble_id(records: Iterable[tuple[str, str]]) -> str:
    """Id of an ensemble: hash of the ids and hashes of all its records."""
    return hashlib.sha256("\n".join(f"{name} {sha}" for name, sha in sorted(records)).encode()).hexdigest()
