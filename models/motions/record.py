"""A record: a motion with where it comes from and how strong it is."""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from toppling.models.errors import InputError
from toppling.models.motions.intensity import measure
from toppling.models.motions.motion import Motion
from toppling.models.motions.place import FREE_FIELD, Place


@dataclass(frozen=True, eq=False)
class Record:
    """Three-component record of an earthquake at a station, x east, y north, z up."""

    record_id: str
    event: str
    station: str
    # None where unknown.
    magnitude: float | None
    distance_km: float | None
    motion: Motion
    # Whether the recorded components' azimuths are known. If not, the first horizontal component is x, the
    # second y.
    north_known: bool
    # Measures of `models.motions.intensity.measure`, units in the names; `strong_azimuth_deg` is the azimuth
    # of the stronger recorded horizontal component.
    intensity: Mapping[str, float]
    history: tuple[str, ...] = ()  # what was done to the motion, step by step
    files: tuple[str, ...] = ()  # paths as read; empty for a motion that was made
    # Hash of what can change an answer: samples, time step, azimuth of the strong component.
    sha: str = field(default="")
    components: int = 3  # 3, or 2 if the vertical is missing (and zero)
    # "corrected" by its agency, "processed" here, "drifting" after processing, "sound" (nobody says if it was
    # corrected, but its displacement does not drift), "uncorrected" or "made".
    quality: str = "made"
    place: Place = FREE_FIELD  # of the sensor
    weight: float = 1.0  # share of the record in a weighted ensemble; 1 unless the ensemble was weighted

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Record) and (self.record_id, self.sha) == (other.record_id, other.sha)

    def __hash__(self) -> int:
        return hash((self.record_id, self.sha))

    @classmethod
    def of(
        cls,
        record_id: str,
        motion: Motion,
        *,
        component_azimuths_deg: tuple[float, float] | None = None,
        history: Iterable[str] = (),
        files: Iterable[str] = (),
        **stated: Any,
    ) -> Record:
        """Measure a motion and name it.

        component_azimuths_deg: Azimuths of the recorded horizontal components, degrees counter-clockwise from x; None
        where unknown.
        stated: Other fields of the record.
        Raises InputError if the motion has no horizontal acceleration.
        """
        intensity = measure(motion, component_azimuths_deg or (0.0, 90.0))
        if not intensity["pga_m_s2"] > 0:
            raise InputError(
                "motion.no_horizontal",
                "both horizontal components are zero throughout",
                where=f"record {record_id}",
                expected="a motion whose horizontal peak can be scaled",
                remedy="leave the record out, or check which columns were read",
            )
        return cls(
            record_id=record_id,
            motion=motion,
            north_known=component_azimuths_deg is not None,
            intensity=intensity,
            history=tuple(history),
            files=tuple(files),
            sha=motion_sha(motion, intensity["strong_azimuth_deg"]),
            **({"event": "", "station": "", "magnitude": None, "distance_km": None} | stated),
        )


def motion_sha(motion: Motion, strong_azimuth_deg: float) -> str:
    """SHA-256 of samples, time step and azimuth of the strong component, the same on every machine."""
    digest = hashlib.sha256(struct.pack("<dd", motion.time_step_s, strong_azimuth_deg))
    digest.update(np.ascontiguousarray(motion.acceleration_m_s2, dtype="<f8").tobytes())
    return digest.hexdigest()
