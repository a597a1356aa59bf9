"""Vectors of three numbers, and the rotation of a pose. Compiled."""

from __future__ import annotations

from typing import Any

from toppling.models.compiled import Array, inner


@inner
def rotation_of(pose: Array, turn: Array) -> None:
    """Matrix (3, 3) of the attitude of a pose (7,)."""
    x, y, z, w = pose[3], pose[4], pose[5], pose[6]
    turn[0, 0], turn[0, 1], turn[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)
    turn[1, 0], turn[1, 1], turn[1, 2] = 2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)
    turn[2, 0], turn[2, 1], turn[2, 2] = 2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)


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
