"""Contacts of a rounded base with the facets of the ground, and with the edges and points of these that stand out.

The base is farthest along a normal at one place (:mod:`models.ground.rolling`). With a facet it touches there, where
that place lies over the facet. An edge or a point it touches where the way from there to the place is along the normal,
if that lies between those of the facets beside it. So every place of a convex base is found once, and goes on from
feature to feature as the rock rolls, always on one surface: a step to another would give or take energy. Compiled.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from toppling.models.compiled import Array, Indices, Vector, inner
from toppling.models.ground.boxes import next_near
from toppling.models.ground.contacts import add
from toppling.models.ground.mesh import ContactMesh, normals_at_edges, sides_at_edges
from toppling.models.ground.pairs import moved_m
from toppling.models.ground.rigid import copy, dot, minus, plus, rotation_of, square, turned, turned_back
from toppling.models.ground.rolling import (
    FIRST_KEY,
    NO_ROLLING,
    RollingSurface,
    follow,
    placed_on,
    without_rims_of_what_touches,
)
from toppling.models.shapes import joined_parts

_ONE_FACET = 1e-6
"""Sine of the angle between two triangles up to which they are one facet."""

_ROUNDS = 60
"""Maximum number of rounds in which the normal at an edge or a point is found."""

_CENTRED = 1e-10
"""Tolerance over the rock's size on the distance of the contact from the edge or the point, across the normal."""

_BESIDE = 1e-9
"""Share of a side by which a place may lie beside a triangle, or beyond an edge's end: it belongs to both beside."""


class Facets(NamedTuple):
    """A rounded base over ground of facets; no parts where a rock has none. Features: facets, points, then edges."""

    surface: RollingSurface
    facet_of: Indices  # (m,): of the ground's triangles
    normals: Array  # (f, 3): of facets; of the first facet beside an edge
    places: Array  # (f, 3): of each
    radii_m: Array  # (f,): of facets around these
    ways: Array  # (e, 3): along edges
    across: Array  # (e, 3): from the first facet outward over an edge, square to it and the normal
    turns: Array  # (e,): to the normal of the second facet, rad
    angles: Array  # (r, e): of the normal that was found last
    lowest: Indices  # (r, f, 4): patch that was farthest last, against a normal; of edges, against those beside too
    apart_m: Array  # (r, f): way that the rock goes before a part can touch a feature, at least
    looked_at: Array  # (7,): the latest pose
    lengths_m: Array  # (2,): way since the start, and from the centre of mass to the farthest vertex


NO_FACETS = Facets(
    NO_ROLLING, np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros((0, 3)),
    np.zeros((0, 3)), np.zeros(0), np.zeros((0, 0)), np.zeros((0, 0, 4), np.int64), np.zeros((0, 0)), np.zeros(7),
    np.zeros(2),
)  # fmt: skip
"""Facets of a rock that touches with its triangles alone."""


def facets_below(surface: RollingSurface, ground: ContactMesh) -> Facets:
    """A rounded base, in body axes, over the facets of its ground."""
    facet_of, normals, places, radii_m = _facets(ground)
    at_edges = normals_at_edges(ground)
    across = -ground.inward[:, 0]
    bounds = (at_edges[:, 0] == at_edges[:, 1]).all(axis=1)
    turns = np.arctan2((at_edges[:, 1] * across).sum(axis=1), (at_edges[:, 1] * at_edges[:, 0]).sum(axis=1))
    start, end = ground.vertices_m[ground.edges[:, 0]], ground.vertices_m[ground.edges[:, 1]]
    points_m = ground.vertices_m[ground.points]
    parts, features = len(surface.lowest), len(normals) + len(points_m) + len(start)
    return Facets(
        surface,
        facet_of,
        np.vstack([normals, np.zeros_like(points_m), at_edges[:, 0]]),
        np.vstack([places, points_m, start]),
        np.append(radii_m, np.zeros(features - len(normals))),
        end - start,
        across,
        np.where(bounds, 0.5 * np.pi, turns),
        np.zeros((parts, len(start))),
        np.broadcast_to(surface.lowest[:, None, None], (parts, features, 4)).copy(),
        np.zeros((parts, features)),
        np.full(7, np.nan),
        np.array([0.0, surface.seen[8]]),
    )


def not_looked_at(on: Facets) -> Facets:
    """The same with nothing looked up yet: answers depend on no other shake."""
    surface = on.surface._replace(fractions=np.zeros(3), down=np.zeros(3))
    first = np.broadcast_to(surface.lowest[:, None, None], on.lowest.shape).copy()
    return on._replace(
        surface=surface,
        angles=np.zeros_like(on.angles),
        lowest=first,
        apart_m=np.zeros_like(on.apart_m),
        looked_at=np.full(7, np.nan),
        lengths_m=on.lengths_m * (0.0, 1.0),
    )


