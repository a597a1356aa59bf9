"""Contacts of a rock with ground in a pose: point on face, edge or vertex, face on point, edge across edge.

A point above several faces has a contact with each of them (a foot held between two facets); beside a convex edge or
vertex it has one, along the shortest way (Ericson 2005, section 5.1.5, for the nearest point of a triangle).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from toppling.models.compiled import Array, Indices, compiled, inner
from toppling.models.ground.mesh import ContactMesh

MOST = 128
"""Contacts that are looked at in one pose; of more, those with the least gaps."""

FEATURES = 24
"""Edges and vertices that are nearest to one point at most."""

SAME_NORMAL = 1e-7
"""Faces under one point whose normals' product misses 1 by less are one."""

LEANING = 0.1
"""Sine by which an edge beside a point that touches a face may dip below it: the edge's other end then touches too."""

ASIDE = 0.01
"""Sine by which the way between two edges may lead into a body: a line that lies on a face touches it at both ends."""

CONTACT = np.dtype(
    [
        ("key", "i8"),  # of the two features, the same from step to step
        ("gap_m", "f8"),
        ("normal", "f8", 3),  # from the ground to the rock
        ("place_m", "f8", 3),
        ("arm_m", "f8", 3),  # from the centre of mass
        ("impulse", "f8", 3),  # over the rock's mass, m/s
        ("floor_m_s", "f8"),  # least normal velocity
        ("lands", "i8"),
    ]
)


class Pairs(NamedTuple):
    """Features that may touch before the rock has moved by a slack; the first `found` of each kind."""

    found: Indices  # (3,)
    rock_point: Indices  # rock's point, ground's triangle
    ground_triangle: Indices
    ground_point: Indices
    rock_triangle: Indices
    rock_edge: Indices
    ground_edge: Indices
    pose: Array  # (7,) in which they were found; the first NaN if never


def no_pairs(room: int) -> Pairs:
    """Room for so many of each kind."""
    some = [np.zeros(room, np.int64) for _ in range(6)]
    return Pairs(
        np.zeros(3, np.int64), some[0], some[1], some[2], some[3], some[4], some[5], np.full(7, np.nan)
    )


@inner
def rotation_of(pose: Array, turn: Array) -> None:
    """Matrix (3, 3) of the attitude of a pose (7,)."""
    x, y, z, w = pose[3], pose[4], pose[5], pose[6]
    turn[0, 0], turn[0, 1], turn[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)
    turn[1, 0], turn[1, 1], turn[1, 2] = 2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)
    turn[2, 0], turn[2, 1], turn[2, 2] = 2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)


@inner
def _dot(a: Any, b: Any) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inner
def _minus(a: Any, b: Any) -> tuple[float, float, float]:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inner
def _plus(a: Any, share: float, b: Any) -> tuple[float, float, float]:
    return a[0] + share * b[0], a[1] + share * b[1], a[2] + share * b[2]


@inner
def _cross(a: Any, b: Any) -> tuple[float, float, float]:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inner
def _turned(turn: Array, a: Any) -> tuple[float, float, float]:
    return _dot(turn[0], a), _dot(turn[1], a), _dot(turn[2], a)


@inner
def _turned_back(turn: Array, a: Any) -> tuple[float, float, float]:
    return (
        turn[0, 0] * a[0] + turn[1, 0] * a[1] + turn[2, 0] * a[2],
        turn[0, 1] * a[0] + turn[1, 1] * a[1] + turn[2, 1] * a[2],
        turn[0, 2] * a[0] + turn[1, 2] * a[1] + turn[2, 2] * a[2],
    )


