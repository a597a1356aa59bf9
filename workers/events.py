"""Contact events: gaps of the contact points, how fast they close, and when the next impact comes.

Pure and compiled; knows no engine. A pose is an array (7,): centre of mass in the support frame, and attitude as a
quaternion. A gap is the clearance of a contact point over the interface plane, negative where the point has penetrated.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from toppling.workers.quaternion import normal_in_body, to_body

Array = NDArray[np.float64]
Vector = tuple[float, float, float]


@njit(cache=True)
def gaps_m(centres_m: Array, radius_m: float, pose: Array, out: Array) -> None:
    """Gaps of the first n contact points, into `out` (n,)."""
    nx, ny, nz = normal_in_body(pose)
    above = pose[2] - radius_m
    for i in range(len(out)):
        out[i] = (centres_m[i, 0] * nx + centres_m[i, 1] * ny + centres_m[i, 2] * nz) + above


@njit(cache=True)
def centripetal_m_s2(centres_m: Array, pose: Array, spin_rad_s: Vector, out: Array) -> None:
    """Acceleration of the first n points toward their axis of rotation, along the normal, into `out` (n,).

    It is spin x (spin x arm), positive upward.
    """
    x, y, z = spin_rad_s
    a, b, c = to_body(z * x, z * y, -x * x - y * y, pose)
    for i in range(len(out)):
        out[i] = centres_m[i, 0] * a + centres_m[i, 1] * b + centres_m[i, 2] * c


@njit(cache=True)
def height_correction_m(gap_m: Array, offset_m: Array, aloft_m: float, penetrating_m: float) -> float:
    """Way up that brings the lowest point to the centripetal offset of its step; 0 where the rock is aloft.

    In a steady step a point that carries leaves the plane along its tangent, by half of (step)^2 times its centripetal
    acceleration, and the next step takes that back. After a change of step the offset is another one.
    """
    lowest = np.inf
    for i in range(len(gap_m)):
        lowest = min(lowest, gap_m[i] - offset_m[i])
    return -lowest if -aloft_m < -lowest < penetrating_m else 0.0


@njit(cache=True)
def terminal_substep_s(
    contact_s: float, gap_m: float, step_s: float, told_apart_m: float, terminal_share: float
) -> float:
    """Last part of the way of a point that comes down, long enough to tell it from the points that carry."""
    told_apart_s = told_apart_m * contact_s / gap_m
    return min(max(terminal_share * step_s, told_apart_s), contact_s)
