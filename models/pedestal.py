"""The pedestal that a rock stands on and may touch before it has toppled: plane, friction, restitution, support."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from toppling.models.arrays import Array
from toppling.models.errors import InputError
from toppling.models.frames import plane_normal, rotation_between, slope_of_normal


@dataclass(frozen=True, eq=False)
class Pedestal:
    """An infinite plane, or a scanned surface with an interface plane."""

    point_m: Array  # (3,): a point of the interface plane, scene frame
    normal: Array  # (3,): upward unit normal of the interface plane
    # (n, 3): scanned surface of the pedestal; None for an infinite plane.
    vertices_m: Array | None = None
    faces: NDArray[np.int64] | None = None  # (m, 3): its triangles, counter-clockwise seen from above

    @property
    def is_plane(self) -> bool:
        """Whether the pedestal is an infinite plane."""
        return self.vertices_m is None

    @property
    def slope_deg(self) -> float:
        """Slope of the interface plane."""
        return slope_of_normal(self.normal)[0]

    @property
    def downhill_azimuth_deg(self) -> float:
        """Azimuth toward which the interface plane falls."""
        return slope_of_normal(self.normal)[1]

    def triangles(self, around_m: Array, reach_m: float) -> tuple[Array, NDArray[np.int64]]:
        """Vertices (n, 3) and triangles (m, 3) of its surface; of an infinite plane a square around a place (3,)."""
        if self.vertices_m is not None and self.faces is not None:
            return self.vertices_m, self.faces
        middle = around_m - ((around_m - self.point_m) @ self.normal) * self.normal
        square = reach_m * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
        turn = rotation_between((0.0, 0.0, 1.0), self.normal)
        return square @ turn.T + middle, np.array([[0, 1, 2], [0, 2, 3]], np.int64)

    @classmethod
    def sloping(cls, slope_deg: float, downhill_azimuth_deg: float) -> Pedestal:
        """Infinite plane through the origin that falls toward an azimuth.

        Raises
        ------
        InputError
            If the slope is out of range.
        """
        if not 0.0 <= slope_deg < 90.0:
            raise InputError(
                "pedestal.slope_out_of_range",
                f"slope_deg is {slope_deg}",
                where="Scene.from_mesh",
                expected="0 to below 90 degrees",
                remedy="give the slope as a positive angle and its downhill azimuth as slope_azimuth_deg",
            )
        return cls(np.zeros(3), plane_normal(slope_deg, downhill_azimuth_deg))


FRICTION_SPREAD = 0.05
"""Coefficient of variation of friction in a realisation."""


@dataclass(frozen=True)
class ContactProperties:
    """Friction and restitution of the contact."""

    # Coulomb's coefficients, not negative, the kinetic one not above the static one.
    friction_static: float = 0.8
    friction_kinetic: float = 0.8
    restitution: float = 0.0  # Poisson's coefficient, 0 to 1: impulse of restitution over that of compression

    def __post_init__(self) -> None:
        for name, low, high in (
            ("friction_static", 0.0, math.inf),
            ("friction_kinetic", 0.0, self.friction_static),
            ("restitution", 0.0, 1.0),
        ):
            value = getattr(self, name)
            if not (math.isfinite(value) and low <= value <= high):
                raise InputError(
                    "contact.property_out_of_range",
                    f"{name} is {value}",
                    where="contact properties",
                    expected=f"a finite number from {low} to {high}",
                    remedy="rock on rock has friction 0.6 to 1.0 (Byerlee 1978) and restitution near 0",
                )

    @classmethod
    def of(cls, friction: float | Sequence[float], restitution: float = 0.0) -> ContactProperties:
        """Contact properties from one coefficient of friction or a (static, kinetic) pair."""
        static, kinetic = np.broadcast_to(friction, 2)
        return cls(float(static), float(kinetic), float(restitution))


CONTACT_SHARE_OF_HEIGHT = 1e-6
"""Distance from the interface plane within which points are in contact, as a fraction of the rock's height."""

LARGEST_OPEN_TILT_DEG = 75.0
"""Tilt beyond which a rock's fate is decided; points that touch only later are left out."""

TOPPLED_TILT_DEG = 45.0
"""Tilt at rest beyond which a rock counts as toppled, degrees."""

TOPPLED_FALL = 0.25
"""Fall of the centre of mass beyond which a rock counts as toppled, as a fraction of its height above the support."""

FARTHEST_SETTLING = 0.1
"""Displacement of the centre of mass, as a fraction of the rock's height, beyond which a settled rock has fallen."""

STEEP = 0.5
"""Upward part of a contact's normal: less, and what is touched stands beside the rock, not below it."""

_ON_A_LINE = 1e-14
"""Area of a triangle, relative to the squares of its sides, below which it is degenerate."""


def moment_arms(ring: Array, com: Array, normal: Array) -> Array:
    """Vectors w (k, 3) such that w_k . f is the stabilising moment of a force f on the centre of mass about edge k."""
    edge = np.roll(ring, -1, axis=0) - ring
    edge = edge - np.outer(edge @ normal, normal)
    axis = edge / np.linalg.norm(edge, axis=1)[:, None]
    return np.cross(com - ring, axis)


def planar_hull(points: Array, width_m: float) -> NDArray[np.intp] | None:
    """Indices of the counter-clockwise convex hull of points (k, 2); None if they are collinear."""
    if np.ptp(points @ _narrow_direction(points)) <= width_m:
        return None
    if len(points) == 3:  # most supports of a path; faster than Qhull
        (x, y), (u, v) = points[1] - points[0], points[2] - points[0]
        twice_area = x * v - y * u
        if abs(twice_area) <= _ON_A_LINE * (x * x + y * y + u * u + v * v):
            return None
        return np.array([0, 1, 2] if twice_area > 0.0 else [0, 2, 1])
    try:
        return np.asarray(ConvexHull(points).vertices)
    except QhullError:
        return None


def _narrow_direction(points: Array) -> Array:
    """Unit vector across the longer principal axis of points (k, 2)."""
    x, y = (points - points.mean(axis=0)).T
    along_rad = 0.5 * math.atan2(2.0 * (x @ y), x @ x - y @ y)
    return np.array([-math.sin(along_rad), math.cos(along_rad)])
