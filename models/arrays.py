"""Array types, common array operations, and proportions of draws."""

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Indices = NDArray[np.int64]

_Kind = TypeVar("_Kind", bound=np.generic)
AT_ONCE = 200_000
"""Number of rows or pairs that are processed together: some 50 MB."""
ROUNDING = 1e-12
"""Relative error by rounding that comparisons of computed lengths, moments and weights allow."""


def bounds_of(rows: Array) -> Array:
    """Minimum and maximum of each column (2, k), column by column, which is faster than reducing rows of three."""
    return np.array([[column.min() for column in rows.T], [column.max() for column in rows.T]])


def inside_box(rows: Array, low: Array, high: Array) -> Flags:
    """Mask of the rows (n, k) between two corners (k,), evaluated axis by axis for speed."""
    inside = np.ones(len(rows), bool)
    for column, least, most in zip(rows.T, low, high, strict=True):
        inside &= column > least
        inside &= column < most
    return inside


def inside_cylinder(points: Array, axis: Array, radius: float, lowest: float) -> Indices:
    """Indices of the points (n, 3) nearer to a vertical axis (2,) than a radius, and above a level.

    Evaluated in blocks, whose intermediate results stay in the cache.
    """
    found = [np.zeros(0, np.int64)]
    for first in range(0, len(points), AT_ONCE // 2):
        x, y, z = points[first : first + AT_ONCE // 2].T
        near = (x - axis[0]) ** 2 + (y - axis[1]) ** 2 < radius**2
        found.append(first + np.flatnonzero(near & (z > lowest)))
    return np.concatenate(found)


def distinct(values: NDArray[_Kind]) -> NDArray[_Kind]:
    """Sorted distinct values (n,), by sorting, which is much faster than the hashing of `numpy.unique`."""
    in_order = np.sort(values)
    first = np.ones(len(in_order), bool)
    first[1:] = in_order[1:] != in_order[:-1]
    return in_order[first]


def numbered(keys: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Index (n,) of each non-negative integer among the sorted distinct ones, and the count of each of these.

    By counting where that takes no more memory than the keys: sorting takes ten times as long.
    """
    most = int(keys.max(initial=-1)) + 1
    if most > AT_ONCE + 4 * len(keys):
        _, place, count = np.unique(keys, return_inverse=True, return_counts=True)
        return place, count
    count = np.bincount(keys, minlength=most)
    occurs = count > 0
    return (np.cumsum(occurs) - 1)[keys], count[occurs]


def at_most(rows: NDArray[_Kind], most: int) -> NDArray[_Kind]:
    """Every k-th row, such that at most `most` rows are left."""
    return rows[:: -(-len(rows) // most) or 1]


def jeffreys_mean(count: Any, of: Any) -> Any:
    """Posterior mean of a proportion under Jeffreys' prior, after `count` of `of` draws: never 0 or 1."""
    return (count + 0.5) / (of + 1.0)


def effective_number(weights: Array) -> float:
    """Kish's effective number of draws with weights that are not all 0."""
    share = weights / weights.max()  # avoids underflow of squares
    return float(share.sum() ** 2 / (share**2).sum())
