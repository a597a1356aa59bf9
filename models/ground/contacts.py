"""Contacts of a rock with ground in a pose: point on face, edge or vertex, face on point, edge across edge.

A point above several faces has a contact with each of them (a foot held between two facets); beside a convex edge or
vertex it has one, along the shortest way (Ericson 2005, section 5.1.5, for the nearest point of a triangle).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from toppling.models.compiled import Array, Vector, compiled, inner
from toppling.models.ground.mesh import ContactMesh
from toppling.models.ground.pairs import (
    FEATURES_AT_A_POINT,
    WAY,
    Pairs,
    PointRoom,
    between,
    least_m,
    look_again,
    nearest,
    refresh,
)
from toppling.models.ground.vectors import cross, dot, minus, plus, rotation_of, turned, turned_back

MOST = 512
"""Contacts that are looked at in one pose; of more, those with the least gaps."""

_SAME_NORMAL = 1e-7
"""Faces under one point whose normals' product misses 1 by less are one."""

LEANING = 0.1
"""Sine by which an edge beside a point that touches a face may dip below it: the edge's other end then touches too."""

_ASIDE = 0.01
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


@inner
def add(out: Any, count: int, key: int, gap: float, normal: Any, place: Any, pose: Array) -> int:
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


@inner
def _meet(p: Any, near: Any, mesh: ContactMesh, margin: float, vertices: bool, room: PointRoom) -> int:
    """Contacts of one point with triangles, into the rows of `room.found`; how many.

    Near are the triangles, the way that the rock goes before each can touch, noted anew, and the way since.
    """
    (triangles, apart_m, way_m), features, count = near, 0, 0
    for place in range(len(triangles)):
        if apart_m[place] >= margin + way_m:
            continue
        t = triangles[place]
        f, n = mesh.faces[t], mesh.normals[t]
        a = mesh.vertices_m[f[0]]
        code, c = nearest(p, a, mesh.vertices_m[f[1]], mesh.vertices_m[f[2]])
        way = minus(p, c)
        depth = dot(n, way)
        apart_m[place] = way_m + math.sqrt(dot(way, way))
        if code == 0:
            if -margin < depth < margin:
                count = _keep_face(room.found, count, n, depth, c)
            continue
        if dot(way, way) >= margin * margin or (code <= 3 and not vertices):
            continue
        name = -1 - f[code - 1] if code <= 3 else mesh.edge_of[t, code - 4]
        features = _keep_feature(room, features, name, n, depth, c)
    for k in range(features):
        name = room.ids[k]
        shared = mesh.triangles_at_vertex[-1 - name] if name < 0 else mesh.triangles_at_edge[name]
        if room.hits[k] != shared or count == len(room.found):
            continue
        way, total = minus(p, room.spots[k]), room.sums[k]
        far, size = math.sqrt(dot(way, way)), math.sqrt(dot(total, total))
        outside = room.inside[k] > 0.0 and far > 1e-9 * mesh.grid.cell_m
        for i in range(3):
            room.found[count, i] = way[i] / far if outside else total[i] / size
            room.found[count, 4 + i] = room.spots[k, i]
        room.found[count, 3] = far if outside else dot(way, total) / size
        count += 1
    return count


@inner
def _keep_feature(room: PointRoom, features: int, name: int, n: Any, depth: float, c: Any) -> int:
    """Note an edge or a vertex that is nearest to a point, or one more of its triangles; how many there are."""
    k = 0
    while k < features and room.ids[k] != name:
        k += 1
    if k == features:
        if features == FEATURES_AT_A_POINT:
            return features
        features += 1
        room.ids[k], room.hits[k], room.inside[k] = name, 0, np.inf
        for i in range(3):
            room.spots[k, i], room.sums[k, i] = c[i], 0.0
    room.hits[k] += 1
    room.inside[k] = min(room.inside[k], depth)
    for i in range(3):
        room.sums[k, i] += n[i]
    return features


