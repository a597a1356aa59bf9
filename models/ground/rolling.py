"""Contacts of a rock with a rounded base with the plane z = 0: the lowest place of each smooth part, and points.

A part touches with one place, which moves over it and along its border as the rock rolls: where its patches
(:mod:`models.smooth_mesh`) are lowest. It is looked for from the patch that was lowest last, from neighbour to
neighbour. Compiled.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from toppling.models.compiled import Array, Indices, Vector, inner
from toppling.models.ground.pairs import moved_m
from toppling.models.ground.rigid import dot, minus, plus, rotation_of, turned
from toppling.models.smooth_mesh import SINGULAR, Patches

_MOST_PATCHES = 200
"""Maximum number of patches that the search for the lowest place crosses."""

_LOWER_SHARE = 1e-13
"""Difference in height, over the distance from the centre of mass, below which a neighbour is as low."""

FIRST_KEY = 4 << 60
"""First key of the contacts of smooth parts; on facets by part, facets and then edges."""

_ONE_WAY = math.cos(math.radians(4.0))
"""Cosine between the normals of a part and of its triangles where it touches: those turn by no more from one to the
next."""

_ONE_PLACE = 0.005
"""Distance from the contact of a part, over that of the farthest vertex, within which vertices belong to its rim."""


class RollingSurface(NamedTuple):
    """Patches of a rock in body axes; parts without any where it has none."""

    corners: Array  # (k, 3, 3)
    bulges: Array  # (k, 3, 3)
    neighbours: Indices  # (k, 3), -1 where the part ends
    vertices: Indices  # (k, 3)
    first: Indices  # patches around vertex i: around[first[i]:first[i + 1]]
    around: Indices
    points: Array  # (p, 3)
    lowest: Indices  # (r,): patch that was lowest last, of each part
    fractions: Array  # (3,): where a patch is lowest
    down: Array  # (3,): of the plane, body axes
    seen: Array  # (9,): pose in which points were looked at, their least gap, and their farthest point


NO_ROLLING = RollingSurface(
    np.zeros((0, 3, 3)), np.zeros((0, 3, 3)), np.zeros((0, 3), np.int64), np.zeros((0, 3), np.int64),
    np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros(0, np.int64), np.zeros(3), np.zeros(3),
    np.zeros(9),
)  # fmt: skip
"""Rolling surface of a rock that has none."""


def rolling_surface(patches: Patches, com_m: Array, scene_from_body: Array) -> RollingSurface:
    """Patches of a rock as compiled code reads them."""
    body_m = (patches.vertices_m - com_m) @ scene_from_body
    farthest_m = float(np.linalg.norm(body_m, axis=1).max())
    return RollingSurface(
        body_m[patches.corners], patches.bulges_m @ scene_from_body, patches.neighbours, patches.corners,
        *patches.around, body_m[patches.points], patches.parts.copy(), np.zeros(3), np.zeros(3),
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
        rock.lowest[part] = follow(rock, rock.lowest[part])
        place = placed_on(rock, rock.lowest[part])
        count = _add(out, count, FIRST_KEY + part, plus(pose, 1.0, turned(turn, place)), margin_m, pose)
    if moved_m(rock.seen, pose, rock.seen[8]) + margin_m < rock.seen[7]:
        return count
    for k in range(7):
        rock.seen[k] = pose[k]
    rock.seen[7] = np.inf
    for k in range(len(rock.points)):
        point = rock.points[k]
        gap = pose[2] - dot(rock.down, point)
        rock.seen[7] = min(rock.seen[7], gap)
        if gap < margin_m:
            count = _add(out, count, k, plus(pose, 1.0, turned(turn, point)), margin_m, pose)
    return without_rims_of_what_touches(rock.seen[8], out, count)


@inner
def without_rims_of_what_touches(farthest_m: float, out: Any, count: int) -> int:
    """Leave out contacts beside the place where a smooth part touches: how many are left.

    A convex part touches a plane at one place. Its rim, nearly there, is within what counts as touching before the rock
    has rolled to it, and would hold the rock as if it had.
    """
    near_m, remaining = _ONE_PLACE * farthest_m, 0
    for i in range(count):
        contact, nearby = out[i], False
        if contact.key < FIRST_KEY:
            for k in range(count):
                if out[k].key >= FIRST_KEY and dot(out[k].normal, contact.normal) > _ONE_WAY:
                    along = minus(out[k].arm_m, contact.arm_m)
                    nearby = nearby or dot(along, along) < near_m**2
        if not nearby:
            if i != remaining:
                out[remaining] = contact
            remaining += 1
    return remaining


@inner
def _add(out: Any, count: int, key: int, place: Vector, margin_m: float, pose: Array) -> int:
    """Note a contact with a place of the rock if it is near the plane and there is room."""
    if not -margin_m < place[2] < margin_m or count == len(out):
        return count
    contact = out[count]
    contact.key, contact.gap_m, contact.lands, contact.floor_m_s = key, place[2], 0, 0.0
    for k in range(3):
        contact.normal[k], contact.place_m[k], contact.arm_m[k] = 0.0, place[k], place[k] - pose[k]
        contact.impulse[k] = contact.slip_m_s[k] = 0.0
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
def follow(rock: RollingSurface, patch: int) -> int:
    """Find the patch that is lowest, from one of its part, and the shares there."""
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
    return patch


@inner
def _lowest(rock: RollingSurface, patch: int) -> float:
    """How far down a patch reaches from the centre of mass, and the shares there."""
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