@inner
def _nearest(p: Any, a: Any, b: Any, c: Any) -> tuple[int, tuple[float, float, float]]:
    """Where a triangle is nearest to a point: 0 its face, 1 to 3 a corner, 4 to 6 the edge from corner 1 to 3 on."""
    ab, ac, ap = _minus(b, a), _minus(c, a), _minus(p, a)
    d1, d2 = _dot(ab, ap), _dot(ac, ap)
    if d1 <= 0.0 and d2 <= 0.0:
        return 1, (a[0], a[1], a[2])
    bp = _minus(p, b)
    d3, d4 = _dot(ab, bp), _dot(ac, bp)
    if d3 >= 0.0 and d4 <= d3:
        return 2, (b[0], b[1], b[2])
    cp = _minus(p, c)
    d5, d6 = _dot(ab, cp), _dot(ac, cp)
    if d6 >= 0.0 and d5 <= d6:
        return 3, (c[0], c[1], c[2])
    vc = d1 * d4 - d3 * d2
    va = d3 * d6 - d5 * d4
    vb = d5 * d2 - d1 * d6
    least = -1e-9 * (va + vb + vc)
    if vc < least and d1 >= 0.0 and d3 <= 0.0:
        return 4, _plus(a, d1 / (d1 - d3), ab)
    if va < least and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        share = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        return 5, _plus(b, share, _minus(c, b))
    if vb < least and d2 >= 0.0 and d6 <= 0.0:
        return 6, _plus(a, d2 / (d2 - d6), ac)
    whole = 1.0 / (va + vb + vc)
    return 0, _plus(_plus(a, vb * whole, ab), vc * whole, ac)


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
def _list_points(
    points: Array, origin: Any, turn: Array, back: bool, mesh: ContactMesh, reach: float, out: Any, count: int
) -> int:
    """Pairs of points and triangles of a mesh within a reach; points of a body in a pose, or in its frame."""
    for index in range(len(points)):
        p = points[index]
        q = _turned_back(turn, _minus(p, origin)) if back else _plus(origin, 1.0, _turned(turn, p))
        cell = _cell(mesh, q)
        if cell < 0:
            continue
        for place in range(mesh.first[cell], mesh.first[cell + 1]):
            t = mesh.near[place]
            f = mesh.faces[t]
            _, c = _nearest(q, mesh.vertices_m[f[0]], mesh.vertices_m[f[1]], mesh.vertices_m[f[2]])
            way = _minus(q, c)
            if _dot(way, way) < reach * reach and count < len(out[0]):
                out[0][count], out[1][count] = index, t
                count += 1
    return count


@inner
def _list_edges(
    rock: ContactMesh, ground: ContactMesh, pose: Array, turn: Array, reach: float, pairs: Pairs
) -> int:
    count = 0
    for i in range(len(rock.edges)):
        a = _plus(pose, 1.0, _turned(turn, rock.vertices_m[rock.edges[i, 0]]))
        b = _plus(pose, 1.0, _turned(turn, rock.vertices_m[rock.edges[i, 1]]))
        way = _minus(b, a)
        length = math.sqrt(_dot(way, way))
        parts = int(length / ground.cell_m) + 1
        begin = count
        for part in range(parts):
            cell = _cell(ground, _plus(a, (part + 0.5) / parts, way))
            if cell < 0:
                continue
            for place in range(ground.first_edge[cell], ground.first_edge[cell + 1]):
                j = ground.near_edges[place]
                known = False
                for k in range(begin, count):
                    known = known or pairs.ground_edge[k] == j
                if known or count >= len(pairs.rock_edge):
                    continue
                c, d = ground.vertices_m[ground.edges[j, 0]], ground.vertices_m[ground.edges[j, 1]]
                _, _, far = _between(a, way, c, _minus(d, c))
                if far < reach * reach:
                    pairs.rock_edge[count], pairs.ground_edge[count] = i, j
                    count += 1
    return count


@inner
def _between(a: Any, way: Any, c: Any, other: Any) -> tuple[float, float, float]:
    """Shares of two segments where they are nearest, and their squared distance there."""
    from_c = _minus(a, c)
    aa, bb, ab = _dot(way, way), _dot(other, other), _dot(way, other)
    af, bf = _dot(way, from_c), _dot(other, from_c)
    det = aa * bb - ab * ab
    s = (ab * bf - af * bb) / det if det > 1e-12 * aa * bb else 0.5
    s = min(max(s, 0.0), 1.0)
    t = (ab * s + bf) / bb
    if t < 0.0 or t > 1.0:
        t = min(max(t, 0.0), 1.0)
        s = min(max((ab * t - af) / aa, 0.0), 1.0)
    gap = _minus(_plus(a, s, way), _plus(c, t, other))
    return s, t, _dot(gap, gap)


@inner(allocates=True)
def refresh(rock: ContactMesh, ground: ContactMesh, pose: Array, reach: float, pairs: Pairs) -> None:
    """Find the features that are within a reach of each other."""
    turn = np.empty((3, 3))
    rotation_of(pose, turn)
    mine = rock.vertices_m[rock.points]
    theirs = ground.vertices_m[ground.points]
    pairs.found[0] = _list_points(
        mine, pose, turn, False, ground, reach, (pairs.rock_point, pairs.ground_triangle), 0
    )
    pairs.found[1] = _list_points(
        theirs, pose, turn, True, rock, reach, (pairs.ground_point, pairs.rock_triangle), 0
    )
    pairs.found[2] = _list_edges(rock, ground, pose, turn, reach, pairs)
    pairs.pose[:] = pose


