"""Frames and angles: the scene's ENU frame, azimuths counter-clockwise from x, planes that slope.

Azimuths are degrees counter-clockwise from x (east) seen from above, as in Veeraraghavan, Hudnut and Krishnan's
study; :func:`compass_deg` converts them to bearings (clockwise from north).
"""

import numpy as np
from numpy.typing import ArrayLike

from toppling.models.arrays import Array

STANDARD_GRAVITY_M_S2 = 9.81
"""Default gravity of a scene, m/s²."""
_TURNED_AT_ONCE = 50_000
"""Number of points per block, whose products stay in the cache and in one thread."""


def horizontal_unit_vector(azimuth_deg: ArrayLike) -> Array:
    """Unit vector(s) toward an azimuth.

    azimuth_deg: degrees counter-clockwise from x, scalar or (n,).
    Returns (3,) or (n, 3) array, scene frame.
    """
    azimuth = np.deg2rad(np.asarray(azimuth_deg, dtype=float))
    return np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros_like(azimuth)], axis=-1)


def azimuth_deg(vector: ArrayLike) -> float:
    """Azimuth of a vector's horizontal part, in [0, 360) degrees counter-clockwise from x."""
    x, y = np.asarray(vector, dtype=float)[:2]
    return float(np.rad2deg(np.arctan2(y, x)) % 360.0) % 360.0  # tiny negative angles round to 360


def compass_deg(azimuth: ArrayLike) -> Array:
    """Compass bearing (degrees clockwise from north) of an azimuth (degrees counter-clockwise from east)."""
    return (90.0 - np.asarray(azimuth, dtype=float)) % 360.0


def apart_deg(azimuth: ArrayLike, other: ArrayLike) -> Array:
    """Angle between azimuths, 0 to 180 degrees."""
    return np.abs((np.asarray(azimuth, float) - np.asarray(other, float) + 180.0) % 360.0 - 180.0)


def plane_normal(slope_deg: float, downhill_azimuth_deg: float) -> Array:
    """Upward unit normal of a plane that falls by `slope_deg` toward `downhill_azimuth_deg`."""
    slope = np.deg2rad(slope_deg)
    return np.sin(slope) * horizontal_unit_vector(downhill_azimuth_deg) + np.array([0.0, 0.0, np.cos(slope)])


def slope_of_normal(normal: ArrayLike) -> tuple[float, float]:
    """Slope and downhill azimuth, both in degrees, of the plane with this upward normal."""
    x, y, z = np.asarray(normal, dtype=float)
    return float(np.rad2deg(np.arctan2(np.hypot(x, y), z))), azimuth_deg((x, y))


def rotation_between(start: ArrayLike, end: ArrayLike) -> Array:
    """Smallest rotation that maps one unit vector to another.

    start, end: (3,), unit vectors, not opposite to each other.
    Returns (3, 3) array: rotation matrix R with R @ start = end (Rodrigues' formula).
    Raises ValueError if the vectors are opposite, where the smallest rotation is not unique.
    """
    a, b = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
    cross, cosine = np.cross(a, b), float(a @ b)
    if cosine < -1 + 1e-12:
        raise ValueError(f"no unique rotation from {a} to its opposite {b}")
    skew = np.array([[0, -cross[2], cross[1]], [cross[2], 0, -cross[0]], [-cross[1], cross[0], 0]])
    return np.eye(3) + skew + skew @ skew / (1.0 + cosine)


def plane_axes(normal: ArrayLike) -> tuple[Array, Array]:
    """Two orthonormal axes in a plane, the first nearest to x, right-handed with the normal."""
    rotation = rotation_between((0.0, 0.0, 1.0), normal)
    return rotation[:, 0], rotation[:, 1]


def shifted_and_turned(points_m: Array, shift_m: Array, matrix: Array) -> Array:
    """`(points_m - shift_m) @ matrix` for many points, in blocks, which is ten times as fast as a single product."""
    if points_m.ndim == 1:
        return (points_m - shift_m) @ matrix
    turned = np.empty((len(points_m), matrix.shape[1]))
    for first in range(0, len(points_m), _TURNED_AT_ONCE):
        rows = slice(first, first + _TURNED_AT_ONCE)
        turned[rows] = (points_m[rows] - shift_m) @ matrix
    return turned