def _facets(ground: ContactMesh) -> tuple[Indices, Array, Array, Array]:
    """Facet (m,) of each triangle; normals (f, 3), places (f, 3) and radii (f,) around these of facets."""
    sides = sides_at_edges(ground.edge_of, ground.triangles_at_edge)[ground.triangles_at_edge == 2] // 3
    off = np.linalg.norm(np.cross(ground.normals[sides[:, 0]], ground.normals[sides[:, 1]]), axis=1)
    same = (off < _ONE_FACET) & ((ground.normals[sides[:, 0]] * ground.normals[sides[:, 1]]).sum(axis=1) > 0)
    facet = joined_parts(sides[same], len(ground.faces))
    at = ground.vertices_m[ground.faces]
    area = np.linalg.norm(np.cross(at[:, 1] - at[:, 0], at[:, 2] - at[:, 0]), axis=1)
    order = np.lexsort((-area, facet))
    largest = order[np.searchsorted(facet[order], np.arange(facet.max(initial=-1) + 1))]
    radii_m = np.zeros(len(largest))
    np.maximum.at(radii_m, facet, np.linalg.norm(at - at[largest[facet], :1], axis=2).max(axis=1))
    return facet, ground.normals[largest], at[largest, 0], radii_m


@inner
def rounded_contacts(
    on: Facets, ground: ContactMesh, pose: Array, margin_m: float, turn: Array, out: Any, count: int
) -> int:
    """Add the contacts of a rounded base with gaps up to a margin, in a pose (7,); how many there are."""
    rotation_of(pose, turn)
    if math.isnan(on.looked_at[0]):
        copy(pose, on.looked_at)
    on.lengths_m[0] += moved_m(on.looked_at, pose, on.lengths_m[1])
    copy(pose, on.looked_at)
    within_m, placed, points = margin_m + on.lengths_m[0], (pose, turn), len(ground.points)
    edges = len(on.normals) - len(on.ways)
    for part in range(len(on.apart_m)):
        for k in range(len(on.normals)):
            if on.apart_m[part, k] >= within_m:
                continue
            apart_m = _apart_m(on, part, k, placed, margin_m)
            on.apart_m[part, k] = on.lengths_m[0] + max(apart_m, 0.0)
            if apart_m >= margin_m:
                continue
            if k < edges - points:
                count = _meet_facet((on, ground), part, k, placed, margin_m, out, count)
            elif k < edges:
                count = _meet_point((on, ground), part, k - edges + points, placed, margin_m, out, count)
            else:
                count = _meet_edge(on, part, k - edges, placed, margin_m, out, count)
    return without_rims_of_what_touches(on.lengths_m[1], out, count)


@inner
def _farthest(on: Facets, part: int, feature: int, role: int, n: Any, placed: Any) -> Vector:
    """Place of a part that is farthest against a normal."""
    pose, turn = placed
    up = turned_back(turn, n)
    for i in range(3):
        on.surface.down[i] = -up[i]
    patch = follow(on.surface, on.lowest[part, feature, role])
    on.lowest[part, feature, role] = patch
    return plus(pose, 1.0, turned(turn, placed_on(on.surface, patch)))


@inner
def _meet_facet(
    bodies: Any, part: int, facet: int, placed: Any, margin_m: float, out: Any, count: int
) -> int:
    """Add the contact of a part with a facet, if there is one."""
    on, ground = bodies
    n = (on.normals[facet, 0], on.normals[facet, 1], on.normals[facet, 2])
    place = _farthest(on, part, facet, 0, n, placed)
    gap = dot(n, minus(place, on.places[facet]))
    on.apart_m[part, facet] = max(on.apart_m[part, facet], on.lengths_m[0] + abs(gap))
    if abs(gap) >= margin_m or not _lies_over(on, ground, facet, place, margin_m):
        return count
    return add(out, count, FIRST_KEY + part * len(on.normals) + facet, gap, n, place, placed[0])


@inner
def _lies_over(on: Facets, ground: ContactMesh, facet: int, place: Vector, margin_m: float) -> bool:
    """Whether a place near a facet's plane lies over one of its triangles."""
    near, within_m = ground.near_triangles, margin_m + _BESIDE * on.radii_m[facet]
    at = next_near(near, -1, (place, place), within_m)
    while at < len(near.features):
        t = near.features[at]
        if on.facet_of[t] == facet and _over_triangle(ground, t, place):
            return True
        at = next_near(near, at, (place, place), within_m)
    return False


@inner
def _over_triangle(ground: ContactMesh, t: int, place: Vector) -> bool:
    for k in range(3):
        a, b = ground.vertices_m[ground.faces[t, k]], ground.vertices_m[ground.faces[t, (k + 1) % 3]]
        n, side, along = ground.normals[t], minus(b, a), minus(place, a)
        inward = (
            n[1] * side[2] - n[2] * side[1],
            n[2] * side[0] - n[0] * side[2],
            n[0] * side[1] - n[1] * side[0],
        )
        if dot(inward, along) < -_BESIDE * dot(side, side):
            return False
    return True


