"""Search for features of a rock and its ground that may touch soon, in the grids. Compiled."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from toppling.models.compiled import Array, Vector, inner
from toppling.models.ground.grid import cell_of
from toppling.models.ground.mesh import ContactMesh
from toppling.models.ground.pairs import (
    EMPTY,
    RADIUS,
    REACH,
    WAY,
    WIDE_RADIUS,
    Lists,
    Pairs,
    ends_of,
    note,
    serve,
)
from toppling.models.ground.vectors import copy, dot, minus, plus, rotation_of, turned, turned_back

_MORE = 1.2
"""Times the margin that is asked for at least, so that the rock may move on a little."""

_PARTS = 4
"""Of a cell: an edge is looked up in as long parts, by the middle of each."""


@inner
def find(rock: ContactMesh, ground: ContactMesh, pose: Array, margin_m: float, lists: Lists) -> None:
    """List what may touch within a margin in a pose, unless what was listed last still serves."""
    if not serve(lists.pairs, pose, margin_m, lists.farthest_m):
        most_m = min(rock.grid.reach_m, ground.grid.reach_m)
        _search(rock, ground, pose, min(max(lists.slack_m, _MORE * margin_m), most_m), lists.pairs)


@inner(allocates=True)
def _search(rock: ContactMesh, ground: ContactMesh, pose: Array, reach: float, pairs: Pairs) -> None:
    """Find the features that are within a reach of each other, in the grids."""
    turn, seen = pairs.turn, np.full(len(ground.edges), -1)
    rotation_of(pose, turn)
    placed, around = np.empty_like(rock.vertices_m), _no_box()
    for i in range(len(placed)):
        placed[i, 0], placed[i, 1], placed[i, 2] = plus(pose, 1.0, turned(turn, rock.vertices_m[i]))
        _widen(around, placed[i], rock.grid.reach_m)
    found, box, lengths_m = pairs.found, _no_box(), pairs.lengths_m
    while True:
        for kind in range(2):
            _list_points(pairs, kind, (rock, ground), (pose, turn), reach, (around, box))
        seen[:] = -1
        _list_edges((placed, seen, box), rock, ground, reach, pairs)
        if found.max() < len(pairs.first[0]) or reach < 1e-5 * ground.grid.cell_m:
            break
        reach *= 0.5  # of pairs that do not fit, none may be left out that can touch soon
    lengths_m[EMPTY] = min(rock.grid.reach_m, ground.grid.reach_m - 0.5 * ground.grid.cell_m / _PARTS)
    lengths_m[WIDE_RADIUS] = _ball_around(box, (pose, turn), pairs.middle_m[2], pairs.middle_m[3])
    _found_in(rock, ground, pose, reach, pairs)


@inner
def _point_apart_m(p: Vector, mesh: ContactMesh, t: int) -> float:
    """Distance of a point from a triangle, at least."""
    off_m, aside = abs(dot(mesh.normals[t], p) - mesh.offsets_m[t]), minus(p, mesh.middles_m[t])
    return max(off_m, math.sqrt(dot(aside, aside)) - mesh.radii_m[t])


@inner
def _edges_apart_m(a: Vector, b: Vector, half_m: float, mesh: ContactMesh, edge: int) -> float:
    """Distance of a segment, of a half length, from an edge, at least."""
    aside = minus(plus(a, 0.5, minus(b, a)), mesh.edge_middles_m[edge])
    c, d = mesh.vertices_m[mesh.edges[edge, 0]], mesh.vertices_m[mesh.edges[edge, 1]]
    apart_m = math.sqrt(dot(aside, aside)) - half_m - mesh.edge_halves_m[edge]
    for k in range(3):
        apart_m = max(apart_m, min(a[k], b[k]) - max(c[k], d[k]), min(c[k], d[k]) - max(a[k], b[k]))
    return apart_m


@inner
def _append(pairs: Pairs, kind: int, first: int, second: int, apart_m: float) -> None:
    """List one more pair, if there is room."""
    count = pairs.found[kind]
    if count < len(pairs.first[kind]):
        pairs.first[kind, count], pairs.second[kind, count], pairs.apart_m[kind, count] = (
            first,
            second,
            apart_m,
        )
        pairs.found[kind] = count + 1


@inner
def _list_points(pairs: Pairs, kind: int, bodies: Any, placed: Any, reach: float, boxes: Any) -> None:
    """List pairs of points of one body and triangles of the other within a reach.

    Rock and ground; the rock's pose and its rotation; a box around all of the ground that may touch the rock, and one
    widened, in body axes, around what lies in any triangle's cells.
    """
    pairs.found[kind], (rock, ground), (around, box) = 0, bodies, boxes
    of, mesh = (rock, ground) if kind == 0 else (ground, rock)
    for index in range(len(of.points)):
        there = of.vertices_m[of.points[index]]
        if kind == 1 and not _is_within(around, (there[0], there[1], there[2])):
            continue
        q, _ = ends_of(bodies, kind, index, placed)
        grid, cell = mesh.grid, cell_of(mesh.grid, q)
        if cell < 0 or grid.first[cell] == grid.first[cell + 1]:
            continue
        if kind == 0:
            _widen(box, there, 0.0)
        else:
            _widen(box, q, reach)
        if reach <= mesh.fine.reach_m and cell_of(mesh.fine, q) >= 0:
            grid, cell = mesh.fine, cell_of(mesh.fine, q)
        for place in range(grid.first[cell], grid.first[cell + 1]):
            t = grid.near[place]
            apart_m = _point_apart_m(q, mesh, t)
            if apart_m < reach:
                _append(pairs, kind, index, t, apart_m)


@inner
def _list_edges(of: Any, rock: ContactMesh, ground: ContactMesh, reach: float, pairs: Pairs) -> None:
    """List pairs of edges within a reach.

    of: the rock's vertices as they are placed; a mark on each edge of the ground; a box widened around edges that lie
    in the cells of any.
    """
    pairs.found[2], (placed, seen, box) = 0, of
    for i in range(len(rock.edges)):
        begin, start, end = pairs.found[2], placed[rock.edges[i, 0]], placed[rock.edges[i, 1]]
        a, b, half_m = (start[0], start[1], start[2]), (end[0], end[1], end[2]), rock.edge_halves_m[i]
        parts, wide = int(_PARTS * 2.0 * half_m / ground.grid.cell_m) + 1, False
        for part in range(parts):
            at = plus(a, (part + 0.5) / parts, minus(b, a))
            grid, cell = ground.grid, cell_of(ground.grid, at)
            if cell < 0 or grid.first_edge[cell] == grid.first_edge[cell + 1]:
                continue
            wide = True
            if reach + half_m / parts <= ground.fine.reach_m and cell_of(ground.fine, at) >= 0:
                grid, cell = ground.fine, cell_of(ground.fine, at)
            for place in range(grid.first_edge[cell], grid.first_edge[cell + 1]):
                j = grid.near_edges[place]
                if seen[j] == i:
                    continue
                seen[j] = i
                apart_m = _edges_apart_m(a, b, half_m, ground, j)
                if apart_m < reach:
                    _append(pairs, 2, i, j, apart_m)
                    _put_in_order(pairs, begin)
        if wide:
            _widen(box, rock.vertices_m[rock.edges[i, 0]], 0.0)
            _widen(box, rock.vertices_m[rock.edges[i, 1]], 0.0)


@inner
def _put_in_order(pairs: Pairs, begin: int) -> None:
    """Put the last pair where it belongs among those of the same edge of the rock: their order depends on no pose."""
    k, second, apart_m = pairs.found[2] - 1, pairs.second[2], pairs.apart_m[2]
    j, last_m = second[k], apart_m[k]
    while k > begin and second[k - 1] > j:
        second[k], apart_m[k] = second[k - 1], apart_m[k - 1]
        k -= 1
    second[k], apart_m[k] = j, last_m


@inner(allocates=True)
def _no_box() -> Array:
    """Low and high corner (2, 3) of a box around nothing."""
    box = np.full((2, 3), np.inf)
    box[1, 0] = box[1, 1] = box[1, 2] = -np.inf
    return box


@inner
def _widen(box: Array, place: Any, by_m: float) -> None:
    """Widen a box so that a place lies in it, and what is so near."""
    for k in range(3):
        box[0, k], box[1, k] = min(box[0, k], place[k] - by_m), max(box[1, k], place[k] + by_m)


@inner
def _is_within(box: Array, place: Any) -> bool:
    """Whether a place lies in a box."""
    x, y, z = place
    return box[0, 0] <= x <= box[1, 0] and box[0, 1] <= y <= box[1, 1] and box[0, 2] <= z <= box[1, 2]


@inner(allocates=True)
def _found_in(rock: ContactMesh, ground: ContactMesh, pose: Array, reach: float, pairs: Pairs) -> None:
    """Note the pose in which pairs were found, their groups, and the ball in which they may touch."""
    lengths_m, placed, box = pairs.lengths_m, (pose, pairs.turn), _no_box()
    copy(pose, pairs.pose)
    copy(pose, pairs.looked_at)
    lengths_m[REACH], lengths_m[WAY] = reach, 0.0
    for kind in range(3):
        _group(pairs, kind)
        for group in range(pairs.groups.found[kind]):
            index = pairs.first[kind, pairs.groups.begin[kind, group]]
            note(pairs, kind, group, ends_of((rock, ground), kind, index, placed))
    _surround(box, (rock, ground), pose, pairs)
    lengths_m[RADIUS] = _ball_around(box, placed, pairs.middle_m[0], pairs.middle_m[1])


@inner
def _group(pairs: Pairs, kind: int) -> None:
    """Note where the pairs of each first feature begin."""
    groups, first, count = pairs.groups, pairs.first[kind], 0
    for k in range(pairs.found[kind]):
        if k == 0 or first[k] != first[k - 1]:
            groups.begin[kind, count] = k
            count += 1
    groups.begin[kind, count] = pairs.found[kind]
    groups.found[kind] = count


@inner
def _surround(box: Array, bodies: Any, pose: Array, pairs: Pairs) -> None:
    """Widen a box, in body axes, around all places at which the pairs may touch while they serve.

    Such a place is a point, or lies on the shorter of two edges; points and edges of the ground move on the rock by
    the reach at most.
    """
    (rock, ground), slack, groups = bodies, pairs.lengths_m[REACH], pairs.groups
    for group in range(groups.found[0]):
        _widen(box, rock.vertices_m[rock.points[pairs.first[0, groups.begin[0, group]]]], 0.0)
    for group in range(groups.found[1]):
        _widen(box, groups.seen_m[1, group], slack)
    for k in range(pairs.found[2]):
        i, j = pairs.first[2, k], pairs.second[2, k]
        for end in range(2):
            if rock.edge_halves_m[i] <= ground.edge_halves_m[j]:
                _widen(box, rock.vertices_m[rock.edges[i, end]], 0.0)
            else:
                there = minus(ground.vertices_m[ground.edges[j, end]], pose)
                _widen(box, turned_back(pairs.turn, there), slack)


@inner
def _ball_around(box: Array, placed: Any, middle_m: Array, place_m: Array) -> float:
    """Set the middle of a ball around a box in body axes, and its place in a pose with its rotation; its radius."""
    squared, (pose, turn) = 0.0, placed
    for k in range(3):
        middle_m[k] = 0.5 * (box[0, k] + box[1, k]) if box[0, k] <= box[1, k] else 0.0
        squared += max(0.5 * (box[1, k] - box[0, k]), 0.0) ** 2
    place_m[0], place_m[1], place_m[2] = plus(pose, 1.0, turned(turn, middle_m))
    return math.sqrt(squared)
