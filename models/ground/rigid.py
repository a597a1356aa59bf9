"""Motion of a free rigid body, per mass: poses (7,), velocities (6,), rotations, and ground that moves. Compiled."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from toppling.models.compiled import Array, Vector, compiled, inner


@inner
def square(a: Any) -> float:
    """Square of a vector's length."""
    return a[0] * a[0] + a[1] * a[1] + a[2] * a[2]


@inner
def move(pose: Array, velocity: Array, time_s: float) -> None:
    """Move a pose (7,) with a constant velocity (6,): a straight way and an exact turn."""
    x, y, z = 0.5 * time_s * velocity[3], 0.5 * time_s * velocity[4], 0.5 * time_s * velocity[5]
    angle = math.sqrt(x * x + y * y + z * z)
    sinc = math.sin(angle) / angle if angle > 1e-12 else 1.0
    x, y, z, w = x * sinc, y * sinc, z * sinc, math.cos(angle)
    a, b, c, d = pose[3], pose[4], pose[5], pose[6]
    pose[0] += time_s * velocity[0]
    pose[1] += time_s * velocity[1]
    pose[2] += time_s * velocity[2]
    pose[3] = w * a + x * d + y * c - z * b
    pose[4] = w * b - x * c + y * d + z * a
    pose[5] = w * c + x * b - y * a + z * d
    pose[6] = w * d - x * a - y * b - z * c
    size = math.sqrt(pose[3] ** 2 + pose[4] ** 2 + pose[5] ** 2 + pose[6] ** 2)
    for k in range(3, 7):
        pose[k] /= size


@inner
def spin(turn: Array, inertia_m2: Array, spin: Array, out: Array) -> None:
    """Angular momentum over mass (3,) of a spin."""
    for k in range(3):
        out[k] = 0.0
    for axis in range(3):
        along = turn[0, axis] * spin[0] + turn[1, axis] * spin[1] + turn[2, axis] * spin[2]
        for k in range(3):
            out[k] += turn[k, axis] * inertia_m2[axis] * along


@inner
def times(matrix: Array, vector: Array, out: Array) -> None:
    """Product (3,) of a matrix (3, 3) and a vector."""
    for k in range(3):
        out[k] = matrix[k, 0] * vector[0] + matrix[k, 1] * vector[1] + matrix[k, 2] * vector[2]


@inner
def invert(turn: Array, inertia_m2: Array, out: Array) -> None:
    """Inverse (3, 3) of the inertia over mass, in the axes of the support frame."""
    for i in range(3):
        for j in range(3):
            out[i, j] = (
                turn[i, 0] * turn[j, 0] / inertia_m2[0]
                + turn[i, 1] * turn[j, 1] / inertia_m2[1]
                + turn[i, 2] * turn[j, 2] / inertia_m2[2]
            )


@inner
def rotation_of(pose: Array, turn: Array) -> None:
    """Matrix (3, 3) of the attitude of a pose (7,)."""
    x, y, z, w = pose[3], pose[4], pose[5], pose[6]
    turn[0, 0], turn[0, 1], turn[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)
    turn[1, 0], turn[1, 1], turn[1, 2] = 2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)
    turn[2, 0], turn[2, 1], turn[2, 2] = 2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)


@compiled
def normal_in_body(pose: Array) -> Vector:
    """The interface's normal in body axes, for a pose (7,)."""
    x, y, z, w = pose[3], pose[4], pose[5], pose[6]
    return 2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)


@compiled
def yaw_between(start: Array, end: Array) -> float:
    """Turn about z, rad, from one pose (7,) to another: what is left of a rotation without the tilt."""
    a, b, c, d = start[3], start[4], start[5], start[6]
    x, y, z, w = end[3], end[4], end[5], end[6]
    return 2.0 * math.atan2(d * z - c * w - b * x + a * y, d * w + a * x + b * y + c * z)