@inner
def _meet_edge(on: Facets, part: int, edge: int, placed: Any, margin_m: float, out: Any, count: int) -> int:
    """Add the contact of a part with an edge between facets, if it is over neither of these."""
    feature = edge + len(on.normals) - len(on.ways)
    start, most = on.places[feature], on.turns[edge]
    place, low = _missed(on, part, edge, 1, 0.0, placed)
    if low <= 0.0:
        return count
    place, high = _missed(on, part, edge, 2, most, placed)
    if high >= 0.0:
        return count
    near, far, angle = 0.0, most, on.angles[part, edge]
    if not near < angle < far:
        angle = far * low / (low - high)
    for _ in range(_ROUNDS):
        place, miss = _missed(on, part, edge, 0, angle, placed)
        if abs(miss) < _CENTRED * on.lengths_m[1] or far - near < 1e-12:
            break
        # False position, in which an end that stays counts half from then on (Dowell and Jarratt 1971).
        if miss > 0.0:
            near, low, high = angle, miss, 0.5 * high
        else:
            far, high, low = angle, miss, 0.5 * low
        angle = near + (far - near) * low / (low - high)
    on.angles[part, edge] = angle
    n, along = _between(on, edge, angle), on.ways[edge]
    gap, share = dot(n, minus(place, start)), dot(along, minus(place, start)) / dot(along, along)
    if abs(gap) >= margin_m or not -_BESIDE <= share <= 1.0 + _BESIDE:
        return count
    return add(out, count, FIRST_KEY + part * len(on.normals) + feature, gap, n, place, placed[0])


@inner
def _apart_m(on: Facets, part: int, feature: int, placed: Any, enough_m: float) -> float:
    """How far a part is from a feature, at least: along the way from there to the centre of mass.

    Where the whole rock is farther than what is enough, its distance.
    """
    pose, edge, nearest = placed[0], feature - len(on.normals) + len(on.ways), on.places[feature]
    nearest = nearest[0], nearest[1], nearest[2]
    if edge >= 0:
        along = on.ways[edge]
        share = dot(along, minus(pose, nearest)) / dot(along, along)
        nearest = plus(nearest, min(max(share, 0.0), 1.0), along)
    up = minus(pose, nearest)
    size = math.sqrt(square(up))
    beyond_m = size - on.lengths_m[1] - on.radii_m[feature]
    if size == 0.0 or beyond_m >= enough_m:
        return beyond_m
    up = (up[0] / size, up[1] / size, up[2] / size)
    return dot(up, minus(_farthest(on, part, feature, 3, up, placed), nearest)) - on.radii_m[feature]


@inner
def _meet_point(
    bodies: Any, part: int, point: int, placed: Any, margin_m: float, out: Any, count: int
) -> int:
    """Add the contact of a part with a point of the ground, if it is over no facet and no edge beside that.

    The normal turns by how far the place misses it, over the radius of the base that its last turn has shown.
    """
    on, ground = bodies
    feature, (pose, _) = point + len(on.normals) - len(on.ways) - len(ground.points), placed
    at, size_m = on.places[feature], on.lengths_m[1]
    n, radius_m, missed, turned_by = minus(pose, at), size_m, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    place = n
    for _ in range(_ROUNDS):
        size = math.sqrt(square(n))
        n = (n[0] / size, n[1] / size, n[2] / size)
        place = _farthest(on, part, feature, 0, n, placed)
        offset = minus(place, at)
        aside = plus(offset, -dot(n, offset), n)
        if square(aside) < (_CENTRED * size_m) ** 2:
            break
        along = dot(minus(missed, aside), turned_by)
        radius_m = along / square(turned_by) if along > 0.0 else size_m
        turned_by, missed = (aside[0] / radius_m, aside[1] / radius_m, aside[2] / radius_m), aside
        n = plus(n, 1.0, turned_by)
    gap = dot(n, minus(place, at))
    if abs(gap) >= margin_m:
        return count
    for way in range(ground.first_way[point], ground.first_way[point + 1]):
        if dot(n, ground.ways[way]) > _BESIDE:
            return count
    return add(out, count, FIRST_KEY + part * len(on.normals) + feature, gap, n, place, pose)


@inner
def _between(on: Facets, edge: int, angle: float) -> Vector:
    """Normal at an edge, turned by an angle from that of its first facet."""
    n, t = on.normals[edge + len(on.normals) - len(on.ways)], on.across[edge]
    c, s = math.cos(angle), math.sin(angle)
    return c * n[0] + s * t[0], c * n[1] + s * t[1], c * n[2] + s * t[2]


@inner
def _missed(on: Facets, part: int, edge: int, role: int, angle: float, placed: Any) -> tuple[Vector, float]:
    """Place farthest against a normal at an edge, and how far it lies from the edge across it."""
    feature = edge + len(on.normals) - len(on.ways)
    place = _farthest(on, part, feature, role, _between(on, edge, angle), placed)
    return place, dot(_between(on, edge, angle + 0.5 * math.pi), minus(place, on.places[feature]))
