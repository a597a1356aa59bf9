"""Points that a cloud holds more than once, as where tiles overlap or an export was merged with itself."""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from toppling.models.scan.read import Cloud

_TOLERATED = 0.4
"""Share of copies below which they stay: coordinates in steps as wide as the points' spacing make a fifth of the points
copies, and patches of a surface are judged by how many points they have."""
_SAMPLED, _ENOUGH = np.uint64(32), 20_000
"""Of so many keys one tells the share of copies, where there are enough: sorting all takes seconds."""
_AT_ONCE = 1_000_000
_MIXERS = (0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB)
"""Odd factors that spread the bits of a coordinate (Steele, Lea and Flood 2014)."""


def copies(points_m: NDArray[np.float64]) -> NDArray[np.bool_] | None:
    """Which points (n, 3) equal an earlier one in every bit; None if so few do that they stay.

    Examples
    --------
    >>> copies(np.array([[0.0, 1.0, 2.0], [2.0, 1.0, 0.0], [0.0, 1.0, 2.0], [0.0, 1.0, 2.0]])).tolist()
    [False, False, True, True]
    """
    keys = _keys(points_m)
    some = keys[keys % _SAMPLED == 0]  # copies of one point have one key: all or none of them
    if len(some) > _ENOUGH and _share(some) < 0.5 * _TOLERATED:
        return None
    if _share(keys) < _TOLERATED:
        return None
    order = np.argsort(keys, kind="stable")
    again = np.zeros(len(points_m), bool)
    again[order[1:]] = keys[order[1:]] == keys[order[:-1]]
    return again


def _share(keys: NDArray[np.uint64]) -> float:
    """Share of the keys that equal another one before them."""
    in_order = np.sort(keys)
    return float((in_order[1:] == in_order[:-1]).sum() / max(len(keys), 1))


def _keys(points_m: NDArray[np.float64]) -> NDArray[np.uint64]:
    """A number of 64 bits for each point: sorting one is far quicker than sorting rows of three."""
    keys = np.empty(len(points_m), np.uint64)
    for start in range(0, len(points_m), _AT_ONCE):
        bits = np.ascontiguousarray(points_m[start : start + _AT_ONCE]).view(np.uint64)
        key = np.zeros(len(bits), np.uint64)
        for axis, factor in enumerate(_MIXERS):
            key += bits[:, axis]
            key *= np.uint64(factor)
            key ^= key >> np.uint64(31)
        keys[start : start + _AT_ONCE] = key
    return keys


def without(cloud: Cloud, again: NDArray[np.bool_] | None) -> Cloud:
    """The cloud without these points, told for each file."""
    if again is None:
        return cloud
    ends = np.cumsum([points for _, points in cloud.files])
    left_out = [int(part.sum()) for part in np.split(again, ends[:-1])]
    kept = ~again
    return dataclasses.replace(
        cloud,
        points_m=cloud.points_m[kept],
        station=cloud.station[kept],
        files=tuple(
            (name, points - less) for (name, points), less in zip(cloud.files, left_out, strict=True)
        ),
        sources=tuple(source.with_less(less) for source, less in zip(cloud.sources, left_out, strict=False)),
        label=None if cloud.label is None else cloud.label[kept],
    )
