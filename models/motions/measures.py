"""Columns of an ensemble's catalogue, and the intensity measures of a motion as imposed, each declared once."""

import hashlib
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

STANDARD_G_M_S2 = 9.80665
"""Standard acceleration of free fall, the unit g of records and hazard (CGPM 1901)."""


@dataclass(frozen=True, slots=True)
class Measure:
    """Intensity measure."""

    description: str  # of the columns of catalogues and rows; its unit is the end of its name
    # Power of the scale by which it grows with the motion; None for an azimuth, which turns with it.
    scaling_power: int | None
    short_name: str = ""  # as people call it; its own name if empty
    compared: bool = False  # whether curves are fitted over it and runs rank it
    # Whether it is of the vertical shaking, which topples nothing by itself: no level is chosen by it.
    vertical: bool = False
    # OpenQuake's name (hazardlib/imt.py), and the factor from SI to OpenQuake's unit.
    openquake: tuple[str, float] | None = None


_IN_G = 1 / STANDARD_G_M_S2
_SPECTRAL = "pseudo-spectral acceleration at {} s, 5 % damping, largest of all azimuths"

# fmt: off
MEASURES: Mapping[str, Measure] = {
    "pga_m_s2": Measure("peak of the horizontal acceleration vector", 1, "PGA", True, openquake=("PGA", _IN_G)),
    "pgv_m_s": Measure("peak of the horizontal velocity vector", 1, "PGV", True, openquake=("PGV", 100.0)),
    "pgv_pga_s": Measure("pgv_m_s over pga_m_s2: how long the strongest pulse is", 0, "PGV/PGA", True),
    "ground_accelerates_toward_deg": Measure("azimuth of the horizontal acceleration at its peak", None),
    "pgd_m": Measure("peak of the horizontal displacement vector", 1, "PGD", True, openquake=("PGD", 100.0)),
    "pga_vertical_m_s2": Measure("peak of the vertical acceleration's size", 1, "vertical PGA", True, vertical=True),
    "arias_m_s": Measure(
        "Arias intensity, sum of the two horizontal components", 2, "Arias intensity", True, openquake=("IA", 1.0)
    ),
    "cav_m_s": Measure(
        "cumulative absolute velocity of the horizontal vector", 1, "CAV", True, openquake=("CAV", _IN_G)
    ),
    "duration_energy_s": Measure(
        "5 to 95 % of the stronger component's integrated squared velocity (Anderson 2004)", 0, "duration", True
    ),
    "duration_arias_s": Measure("5 to 95 % of the horizontal vector's integrated squared acceleration", 0),
    "sa_1s_m_s2": Measure(_SPECTRAL.format(1), 1, "SA(1 s)", True, openquake=("SA(1.0)", _IN_G)),
    "sa_2s_m_s2": Measure(_SPECTRAL.format(2), 1, "SA(2 s)", True, openquake=("SA(2.0)", _IN_G)),
    "directionality": Measure("share of PGA reached over 22.5 deg off its azimuth", 0),
}
# fmt: on

SCALING_POWER = {
    name: measure.scaling_power for name, measure in MEASURES.items() if measure.scaling_power is not None
}
"""Measures that follow a scaled and turned motion, with the power of the scale by which they grow."""

COMPARED = tuple(name for name, measure in MEASURES.items() if measure.compared)
"""Measures over which curves are fitted, and which are ranked."""

LEVEL_MEASURES = tuple(
    name for name in COMPARED if MEASURES[name].scaling_power and not MEASURES[name].vertical
)
"""Measures of the horizontal shaking that grow with its scale, so that a level is a choice of them."""

OPENQUAKE = {name: measure.openquake for name, measure in MEASURES.items() if measure.openquake}
"""OpenQuake's name and the factor from SI to its unit, by measure."""


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