@inner
def _keep_face(found: Any, count: int, n: Any, depth: float, c: Any) -> int:
    """Note a face under a point unless it is one that is known, or lies behind one that is less deep."""
    for k in range(count):
        if dot(found[k], n) > 1.0 - _SAME_NORMAL:
            return count
        if depth < 0.0 and found[k, 3] < 0.0:
            # Behind a ridge only one of its two faces is the way out: the nearer.
            apart = minus(c, (found[k, 4], found[k, 5], found[k, 6]))
            if dot(found[k], apart) < 0.0:
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
        if dot(normal, mesh.ways[place]) < -leaning:
            return False
    return True


@inner
def _near_a_plane(p: Any, mesh: ContactMesh, near_it: Any, margin_m: float) -> bool:
    """Whether a point is as near to one of some triangles' planes as a contact must be; notes the way to each.

    Near are the triangles, the way that the rock goes before each can touch, and the way since.
    """
    (triangles, apart_m, way_m), near = near_it, False
    for place in range(len(triangles)):
        if apart_m[place] >= margin_m + way_m:
            continue
        t = triangles[place]
        off = abs(dot(mesh.normals[t], p) - mesh.offsets_m[t])
        near = near or off <= 1.001 * margin_m
        apart_m[place] = max(apart_m[place], way_m + off)
    return near


@inner
def _may_touch(pairs: Pairs, kind: int, group: int, p: Vector, margin_m: float) -> bool:
    """Whether a group's point has come near since it was last looked at; if not, the way left to it is noted."""
    seen_m, way_m = pairs.groups.seen_m[kind, group], pairs.lengths_m[WAY]
    moved = minus(p, seen_m)
    left_m = seen_m[3] - math.sqrt(dot(moved, moved))
    if left_m < margin_m:
        return True
    pairs.groups.apart_m[kind, group] = way_m + left_m
    return False


@inner
def _note(pairs: Pairs, kind: int, group: int, p: Vector, near_it: Any) -> None:
    """Note where a group's point was looked at, and how far that is from what it may touch."""
    apart_m, seen_m = least_m(near_it[1]), pairs.groups.seen_m[kind, group]
    pairs.groups.apart_m[kind, group] = apart_m
    seen_m[0], seen_m[1], seen_m[2], seen_m[3] = p[0], p[1], p[2], apart_m - near_it[2]


@inner
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
    turn, room, count = pairs.turn, pairs.point, 0
    rotation_of(pose, turn)
    way_m = look_again(pairs, pose, margin_m)
    near_m = margin_m + way_m
    groups, found, first, triangles = pairs.groups, room.found, pairs.rock_point, pairs.ground_triangle
    for place in range(groups.near_found[0]):
        group = groups.near[0, place]
        if groups.apart_m[0, group] >= near_m:
            continue
        begin, end = groups.begin[0, group], groups.begin[0, group + 1]
        index, near_it = first[begin], (triangles[begin:end], pairs.apart_m[0, begin:end], way_m)
        p = plus(pose, 1.0, turned(turn, rock.vertices_m[rock.points[index]]))
        if not _may_touch(pairs, 0, group, p, margin_m):
            continue
        if _near_a_plane(p, ground, near_it, margin_m):
            for i in range(_meet(p, near_it, ground, margin_m, True, room)):
                if _leads_out(rock, index, turned_back(turn, found[i]), leaning):
                    count = add(out, count, 8 * index + i, found[i, 3], found[i], p, pose)
        _note(pairs, 0, group, p, near_it)
    first, triangles = pairs.ground_point, pairs.rock_triangle
    for place in range(groups.near_found[1]):
        group = groups.near[1, place]
        if groups.apart_m[1, group] >= near_m:
            continue
        begin, end = groups.begin[1, group], groups.begin[1, group + 1]
        index, near_it = first[begin], (triangles[begin:end], pairs.apart_m[1, begin:end], way_m)
        there = ground.vertices_m[ground.points[index]]
        p = turned_back(turn, minus(there, pose))
        if not _may_touch(pairs, 1, group, p, margin_m):
            continue
        if _near_a_plane(p, rock, near_it, margin_m):
            for i in range(_meet(p, near_it, rock, margin_m, False, room)):
                n = turned(turn, found[i])
                if _leads_out(ground, index, n, LEANING):
                    key = (1 << 60) + 8 * index + i
                    count = add(out, count, key, found[i, 3], (-n[0], -n[1], -n[2]), there, pose)
        _note(pairs, 1, group, p, near_it)
    return _edges_across((rock, ground), pairs, pose, margin_m, out, count)


