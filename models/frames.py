"""Frames and angles: the scene's ENU frame, azimuths counter-clockwise from x, bearings and coordinates as written."""

import math
import re

import numpy as np
from numpy.typing import ArrayLike

from toppling.models.arrays import Array
from toppling.models.errors import InputError

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


WINDS = ("N", "NNE", "NE", "ENE", "E", "ESE", "SE", "SSE", "S", "SSW", "SW", "WSW", "W", "WNW", "NW", "NNW")
_QUADRANT = re.compile(r"([NS])\s*(\d+(?:\.\d*)?)\s*°?\s*([EW])", re.IGNORECASE)


def azimuth_of(text: str | float) -> float:
    """Parse a direction to an azimuth, degrees counter-clockwise from east.

    text: an azimuth (`50`), a compass bearing (`compass:40`), a quadrant bearing (`N40E`) or a compass point (`NNE`).
    Raises InputError if it is none of these.

    Examples
    --------
    >>> azimuth_of("50"), azimuth_of("compass:40"), azimuth_of("N40E"), azimuth_of("S30W"), azimuth_of("NW")
    (50.0, 50.0, 50.0, 240.0, 135.0)
    """
    stated = str(text).strip()
    bearing: float | None = None
    try:
        if stated.lower().startswith("compass:"):
            bearing = float(stated[8:])
            if not 0.0 <= bearing <= 360.0:
                raise ValueError
        elif (quadrant := _QUADRANT.fullmatch(stated)) is not None:
            away = float(quadrant[2])
            if away > 90.0:
                raise ValueError
            north, east = quadrant[1].upper() == "N", quadrant[3].upper() == "E"
            bearing = (away if north else 180.0 - away) if east else (-away if north else 180.0 + away)
        elif stated.upper() in WINDS:
            bearing = 22.5 * WINDS.index(stated.upper())
        if bearing is not None:
            return (90.0 - bearing) % 360.0
        if not math.isfinite(azimuth := float(stated)):
            raise ValueError
    except ValueError:
        raise InputError(
            "azimuth.unreadable",
            f"'{text}' is no direction",
            where="azimuth",
            expected="degrees counter-clockwise from east (50), a compass bearing (compass:40, N40E) or a wind (NNE)",
            remedy="write a bearing of 40 degrees as compass:40 or N40E; a bare number is counted from east",
        ) from None
    return azimuth


def quadrant_of(azimuth_deg: float) -> str:
    """An azimuth, degrees counter-clockwise from east, as a quadrant bearing to the degree, or as one of four winds.

    Examples
    --------
    >>> [quadrant_of(azimuth) for azimuth in (50.0, 240.0, 135.0, 90.0, -0.2)]
    ['N40E', 'S30W', 'N45W', 'N', 'E']
    """
    bearing = round(90.0 - azimuth_deg) % 360
    if bearing % 90 == 0:
        return WINDS[bearing // 90 * 4]
    away = bearing if bearing < 90 else abs(180 - bearing) if bearing < 270 else 360 - bearing
    return f"{'S' if 90 < bearing < 270 else 'N'}{away}{'E' if bearing < 180 else 'W'}"


_DEGREES = re.compile(r"(-?\d{1,3}(?:\.\d+)?)\s*([NSEW]?)", re.IGNORECASE)
_LETTERS = {"longitude": "EW", "latitude": "NS"}


def degrees_of(text: str, axis: str) -> float | None:
    """Parse degrees east or north; None if the text is invalid, or of the other axis.

    text: a number (`-118.92`), or one with a compass letter (`118.92W`, `34.08 N`).
    axis: `longitude` or `latitude`.

    Examples
    --------
    >>> [degrees_of(text, "longitude") for text in ("-118.92", "118.92 W", "34.08N", "11855")]
    [-118.92, -118.92, None, None]
    """
    match = _DEGREES.fullmatch(text.strip())
    letter = match[2].upper() if match else ""
    if match is None or (letter and (letter not in _LETTERS[axis] or match[1].startswith("-"))):
        return None
    return float(match[1]) * (-1.0 if letter in ("W", "S") else 1.0)