@inner
def moved_m(start: Array, end: Array, radius_m: float) -> float:
    """Way of the point that moved most of those within a radius of the centre of mass, at most."""
    cosine = abs(start[3] * end[3] + start[4] * end[4] + start[5] * end[5] + start[6] * end[6])
    sine = math.sqrt(max(1.0 - cosine * cosine, 0.0))
    way = _minus(end, start)
    return math.sqrt(_dot(way, way)) + 2.0 * sine * radius_m


@inner
def _add(out: Any, count: int, key: int, gap: float, normal: Any, place: Any, pose: Array) -> int:
    """Note a contact; of too many the one with the largest gap goes."""
    where = count
    if count == len(out):
        where = 0
        for k in range(1, count):
            if out[k].gap_m > out[where].gap_m:
                where = k
        if out[where].gap_m <= gap:
            return count
        count -= 1
    one = out[where]
    one.key, one.gap_m, one.lands = key, gap, 0
    for k in range(3):
        one.normal[k], one.place_m[k], one.arm_m[k] = normal[k], place[k], place[k] - pose[k]
        one.impulse[k] = 0.0
    one.floor_m_s = 0.0
    return count + 1


@inner(allocates=True)
def _meet(
    p: Any,
    triangles: Indices,
    begin: int,
    end: int,
    mesh: ContactMesh,
    margin: float,
    vertices: bool,
    found: Any,
) -> int:
    """Contacts of one point with the triangles near it: rows (normal, gap) of `found`; how many."""
    ids, hits = np.empty(FEATURES, np.int64), np.empty(FEATURES, np.int64)
    spots, sums, inside = np.empty((FEATURES, 3)), np.zeros((FEATURES, 3)), np.zeros(FEATURES)
    features, count = 0, 0
    for place in range(begin, end):
        t = triangles[place]
        f, n = mesh.faces[t], mesh.normals[t]
        a = mesh.vertices_m[f[0]]
        code, c = _nearest(p, a, mesh.vertices_m[f[1]], mesh.vertices_m[f[2]])
        way = _minus(p, c)
        depth = _dot(n, way)
        if code == 0:
            if -margin < depth < margin:
                count = _keep_face(found, count, n, depth, c)
            continue
        if _dot(way, way) >= margin * margin or (code <= 3 and not vertices):
            continue
        name = -1 - f[code - 1] if code <= 3 else mesh.edge_of[t, code - 4]
        k = 0
        while k < features and ids[k] != name:
            k += 1
        if k == features:
            if features == FEATURES:
                continue
            features += 1
            ids[k], hits[k], inside[k] = name, 0, np.inf
            for i in range(3):
                spots[k, i], sums[k, i] = c[i], 0.0
        hits[k] += 1
        inside[k] = min(inside[k], depth)
        for i in range(3):
            sums[k, i] += n[i]
    for k in range(features):
        shared = mesh.triangles_at_vertex[-1 - ids[k]] if ids[k] < 0 else mesh.triangles_at_edge[ids[k]]
        if hits[k] != shared or count == len(found):
            continue
        way = _minus(p, spots[k])
        far, size = math.sqrt(_dot(way, way)), math.sqrt(_dot(sums[k], sums[k]))
        outside = inside[k] > 0.0 and far > 1e-9 * mesh.cell_m
        for i in range(3):
            found[count, i] = way[i] / far if outside else sums[k, i] / size
            found[count, 4 + i] = spots[k, i]
        found[count, 3] = far if outside else _dot(way, sums[k]) / size
        count += 1
    return count


@inner
def _keep_face(found: Any, count: int, n: Any, depth: float, c: Any) -> int:
    """Note a face under a point unless it is one that is known, or lies behind one that is less deep."""
    for k in range(count):
        if _dot(found[k], n) > 1.0 - SAME_NORMAL:
            return count
        if depth < 0.0 and found[k, 3] < 0.0:
            # Behind a ridge only one of its two faces is the way out: the nearer.
            between = _minus(c, (found[k, 4], found[k, 5], found[k, 6]))
            if _dot(found[k], between) < 0.0:
                if depth > found[k, 3]:
                    found[k, 3] = depth
                    for i in range(3):
                        found[k, i], found[k, 4 + i] = n[i], c[i]
                return count
    if count < len(found):
        for i in range(3):
            found[count, i], found[count, 4 + i] = n[i], c[i]
        found[count, 3] = depth
        return count + 1
    return count


