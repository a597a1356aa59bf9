"""Grids of a mesh, and where points, triangles and segments are nearest to each other. Compiled."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from toppling.models.compiled import Array, Indices, compiled, inner
from toppling.models.ground.rigid import cross, dot, minus, plus

_CELLS = 40
"""Number of cells along the longest side of a grid, or more where cells would be longer than asked."""


class Grid(NamedTuple):
    """Cells of a box.

    Parameters
    ----------
    origin_m, cell_m, shape
        Low corner, length of a cell's side, cells along each axis.
    reach_m : float
        A cell has all triangles and edges that are so near to any place in it.
    first, near : int arrays
        Triangles near cell c: near[first[c]:first[c + 1]].
    first_edge, near_edges : int arrays
        The same of the edges that can touch another body's edges.
    """

    origin_m: Array
    cell_m: float
    shape: Indices
    reach_m: float
    first: Indices
    near: Indices
    first_edge: Indices
    near_edges: Indices


NO_GRID = Grid(
    np.zeros(3), 1.0, np.zeros(3, np.int64), 0.0, np.zeros(1, np.int64), np.zeros(0, np.int64),
    np.zeros(1, np.int64), np.zeros(0, np.int64),
)  # fmt: skip
"""Grid without cells."""


def grid_of(features: tuple[Array, Array], low_m: Array, high_m: Array, reach_m: float) -> Grid:
    """Grid of some triangles (m, 3, 3) and edges (k, 3, 3), whose last two corners are one, in a box."""
    corners, edges = features
    low = np.maximum(low_m, corners.min(axis=(0, 1))) - reach_m
    high = np.minimum(high_m, corners.max(axis=(0, 1))) + reach_m
    cell = min(float((high - low).max()) / _CELLS, reach_m)
    if not cell > 0.0:
        return NO_GRID
    shape = np.maximum(np.ceil((high - low) / cell).astype(np.int64), 1)
    registered = (
        *_register(corners, low, cell, shape, reach_m),
        *_register(edges, low, cell, shape, reach_m),
    )
    return Grid(low, cell, shape, float(reach_m), *registered)


@inner
def cell_of(grid: Grid, p: Any) -> int:
    """Cell of a place; -1 outside of the grid."""
    number = 0
    for k in range(3):
        i = math.floor((p[k] - grid.origin_m[k]) / grid.cell_m)
        if i < 0 or i >= grid.shape[k]:
            return -1
        number = number * grid.shape[k] + i
    return number


@compiled(allocates=True)
def _register(
    corners: Array, low: Array, cell: float, shape: Indices, reach_m: float
) -> tuple[Indices, Indices]:
    """For each cell the triangles (m, 3, 3) within a reach of it: by their boxes, and by their planes or lines."""
    # Counted one cell further on, then summed: where each cell begins moves on as it is filled, to where it ends.
    first = np.zeros(shape[0] * shape[1] * shape[2] + 2, np.int64)
    near = np.zeros(0, np.int64)
    begin, end = np.zeros(3, np.int64), np.zeros(3, np.int64)
    far_m = reach_m + 0.5 * math.sqrt(3.0) * cell
    for fills in (False, True):
        if fills:
            for number in range(1, len(first)):
                first[number] += first[number - 1]
            near = np.zeros(first[-1], np.int64)
        for owner in range(len(corners)):
            of = corners[owner]
            for k in range(3):
                least, most = min(of[0, k], of[1, k], of[2, k]), max(of[0, k], of[1, k], of[2, k])
                # Of what lies beyond the box the last cell comes before the first: it is registered nowhere.
                begin[k] = max(math.floor((least - reach_m - low[k]) / cell), 0)
                end[k] = min(math.floor((most + reach_m - low[k]) / cell), shape[k] - 1)
            side = minus(of[1], of[0])
            normal = cross(side, minus(of[2], of[0]))
            size, along = math.sqrt(dot(normal, normal)), dot(side, side)
            for x in range(begin[0], end[0] + 1):
                for y in range(begin[1], end[1] + 1):
                    for z in range(begin[2], end[2] + 1):
                        offset = (
                            low[0] + (x + 0.5) * cell - of[0, 0],
                            low[1] + (y + 0.5) * cell - of[0, 1],
                            low[2] + (z + 0.5) * cell - of[0, 2],
                        )
                        if size > 0.0:
                            if abs(dot(offset, normal)) > far_m * size:
                                continue
                        else:
                            aside = plus(offset, -min(max(dot(offset, side) / along, 0.0), 1.0), side)
                            if dot(aside, aside) > far_m * far_m:
                                continue
                        number = (x * shape[1] + y) * shape[2] + z
                        if fills:
                            near[first[number + 1]] = owner
                            first[number + 1] += 1
                        else:
                            first[number + 2] += 1
    return first[:-1].copy(), near


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