@inner
def kinetic_j_kg(turn: Array, inertia_m2: Array, velocity: Array) -> float:
    """Kinetic energy per mass at a velocity (6,)."""
    p, q, r = turned_back(turn, velocity[3:])
    turning = inertia_m2[0] * p * p + inertia_m2[1] * q * q + inertia_m2[2] * r * r
    return 0.5 * (square(velocity) + turning)


@inner
def copy(source: Array, target: Array) -> None:
    """Copy one array into another; an assignment of arrays takes Numba's compiler long."""
    for k in range(len(target)):
        target[k] = source[k]


@inner
def dot(a: Any, b: Any) -> float:
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inner
def minus(a: Any, b: Any) -> tuple[float, float, float]:
    """Difference of two."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inner
def plus(a: Any, share: float, b: Any) -> tuple[float, float, float]:
    """One, and a share of another."""
    return a[0] + share * b[0], a[1] + share * b[1], a[2] + share * b[2]


@inner
def cross(a: Any, b: Any) -> tuple[float, float, float]:
    """Vector product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inner
def turned(turn: Array, a: Any) -> tuple[float, float, float]:
    """One turned by a rotation (3, 3)."""
    return dot(turn[0], a), dot(turn[1], a), dot(turn[2], a)


@inner
def turned_back(turn: Array, a: Any) -> tuple[float, float, float]:
    """One turned by the inverse of a rotation (3, 3)."""
    return (
        turn[0, 0] * a[0] + turn[1, 0] * a[1] + turn[2, 0] * a[2],
        turn[0, 1] * a[0] + turn[1, 1] * a[1] + turn[2, 1] * a[2],
        turn[0, 2] * a[0] + turn[1, 2] * a[1] + turn[2, 2] * a[2],
    )


def excitation(acceleration_m_s2: Array, sample_s: float) -> Array:
    """Acceleration and velocity (samples, 6) of ground that starts at rest, from its acceleration (samples, 3).

    The velocity is the exact integral of an acceleration that is linear between samples.
    """
    velocity = np.zeros_like(acceleration_m_s2)
    means = 0.5 * (acceleration_m_s2[1:] + acceleration_m_s2[:-1])
    np.cumsum(sample_s * means, axis=0, out=velocity[1:])
    return np.hstack([acceleration_m_s2, velocity])


@inner
def velocity_increment_m_s(
    ground: Array, sample_s: float, gravity_m_s2: Array, since_s: float, until_s: float
) -> Vector:
    """Increment of a velocity between two times by gravity less the ground's acceleration.

    Parameters
    ----------
    ground : (samples, 6) array
        As :func:`excitation` gives it; before it and after it the ground moves uniformly.
    sample_s : float
    gravity_m_s2 : (3,) array
        In the axes of the ground's motion.
    since_s, until_s : float
    """
    before, after = _velocity_m_s(ground, sample_s, since_s), _velocity_m_s(ground, sample_s, until_s)
    lasting_s = until_s - since_s
    return (
        gravity_m_s2[0] * lasting_s - (after[0] - before[0]),
        gravity_m_s2[1] * lasting_s - (after[1] - before[1]),
        gravity_m_s2[2] * lasting_s - (after[2] - before[2]),
    )


@inner
def _velocity_m_s(ground: Array, sample_s: float, time_s: float) -> Vector:
    time = min(max(time_s, 0.0), (len(ground) - 1) * sample_s)
    i = min(int(time / sample_s), len(ground) - 2)
    since = time - i * sample_s
    half = 0.5 * since * since / sample_s
    return (
        ground[i, 3] + since * ground[i, 0] + half * (ground[i + 1, 0] - ground[i, 0]),
        ground[i, 4] + since * ground[i, 1] + half * (ground[i + 1, 1] - ground[i, 1]),
        ground[i, 5] + since * ground[i, 2] + half * (ground[i + 1, 2] - ground[i, 2]),
    )
