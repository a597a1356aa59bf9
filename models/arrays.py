"""The arrays that nearly every function takes and returns."""

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Indices = NDArray[np.int64]

_Kind = TypeVar("_Kind", bound=np.generic)
_MOST_COUNTED = 1_000_000


def bounds_of(rows: Array) -> Array:
    """Lowest and highest of each column (2, k), one after the other: rows of three are slow to reduce."""
    return np.array([[column.min() for column in rows.T], [column.max() for column in rows.T]])


def inside_box(rows: Array, low: Array, high: Array) -> Flags:
    """Which rows (n, k) lie between two (k,), axis by axis for the same reason."""
    inside = np.ones(len(rows), bool)
    for column, least, most in zip(rows.T, low, high, strict=True):
        inside &= column > least
        inside &= column < most
    return inside


def inside_cylinder(
    points: Array, axis: Array, radius: float, lowest: float, at_once: int = 100_000
) -> Indices:
    """Numbers of the points (n, 3) nearer to a vertical axis (2,) than a radius, and above a level.

    Block by block: what is worked out on the way stays in the cache.
    """
    found = [np.zeros(0, np.int64)]
    for first in range(0, len(points), at_once):
        x, y, z = points[first : first + at_once].T
        near = (x - axis[0]) ** 2 + (y - axis[1]) ** 2 < radius**2
        found.append(first + np.flatnonzero(near & (z > lowest)))
    return np.concatenate(found)


def distinct(values: NDArray[_Kind]) -> NDArray[_Kind]:
    """The values (n,) that occur, in order: sorting is many times as quick as `numpy.unique`, which hashes."""
    in_order = np.sort(values)
    first = np.ones(len(in_order), bool)
    first[1:] = in_order[1:] != in_order[:-1]
    return in_order[first]


def numbered(keys: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The place (n,) of each of some whole numbers from 0 on among those that occur, in order, and how often each does.

    By counting where that takes no more room than the numbers do: sorting takes ten times as long.
    """
    most = int(keys.max(initial=-1)) + 1
    if most > _MOST_COUNTED + 4 * len(keys):
        _, place, count = np.unique(keys, return_inverse=True, return_counts=True)
        return place, count
    count = np.bincount(keys, minlength=most)
    occurs = count > 0
    return (np.cumsum(occurs) - 1)[keys], count[occurs]


def at_most(rows: NDArray[_Kind], most: int) -> NDArray[_Kind]:
    """Every k-th row, so that no more than so many are left."""
    return rows[:: -(-len(rows) // most) or 1]
