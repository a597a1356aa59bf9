"""Motion of a free rigid body: poses (7,) and velocities (6,), per mass. Compiled."""

from __future__ import annotations

import math
from typing import Any

from toppling.models.compiled import Array, inner


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
