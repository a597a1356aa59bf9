"""Which features of a rock and its ground may touch soon: points and triangles, edges and edges. Compiled."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from toppling.models.compiled import Array, Indices, inner
from toppling.models.ground.mesh import ContactMesh
from toppling.models.ground.vectors import copy, dot, minus, plus, rotation_of, turned, turned_back

MOST_AT_A_POINT, FEATURES_AT_A_POINT = 8, 24
"""Contacts of one point, and edges and vertices that are nearest to it, at most."""


RADIUS, REACH, WAY, NEAR = range(4)
"""Of `Pairs.lengths_m`."""

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


class Listed(NamedTuple):
    """Pairs of features, of each kind the first `found`."""

    found: Indices  # (3,)
    rock_point: Indices  # rock's point, ground's triangle
    ground_triangle: Indices
    ground_point: Indices
    rock_triangle: Indices
    rock_edge: Indices
    ground_edge: Indices
    # (3, room): of each pair, by kind: the way that the rock goes before it can touch, at least; where it stands
    # among all.
    apart_m: Array
    place: Indices


class Pairs(NamedTuple):
    """Features that may touch before the rock has moved by a slack, and those of them that may touch first."""

    every: Listed
    near: Listed
    pose: Array  # (7,) in which they were found; the first NaN if never
    looked_at: Array  # (7,): the latest pose that was looked at
    # From the centre of mass to the farthest vertex; the reach in which they were found; way since; that before which
    # only those near can touch.
    lengths_m: Array
    turn: Array  # (3, 3): rotation of the pose that is looked at
    point: PointRoom


def no_pairs(room: int) -> Pairs:
    """Room for so many of each kind."""
    features = FEATURES_AT_A_POINT
    return Pairs(
        _none_listed(room), _none_listed(room), np.full(7, np.nan), np.zeros(7), np.zeros(4), np.zeros((3, 3)),
        PointRoom(np.zeros((MOST_AT_A_POINT, 7)), np.zeros(features, np.int64), np.zeros(features, np.int64),
                  np.zeros((features, 3)), np.zeros((features, 3)), np.zeros(features)),
    )  # fmt: skip


def _none_listed(room: int) -> Listed:
    some = [np.zeros(room, np.int64) for _ in range(6)]
    return Listed(
        np.zeros(3, np.int64), some[0], some[1], some[2], some[3], some[4], some[5], np.zeros((3, room)),
        np.zeros((3, room), np.int64),
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
def cell_of(mesh: ContactMesh, p: Any) -> int:
    """Cell of a place; -1 outside of the grid."""
    number = 0
    for k in range(3):
        i = math.floor((p[k] - mesh.origin_m[k]) / mesh.cell_m)
        if i < 0 or i >= mesh.shape[k]:
            return -1
        number = number * mesh.shape[k] + i
    return number


@inner
def _list_points(points: Array, mesh: ContactMesh, reach: float, out: Any) -> int:
    """Pairs of points and triangles of a mesh within a reach, in the mesh's frame."""
    count = 0
    for index in range(len(points)):
        q = points[index]
        cell = cell_of(mesh, q)
        if cell < 0:
            continue
        for place in range(mesh.first[cell], mesh.first[cell + 1]):
            t = mesh.near[place]
            aside, far = minus(q, mesh.middles_m[t]), reach + mesh.radii_m[t]
            if dot(aside, aside) >= far * far or abs(dot(mesh.normals[t], q) - mesh.offsets_m[t]) >= reach:
                continue
            f = mesh.faces[t]
            _, c = nearest(q, mesh.vertices_m[f[0]], mesh.vertices_m[f[1]], mesh.vertices_m[f[2]])
            way = minus(q, c)
            apart = math.sqrt(dot(way, way))
            if apart < reach and count < len(out[0]):
                out[0][count], out[1][count], out[2][count] = index, t, apart
                count += 1
    return count


@inner
def _list_edges(
    of: tuple[Array, Indices], rock: ContactMesh, ground: ContactMesh, reach: float, pairs: Listed
) -> int:
    """Pairs of edges within a reach, of the rock's vertices as they are placed, and a mark on each edge of ground."""
    count, (placed, seen) = 0, of
    for i in range(len(rock.edges)):
        begin = count
        a, b = placed[rock.edges[i, 0]], placed[rock.edges[i, 1]]
        way = minus(b, a)
        length = math.sqrt(dot(way, way))
        parts, middle = int(length / ground.cell_m) + 1, plus(a, 0.5, way)
        for part in range(parts):
            cell = cell_of(ground, plus(a, (part + 0.5) / parts, way))
            if cell < 0:
                continue
            for place in range(ground.first_edge[cell], ground.first_edge[cell + 1]):
                j = ground.near_edges[place]
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
    return count


