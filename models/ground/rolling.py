"""Contacts of a rock with a rounded base with the plane z = 0: the lowest place of each smooth part, and points.

A part touches with one place, which moves over it as the rock rolls: where its patches (:mod:`models.rounded.patches`)
are lowest. It is looked for from the patch that was lowest last, from neighbour to neighbour. Compiled.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from toppling.models.compiled import Array, Flags, Indices, Vector, inner
from toppling.models.ground.pairs import moved_m
from toppling.models.ground.rigid import dot, plus, rotation_of, turned
from toppling.models.rounded.base import SINGULAR, Patches

_MOST_PATCHES = 200
"""Maximum number of patches that the search for the lowest place crosses."""

_LOWER_SHARE = 1e-13
"""Difference in height, over the distance from the centre of mass, below which a neighbour is as low."""


class RollingSurface(NamedTuple):
    """Patches of a rock in body axes; parts without any where it has none."""

    corners: Array  # (k, 3, 3)
    bulges: Array  # (k, 3, 3)
    neighbours: Indices  # (k, 3), -1 where the part ends
    sharp: Flags  # (k, 3): ends in a crease
    vertices: Indices  # (k, 3)
    first: Indices  # patches around vertex i: around[first[i]:first[i + 1]]
    around: Indices
    points: Array  # (p, 3)
    creases: Indices  # (c, 2): patch, edge
    lowest: Indices  # (r,): patch that was lowest last, of each part
    fractions: Array  # (3,): where a patch is lowest
    down: Array  # (3,): of the plane, body axes
    seen: Array  # (9,): pose in which creases and points were looked at, their least gap, and their farthest point


NO_ROLLING = RollingSurface(
    np.zeros((0, 3, 3)), np.zeros((0, 3, 3)), np.zeros((0, 3), np.int64), np.zeros((0, 3), bool),
    np.zeros((0, 3), np.int64), np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 3)),
    np.zeros((0, 2), np.int64), np.zeros(0, np.int64), np.zeros(3), np.zeros(3), np.zeros(9),
)  # fmt: skip
"""Rolling surface of a rock that has none."""


def rolling_surface(patches: Patches, com_m: Array, scene_from_body: Array) -> RollingSurface:
    """Patches of a rock as compiled code reads them."""
    body_m = (patches.vertices_m - com_m) @ scene_from_body
    creases = np.ascontiguousarray(np.argwhere(patches.sharp))
    farthest_m = float(np.linalg.norm(body_m, axis=1).max())
    return RollingSurface(
        body_m[patches.corners], patches.bulges_m @ scene_from_body, patches.neighbours, patches.sharp, patches.corners,
        *patches.around, body_m[patches.points], creases, patches.parts.copy(), np.zeros(3), np.zeros(3),
        np.append(np.zeros(8), farthest_m),
    )  # fmt: skip


@inner
def rolling_contacts(rock: RollingSurface, pose: Array, margin_m: float, turn: Array, out: Any) -> int:
    """Contacts with gaps up to a margin, in a pose (7,); how many."""
    rotation_of(pose, turn)
    for k in range(3):
        rock.down[k] = -turn[2, k]
    count = 0
    for part in range(len(rock.lowest)):
        rock.lowest[part], on_crease = follow(rock, rock.lowest[part])
        if not on_crease:
            place = placed_on(rock, rock.lowest[part])
            count = _add(out, count, part, plus(pose, 1.0, turned(turn, place)), margin_m, pose)
    if moved_m(rock.seen, pose, rock.seen[8]) + margin_m < rock.seen[7]:
        return count
    for k in range(7):
        rock.seen[k] = pose[k]
    rock.seen[7] = np.inf
    key = len(rock.lowest)
    for k in range(len(rock.creases)):
        patch, edge = rock.creases[k, 0], rock.creases[k, 1]
        if lowest_within(rock, patch, edge):
            place = plus(pose, 1.0, turned(turn, placed_on(rock, patch)))
            rock.seen[7] = min(rock.seen[7], place[2])
            count = _add(out, count, key + k, place, margin_m, pose)
    key += len(rock.creases)
    for k in range(len(rock.points)):
        point = rock.points[k]
        gap = pose[2] - dot(rock.down, point)
        rock.seen[7] = min(rock.seen[7], gap)
        if gap < margin_m:
            count = _add(out, count, key + k, plus(pose, 1.0, turned(turn, point)), margin_m, pose)
    return count


@inner
def _add(out: Any, count: int, key: int, place: Vector, margin_m: float, pose: Array) -> int:
    """Note a contact with a place of the rock if it is near the plane and there is room."""
    if not -margin_m < place[2] < margin_m or count == len(out):
        return count
    contact = out[count]
    contact.key, contact.gap_m, contact.lands, contact.floor_m_s = key, place[2], 0, 0.0
    for k in range(3):
        contact.normal[k], contact.place_m[k], contact.arm_m[k] = 0.0, place[k], place[k] - pose[k]
        contact.impulse[k] = 0.0
    contact.normal[2] = 1.0
    return count + 1


@inner
def placed_on(rock: RollingSurface, patch: int) -> Vector:
    """Place on a patch, body axes, with the present shares of its corners."""
    s, p, b = rock.fractions, rock.corners[patch], rock.bulges[patch]
    ab, bc, ca = s[0] * s[1], s[1] * s[2], s[2] * s[0]
    return (
        s[0] * p[0, 0] + s[1] * p[1, 0] + s[2] * p[2, 0] + ab * b[0, 0] + bc * b[1, 0] + ca * b[2, 0],
        s[0] * p[0, 1] + s[1] * p[1, 1] + s[2] * p[2, 1] + ab * b[0, 1] + bc * b[1, 1] + ca * b[2, 1],
        s[0] * p[0, 2] + s[1] * p[1, 2] + s[2] * p[2, 2] + ab * b[0, 2] + bc * b[1, 2] + ca * b[2, 2],
    )


@inner
def follow(rock: RollingSurface, patch: int) -> tuple[int, bool]:
    """Find the patch that is lowest, from one of its part, and the shares there; whether that is on a crease."""
    far = 0.0
    for _ in range(_MOST_PATCHES):
        far = _lowest(rock, patch)
        a, b, c = rock.fractions[0], rock.fractions[1], rock.fractions[2]
        better, most = -1, far + _LOWER_SHARE * abs(far)
        if a > 0.0 and b > 0.0 and c > 0.0:
            break
        for k in range(3):
            after = (k + 1) % 3
            if rock.fractions[k] == 1.0:
                vertex = rock.vertices[patch, k]
                for place in range(rock.first[vertex], rock.first[vertex + 1]):
                    other = _lowest(rock, rock.around[place])
                    if other > most:
                        better, most = rock.around[place], other
            elif rock.fractions[k] > 0.0 and rock.fractions[after] > 0.0 and rock.neighbours[patch, k] >= 0:
                other = _lowest(rock, rock.neighbours[patch, k])
                if other > most:
                    better, most = rock.neighbours[patch, k], other
            rock.fractions[0], rock.fractions[1], rock.fractions[2] = a, b, c
        if better < 0:
            break
        patch = better
    on_crease = False
    for k in range(3):
        on_crease = on_crease or (rock.sharp[patch, k] and rock.fractions[(k + 2) % 3] == 0.0)
    return patch, on_crease


@inner
def _lowest(rock: RollingSurface, patch: int) -> float:
    """How far down a patch reaches from the centre of mass, and the shares there, as `patches.highest` finds them."""
    d, s, corners, bulges = rock.down, rock.fractions, rock.corners[patch], rock.bulges[patch]
    p, q, r = dot(d, corners[0]), dot(d, corners[1]), dot(d, corners[2])
    m, n, o = dot(d, bulges[0]), dot(d, bulges[1]), dot(d, bulges[2])
    if m > 0.0 and o > 0.0:
        both, right, up, size = n - m - o, q - p + m, r - p + o, 4.0 * m * o
        det = size - both * both
        t, u = 2.0 * o * right + both * up, 2.0 * m * up + both * right
        if det > SINGULAR * size and t >= 0.0 and u >= 0.0 and t + u <= det:
            t, u = t / det, u / det
            s[0], s[1], s[2] = 1.0 - t - u, t, u
            return s[0] * p + t * q + u * r + s[0] * t * m + t * u * n + u * s[0] * o
    a, at_a = _edge(p, q, m)
    b, at_b = _edge(q, r, n)
    c, at_c = _edge(r, p, o)
    if at_a >= at_b and at_a >= at_c:
        s[0], s[1], s[2] = 1.0 - a, a, 0.0
        return at_a
    if at_b >= at_c:
        s[0], s[1], s[2] = 0.0, 1.0 - b, b
        return at_b
    s[0], s[1], s[2] = c, 0.0, 1.0 - c
    return at_c


@inner
def _edge(start: float, end: float, bulge: float) -> tuple[float, float]:
    """Share of the end at which an edge reaches farthest, and how far."""
    share = 1.0 if end > start else 0.0
    if bulge > 0.0:
        share = min(max((end - start + bulge) / (2.0 * bulge), 0.0), 1.0)
    return share, start + share * (end - start) + share * (1.0 - share) * bulge


@inner
def lowest_within(rock: RollingSurface, patch: int, edge: int) -> bool:
    """Whether an edge is lowest between its ends, which are points; the shares of the corners there."""
    after = (edge + 1) % 3
    start, end = dot(rock.down, rock.corners[patch, edge]), dot(rock.down, rock.corners[patch, after])
    share, _ = _edge(start, end, dot(rock.down, rock.bulges[patch, edge]))
    rock.fractions[0] = rock.fractions[1] = rock.fractions[2] = 0.0
    rock.fractions[edge], rock.fractions[after] = 1.0 - share, share
    return 0.0 < share < 1.0
