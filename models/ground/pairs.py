"""Pairs of features of a rock and its ground that may touch soon: their search, and how long they are all. Compiled."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from toppling.models.compiled import Array, Indices, Vector, compiled, inner
from toppling.models.ground.boxes import next_near
from toppling.models.ground.mesh import ContactMesh
from toppling.models.ground.rigid import copy, dot, minus, plus, rotation_of, turned, turned_back

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
    # around all features that were not far from the other body, in body axes and when they were found.
    middle_m: Array
    # Radius of the first ball; the reach in which they were found; way of that ball since; radius of the second ball;
    # least distance of a feature outside of it when they were found.
    lengths_m: Array
    turn: Array  # (3, 3): rotation of the pose that is looked at
    point: PointRoom


_LISTS = 8
"""Number of poses around each of which pairs are listed: a rock that rocks comes back to those that it was in."""


def _no_pairs(room: int) -> Pairs:
    """Room for so many of each kind, in each list.

    What is not found yet is not written either: zeros took a third of a short job.
    """
    features, lists = FEATURES_AT_A_POINT, _LISTS
    return Pairs(
        np.zeros((lists, 3), np.int64), np.empty((lists, 3, room), np.int64), np.empty((lists, 3, room), np.int64),
        np.empty((lists, 3, room)),
        Groups(np.zeros((lists, 3), np.int64), np.empty((lists, 3, room + 1), np.int64),
               np.empty((lists, 3, room)), np.empty((lists, 3, room, 7))),
        np.full((lists, 7), np.nan), np.zeros((lists, 7)), np.zeros((lists, 4, 3)), np.zeros((lists, 5)),
        np.zeros((lists, 3, 3)),
        PointRoom(np.zeros((MOST_AT_A_POINT, 7)), np.zeros(features, np.int64), np.zeros(features, np.int64),
                  np.zeros((features, 3)), np.zeros((features, 3)), np.zeros(features)),
    )  # fmt: skip


class Lists(NamedTuple):
    """What may touch: the pairs that are listed around some poses, and how they are."""

    pairs: Pairs  # of all lists: these are the first axis, but of the room for a point
    latest: Indices  # (2,): the list that served last, and the one that was made last
    slack_m: Array  # (2,): way of the rock over which pairs are listed: what fitted last, and at most
    farthest_m: float  # from the centre of mass


_PAIRS = 1 << 16
"""Room for pairs of features that may touch."""

_SLACK_SHARE = 0.05
"""Of R: way of the rock over which pairs are listed."""


def empty_lists(size_m: float, farthest_m: float, room: int = _PAIRS) -> Lists:
    """Lists of a rock in which nothing is found yet, with room for so many pairs of each kind."""
    return Lists(_no_pairs(room), np.zeros(2, np.int64), np.full(2, _SLACK_SHARE * size_m), farthest_m)


@inner
def latest_pairs(lists: Lists) -> Pairs:
    """The pairs of the list that served last."""
    i, of, groups = lists.latest[0], lists.pairs, lists.pairs.groups
    return Pairs(
        of.found[i], of.first[i], of.second[i], of.apart_m[i],
        Groups(groups.found[i], groups.begin[i], groups.apart_m[i], groups.seen_m[i]),
        of.pose[i], of.looked_at[i], of.middle_m[i], of.lengths_m[i], of.turn[i], of.point,
    )  # fmt: skip


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
    travel_m = math.sqrt(dot(moved, moved))
    if kind == 2:
        moved = minus(b, seen_m[3:])
        travel_m = max(travel_m, math.sqrt(dot(moved, moved)))
    left_m = seen_m[6] - travel_m
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
    offset = minus(plus(pose, 1.0, turned(turn, pairs.middle_m[2])), pairs.middle_m[3])
    moved = math.sqrt(dot(offset, offset)) + _turned_m(pairs.pose, pose, lengths_m[WIDE_RADIUS])
    return moved + margin_m < lengths_m[REACH]


@inner
def look(pairs: Pairs, pose: Array) -> float:
    """Note the way to a pose, whose rotation `pairs.turn` gets; the way since the pairs were found."""
    lengths_m, turn = pairs.lengths_m, pairs.turn
    rotation_of(pose, turn)
    place = plus(pose, 1.0, turned(turn, pairs.middle_m[0]))
    offset = minus(place, pairs.middle_m[1])
    lengths_m[WAY] += math.sqrt(dot(offset, offset)) + _turned_m(pairs.looked_at, pose, lengths_m[RADIUS])
    pairs.middle_m[1, 0], pairs.middle_m[1, 1], pairs.middle_m[1, 2] = place
    copy(pose, pairs.looked_at)
    return lengths_m[WAY]


@compiled
def moved_m(start: Array, end: Array, radius_m: float) -> float:
    """Way of the point that moved most of those within a radius of the centre of mass, at most."""
    offset = minus(end, start)
    return math.sqrt(dot(offset, offset)) + _turned_m(start, end, radius_m)


@inner
def _turned_m(start: Array, end: Array, radius_m: float) -> float:
    """Way of a point at a radius from one that stays, as the attitude changes, at most."""
    same, opposite = 0.0, 0.0  # a quaternion and its opposite are one attitude
    for k in range(3, 7):
        same, opposite = same + (end[k] - start[k]) ** 2, opposite + (end[k] + start[k]) ** 2
    return 2.0 * math.sqrt(min(same, opposite)) * radius_m


_MORE = 1.2
"""Times the margin that is asked for at least, so that the rock may move on a little."""

_WIDE = 2.0
"""Times the reach in which pairs are listed, up to which features decide by their way whether these still serve."""


@inner
def find(rock: ContactMesh, ground: ContactMesh, pose: Array, margin_m: float, lists: Lists) -> None:
    """List what may touch within a margin in a pose, unless a list that was made serves; the oldest is replaced."""
    latest, count = lists.latest, len(lists.pairs.found)
    for _ in range(count):
        if serve(latest_pairs(lists), pose, margin_m, lists.farthest_m):
            return
        latest[0] = (latest[0] + 1) % count
    latest[1] = (latest[1] + 1) % count
    latest[0] = latest[1]
    pairs, slack_m = latest_pairs(lists), lists.slack_m
    reach_m = _search((rock, ground), pose, max(slack_m[0], _MORE * margin_m), pairs)
    # In twice the reach there are some four times as many.
    few = 4 * max(pairs.found[0], pairs.found[1], pairs.found[2]) < len(pairs.first[0])
    slack_m[0] = min(2.0 * reach_m if few else reach_m, slack_m[1])


@inner(allocates=True)
def _search(bodies: Any, pose: Array, reach: float, pairs: Pairs) -> float:
    """Find the features of rock and ground within a reach of each other, or within so much of it that they fit."""
    turn, found, least, box = pairs.turn, pairs.found, 1e-7 * reach, _no_box()
    rotation_of(pose, turn)
    while True:
        for kind in range(3):
            _list(pairs, kind, bodies, (pose, turn), reach, box)
        if found.max() < len(pairs.first[0]) or reach < least:
            break
        reach *= 0.5  # of pairs that do not fit, none may be left out that can touch soon
    pairs.lengths_m[EMPTY] = _WIDE * reach
    pairs.lengths_m[WIDE_RADIUS] = _ball_around(box, (pose, turn), pairs.middle_m[2], pairs.middle_m[3])
    _found_in(*bodies, pose, reach, pairs)
    return reach


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
def _list(pairs: Pairs, kind: int, bodies: Any, placed: Any, reach: float, box: Array) -> None:
    """List the pairs of a kind within a reach.

    Rock and ground; the rock's pose and its rotation; a box widened, in body axes, around what is not far.
    """
    (rock, ground), second, apart, count = bodies, pairs.second[kind], pairs.apart_m[kind], 0
    of, mesh = (ground, rock) if kind == 1 else (rock, ground)
    near = ground.near_edges if kind == 2 else mesh.near_triangles
    for index in range(len(rock.edges) if kind == 2 else len(of.points)):
        if count == len(second):
            break
        ends = ends_of(bodies, kind, index, placed)
        if next_near(near, -1, ends, _WIDE * reach) == len(near.features):
            continue
        for end in ends:
            _widen(box, end if kind == 1 else turned_back(placed[1], minus(end, placed[0])), 0.0)
        begin, at = count, next_near(near, -1, ends, reach)
        while at < len(near.features) and count < len(second):
            other = near.features[at]
            if kind == 2:
                apart_m = _edges_apart_m(ends[0], ends[1], rock.edge_halves_m[index], ground, other)
            else:
                apart_m = _point_apart_m(ends[0], mesh, other)
            if apart_m < reach:
                k = count  # of one first feature, in the order of the second
                while k > begin and second[k - 1] > other:
                    second[k], apart[k] = second[k - 1], apart[k - 1]
                    k -= 1
                second[k], apart[k], pairs.first[kind, count] = other, apart_m, index
                count += 1
            at = next_near(near, at, ends, reach)
    pairs.found[kind] = count


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