@inner
def _insert_edge(pairs: Listed, begin: int, count: int, pair: tuple[int, int], apart_m: float) -> None:
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
    placed, farthest = np.empty_like(rock.vertices_m), 0.0
    for i in range(len(placed)):
        vertex = rock.vertices_m[i]
        placed[i, 0], placed[i, 1], placed[i, 2] = plus(pose, 1.0, turned(turn, vertex))
        farthest = max(farthest, dot(vertex, vertex))
    theirs = np.empty((len(ground.points), 3))
    for i in range(len(theirs)):
        there = minus(ground.vertices_m[ground.points[i]], pose)
        theirs[i, 0], theirs[i, 1], theirs[i, 2] = turned_back(turn, there)
    every = pairs.every
    near_ground = (every.rock_point, every.ground_triangle, every.apart_m[0])
    near_rock = (every.ground_point, every.rock_triangle, every.apart_m[1])
    while True:
        every.found[0] = _list_points(placed[rock.points], ground, reach, near_ground)
        every.found[1] = _list_points(theirs, rock, reach, near_rock)
        seen[:] = -1
        every.found[2] = _list_edges((placed, seen), rock, ground, reach, every)
        if every.found.max() < len(every.rock_point) or reach < 1e-6 * math.sqrt(farthest):
            break
        reach *= 0.5  # of pairs that do not fit, none may be left out that can touch soon
    copy(pose, pairs.pose)
    copy(pose, pairs.looked_at)
    pairs.near.found[:] = 0
    lengths_m = pairs.lengths_m
    lengths_m[RADIUS], lengths_m[REACH] = math.sqrt(farthest), reach
    lengths_m[WAY] = lengths_m[NEAR] = 0.0


@inner
def look_again(pairs: Pairs, pose: Array, margin_m: float) -> float:
    """Note the way to a pose, and list the pairs anew that can touch within a margin of it; the way since all were."""
    lengths_m = pairs.lengths_m
    lengths_m[WAY] += moved_m(pairs.looked_at, pose, lengths_m[RADIUS])
    copy(pose, pairs.looked_at)
    way_m, near_m = lengths_m[WAY], lengths_m[NEAR]
    if near_m < margin_m + way_m or near_m > _MOST_NEAR_MARGINS * margin_m + way_m:
        near_m = _NEAR_MARGINS * margin_m + way_m
        e, n = pairs.every, pairs.near
        _list_near(0, near_m, (e, e.rock_point, e.ground_triangle), (n, n.rock_point, n.ground_triangle))
        _list_near(1, near_m, (e, e.ground_point, e.rock_triangle), (n, n.ground_point, n.rock_triangle))
        _list_near(2, near_m, (e, e.rock_edge, e.ground_edge), (n, n.rock_edge, n.ground_edge))
        lengths_m[NEAR] = near_m
    return way_m


@inner
def _list_near(kind: int, near_m: float, of: Any, to: Any) -> None:
    """Copy the pairs of a kind that touch before some way is gone; what is known of those listed before is kept.

    of, to: a list, and its two features of that kind.
    """
    (every, one, other), (near, near_one, near_other) = of, to
    apart_m, place, count = every.apart_m[kind], near.place[kind], 0
    for k in range(near.found[kind]):
        apart_m[place[k]] = near.apart_m[kind, k]
    for k in range(every.found[kind]):
        if apart_m[k] < near_m:
            near_one[count], near_other[count], place[count] = one[k], other[k], k
            near.apart_m[kind, count] = apart_m[k]
            count += 1
    near.found[kind] = count


@inner
def group_end(first: Indices, apart_m: Array, begin: int, found: int, near_m: float) -> tuple[int, bool]:
    """End of the pairs of the point whose first pair is given, and whether one of them is nearer than that."""
    k, near = begin, False
    while k < found and first[k] == first[begin]:
        near = near or apart_m[k] < near_m
        k += 1
    return k, near


@inner
def moved_m(start: Array, end: Array, radius_m: float) -> float:
    """Way of the point that moved most of those within a radius of the centre of mass, at most."""
    cosine = abs(start[3] * end[3] + start[4] * end[4] + start[5] * end[5] + start[6] * end[6])
    sine = math.sqrt(max(1.0 - cosine * cosine, 0.0))
    way = minus(end, start)
    return math.sqrt(dot(way, way)) + 2.0 * sine * radius_m
