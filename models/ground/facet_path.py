"""Quasi-static path of a rock over the facets of its hull. Compiled.

A horizontal ground acceleration a grows so slowly that the rock's inertia relative to the ground is negligible until it
is unseated. At rest it is in an equilibrium under the effective gravity g - a, on a set of its hull's vertices whose
convex hull contains the point where the line of action through the centre of mass pierces the plane. An equilibrium on
a vertex or an edge is that of an inverted pendulum and never stable, so the path goes from facet to facet of the convex
hull: a facet is stable until the piercing point crosses its border. There the rock falls about the edge (or vertex)
nearest to the piercing point, rolling without slip or spin, onto another facet. What its landing leaves of the energy
of the fall carries it over the next edge if it is enough for the way up to the balance; else the rock rests there, or
falls on. If no facet is stable and reached at rest, it topples. A smooth base is the limit of fine facets, whose path
ends at the limit point of the equilibria of the potential -g_eff . x_com. For a sharp-edged flat base it is the formula
of Anooshehpoor, Brune and Zeng (2004), g tan(alpha), extended to three dimensions (moments about each edge) and to
slopes (gravity in the plane's frame).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from toppling.models.compiled import Array, Indices, Vector, compiled, inner
from toppling.models.frames import horizontal_unit_vector, plane_axes
from toppling.models.ground.rigid import dot, minus, plus, turned, turned_back
from toppling.models.pedestal import (
    CONTACT_SHARE_OF_HEIGHT,
    FARTHEST_SETTLING,
    TOPPLED_FALL,
    TOPPLED_TILT_DEG,
    Pedestal,
)
from toppling.models.relief import contact_feet_m
from toppling.models.rock import Rock

_VERTEX_STEP_RAD = 2e-3  # rotation about a single vertex between updates of the direction of fall
_PAST_THE_EDGE = 1e-9  # relative excess of the acceleration over lift-off, which sets the direction of fall
_ROUNDING = 1e-12  # relative tolerance of a moment for equilibrium
_LEAST_UPWARD = math.cos(math.radians(TOPPLED_TILT_DEG))


class _Turn(NamedTuple):
    """A rotation over an edge or vertex: a point of its axis in the plane, and the unit vector across it, outward."""

    pivot: tuple[float, float]
    out: tuple[float, float]


class _Rolling(NamedTuple):
    """Hull vertices and centre of mass in the plane's frame (z normal to it, 0 in it), and a pose on their path."""

    points: Array  # (n, 3), at the start
    com: Array  # (3,)
    inertia_m2: Array  # (3, 3): over mass, at the start
    tolerance_m: float
    moved: Array  # (n, 3): points in the pose
    turn: Array  # (3, 3): from the start
    shift: Array  # (3,)
    ring: Array  # (n, 2): counter-clockwise support polygon, or the one or two ends of the contact
    sorted: Array  # (2 n, 2): room for its corners
    corners: Indices  # (1,): of the ring


@dataclass(frozen=True)
class Seat:
    """A rock in its scene's pose, with its support."""

    points: Array  # (n, 3): what can touch, in the plane's frame, the lowest at 0
    com: Array  # (3,)
    frame: Array  # rows: axes of the plane and its normal, scene frame
    inertia_m2: Array  # (3, 3): over mass, in that frame
    tolerance_m: float
    farthest_m: float  # that it may settle

    @classmethod
    def of(cls, rock: Rock, pedestal: Pedestal) -> Seat:
        """Seat of a rock on its points of contact with the plane."""
        frame = np.vstack([*plane_axes(pedestal.normal), pedestal.normal])
        points = (contact_feet_m(rock, pedestal) - pedestal.point_m) @ frame.T
        lowest = np.array([0.0, 0.0, points[:, 2].min()])
        com = (rock.com_m - pedestal.point_m) @ frame.T - lowest
        inertia_m2 = frame @ rock.inertia_per_mass_m2 @ frame.T
        tolerances = np.array([CONTACT_SHARE_OF_HEIGHT, FARTHEST_SETTLING])
        return cls(points - lowest, com, frame, inertia_m2, *(tolerances * rock.height_m))

    def path(self, gravity_m_s2: float, azimuth_deg: float) -> tuple[float, float]:
        """Accelerations at lift-off and at toppling; both 0 for a rock that does not stand where it is."""
        left = [acceleration for *_, acceleration in self.rests(gravity_m_s2, azimuth_deg)]
        return (left[0], left[-1]) if left else (0.0, 0.0)

    def rests(self, gravity_m_s2: float, azimuth_deg: float) -> Iterator[tuple[Array, Array, float]]:
        """Stable poses on the path: rotation (3, 3) and shift (3,) from the start, and the acceleration each bears.

        None where the first, in which the rock settles, is not near the start.
        """
        gravity = self.frame @ np.array([0.0, 0.0, -gravity_m_s2])
        push = -self.frame @ horizontal_unit_vector(azimuth_deg)
        rolling = self._rolling()
        acceleration = _next_rest(rolling, gravity, push, -1.0)
        settled_m = rolling.turn @ self.com + rolling.shift - self.com
        if np.linalg.norm(settled_m) > self.farthest_m:
            return
        while acceleration >= 0.0:
            yield rolling.turn.copy(), rolling.shift.copy(), acceleration
            acceleration = _next_rest(rolling, gravity, push, acceleration)

    def _rolling(self) -> _Rolling:
        points, count = np.ascontiguousarray(self.points), len(self.points)
        return _Rolling(
            points, self.com, self.inertia_m2, self.tolerance_m, points.copy(), np.eye(3), np.zeros(3),
            np.empty((count, 2)), np.empty((2 * count, 2)), np.zeros(1, np.int64),
        )  # fmt: skip


