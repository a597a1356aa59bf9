"""Boxes around a mesh's features, and where points, triangles and segments are nearest to each other. Compiled."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from toppling.models.compiled import Array, Indices, Vector, inner
from toppling.models.ground.rigid import dot, minus, plus

_HALVINGS = 10
"""Halvings of each axis by which features are ordered along Morton's curve (1966)."""


class Boxes(NamedTuple):
    """Boxes around features that are ordered so that neighbours follow each other, and around each four boxes."""

    features: Indices  # (n,)
    corners_m: Array  # (boxes, 2, 3): low and high, level after level; the last is around all
    first: Indices  # (levels,): where each level begins


def boxes_around(corners_m: Array) -> Boxes:
    """Boxes around features of some corners (n, k, 3)."""
    low, high = corners_m.min(axis=1), corners_m.max(axis=1)
    middle = low + high - (low + high).min(axis=0, initial=np.inf)
    cells = (middle / (middle.max(initial=0.0) or 1.0) * ((1 << _HALVINGS) - 1)).astype(np.int64)
    bits = np.arange(_HALVINGS)
    along = ((cells[:, :, None] >> bits & 1) << 3 * bits + np.arange(3)[:, None]).sum(axis=(1, 2))
    order = np.argsort(along, kind="stable")
    levels = [np.stack([low, high], axis=1)[order]]
    while len(levels[-1]) > 1:
        (low, high), fours = np.moveaxis(levels[-1], 1, 0), np.arange(0, len(levels[-1]), 4)
        levels.append(np.stack([np.minimum.reduceat(low, fours), np.maximum.reduceat(high, fours)], axis=1))
    return Boxes(order, np.concatenate(levels), np.cumsum([0, *map(len, levels[:-1])]))


@inner
def next_near(of: Boxes, after: int, ends: tuple[Vector, Vector], reach_m: float) -> int:
    """Place, after another or -1, of the next feature whose box is near a segment; their number if there is none."""
    a, offset, at, level, top = ends[0], minus(ends[1], ends[0]), after, 0, len(of.first) - 1
    share = _inverse(offset[0]), _inverse(offset[1]), _inverse(offset[2])
    while True:
        at += 1 << 2 * level
        while level < top and at & ((4 << 2 * level) - 1) == 0:
            level += 1
        if at >= len(of.features):
            return len(of.features)
        while _is_near(of.corners_m[of.first[level] + (at >> 2 * level)], a, share, reach_m):
            if level == 0:
                return at
            level -= 1


@inner
def _inverse(length: float) -> float:
    return 1.0 / length if abs(length) > 1e-300 else 1e300


@inner
def _is_near(box: Array, a: Vector, share: Vector, reach_m: float) -> bool:
    """Whether a segment, by its start and the share of it along each axis, comes within a reach of a box."""
    near, far = 0.0, 1.0
    for k in range(3):
        first, last = (box[0, k] - reach_m - a[k]) * share[k], (box[1, k] + reach_m - a[k]) * share[k]
        near, far = max(near, min(first, last)), min(far, max(first, last))
    return near <= far


@inner
def nearest(p: Any, a: Any, b: Any, c: Any) -> tuple[int, tuple[float, float, float]]:
    """Where a triangle is nearest to a point: 0 its face, 1 to 3 a corner, 4 to 6 the edge from corner 1 to 3 on."""
    ab, ac, ap = minus(b, a), minus(c, a), minus(p, a)
    d1, d2 = dot(ab, ap), dot(ac, ap)
    if d1 <= 0.0 and d2 <= 0.0:
        return 1, (a[0], a[1], a[2])
    bp = minus(p, b)
    d3, d4 = dot(ab, bp), dot(ac, bp)
    if d3 >= 0.0 and d4 <= d3:
        return 2, (b[0], b[1], b[2])
    cp = minus(p, c)
    d5, d6 = dot(ab, cp), dot(ac, cp)
    if d6 >= 0.0 and d5 <= d6:
        return 3, (c[0], c[1], c[2])
    vc = d1 * d4 - d3 * d2
    va = d3 * d6 - d5 * d4
    vb = d5 * d2 - d1 * d6
    least = -1e-9 * (va + vb + vc)
    if vc < least and d1 >= 0.0 and d3 <= 0.0:
        return 4, plus(a, d1 / (d1 - d3), ab)
    if va < least and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        share = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        return 5, plus(b, share, minus(c, b))
    if vb < least and d2 >= 0.0 and d6 <= 0.0:
        return 6, plus(a, d2 / (d2 - d6), ac)
    whole = 1.0 / (va + vb + vc)
    return 0, plus(plus(a, vb * whole, ab), vc * whole, ac)


@inner
def between(a: Any, along: Any, c: Any, other: Any) -> tuple[float, float, float]:
    """Shares of two segments where they are nearest, and their squared distance there."""
    from_c = minus(a, c)
    aa, bb, ab = dot(along, along), dot(other, other), dot(along, other)
    af, bf = dot(along, from_c), dot(other, from_c)
    det = aa * bb - ab * ab
    s = (ab * bf - af * bb) / det if det > 1e-12 * aa * bb else 0.5
    s = min(max(s, 0.0), 1.0)
    t = (ab * s + bf) / bb
    if t < 0.0 or t > 1.0:
        t = min(max(t, 0.0), 1.0)
        s = min(max((ab * t - af) / aa, 0.0), 1.0)
    gap = minus(plus(a, s, along), plus(c, t, other))
    return s, t, dot(gap, gap)