@inner
def _leads_out(mesh: ContactMesh, index: int, normal: Any, leaning: float) -> bool:
    """Whether a body lies, beside one of its points, on the side of it to which a normal points."""
    for place in range(mesh.first_way[index], mesh.first_way[index + 1]):
        if _dot(normal, mesh.ways[place]) < -leaning:
            return False
    return True


@inner(allocates=True)
def contacts_in(
    rock: ContactMesh,
    ground: ContactMesh,
    pairs: Pairs,
    pose: Array,
    margin_m: float,
    leaning: float,
    out: Any,
) -> int:
    """Contacts with gaps up to a margin, of the pairs that were found last; how many.

    A point of the rock touches a face only where no edge beside it dips below that face by more than the sine
    `leaning`; 1 keeps those that may touch it once the rock has tilted.
    """
    turn, found, count = np.empty((3, 3)), np.empty((8, 7)), 0
    rotation_of(pose, turn)
    k = 0
    while k < pairs.found[0]:
        index, begin = pairs.rock_point[k], k
        while k < pairs.found[0] and pairs.rock_point[k] == index:
            k += 1
        p = _plus(pose, 1.0, _turned(turn, rock.vertices_m[rock.points[index]]))
        for i in range(_meet(p, pairs.ground_triangle, begin, k, ground, margin_m, True, found)):
            if not _leads_out(rock, index, _turned_back(turn, found[i]), leaning):
                continue
            count = _add(out, count, 8 * index + i, found[i, 3], found[i], p, pose)
    k = 0
    while k < pairs.found[1]:
        index, begin = pairs.ground_point[k], k
        while k < pairs.found[1] and pairs.ground_point[k] == index:
            k += 1
        place = ground.vertices_m[ground.points[index]]
        p = _turned_back(turn, _minus(place, pose))
        for i in range(_meet(p, pairs.rock_triangle, begin, k, rock, margin_m, False, found)):
            n = _turned(turn, found[i])
            if not _leads_out(ground, index, n, LEANING):
                continue
            count = _add(
                out, count, (1 << 60) + 8 * index + i, found[i, 3], (-n[0], -n[1], -n[2]), place, pose
            )
    for k in range(pairs.found[2]):
        i, j = pairs.rock_edge[k], pairs.ground_edge[k]
        a = _plus(pose, 1.0, _turned(turn, rock.vertices_m[rock.edges[i, 0]]))
        b = _plus(pose, 1.0, _turned(turn, rock.vertices_m[rock.edges[i, 1]]))
        c, d = ground.vertices_m[ground.edges[j, 0]], ground.vertices_m[ground.edges[j, 1]]
        count = _across(rock, ground, i, j, a, b, c, d, turn, pose, margin_m, out, count)
    return count


@inner
def _across(
    rock: ContactMesh, ground: ContactMesh, i: int, j: int, a: Any, b: Any, c: Any, d: Any,
    turn: Array, pose: Array, margin_m: float, out: Any, count: int,
) -> int:  # fmt: skip
    """Add the contact of two edges that cross, if the way between them leads out of both bodies."""
    way, other = _minus(b, a), _minus(d, c)
    s, t, _ = _between(a, way, c, other)
    if not (1e-9 < s < 1.0 - 1e-9 and 1e-9 < t < 1.0 - 1e-9):
        return count
    n = _cross(way, other)
    size, scale = math.sqrt(_dot(n, n)), math.sqrt(_dot(way, way) * _dot(other, other))
    if size < 1e-4 * scale:
        return count
    n = (n[0] / size, n[1] / size, n[2] / size)
    own0, own1 = _turned(turn, rock.inward[i, 0]), _turned(turn, rock.inward[i, 1])
    for _ in range(2):
        out_of_ground = max(_dot(n, ground.inward[j, 0]), _dot(n, ground.inward[j, 1]))
        out_of_rock = -min(_dot(n, own0), _dot(n, own1))
        if out_of_ground <= ASIDE and out_of_rock <= ASIDE:
            place = _plus(c, t, other)
            gap = _dot(n, _minus(_plus(a, s, way), place))
            if -margin_m < gap < margin_m:
                key = (2 << 60) + i * len(ground.edges) + j
                return _add(out, count, key, gap, n, place, pose)
            return count
        n = (-n[0], -n[1], -n[2])
    return count


@compiled
def contacts_at(
    rock: ContactMesh,
    ground: ContactMesh,
    pose: Array,
    margin_m: float,
    leaning: float,
    pairs: Pairs,
    out: Any,
) -> int:
    """Contacts with gaps up to a margin in a pose (7,), whatever was found before; how many."""
    refresh(rock, ground, pose, margin_m, pairs)
    return contacts_in(rock, ground, pairs, pose, margin_m, leaning, out)
