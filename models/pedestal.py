"""The pedestal: the surface that the rock stands on and can reach while its fate is open."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from toppling.models.frames import slope_of_normal


@dataclass(frozen=True, eq=False)
class Pedestal:
    """An endless plane, or a plane's surroundings as scanned."""

    point_m: NDArray[np.float64]  # (3,): a point of the interface plane, scene frame
    normal: NDArray[np.float64]  # (3,): upward unit normal of the interface plane
    # (n, 3): surface of the pedestal as scanned; None for an endless plane.
    vertices_m: NDArray[np.float64] | None = None
    faces: NDArray[np.int64] | None = None  # (m, 3): its triangles, counter-clockwise seen from above

    @property
    def is_plane(self) -> bool:
        """Whether the pedestal is an endless plane."""
        return self.vertices_m is None

    @property
    def slope_deg(self) -> float:
        """Slope of the interface plane."""
        return slope_of_normal(self.normal)[0]

    @property
    def downhill_azimuth_deg(self) -> float:
        """Azimuth toward which the interface plane falls."""
        return slope_of_normal(self.normal)[1]
