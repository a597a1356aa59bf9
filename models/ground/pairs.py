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


RADIUS, REACH, WAY = range(3)
"""Of `Pairs.lengths_m`."""


class PointRoom(NamedTuple):
    """Where the contacts of one point are put together."""

    found: Array  # (contacts, 7): normal, gap, place
    ids: Indices  # of edges and vertices that are nearest to it
    hits: Indices  # by so many of their triangles
    spots: Array
    sums: Array  # of these triangles' normals
    inside: Array  # least distance over them


class Pairs(NamedTuple):
    """Features that may touch before the rock has moved by a slack; the first `found` of each kind."""

    found: Indices  # (3,)
    rock_point: Indices  # rock's point, ground's triangle
    ground_triangle: Indices
    ground_point: Indices
    rock_triangle: Indices
    rock_edge: Indices
    ground_edge: Indices
    apart_m: Array  # (3, room): of each pair, by kind, the way that the rock goes before it can touch
    pose: Array  # (7,) in which they were found; the first NaN if never
    looked_at: Array  # (7,): the latest pose that was looked at
    lengths_m: (
        Array  # from the centre of mass to the farthest vertex; the reach in which they were found; way since
    )
    turn: Array  # (3, 3): rotation of the pose that is looked at
    point: PointRoom


def no_pairs(room: int) -> Pairs:
    """Room for so many of each kind."""
    some, features = [np.zeros(room, np.int64) for _ in range(6)], FEATURES_AT_A_POINT
    return Pairs(
        np.zeros(3, np.int64), some[0], some[1], some[2], some[3], some[4], some[5],
        np.zeros((3, room)), np.full(7, np.nan), np.zeros(7), np.zeros(3), np.zeros((3, 3)),
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
def _cell(mesh: ContactMesh, p: Any) -> int:
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
        cell = _cell(mesh, q)
        if cell < 0:
            continue
        for place in range(mesh.first[cell], mesh.first[cell + 1]):
            t = mesh.near[place]
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
    of: tuple[Array, Indices], rock: ContactMesh, ground: ContactMesh, reach: float, pairs: Pairs
) -> int:
    """Pairs of edges within a reach, of the rock's vertices as they are placed, and a mark on each edge of ground."""
    count, (placed, seen) = 0, of
    for i in range(len(rock.edges)):
        a, b = placed[rock.edges[i, 0]], placed[rock.edges[i, 1]]
        way = minus(b, a)
        length = math.sqrt(dot(way, way))
        parts = int(length / ground.cell_m) + 1
        for part in range(parts):
            cell = _cell(ground, plus(a, (part + 0.5) / parts, way))
            if cell < 0:
                continue
            for place in range(ground.first_edge[cell], ground.first_edge[cell + 1]):
                j = ground.near_edges[place]
                if seen[j] == i or count >= len(pairs.rock_edge):
                    continue
                seen[j] = i
                c, d = ground.vertices_m[ground.edges[j, 0]], ground.vertices_m[ground.edges[j, 1]]
                _, _, far = between(a, way, c, minus(d, c))
                if far < reach * reach:
                    pairs.rock_edge[count], pairs.ground_edge[count] = i, j
                    pairs.apart_m[2, count] = math.sqrt(far)
                    count += 1
    return count


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
    near_ground = (pairs.rock_point, pairs.ground_triangle, pairs.apart_m[0])
    near_rock = (pairs.ground_point, pairs.rock_triangle, pairs.apart_m[1])
    pairs.found[0] = _list_points(placed[rock.points], ground, reach, near_ground)
    pairs.found[1] = _list_points(theirs, rock, reach, near_rock)
    pairs.found[2] = _list_edges((placed, seen), rock, ground, reach, pairs)
    copy(pose, pairs.pose)
    copy(pose, pairs.looked_at)
    pairs.lengths_m[RADIUS], pairs.lengths_m[REACH], pairs.lengths_m[WAY] = math.sqrt(farthest), reach, 0.0


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
