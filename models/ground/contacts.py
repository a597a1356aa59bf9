"""Contacts of a rock with ground in a pose: point on face, edge or vertex, face on point, edge across edge."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from toppling.models.compiled import Array, Indices, Vector, inner
from toppling.models.ground.boxes import between, nearest
from toppling.models.ground.mesh import ContactMesh
from toppling.models.ground.pairs import (
    FEATURES_AT_A_POINT,
    Pairs,
    PointRoom,
    ends_of,
    look,
    may_touch,
    note,
)
from toppling.models.ground.rigid import cross, dot, minus, plus, turned, turned_back

MOST = 512
"""Contacts that are looked at in one pose; of more, those with the least gaps."""

_SAME_NORMAL = 1e-7
"""Faces under one point whose normals' product misses 1 by less are one."""

_IN_PLANE = 1e-6
"""Sine up to which a place lies in a face's plane: one in a hollow is as near to the faces beside it."""

LEANING = 0.1
"""Sine by which an edge beside a point that touches a face may dip below it: the edge's other end then touches too."""

_ASIDE = 0.01
"""Sine by which the way between two edges may lead into a body: a line that lies on a face touches it at both ends."""

_SMOOTH = 0.01
"""The same two sines of a feature within a smooth part, over the one by which its other side falls away: such a part
touches with one place, or with both ends of a triangle that lies on a face."""

_ON_CORNER, _END = 1e-9, 1e-12
"""Distance over a triangle's size within which a point lies on a corner, so that bodies of one outline have a contact
at each corner; over an edge's length from its ends, within which edges do not cross. The two overlap."""

_APART = 1e-10
"""Distance over a mesh's width from which the way to a point tells a normal."""