@compiled
def _next_rest(rock: _Rolling, gravity: Array, push: Array, left_m_s2: float) -> float:
    """Roll to the next stable pose, from the start (-1), or from one that is left at an acceleration.

    Returns the acceleration at which that is left; -1 if the rock topples, or if none unseated it.
    """
    weight = gravity[0], gravity[1], gravity[2]
    if left_m_s2 < 0.0:
        _touch(rock)
    elif left_m_s2 == np.inf:
        return -1.0
    else:
        g = math.sqrt(gravity[0] ** 2 + gravity[1] ** 2 + gravity[2] ** 2)
        past = _PAST_THE_EDGE * (left_m_s2 + g)
        weight = plus(gravity, left_m_s2 + past, push)
        while _holds(rock, weight):  # an edge along the push
            past *= 2.0
            weight = plus(gravity, left_m_s2 + past, push)
    if weight[2] >= 0.0:
        return -1.0
    motion, energy = _Turn((0.0, 0.0), (0.0, 0.0)), 0.0  # per mass
    while rock.turn[2, 2] >= _LEAST_UPWARD and _com(rock)[2] >= (1.0 - TOPPLED_FALL) * rock.com[2]:
        about, retained = _onward(rock, motion)
        angle = _landing(rock, about)
        if energy * retained <= _climb(rock, about, angle, weight):
            if _holds(rock, weight):
                return _leaves(rock, gravity, push, max(left_m_s2, 0.0))
            about, on_vertex = _falls_about(rock, weight)
            retained, angle = _retained_share(rock, motion, about), _landing(rock, about)
            if on_vertex:
                angle = min(angle, max(0.25 * angle, _VERTEX_STEP_RAD))
        before = _com(rock)
        _roll(rock, about, angle)
        if left_m_s2 >= 0.0:  # a rock as scanned settles without speed
            motion, energy = about, max(energy * retained + dot(weight, minus(_com(rock), before)), 0.0)
        _touch(rock)
    return -1.0


@inner
def _reach(rock: _Rolling, turn: _Turn) -> float:
    """Distance of the centre of mass beyond an axis."""
    com = _com(rock)
    return turn.out[0] * (com[0] - turn.pivot[0]) + turn.out[1] * (com[1] - turn.pivot[1])


@inner
def _retained_share(rock: _Rolling, before: _Turn, after: _Turn) -> float:
    """Share of its energy that a rock keeps where one rotation becomes another; 0 against its motion.

    No contact that lands slips or rebounds, so their impulses do no work on the motion after.
    """
    first, then = _motion(rock, before), _motion(rock, after)
    product, size = _product(rock, first, then), _product(rock, first, first) * _product(rock, then, then)
    return product**2 / size if product > 0.0 else 0.0


@inner
def _motion(rock: _Rolling, turn: _Turn) -> tuple[Vector, Vector]:
    """Velocities of the centre of mass, across the axis, and of rotation, in the axes of the start."""
    out, height = turn.out, _com(rock)[2]
    velocity = height * out[0], height * out[1], -_reach(rock, turn)
    return velocity, turned_back(rock.turn, (-out[1], out[0], 0.0))


@inner
def _product(rock: _Rolling, first: tuple[Vector, Vector], other: tuple[Vector, Vector]) -> float:
    """Product of two motions in the rock's kinetic energy."""
    return dot(first[0], other[0]) + dot(turned(rock.inertia_m2, first[1]), other[1])


