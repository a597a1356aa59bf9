"""Settling of a rock before it is shaken: from its scanned pose to the one in which it stands by itself."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from toppling.models.frames import azimuth_deg
from toppling.models.rock import Rock

_REPORTED_FROM_DEG = 0.1
"""Tilt, or displacement as of such a tilt, from which a settling is reported, degrees: the error of an interface."""


@dataclass(frozen=True)
class Settling:
    """Difference between a rock's pose in its scene and the one in which every job begins."""

    tilt_deg: float  # angle between the interface's normal before and after rotation with the rock
    toward_deg: float  # azimuth toward which it tilted
    moved_m: float  # displacement of the vertex that moved farthest
    height_m: float  # of the rock in the scene

    @classmethod
    def between(cls, scanned: Rock, settled: Rock, normal: np.ndarray) -> Settling:
        """Settling of a rock on an interface with this upward normal, from its mesh before and after."""
        before, after = scanned.vertices_m - scanned.com_m, settled.vertices_m - settled.com_m
        turn, _ = Rotation.align_vectors(after, before)
        leant = turn.apply(normal) - normal
        return cls(
            tilt_deg=float(np.rad2deg(2.0 * np.arcsin(min(0.5 * float(np.linalg.norm(leant)), 1.0)))),
            toward_deg=azimuth_deg(leant),
            moved_m=float(np.linalg.norm(settled.vertices_m - scanned.vertices_m, axis=1).max()),
            height_m=scanned.height_m,
        )

    @property
    def moved_deg(self) -> float:
        """Tilt about the rock's foot that would move its top as far."""
        return math.degrees(self.moved_m / self.height_m)

    @property
    def sentence(self) -> str | None:
        """Sentence on the settling; None where the rock stands as scanned."""
        if self.tilt_deg >= _REPORTED_FROM_DEG:
            return (
                f"the rock settles by {self.tilt_deg:.1f}° toward azimuth {self.toward_deg:.0f}° "
                f"({self.moved_m:.2g} m at its farthest point) before it is shaken"
            )
        if self.moved_deg >= _REPORTED_FROM_DEG:
            return f"the rock settles by {self.moved_m:.2g} m at its farthest point before it is shaken"
        return None

    def to_json(self) -> dict[str, Any]:
        """Fields and sentence, for `run.json`."""
        return {**asdict(self), "sentence": self.sentence}