@inner
def _edges_across(bodies: Any, pairs: Pairs, pose: Array, margin_m: float, out: Any, count: int) -> int:
    """Add the contacts of pairs of edges, of rock and ground, that cross."""
    (rock, ground), turn, way_m, groups = bodies, pairs.turn, pairs.lengths_m[WAY], pairs.groups
    for place in range(groups.near_found[2]):
        group = groups.near[2, place]
        if groups.apart_m[2, group] >= margin_m + way_m:
            continue
        begin, end = groups.begin[2, group], groups.begin[2, group + 1]
        edge = pairs.rock_edge[begin]
        a = plus(pose, 1.0, turned(turn, rock.vertices_m[rock.edges[edge, 0]]))
        b = plus(pose, 1.0, turned(turn, rock.vertices_m[rock.edges[edge, 1]]))
        for k in range(begin, end):
            if pairs.apart_m[2, k] >= margin_m + way_m:
                continue
            placed = edge, a, minus(b, a), pairs.ground_edge[k]
            count, apart_m = _across((rock, ground), placed, (pose, turn), margin_m, out, count)
            pairs.apart_m[2, k] = way_m + apart_m
        groups.apart_m[2, group] = least_m(pairs.apart_m[2, begin:end])
    return count


@inner
def _across(bodies: Any, edges: Any, placed: Any, margin_m: float, out: Any, count: int) -> tuple[int, float]:
    """Add the contact of two edges that cross, if the way between them leads out of both bodies; their distance too.

    Rock and ground; the rock's edge, its start and its way to its end, the ground's edge; the rock's pose and rotation.
    """
    (rock, ground), (i, a, way, j), (pose, turn) = bodies, edges, placed
    c, d = ground.vertices_m[ground.edges[j, 0]], ground.vertices_m[ground.edges[j, 1]]
    other = minus(d, c)
    s, t, far = between(a, way, c, other)
    apart_m = math.sqrt(far)
    if apart_m >= margin_m:
        return count, apart_m
    if not (1e-9 < s < 1.0 - 1e-9 and 1e-9 < t < 1.0 - 1e-9):
        return count, apart_m
    n = cross(way, other)
    size, scale = math.sqrt(dot(n, n)), math.sqrt(dot(way, way) * dot(other, other))
    if size < 1e-4 * scale:
        return count, apart_m
    own0, own1 = turned(turn, rock.inward[i, 0]), turned(turn, rock.inward[i, 1])
    into = minus(plus(ground.inward[j, 0], 1.0, ground.inward[j, 1]), plus(own0, 1.0, own1))
    # Of the two ways that lead out of edges which are nearly flat, the one that leads out of both bodies.
    sign = -1.0 if dot(n, into) > 0.0 else 1.0
    n = (sign * n[0] / size, sign * n[1] / size, sign * n[2] / size)
    out_of_ground = max(dot(n, ground.inward[j, 0]), dot(n, ground.inward[j, 1]))
    out_of_rock = -min(dot(n, own0), dot(n, own1))
    if out_of_ground > _ASIDE or out_of_rock > _ASIDE:
        return count, apart_m
    place = plus(c, t, other)
    gap = dot(n, minus(plus(a, s, way), place))
    if -margin_m < gap < margin_m:
        key = (2 << 60) + i * len(ground.edges) + j
        count = add(out, count, key, gap, n, place, pose)
    return count, apart_m


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