@inner
def _onward(rock: _Rolling, motion: _Turn) -> tuple[_Turn, float]:
    """The rotation with which a rock goes on as it turned, and the share of its energy that it keeps.

    About an edge of its support, or as before, over the farthest of its corners.
    """
    best, most, corners, far = motion, -1.0, rock.corners[0], -np.inf
    for k in range(corners):
        corner = rock.ring[k, 0], rock.ring[k, 1]
        reach = corner[0] * motion.out[0] + corner[1] * motion.out[1]
        if reach > far:
            far, best = reach, _Turn(corner, motion.out)
    most = _retained_share(rock, motion, best)
    for k in range(corners if corners > 1 else 0):
        right, up = _edge(rock, k)
        length = math.hypot(right, up)
        if length > 0.0:
            edge = _Turn((rock.ring[k, 0], rock.ring[k, 1]), (up / length, -right / length))
            share = _retained_share(rock, motion, edge)
            if share > most:
                best, most = edge, share
    return best, most


@inner
def _climb(rock: _Rolling, about: _Turn, angle: float, weight: Vector) -> float:
    """Energy per mass that a rotation takes to where it is in balance, or ends; infinite where the force turns it."""
    reach, height = _reach(rock, about), _com(rock)[2]
    out, down = about.out[0] * weight[0] + about.out[1] * weight[1], -weight[2]
    to_balance = math.atan2(-out * height - down * reach, down * height - out * reach)
    if to_balance <= 0.0:
        return np.inf
    turned_rad = min(angle, to_balance)
    sine, versed = math.sin(turned_rad), 1.0 - math.cos(turned_rad)
    return out * (versed * reach - sine * height) - down * (versed * height + sine * reach)


@inner
def _com(rock: _Rolling) -> Vector:
    return plus(rock.shift, 1.0, turned(rock.turn, rock.com))


@inner
def _edge(rock: _Rolling, k: int) -> tuple[float, float]:
    start, end = rock.ring[k], rock.ring[(k + 1) % rock.corners[0]]
    return end[0] - start[0], end[1] - start[1]


@inner
def _moment(rock: _Rolling, k: int, com: Vector, force: Vector) -> float:
    """Stabilising moment of a force on the centre of mass about an edge of the support."""
    right, up = _edge(rock, k)
    twice_area = (com[0] - rock.ring[k, 0]) * up - (com[1] - rock.ring[k, 1]) * right
    return (com[2] * (right * force[1] - up * force[0]) + twice_area * force[2]) / math.hypot(right, up)


@inner
def _holds(rock: _Rolling, weight: Vector) -> bool:
    com = _com(rock)
    rounding = -_ROUNDING * com[2] * math.sqrt(weight[0] ** 2 + weight[1] ** 2 + weight[2] ** 2)
    holds = rock.corners[0] > 2 and weight[2] < 0.0
    for k in range(rock.corners[0] if holds else 0):
        holds = holds and _moment(rock, k, com, weight) >= rounding
    return holds


@inner
def _leaves(rock: _Rolling, gravity: Array, push: Array, least: float) -> float:
    """Smallest acceleration, at least `least`, at which the moment about an edge vanishes."""
    root, com = np.inf, _com(rock)
    for k in range(rock.corners[0]):
        change = _moment(rock, k, com, (push[0], push[1], push[2]))
        if change < 0.0:
            root = min(root, -_moment(rock, k, com, (gravity[0], gravity[1], gravity[2])) / change)
    return max(root, least)


@inner
def _landing(rock: _Rolling, about: _Turn) -> float:
    """Angle of a rotation about an edge or vertex at which another point lands."""
    # A touching point behind the pivot is at an angle of pi and rises: it cannot be the next contact.
    across, over, (pivot, out) = -1.0, 0.0, about
    for k in range(len(rock.moved)):
        point = rock.moved[k]
        reach = (point[0] - pivot[0]) * out[0] + (point[1] - pivot[1]) * out[1]
        height = max(point[2], 0.0)
        if reach * over > across * height and reach**2 + point[2] ** 2 > rock.tolerance_m**2:
            across, over = reach, height
        elif height == 0.0 and reach > rock.tolerance_m:
            across, over = 1.0, 0.0
    return math.atan2(over, across)


@inner
def _roll(rock: _Rolling, about: _Turn, angle: float) -> None:
    """Turn about an edge or vertex."""
    pivot, out = about
    sine, versed = math.sin(angle), 1.0 - math.cos(angle)
    i, j, turn, shift = -out[1], out[0], rock.turn, rock.shift  # axis of rotation
    rows = (
        (1.0 - versed * j * j, versed * i * j, sine * j),
        (versed * i * j, 1.0 - versed * i * i, -sine * i),
        (-sine * j, sine * i, 1.0 - versed),
    )
    shift[0], shift[1] = shift[0] - pivot[0], shift[1] - pivot[1]
    shift[0], shift[1], shift[2] = dot(rows[0], shift), dot(rows[1], shift), dot(rows[2], shift)
    shift[0], shift[1] = shift[0] + pivot[0], shift[1] + pivot[1]
    for k in range(3):
        turn[0, k], turn[1, k], turn[2, k] = (
            dot(rows[0], turn[:, k]),
            dot(rows[1], turn[:, k]),
            dot(rows[2], turn[:, k]),
        )
    for k in range(len(rock.moved)):
        place = plus(shift, 1.0, turned(turn, rock.points[k]))
        rock.moved[k, 0], rock.moved[k, 1], rock.moved[k, 2] = place


