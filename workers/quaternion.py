"""Quaternions (x, y, z, w): in NumPy for many at once, compiled for the inner loop."""

import math

import numpy as np

from toppling.models.compiled import Array, compiled, inner


def product(left: Array, right: Array) -> Array:
    """Turn by `right`, then by `left`; broadcasts over (..., 4)."""
    x1, y1, z1, w1 = np.moveaxis(np.asarray(left, float), -1, 0)
    x2, y2, z2, w2 = np.moveaxis(np.asarray(right, float), -1, 0)
    return np.stack(
        [
            w1 * x2 + x1 * w2 + y1 * z2 - z1 * y2,
            w1 * y2 - x1 * z2 + y1 * w2 + z1 * x2,
            w1 * z2 + x1 * y2 - y1 * x2 + z1 * w2,
            w1 * w2 - x1 * x2 - y1 * y2 - z1 * z2,
        ],
        axis=-1,
    )


def inverse(quaternion: Array) -> Array:
    """The turn back, of unit quaternions (..., 4)."""
    return np.asarray(quaternion, float) * (-1.0, -1.0, -1.0, 1.0)


def matrix(quaternion: Array) -> Array:
    """Rotation matrices (..., 3, 3) of unit quaternions (..., 4)."""
    x, y, z, w = np.moveaxis(np.asarray(quaternion, float), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def from_matrix(turn: Array) -> Array:
    """Unit quaternion (4,) of a rotation matrix (3, 3), by the largest of its components (Shepperd 1978)."""
    trace = float(np.trace(turn))
    squares = np.array([turn[0, 0], turn[1, 1], turn[2, 2], trace])
    i = int(squares.argmax())
    if i == 3:
        vector = [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
        found = np.array([*vector, 1.0 + trace])
    else:
        j, k = (i + 1) % 3, (i + 2) % 3
        found = np.empty(4)
        found[i] = 1.0 + 2.0 * turn[i, i] - trace
        found[j] = turn[j, i] + turn[i, j]
        found[k] = turn[k, i] + turn[i, k]
        found[3] = turn[k, j] - turn[j, k]
    return found / np.linalg.norm(found)


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