CONTACT = np.dtype(
    (
        np.record,
        [
            ("key", "i8"),  # of the two features, the same from step to step
            ("gap_m", "f8"),
            ("normal", "f8", 3),  # from the ground to the rock
            ("place_m", "f8", 3),  # of the rock's material point
            ("arm_m", "f8", 3),  # from the centre of mass
            ("impulse", "f8", 3),  # over the rock's mass, m/s
            ("floor_m_s", "f8"),  # least normal velocity
            ("slip_m_s", "f8", 3),  # friction is against this and the slip
            ("lands", "i8"),
        ],
    )
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
    contact = out[where]
    contact.key, contact.gap_m, contact.lands = key, gap, 0
    for k in range(3):
        contact.normal[k], contact.place_m[k], contact.arm_m[k] = normal[k], place[k], place[k] - pose[k]
        contact.impulse[k] = contact.slip_m_s[k] = 0.0
    contact.floor_m_s = 0.0
    return count + 1


@inner
def _meet(point: Any, near: Any, mesh: ContactMesh, reach: Any, vertices: bool, pairs: Pairs) -> int:
    """Contacts of one point with triangles, into the rows of `room.found`; how many.

    point: the body of which it is one, its number there, and its place in the axes of the triangles. Near are the
    triangles, the way that the rock goes before each can touch, noted anew, and the way since.
    """
    (of, index, p), (triangles, apart_m, travel_m), (margin, leaning) = point, near, reach
    room, features, count, whole = pairs.point, 0, 0, mesh.near_triangles.corners_m[-1]
    for place in range(len(triangles)):
        if apart_m[place] >= margin + travel_m:
            continue
        t = triangles[place]
        f, n = mesh.faces[t], mesh.normals[t]
        a = mesh.vertices_m[f[0]]
        code, c = nearest(p, a, mesh.vertices_m[f[1]], mesh.vertices_m[f[2]])
        offset = minus(p, c)
        depth = dot(n, offset)
        apart_m[place] = travel_m + math.sqrt(dot(offset, offset))
        aside = minus(offset, (depth * n[0], depth * n[1], depth * n[2]))
        if code == 0 or dot(aside, aside) <= (_ON_CORNER * mesh.radii_m[t]) ** 2:
            if -margin < depth < margin and _leads_out(of, index, n, leaning, pairs, vertices):
                count = _keep_face(room.found, count, n, depth, c)
            continue
        if dot(offset, offset) >= margin * margin or (code <= 3 and not vertices):
            continue
        if code > 3 and mesh.over_hollow[t, code - 4] >= 0:
            # Above a hollow's other face, its plane goes on below that one: what comes over the edge lands on it.
            below = _lies_below(p, mesh, mesh.over_hollow[t, code - 4], mesh.edge_of[t, code - 4])
            if below and depth < margin and _leads_out(of, index, n, leaning, pairs, vertices):
                count = _keep_face(room.found, count, n, depth, c)
            continue
        name = -1 - f[code - 1] if code <= 3 else mesh.edge_of[t, code - 4]
        features = _keep_feature(room, features, name, n, depth, c)
    for k in range(features):
        name = room.ids[k]
        shared = mesh.triangles_at_vertex[-1 - name] if name < 0 else mesh.triangles_at_edge[name]
        ends = mesh.ends[-1 - name] if name < 0 else shared == 1
        if room.hits[k] != shared or count == len(room.found):
            continue
        offset, total = minus(p, room.spots[k]), room.sums[k]
        far, size = math.sqrt(dot(offset, offset)), math.sqrt(dot(total, total))
        outside = (ends or room.inside[k] > 0.0) and far > _APART * (whole[1, 0] - whole[0, 0])
        for i in range(3):
            room.found[count, i] = offset[i] / far if outside else total[i] / size
            room.found[count, 4 + i] = room.spots[k, i]
        room.found[count, 3] = far if outside else dot(offset, total) / size
        if _leads_out(of, index, room.found[count], leaning, pairs, vertices):
            count += 1
    return count


@inner
def _lies_below(p: Any, mesh: ContactMesh, t: int, edge: int) -> bool:
    """Whether a triangle is nearest to a point at its face, or at one of its edges."""
    f = mesh.faces[t]
    code, _ = nearest(p, mesh.vertices_m[f[0]], mesh.vertices_m[f[1]], mesh.vertices_m[f[2]])
    return code == 0 or (code > 3 and mesh.edge_of[t, code - 4] == edge)


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
            if dot(found[k], apart) < -_IN_PLANE * math.sqrt(dot(apart, apart)):
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
def _leads_out(body: ContactMesh, index: int, n: Any, leaning: float, pairs: Pairs, is_rock: bool) -> bool:
    """Whether a body lies, beside one of its points, on the side to which a normal in the other's axes points."""
    normal = turned_back(pairs.turn, n) if is_rock else turned(pairs.turn, n)
    least, most, smooth = np.inf, 0.0, body.smooth_points[index] >= 0
    for place in range(body.first_way[index], body.first_way[index + 1]):
        along = dot(normal, body.ways[place])
        least, most = min(least, along), max(most, along)
    return least >= -(_SMOOTH * most if smooth else leaning)


@inner
def _near_a_plane(p: Any, mesh: ContactMesh, near_it: Any, margin_m: float) -> bool:
    """Whether a point is as near to one of some triangles' planes as a contact must be; notes the way to each.

    Near are the triangles, the way that the rock goes before each can touch, and the way since.
    """
    (triangles, apart_m, travel_m), near = near_it, False
    for place in range(len(triangles)):
        if apart_m[place] >= margin_m + travel_m:
            continue
        t = triangles[place]
        off = abs(dot(mesh.normals[t], p) - mesh.offsets_m[t])
        near = near or off <= 1.001 * margin_m
        apart_m[place] = max(apart_m[place], travel_m + off)
    return near


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
    travel_m, bodies, placed, count = look(pairs, pose), (rock, ground), (pose, pairs.turn), 0
    groups = pairs.groups
    for kind in range(3):
        for group in range(groups.found[kind]):
            if groups.apart_m[kind, group] >= margin_m + travel_m:
                continue
            begin, end = groups.begin[kind, group], groups.begin[kind, group + 1]
            index = pairs.first[kind, begin]
            ends = ends_of(bodies, kind, index, placed)
            if not may_touch(pairs, kind, group, ends, margin_m):
                continue
            near_it = pairs.second[kind, begin:end], pairs.apart_m[kind, begin:end], travel_m
            if kind == 2:
                count = _edges_across(bodies, (index, ends), near_it, placed, margin_m, out, count)
            elif kind == 1:
                count = _ground_point(bodies, (index, ends[0]), near_it, pairs, margin_m, out, count)
            else:
                reach = margin_m, leaning
                count = _rock_point(bodies, (index, ends[0]), near_it, pairs, reach, out, count)
            note(pairs, kind, group, ends)
    return count


@inner
def _rock_point(bodies: Any, point: Any, near_it: Any, pairs: Pairs, reach: Any, out: Any, count: int) -> int:
    """Add the contacts of a point of the rock; how many there are then."""
    (rock, ground), (index, p), (margin_m, _) = bodies, point, reach
    if not _near_a_plane(p, ground, near_it, margin_m):
        return count
    found = pairs.point.found
    for i in range(_meet((rock, index, p), near_it, ground, reach, True, pairs)):
        key = 8 * _name(index, rock.smooth_points) + i
        count = add(out, count, key, found[i, 3], found[i], p, pairs.looked_at)
    return count


@inner
def _ground_point(
    bodies: Any, point: Any, near_it: Any, pairs: Pairs, margin_m: float, out: Any, count: int
) -> int:
    """Add the contacts of a point of the ground, which is given in body axes; how many there are then."""
    (rock, ground), (index, p) = bodies, point
    if not _near_a_plane(p, rock, near_it, margin_m):
        return count
    there, found = ground.vertices_m[ground.points[index]], pairs.point.found
    for i in range(_meet((ground, index, p), near_it, rock, (margin_m, LEANING), False, pairs)):
        n, key = turned(pairs.turn, found[i]), (1 << 60) + 8 * _name(index, ground.smooth_points) + i
        place = plus(there, -found[i, 3], n)
        count = add(out, count, key, found[i, 3], (-n[0], -n[1], -n[2]), place, pairs.looked_at)
    return count


@inner
def _name(index: int, smooth: Indices) -> int:
    """By what a point or an edge is known from step to step: one name within a smooth part."""
    return smooth[index] if smooth[index] >= 0 else index


@inner
def _edges_across(
    bodies: Any, edge: Any, near_it: Any, placed: Any, margin_m: float, out: Any, count: int
) -> int:
    """Add the contacts of an edge of the rock with edges of the ground that it crosses; how many there are then.

    The edge and its ends; the ground's edges, the way before each can touch, noted anew, and the way since.
    """
    (index, (a, b)), (edges, apart_m, travel_m) = edge, near_it
    offset = minus(b, a)
    for place in range(len(edges)):
        if apart_m[place] < margin_m + travel_m:
            ends = index, a, offset, edges[place]
            count, far_m = _across(bodies, ends, placed, margin_m, out, count)
            apart_m[place] = travel_m + far_m
    return count


@inner
def _across(bodies: Any, edges: Any, placed: Any, margin_m: float, out: Any, count: int) -> tuple[int, float]:
    """Add the contact of two edges that cross, if the way between them leads out of both bodies; their distance too.

    Rock and ground; the rock's edge, its start and its way to its end, the ground's edge; the rock's pose and rotation.
    """
    (rock, ground), (i, a, offset, j), (pose, turn) = bodies, edges, placed
    c, d = ground.vertices_m[ground.edges[j, 0]], ground.vertices_m[ground.edges[j, 1]]
    other = minus(d, c)
    s, t, far = between(a, offset, c, other)
    apart_m = math.sqrt(far)
    if apart_m >= margin_m:
        return count, apart_m
    if not (_END < s < 1.0 - _END and _END < t < 1.0 - _END):
        return count, apart_m
    n = cross(offset, other)
    size, scale = math.sqrt(dot(n, n)), math.sqrt(dot(offset, offset) * dot(other, other))
    if size < 1e-4 * scale:
        return count, apart_m
    own0, own1 = turned(turn, rock.inward[i, 0]), turned(turn, rock.inward[i, 1])
    into = minus(plus(ground.inward[j, 0], 1.0, ground.inward[j, 1]), plus(own0, 1.0, own1))
    # Of the two ways that lead out of edges which are nearly flat, the one that leads out of both bodies.
    sign = -1.0 if dot(n, into) > 0.0 else 1.0
    n = (sign * n[0] / size, sign * n[1] / size, sign * n[2] / size)
    off = _off(dot(n, ground.inward[j, 0]), dot(n, ground.inward[j, 1]), ground.smooth_edges[j] >= 0)
    if off > 0.0:  # until the rock's edge has turned by so much: then one of its ends has gone as far
        half_m = min(rock.edge_halves_m[i], ground.edge_halves_m[j])
        return count, max(apart_m, half_m * off * size / scale)
    if _off(-dot(n, own0), -dot(n, own1), rock.smooth_edges[i] >= 0) > 0.0:
        return count, apart_m
    place = plus(a, s, offset)
    gap = dot(n, minus(place, plus(c, t, other)))
    if -margin_m < gap < margin_m:
        key = (2 << 60) + _name(i, rock.smooth_edges) * len(ground.edges) + _name(j, ground.smooth_edges)
        count = add(out, count, key, gap, n, place, pose)
    return count, apart_m


@inner
def _off(first: float, other: float, smooth: bool) -> float:
    """By how much more than it may a way leads into a body beside an edge; its sines toward the triangles there."""
    return max(first, other) - (_SMOOTH * max(-min(first, other), 0.0) if smooth else _ASIDE)


class SolverRoom(NamedTuple):
    """Where impulses are worked out, so that no step makes arrays."""

    free: Array  # (6,): the velocity without any impulses
    start: Array  # (6,): velocities from and with which one is searched for
    trial: Array
    off: Array  # (6,): by how much a velocity is not what its impulses make of the free one
    matrix: Array  # (6, 6): the derivative of that by the velocity
    stiffness: Array  # (contacts,): impulse over velocity
    weights: Array  # (contacts,): by which contacts that stick share the load
    sticks: Indices  # (contacts,): those that are to stick
    states: Indices  # (contacts,): open, sticks or slips, at the velocity that was looked at
    toward: Array  # (contacts, 4): of one that slips, direction of its friction, and what turns that


def solver_room(most: int) -> SolverRoom:
    """Room for so many contacts."""
    contacts, marks = np.zeros((2, most)), np.zeros((2, most), np.int64)
    rooms = [*np.zeros((4, 6)), np.zeros((6, 6)), *contacts, *marks, np.zeros((most, 4))]
    return SolverRoom(*rooms)


class Touching(NamedTuple):
    """A rock that touches its ground, at one moment."""

    contacts: Any  # records of CONTACT
    number: int  # so many are looked at
    friction: tuple[float, float]  # static, kinetic
    inverse_inertia: Array  # (3, 3) over mass
    velocity: Array  # (6,)
    enough_m_s: float  # a velocity that is off by less is right
    room: SolverRoom


@inner
def velocity_of(arm: Any, velocity: Array) -> Vector:
    """Velocity of the point at an arm."""
    return plus(velocity, 1.0, cross((velocity[3], velocity[4], velocity[5]), arm))


@inner
def response(arm: Any, impulse: Any, inverse_inertia: Array) -> tuple[Vector, Vector]:
    """What an impulse at an arm adds to the velocity: of the centre of mass, and the spin."""
    x, y, z = cross(arm, impulse)
    m = inverse_inertia
    return (impulse[0], impulse[1], impulse[2]), (
        m[0, 0] * x + m[0, 1] * y + m[0, 2] * z,
        m[1, 0] * x + m[1, 1] * y + m[1, 2] * z,
        m[2, 0] * x + m[2, 1] * y + m[2, 2] * z,
    )


@inner
def push(at: Touching, i: int, share: float, impulse: Any, velocity: Array) -> None:
    """Change a velocity (6,) by a share of an impulse at a contact."""
    shift, spin = response(at.contacts[i].arm_m, impulse, at.inverse_inertia)
    for k in range(3):
        velocity[k] += share * shift[k]
        velocity[3 + k] += share * spin[k]
