"""Pairs of features of a rock and its ground that may touch soon, and how long they are all that may. Compiled.

Points of the rock and triangles of the ground, points of the ground and triangles of the rock, edges and edges: the
kinds 0, 1 and 2. Of each pair the way is noted that the rock goes before it can touch.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from toppling.models.compiled import Array, Indices, Vector, inner
from toppling.models.ground.vectors import copy, dot, minus, plus, rotation_of, turned, turned_back

MOST_AT_A_POINT, FEATURES_AT_A_POINT = 8, 24
"""Contacts of one point, and edges and vertices that are nearest to it, at most."""


RADIUS, REACH, WAY, WIDE_RADIUS, EMPTY = range(5)
"""Of `Pairs.lengths_m`."""


class PointRoom(NamedTuple):
    """Where the contacts of one point are put together."""

    found: Array  # (contacts, 7): normal, gap, place
    ids: Indices  # of edges and vertices that are nearest to it
    hits: Indices  # by so many of their triangles
    spots: Array
    sums: Array  # of these triangles' normals
    inside: Array  # least distance over them


class Groups(NamedTuple):
    """The pairs of each kind, by their first feature; the first `found`."""

    found: Indices  # (3,)
    begin: Indices  # (3, room + 1): first pair of each, and the end of the last
    apart_m: Array  # (3, room): way that the rock goes before one of its pairs can touch, at least
    # (3, room, 7): place, in the other body's axes, of a group's point or of its edge's two ends as it was last looked
    # at, and how far that is from what it may touch, at least.
    seen_m: Array


class Pairs(NamedTuple):
    """Features that may touch before the rock has moved by a slack; of each kind the first `found` pairs."""

    found: Indices  # (3,)
    first: Indices  # (3, room): point or edge: the rock's, the ground's, the rock's
    second: Indices  # (3, room): triangle or edge of the other body
    apart_m: Array  # (3, room): way that the rock goes before a pair can touch, at least
    groups: Groups
    pose: Array  # (7,) in which they were found; the first NaN if never
    looked_at: Array  # (7,): the latest pose that was looked at
    # (4, 3): middle of a ball around all places at which they may touch, in body axes and at the latest look; of one
    # around all features that lie in occupied cells of the other body, in body axes and when they were found.
    middle_m: Array
    # Radius of the first ball; the reach in which they were found; way of that ball since; radius of the second ball;
    # least distance of a feature outside of it when they were found.
    lengths_m: Array
    turn: Array  # (3, 3): rotation of the pose that is looked at
    point: PointRoom


def _no_pairs(room: int) -> Pairs:
    """Room for so many of each kind; what is not found yet is not written either: zeros took a third of a short job."""
    features = FEATURES_AT_A_POINT
    return Pairs(
        np.zeros(3, np.int64), np.empty((3, room), np.int64), np.empty((3, room), np.int64), np.empty((3, room)),
        Groups(np.zeros(3, np.int64), np.empty((3, room + 1), np.int64), np.empty((3, room)), np.empty((3, room, 7))),
        np.full(7, np.nan), np.zeros(7), np.zeros((4, 3)), np.zeros(5), np.zeros((3, 3)),
        PointRoom(np.zeros((MOST_AT_A_POINT, 7)), np.zeros(features, np.int64), np.zeros(features, np.int64),
                  np.zeros((features, 3)), np.zeros((features, 3)), np.zeros(features)),
    )  # fmt: skip


class Lists(NamedTuple):
    """What may touch: the pairs that are listed, and how they are."""

    pairs: Pairs
    slack_m: float  # way of the rock over which pairs are listed
    farthest_m: float  # from the centre of mass


_PAIRS = 1 << 16
"""Room for pairs of features that may touch."""

_SLACK_SHARE = 0.05
"""Of R: way of the rock over which pairs are listed."""


def empty_lists(size_m: float, farthest_m: float, room: int = _PAIRS) -> Lists:
    """Lists of a rock in which nothing is found yet, with room for so many pairs of each kind."""
    return Lists(_no_pairs(room), _SLACK_SHARE * size_m, farthest_m)


@inner
def ends_of(bodies: Any, kind: int, index: int, placed: Any) -> tuple[Vector, Vector]:
    """Place of a point, twice, or of an edge's two ends, in the other body's axes.

    Rock and ground; the rock's pose and its rotation.
    """
    (rock, ground), (pose, turn) = bodies, placed
    if kind == 1:
        p = turned_back(turn, minus(ground.vertices_m[ground.points[index]], pose))
        return p, p
    if kind == 0:
        p = plus(pose, 1.0, turned(turn, rock.vertices_m[rock.points[index]]))
        return p, p
    a, b = rock.vertices_m[rock.edges[index, 0]], rock.vertices_m[rock.edges[index, 1]]
    return plus(pose, 1.0, turned(turn, a)), plus(pose, 1.0, turned(turn, b))


@inner
def may_touch(pairs: Pairs, kind: int, group: int, ends: Any, margin_m: float) -> bool:
    """Whether a group's feature has come near since it was last looked at; if not, the way left to it is noted."""
    seen_m, (a, b) = pairs.groups.seen_m[kind, group], ends
    moved = minus(a, seen_m)
    way_m = math.sqrt(dot(moved, moved))
    if kind == 2:
        moved = minus(b, seen_m[3:])
        way_m = max(way_m, math.sqrt(dot(moved, moved)))
    left_m = seen_m[6] - way_m
    if left_m < margin_m:
        return True
    pairs.groups.apart_m[kind, group] = pairs.lengths_m[WAY] + left_m
    return False


@inner
def note(pairs: Pairs, kind: int, group: int, ends: Any) -> None:
    """Note where a group's feature was looked at, and how far that is from what it may touch."""
    groups, (a, b), least = pairs.groups, ends, np.inf
    for k in range(groups.begin[kind, group], groups.begin[kind, group + 1]):
        least = min(least, pairs.apart_m[kind, k])
    groups.apart_m[kind, group] = least
    seen_m = groups.seen_m[kind, group]
    for k in range(3):
        seen_m[k], seen_m[3 + k] = a[k], b[k]
    seen_m[6] = least - pairs.lengths_m[WAY]


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
def look(pairs: Pairs, pose: Array) -> float:
    """Note the way to a pose, whose rotation `pairs.turn` gets; the way since the pairs were found."""
    lengths_m, turn = pairs.lengths_m, pairs.turn
    rotation_of(pose, turn)
    place = plus(pose, 1.0, turned(turn, pairs.middle_m[0]))
    way = minus(place, pairs.middle_m[1])
    lengths_m[WAY] += math.sqrt(dot(way, way)) + _turned_m(pairs.looked_at, pose, lengths_m[RADIUS])
    pairs.middle_m[1, 0], pairs.middle_m[1, 1], pairs.middle_m[1, 2] = place
    copy(pose, pairs.looked_at)
    return lengths_m[WAY]


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
