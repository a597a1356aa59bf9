"""Which features of a rock and its ground may touch soon: points and triangles, edges and edges. Compiled."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from toppling.models.compiled import Array, Indices, inner
from toppling.models.ground.grid import cell_of
from toppling.models.ground.mesh import ContactMesh
from toppling.models.ground.vectors import copy, dot, minus, plus, rotation_of, turned, turned_back

MOST_AT_A_POINT, FEATURES_AT_A_POINT = 8, 24
"""Contacts of one point, and edges and vertices that are nearest to it, at most."""


RADIUS, REACH, WAY, NEAR, WIDE_RADIUS, EMPTY = range(6)
"""Of `Pairs.lengths_m`."""

_EXACT = 0.4
"""Of the reach: the distance of a point that may be nearer to a triangle is computed, that of others bounded."""

_PARTS = 4
"""Of a cell: an edge is looked up in as long parts, by the middle of each."""

_NEAR_MARGINS, _MOST_NEAR_MARGINS = 4.0, 12.0
"""Beyond the way since, a new list reaches so many margins; one that reaches more is longer than the steps need."""


class PointRoom(NamedTuple):
    """Where the contacts of one point are put together."""

    found: Array  # (contacts, 7): normal, gap, place
    ids: Indices  # of edges and vertices that are nearest to it
    hits: Indices  # by so many of their triangles
    spots: Array
    sums: Array  # of these triangles' normals
    inside: Array  # least distance over them


class Groups(NamedTuple):
    """The pairs of each kind, by their first feature, and those groups that may touch first; the first `found`."""

    found: Indices  # (3,)
    begin: Indices  # (3, room + 1): first pair of each, and the end of the last
    apart_m: Array  # (3, room): way that the rock goes before one of its pairs can touch, at least
    near_found: Indices  # (3,)
    near: Indices  # (3, room): numbers of those that may touch first
    # (2, room, 4): place, in the other body's axes, of the point of a group as it was last looked at, and how far that
    # is from what it may touch, at least.
    seen_m: Array


class Pairs(NamedTuple):
    """Features that may touch before the rock has moved by a slack; of each kind the first `found` pairs."""

    found: Indices  # (3,)
    rock_point: Indices  # rock's point, ground's triangle
    ground_triangle: Indices
    ground_point: Indices
    rock_triangle: Indices
    rock_edge: Indices
    ground_edge: Indices
    # (3, room): of each pair, by kind: the way that the rock goes before it can touch, at least.
    apart_m: Array
    groups: Groups
    pose: Array  # (7,) in which they were found; the first NaN if never
    looked_at: Array  # (7,): the latest pose that was looked at
    # (4, 3): middle of a ball around all places at which they may touch, in body axes and at the latest look; of one
    # around all features that lie in occupied cells of the other body, in body axes and when they were found.
    middle_m: Array
    # Radius of the first ball; the reach in which they were found; way of that ball since; that before which only those
    # near can touch; radius of the second ball; least distance of a feature outside of it when they were found.
    lengths_m: Array
    turn: Array  # (3, 3): rotation of the pose that is looked at
    point: PointRoom


def no_pairs(room: int) -> Pairs:
    """Room for so many of each kind."""
    features, one = FEATURES_AT_A_POINT, np.zeros((6, room), np.int64)
    return Pairs(
        np.zeros(3, np.int64), one[0], one[1], one[2], one[3], one[4], one[5], np.zeros((3, room)),
        Groups(np.zeros(3, np.int64), np.zeros((3, room + 1), np.int64), np.zeros((3, room)), np.zeros(3, np.int64),
               np.zeros((3, room), np.int64), np.zeros((2, room, 4))),
        np.full(7, np.nan), np.zeros(7), np.zeros((4, 3)), np.zeros(6), np.zeros((3, 3)),
        PointRoom(np.zeros((MOST_AT_A_POINT, 7)), np.zeros(features, np.int64), np.zeros(features, np.int64),
                  np.zeros((features, 3)), np.zeros((features, 3)), np.zeros(features)),
    )  # fmt: skip


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
def _list_points(points: Array, mesh: ContactMesh, reach: float, out: Any, wide: Any) -> int:
    """Pairs of points and triangles of a mesh within a reach, in the mesh's frame.

    wide: a box widened around what lies in any triangle's cells; the points in its axes; how far they go in these.
    """
    count, (box, places, slack) = 0, wide
    for index in range(len(points)):
        q = points[index]
        grid, cell = mesh.grid, cell_of(mesh.grid, q)
        if cell < 0 or grid.first[cell] == grid.first[cell + 1]:
            continue
        _widen(box, places[index], slack)
        if reach <= mesh.fine.reach_m and cell_of(mesh.fine, q) >= 0:
            grid, cell = mesh.fine, cell_of(mesh.fine, q)
        for place in range(grid.first[cell], grid.first[cell + 1]):
            t = grid.near[place]
            aside, far = minus(q, mesh.middles_m[t]), reach + mesh.radii_m[t]
            off, squared = abs(dot(mesh.normals[t], q) - mesh.offsets_m[t]), dot(aside, aside)
            if squared >= far * far or off >= reach:
                continue
            apart = max(off, math.sqrt(squared) - mesh.radii_m[t])
            if apart < _EXACT * reach:
                f = mesh.faces[t]
                _, c = nearest(q, mesh.vertices_m[f[0]], mesh.vertices_m[f[1]], mesh.vertices_m[f[2]])
                way = minus(q, c)
                apart = math.sqrt(dot(way, way))
            if apart < reach and count < len(out[0]):
                out[0][count], out[1][count], out[2][count] = index, t, apart
                count += 1
    return count


@inner
def _list_edges(of: Any, rock: ContactMesh, ground: ContactMesh, reach: float, pairs: Pairs) -> int:
    """Pairs of edges within a reach.

    of: the rock's vertices as they are placed; a mark on each edge of the ground; a box widened around edges that lie
    in the cells of any.
    """
    count, (placed, seen, box) = 0, of
    for i in range(len(rock.edges)):
        begin = count
        a, b = placed[rock.edges[i, 0]], placed[rock.edges[i, 1]]
        way = minus(b, a)
        length = math.sqrt(dot(way, way))
        parts, middle, wide = int(_PARTS * length / ground.grid.cell_m) + 1, plus(a, 0.5, way), False
        for part in range(parts):
            at = plus(a, (part + 0.5) / parts, way)
            grid, cell = ground.grid, cell_of(ground.grid, at)
            if cell < 0 or grid.first_edge[cell] == grid.first_edge[cell + 1]:
                continue
            wide = True
            if reach + 0.5 * length / parts <= ground.fine.reach_m and cell_of(ground.fine, at) >= 0:
                grid, cell = ground.fine, cell_of(ground.fine, at)
            for place in range(grid.first_edge[cell], grid.first_edge[cell + 1]):
                j = grid.near_edges[place]
                aside = minus(middle, ground.edge_middles_m[j])
                within = 0.5 * length + ground.edge_halves_m[j] + reach
                if dot(aside, aside) >= within * within or seen[j] == i or count >= len(pairs.rock_edge):
                    continue
                seen[j] = i
                c, d = ground.vertices_m[ground.edges[j, 0]], ground.vertices_m[ground.edges[j, 1]]
                if _boxes_apart(a, b, c, d, reach):
                    continue
                _, _, squared = between(a, way, c, minus(d, c))
                if squared < reach * reach:
                    _insert_edge(pairs, begin, count, (i, j), math.sqrt(squared))
                    count += 1
        if wide:
            _widen(box, rock.vertices_m[rock.edges[i, 0]], 0.0)
            _widen(box, rock.vertices_m[rock.edges[i, 1]], 0.0)
    return count


@inner
def _insert_edge(pairs: Pairs, begin: int, count: int, pair: tuple[int, int], apart_m: float) -> None:
    """Put a pair where it belongs among those of the same edge of the rock: their order depends on no pose."""
    k, (i, j) = count, pair
    while k > begin and pairs.ground_edge[k - 1] > j:
        pairs.ground_edge[k], pairs.apart_m[2, k] = pairs.ground_edge[k - 1], pairs.apart_m[2, k - 1]
        k -= 1
    pairs.rock_edge[count], pairs.ground_edge[k], pairs.apart_m[2, k] = i, j, apart_m


@inner
def _boxes_apart(a: Any, b: Any, c: Any, d: Any, reach: float) -> bool:
    """Whether the boxes around two segments are farther from each other than a reach, along one of the axes."""
    for k in range(3):
        if min(a[k], b[k]) - max(c[k], d[k]) >= reach or min(c[k], d[k]) - max(a[k], b[k]) >= reach:
            return True
    return False


@inner
def between(a: Any, way: Any, c: Any, other: Any) -> tuple[float, float, float]:
    """Shares of two segments where they are nearest, and their squared distance there."""
    from_c = minus(a, c)
    aa, bb, ab = dot(way, way), dot(other, other), dot(way, other)
    af, bf = dot(way, from_c), dot(other, from_c)
    det = aa * bb - ab * ab
    s = (ab * bf - af * bb) / det if det > 1e-12 * aa * bb else 0.5
    s = min(max(s, 0.0), 1.0)
    t = (ab * s + bf) / bb
    if t < 0.0 or t > 1.0:
        t = min(max(t, 0.0), 1.0)
        s = min(max((ab * t - af) / aa, 0.0), 1.0)
    gap = minus(plus(a, s, way), plus(c, t, other))
    return s, t, dot(gap, gap)


@inner(allocates=True)
def refresh(rock: ContactMesh, ground: ContactMesh, pose: Array, reach: float, pairs: Pairs) -> None:
    """Find the features that are within a reach of each other."""
    turn, seen = pairs.turn, np.full(len(ground.edges), -1)
    rotation_of(pose, turn)
    placed, ours = np.empty_like(rock.vertices_m), rock.vertices_m[rock.points]
    for i in range(len(placed)):
        placed[i, 0], placed[i, 1], placed[i, 2] = plus(pose, 1.0, turned(turn, rock.vertices_m[i]))
    theirs = np.empty((len(ground.points), 3))
    for i in range(len(theirs)):
        there = minus(ground.vertices_m[ground.points[i]], pose)
        theirs[i, 0], theirs[i, 1], theirs[i, 2] = turned_back(turn, there)
    found, box, near, lengths_m = pairs.found, _no_box(), _no_box(), pairs.lengths_m
    near_ground = (pairs.rock_point, pairs.ground_triangle, pairs.apart_m[0])
    near_rock = (pairs.ground_point, pairs.rock_triangle, pairs.apart_m[1])
    while True:
        found[0] = _list_points(placed[rock.points], ground, reach, near_ground, (box, ours, 0.0))
        found[1] = _list_points(theirs, rock, reach, near_rock, (box, theirs, reach))
        seen[:] = -1
        found[2] = _list_edges((placed, seen, box), rock, ground, reach, pairs)
        if found.max() < len(pairs.rock_point) or reach < 1e-5 * ground.grid.cell_m:
            break
        reach *= 0.5  # of pairs that do not fit, none may be left out that can touch soon
    _group(pairs, 0, pairs.rock_point)
    _group(pairs, 1, pairs.ground_point)
    _group(pairs, 2, pairs.rock_edge)
    copy(pose, pairs.pose)
    copy(pose, pairs.looked_at)
    lengths_m[REACH], lengths_m[WAY], lengths_m[NEAR] = reach, 0.0, 0.0
    _surround(near, (rock, ground), pose, pairs, theirs)  # by the reach
    lengths_m[EMPTY] = min(rock.grid.reach_m, ground.grid.reach_m - 0.5 * ground.grid.cell_m / _PARTS)
    lengths_m[RADIUS] = _ball_around(near, (pose, turn), pairs.middle_m[0], pairs.middle_m[1])
    lengths_m[WIDE_RADIUS] = _ball_around(box, (pose, turn), pairs.middle_m[2], pairs.middle_m[3])


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
def _surround(box: Array, bodies: Any, pose: Array, pairs: Pairs, theirs: Array) -> None:
    """Widen a box, in body axes, around all places at which the pairs may touch while they serve.

    Rock and ground; the ground's points in body axes. Such a place is a point, or lies on the shorter of two edges;
    points and edges of the ground move on the rock by the reach at most.
    """
    (rock, ground), slack = bodies, pairs.lengths_m[REACH]
    for group in range(pairs.groups.found[0]):
        point = rock.points[pairs.rock_point[pairs.groups.begin[0, group]]]
        _widen(box, rock.vertices_m[point], 0.0)
    for group in range(pairs.groups.found[1]):
        _widen(box, theirs[pairs.ground_point[pairs.groups.begin[1, group]]], slack)
    for k in range(pairs.found[2]):
        i, j = pairs.rock_edge[k], pairs.ground_edge[k]
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


@inner
def serve(pairs: Pairs, pose: Array, margin_m: float, farthest_m: float) -> bool:
    """Whether in a pose nothing else than the pairs that were found can be within a margin."""
    if math.isnan(pairs.pose[0]):
        return False
    lengths_m, turn = pairs.lengths_m, pairs.turn
    if moved_m(pairs.pose, pose, farthest_m) + margin_m >= lengths_m[EMPTY]:
        return False
    rotation_of(pose, turn)
    way = minus(plus(pose, 1.0, turned(turn, pairs.middle_m[2])), pairs.middle_m[3])
    moved = math.sqrt(dot(way, way)) + _turned_m(pairs.pose, pose, lengths_m[WIDE_RADIUS])
    return moved + margin_m < lengths_m[REACH]


@inner
def _group(pairs: Pairs, kind: int, first: Indices) -> None:
    """Note where the pairs of each first feature begin, and how far the nearest of them is."""
    groups, count = pairs.groups, 0
    for k in range(pairs.found[kind]):
        apart_m = pairs.apart_m[kind, k]
        if k == 0 or first[k] != first[k - 1]:
            groups.begin[kind, count], groups.apart_m[kind, count] = k, apart_m
            if kind < 2:
                groups.seen_m[kind, count, 3] = 0.0
            count += 1
        else:
            groups.apart_m[kind, count - 1] = min(groups.apart_m[kind, count - 1], apart_m)
    groups.begin[kind, count] = pairs.found[kind]
    groups.found[kind], groups.near_found[kind] = count, 0


@inner
def look_again(pairs: Pairs, pose: Array, margin_m: float) -> float:
    """Note the way to a pose, and list anew what can touch within a margin of it; the way since all was.

    The pose is that whose rotation `pairs.turn` has.
    """
    lengths_m, groups = pairs.lengths_m, pairs.groups
    place = plus(pose, 1.0, turned(pairs.turn, pairs.middle_m[0]))
    way = minus(place, pairs.middle_m[1])
    lengths_m[WAY] += math.sqrt(dot(way, way)) + _turned_m(pairs.looked_at, pose, lengths_m[RADIUS])
    pairs.middle_m[1, 0], pairs.middle_m[1, 1], pairs.middle_m[1, 2] = place
    copy(pose, pairs.looked_at)
    way_m, near_m = lengths_m[WAY], lengths_m[NEAR]
    if near_m < margin_m + way_m or near_m > _MOST_NEAR_MARGINS * margin_m + way_m:
        near_m = _NEAR_MARGINS * margin_m + way_m
        for kind in range(3):
            count = 0
            for group in range(groups.found[kind]):
                if groups.apart_m[kind, group] < near_m:
                    groups.near[kind, count] = group
                    count += 1
            groups.near_found[kind] = count
        lengths_m[NEAR] = near_m
    return way_m


@inner
def least_m(apart_m: Array) -> float:
    """The least of some ways."""
    least = np.inf
    for way_m in apart_m:
        least = min(least, way_m)
    return least


@inner
def moved_m(start: Array, end: Array, radius_m: float) -> float:
    """Way of the point that moved most of those within a radius of the centre of mass, at most."""
    way = minus(end, start)
    return math.sqrt(dot(way, way)) + _turned_m(start, end, radius_m)


@inner
def _turned_m(start: Array, end: Array, radius_m: float) -> float:
    """Way of a point at a radius from one that stays, as the attitude changes, at most."""
    cosine = abs(start[3] * end[3] + start[4] * end[4] + start[5] * end[5] + start[6] * end[6])
    return 2.0 * math.sqrt(max(1.0 - cosine * cosine, 0.0)) * radius_m