@inner
def _falls_about(rock: _Rolling, weight: Vector) -> tuple[_Turn, bool]:
    """The axis at the point of the support nearest to the piercing point, and whether that point is a vertex."""
    com = _com(rock)
    x, y = com[0] - weight[0] * com[2] / weight[2], com[1] - weight[1] * com[2] / weight[2]
    corners, ring, least = rock.corners[0], rock.ring, np.inf
    pivot, on_edge, along = (ring[0, 0], ring[0, 1]), False, (0.0, 0.0)
    for k in range(corners if corners > 1 else 0):
        right, up = _edge(rock, k)
        ahead, aside = x - ring[k, 0], y - ring[k, 1]
        if corners > 2 and right * aside - up * ahead >= 0.0:  # on its inner side
            continue
        squared = right * right + up * up  # 0 between two places that coincide
        share = (ahead * right + aside * up) / (squared if squared > 0.0 else 1.0)
        inside, share = 0.0 < share < 1.0, min(max(share, 0.0), 1.0)
        at = ring[k, 0] + share * right, ring[k, 1] + share * up
        distance = (x - at[0]) ** 2 + (y - at[1]) ** 2
        if distance < least:
            least, pivot, on_edge, along = distance, at, inside, (right, up)
    away = x - pivot[0], y - pivot[1]
    if on_edge:
        length = math.hypot(along[0], along[1])
        sign = 1.0 if along[1] * away[0] - along[0] * away[1] >= 0.0 else -1.0
        return _Turn(pivot, (sign * along[1] / length, -sign * along[0] / length)), False
    length = math.hypot(away[0], away[1])
    return _Turn(pivot, (away[0] / length, away[1] / length) if length > 0.0 else (1.0, 0.0)), True


@inner
def _touch(rock: _Rolling) -> None:
    """Find the support polygon in the pose; of contacts in one line, within the tolerance, their two ends."""
    lowest, count, ring, work = np.inf, 0, rock.ring, rock.sorted
    for k in range(len(rock.moved)):
        lowest = min(lowest, rock.moved[k, 2])
    for k in range(len(rock.moved)):
        if rock.moved[k, 2] <= lowest + rock.tolerance_m:
            ring[count, 0], ring[count, 1] = rock.moved[k, 0], rock.moved[k, 1]
            count += 1
    rock.corners[0] = count
    if count < 3:
        return
    _sort(ring, count)
    corners = 0
    for upward in (False, True):  # the lower chain, and the upper one back (Andrew 1979)
        start = corners
        for k in range(count):
            place = ring[count - 1 - k if upward else k]
            while corners > start + 1 and _left(work[corners - 2], work[corners - 1], place) <= 0.0:
                corners -= 1
            work[corners, 0], work[corners, 1] = place[0], place[1]
            corners += 1
        corners -= 1
    rock.corners[0] = corners
    for k in range(corners):
        ring[k, 0], ring[k, 1] = work[k, 0], work[k, 1]
    first, _ = _farthest(rock, 0)
    other, length = _farthest(rock, first)
    for k in range(corners):
        if abs(_left(work[first], work[other], work[k])) > rock.tolerance_m * length:
            return
    rock.corners[0] = 2
    ring[0, 0], ring[0, 1] = work[first, 0], work[first, 1]
    ring[1, 0], ring[1, 1] = work[other, 0], work[other, 1]


@inner
def _farthest(rock: _Rolling, corner: int) -> tuple[int, float]:
    """The corner that is farthest from another, and how far."""
    far, most = corner, 0.0
    for k in range(rock.corners[0]):
        away = math.hypot(rock.ring[k, 0] - rock.ring[corner, 0], rock.ring[k, 1] - rock.ring[corner, 1])
        if away > most:
            far, most = k, away
    return far, most


@inner
def _sort(places: Array, count: int) -> None:
    """Sort the first of some places (n, 2) by x, then y (Shell 1959)."""
    step = 1
    while 3 * step < count:
        step = 3 * step + 1
    while step > 0:
        for k in range(step, count):
            x, y, at = places[k, 0], places[k, 1], k
            while at >= step and (places[at - step, 0], places[at - step, 1]) > (x, y):
                places[at, 0], places[at, 1] = places[at - step, 0], places[at - step, 1]
                at -= step
            places[at, 0], places[at, 1] = x, y
        step //= 3


@inner
def _left(a: Array, b: Array, c: Array) -> float:
    """Twice the area of a triangle of places (2,); positive where the way a, b, c turns left."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
