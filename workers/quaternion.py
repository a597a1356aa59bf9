"""Quaternions (x, y, z, w) of poses. Compiled."""

import math

import numpy as np
from scipy.spatial.transform import Rotation

from toppling.models.compiled import Array, compiled, inner


def seated(seat: Array, pose: Array) -> Array:
    """The pose (7,) in which a rock comes to rest where it is, with its turn about the normal since its seat."""
    attitude = Rotation.from_euler("z", yaw_between(seat, pose)) * Rotation.from_quat(seat[3:])
    return np.concatenate([pose[:2], seat[2:3], attitude.as_quat()])


@compiled
def normal_in_body(pose: Array) -> tuple[float, float, float]:
    """The interface's normal in body axes, for a pose (7,): place, then attitude as a quaternion."""
    x, y, z, w = pose[3], pose[4], pose[5], pose[6]
    return 2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)


@inner
def _turn_between(start: Array, end: Array) -> tuple[float, float, float, float]:
    """Quaternion that carries the attitude of pose `start` (7,) into that of pose `end`."""
    x1, y1, z1, w1 = end[3], end[4], end[5], end[6]
    x2, y2, z2, w2 = -start[3], -start[4], -start[5], start[6]
    return (
        w1 * x2 + x1 * w2 + y1 * z2 - z1 * y2,
        w1 * y2 - x1 * z2 + y1 * w2 + z1 * x2,
        w1 * z2 + x1 * y2 - y1 * x2 + z1 * w2,
        w1 * w2 - x1 * x2 - y1 * y2 - z1 * z2,
    )


@compiled
def rotation_between(start: Array, end: Array) -> tuple[float, float, float]:
    """Rotation vector, rad, that carries the attitude of pose `start` (7,) into that of pose `end`."""
    x, y, z, w = _turn_between(start, end)
    sine = math.sqrt(x * x + y * y + z * z)
    if w < 0:
        x, y, z, w = -x, -y, -z, -w
    scale = 2.0 * math.atan2(sine, w) / sine if sine > 1e-300 else 2.0
    return x * scale, y * scale, z * scale


@compiled
def to_body(a: float, b: float, c: float, pose: Array) -> tuple[float, float, float]:
    """Components of a vector in the axes of a body in a pose (7,)."""
    x, y, z, w = pose[3], pose[4], pose[5], pose[6]
    # twice the cross product of the vector and the axis, as q* v q written out
    p, q, r = 2.0 * (b * z - c * y), 2.0 * (c * x - a * z), 2.0 * (a * y - b * x)
    return a + w * p + q * z - r * y, b + w * q + r * x - p * z, c + w * r + p * y - q * x


@compiled
def to_world(a: float, b: float, c: float, pose: Array) -> tuple[float, float, float]:
    """A vector of a body in a pose (7,) in the axes that the pose is told in."""
    x, y, z, w = pose[3], pose[4], pose[5], pose[6]
    p, q, r = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    return a + w * p + y * r - z * q, b + w * q + z * p - x * r, c + w * r + x * q - y * p


@compiled
def yaw_between(start: Array, end: Array) -> float:
    """Turn about z, rad, from one pose (7,) to another: what is left of a rotation without the tilt."""
    _, _, z, w = _turn_between(start, end)
    return 2.0 * math.atan2(z, w)
