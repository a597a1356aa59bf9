"""Quasi-static path of a rock over the facets of its hull. Compiled.

A horizontal ground acceleration a grows so slowly that the rock's inertia relative to the ground is negligible until it
is unseated. At rest it is in an equilibrium under the effective gravity g - a, on a set of its hull's vertices whose
convex hull contains the point where the line of action through the centre of mass pierces the plane. An equilibrium on
a vertex or an edge is that of an inverted pendulum and never stable, so the path goes from facet to facet of the convex
hull: a facet is stable until the piercing point crosses its border. There the rock falls about that edge onto another
facet. Neither a rolling contact nor an impact without rebound adds energy, so a rock on a stable facet whose energy is
less than it takes over any of its edges comes to rest there. Else it is followed by the time steps and impacts of the
shakes, without slip, until that is so, it rests, or it has toppled. A smooth base is the limit of fine facets, whose
path ends at the limit point of the equilibria of the potential -g_eff . x_com. For a sharp-edged flat base it is the
formula of Anooshehpoor, Brune and Zeng (2004), g tan(alpha), extended to three dimensions (moments about each edge) and
to slopes (gravity in the plane's frame).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from toppling.models.compiled import Array, Indices, Vector, compiled, inner
from toppling.models.errors import InputError
from toppling.models.frames import horizontal_unit_vector, plane_axes
from toppling.models.ground.plane import ENDLESS, plane_points
from toppling.models.ground.rigid import (
    copy,
    dot,
    kinetic_j_kg,
    minus,
    move,
    plus,
    rotation_of,
    square,
    turned,
    turned_back,
)
from toppling.models.ground.stepping import Grounded, step, unmoved
from toppling.models.pedestal import (
    CONTACT_SHARE_OF_HEIGHT,
    FARTHEST_SETTLING,
    LARGEST_OPEN_TILT_DEG,
    TOPPLED_FALL,
    TOPPLED_TILT_DEG,
    Pedestal,
)
from toppling.models.relief import contact_feet_m
from toppling.models.rock import Rock

_STEPS_OF_FALL = 48
"""Number of steps of a fall within sqrt(R / g): twice as many change 5 of 115 azimuths of random rocks by over 1 %."""

_LONGEST_FALL = 30
"""Number of such times after which a rock that still rocks is let down; three times as many change 4 by over 1 %."""

_RESOLVED, _STILL = 1e-4, 1e-5
"""Speeds over sqrt(g R) of a contact that is stopped at a step's end, of which ten times as much changes none by over
1 %, and of a rock at rest."""

_SEATED = 1e-3  # tolerance, over that of contacts, with which the steps' last pose is let down onto its facet
_LITTLE = 1e-4
"""Energy over g and the height of the centre of mass with which a rock comes to rest without turning about the normal:
a tenth of it changes none by over .2 %, ten times as much 3 by up to 8 %."""

_BEARS = 1e-4
"""Acceleration over gravity that a rest after a fall bears beyond that at which the rock fell. A rock that rocks back
to the balance that it fell from is at rest there, and would fall from it without end, turning by 1e-5 degrees."""

_MOST_RESTS = 1200
"""Rests, at most, on the path of one azimuth."""

NO_SLIP = 30.0
"""Friction without slip."""

_VERTEX_STEP_RAD = 2e-3  # rotation about a single vertex between updates of the direction of fall
_PAST_THE_EDGE = 1e-9  # relative excess of the acceleration over lift-off, which sets the direction of fall
_ROUNDING = 1e-12  # relative tolerance of moments and energies
_LEAST_UPWARD, _LEAST_OPEN = (
    math.cos(math.radians(tilt)) for tilt in (TOPPLED_TILT_DEG, LARGEST_OPEN_TILT_DEG)
)
_TOPPLES, _OPEN = -1.0, -2.0  # instead of the acceleration at which a rest is left


class _Turn(NamedTuple):
    """A rotation over an edge or vertex: a point of its axis in the plane, and the unit vector across it, outward."""

    pivot: tuple[float, float]
    out: tuple[float, float]


class Hull(NamedTuple):
    """Vertices of a rock's hull, in body axes from the centre of mass, and a pose of it over the plane z = 0."""

    points: Array  # (n, 3)
    upright: Array  # (3,): normal of the plane at the start
    inertia_m2: Array  # (3,): principal moments over mass
    tolerance_m: float
    least_m: float  # height of the centre of mass below which it has fallen
    pose: Array  # (7,): centre of mass, attitude as a quaternion x, y, z, w
    com: Array  # (3,): of the pose
    turn: Array  # (3, 3): its rotation
    moved: Array  # (n, 3): points
    ring: Array  # (n, 2): counter-clockwise support polygon, or the one or two ends of the contact
    touching: Array  # (n, 2): places of contact
    corners: Indices  # (1,): of the ring


def _hull(points: Array, upright: Array, inertia_m2: Array, tolerance_m: float, least_m: float) -> Hull:
    count, pose = len(points), np.zeros(7)
    return Hull(
        points, upright, inertia_m2, tolerance_m, least_m, pose, pose[:3], np.eye(3), np.empty((count, 3)),
        np.empty((count, 2)), np.empty((count, 2)), np.zeros(1, np.int64),
    )  # fmt: skip


NO_HULL = _hull(np.zeros((0, 3)), np.zeros(3), np.zeros(3), 0.0, -np.inf)
"""That of a rock which falls on another ground than the plane z = 0."""


def unfinished(azimuth_deg: float, steps: int) -> InputError:
    """Refusal of a rock whose path does not end."""
    return InputError(
        "scene.statics_unfinished",
        f"the rock rocks over more than {steps} contacts where the ground accelerates toward {azimuth_deg:g}",
        where="statics",
        expected="meshes of rock and ground on which its way to toppling can be followed",
        remedy="simplify the meshes",
    )


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

        None where the first, in which the rock settles without speed, is not near the start.
        """
        hull, start, axes = self._hull
        gravity = self.frame @ np.array([0.0, 0.0, -gravity_m_s2])
        push, velocity = -self.frame @ horizontal_unit_vector(azimuth_deg), np.zeros(6)
        hull.pose[:] = start
        acceleration = _rest_near(hull, gravity, push, gravity, 0.0)
        if np.linalg.norm(hull.com - self.com) > self.farthest_m:
            return
        for _ in range(_MOST_RESTS):
            if acceleration < 0.0:
                return
            turn = hull.turn @ axes.T
            yield turn, hull.com - turn @ self.com, acceleration
            left_m_s2, force = acceleration, gravity.copy()
            acceleration = _next_rest(hull, gravity, push, left_m_s2, force, velocity)
            if acceleration == _OPEN:
                sim = falling_under(force, gravity_m_s2, self._falling)
                sim.pose[0], sim.velocity[0], sim.counts[:] = hull.pose, velocity, 0
                fall(sim, hull, self.frame[:, 2].copy(), np.inf, _LONGEST_FALL)
                hull.pose[:] = sim.pose[0]
                least_m_s2 = left_m_s2 + _BEARS * gravity_m_s2
                force = gravity + least_m_s2 * push
                for tolerance_m in (_SEATED * self.tolerance_m, self.tolerance_m):
                    near = hull._replace(tolerance_m=tolerance_m)
                    acceleration = _rest_near(near, gravity, push, force, least_m_s2)
        raise unfinished(azimuth_deg, _MOST_RESTS)

    @cached_property
    def _hull(self) -> tuple[Hull, Array, Array]:
        """Hull, its pose (7,) at the start, and its principal axes (columns) in the plane's frame then."""
        moments, axes = np.linalg.eigh(self.inertia_m2)
        axes[:, 0] *= np.sign(np.linalg.det(axes))
        points = np.ascontiguousarray((self.points - self.com) @ axes)
        least_m = (1.0 - TOPPLED_FALL) * self.com[2]
        start = np.concatenate([self.com, Rotation.from_matrix(axes).as_quat()])
        return _hull(points, axes[2].copy(), moments, self.tolerance_m, float(least_m)), start, axes

    @cached_property
    def _falling(self) -> Grounded:
        """The rock over the plane z = 0, to be let go."""
        hull, *_ = self._hull
        away_m = np.linalg.norm(hull.points, axis=1)
        size_m, farthest_m = float(away_m[self.points[:, 2] <= self.com[2]].max()), float(away_m.max())
        over = plane_points(hull.points, np.zeros(len(hull.points), bool), ENDLESS, as_drawn=False)
        return unmoved(over, farthest_m, hull.inertia_m2, size_m, (NO_SLIP,) * 2)


def falling_under(force_m_s2: Array, gravity_m_s2: float, sim: Grounded) -> Grounded:
    """A rock that is to fall under a constant specific force, of which gravity is the scene's."""
    step_s = math.sqrt(sim.size_m / gravity_m_s2) / _STEPS_OF_FALL
    resolved_m_s = _RESOLVED * math.sqrt(sim.size_m * gravity_m_s2)
    return sim._replace(gravity_m_s2=force_m_s2, resolved_m_s=resolved_m_s, step_s=step_s)


@compiled
def fall(sim: Grounded, hull: Hull, up: Array, farthest_m: float, longest: int) -> tuple[bool, float]:
    """Let a rock go from its latest pose and velocity: whether it comes to rest, and how far it has sunk.

    It ends at rest, on a facet of its hull that it has too little energy to leave or, where it still rocks after so
    many times sqrt(R / g), in the lowest pose that it passed, along the force. up: the plumb line, along which it sinks
    from the highest place that it passed. Beyond a distance, and the largest tilt with an open end, it is not followed.
    """
    pose, start, velocity = sim.pose[sim.counts[1]], sim.work.start, sim.velocity[sim.counts[1]]
    rests, quiet, highest_m, least = False, 0, -np.inf, np.inf
    lowest = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    copy(pose, start)
    for _ in range(longest * _STEPS_OF_FALL):
        step(sim, 0.0, pose, velocity)
        rotation_of(pose, sim.work.turn)
        quiet, highest_m = quiet + 1 if _is_slow(sim, velocity) else 0, max(highest_m, dot(pose, up))
        rests = quiet == _STEPS_OF_FALL or _is_caught(sim, hull, pose, velocity)
        tilted = turned(sim.work.turn, hull.upright)[2] < _LEAST_OPEN
        beyond = tilted or square(plus(pose, -1.0, start)) > farthest_m**2 or pose[2] < hull.least_m
        if rests or beyond:
            break
        if -dot(sim.gravity_m_s2, pose) < least:
            least = -dot(sim.gravity_m_s2, pose)
            lowest = (pose[0], pose[1], pose[2], pose[3], pose[4], pose[5], pose[6])
    else:
        for k in range(7):
            pose[k] = lowest[k]
    return rests, highest_m - dot(pose, up)


@inner
def _is_slow(sim: Grounded, velocity: Array) -> bool:
    g = math.sqrt(square(sim.gravity_m_s2))
    return square(velocity) + square(velocity[3:]) * sim.size_m**2 < _STILL**2 * g * sim.size_m


@inner
def _is_caught(sim: Grounded, hull: Hull, pose: Array, velocity: Array) -> bool:
    """Whether a moving rock comes to rest on the facet of its hull that it touches with."""
    if sim.counts[0] < 3 or len(hull.points) == 0:
        return False
    force = sim.gravity_m_s2[0], sim.gravity_m_s2[1], sim.gravity_m_s2[2]
    moving_j_kg = kinetic_j_kg(sim.work.turn, hull.inertia_m2, velocity)
    if moving_j_kg > 1.1 * _LITTLE * math.sqrt(square(force)) * pose[2]:
        return False
    copy(pose, hull.pose)
    rotation_of(pose, hull.turn)
    _move(hull)
    _touch(hull)
    over_facet_j_kg = -force[2] * (pose[2] - hull.com[2])
    return _stays(hull, force, over_facet_j_kg + moving_j_kg)


@inner
def _stays(hull: Hull, force: Vector, energy_j_kg: float) -> bool:
    """Whether a rock comes to rest on a facet, with little energy above that and less than takes it over an edge."""
    unit_j_kg = math.sqrt(square(force)) * hull.com[2]
    if energy_j_kg > _LITTLE * unit_j_kg or not _holds(hull, force):
        return False
    return energy_j_kg <= _barrier_j_kg(hull, force) + _ROUNDING * unit_j_kg


@compiled
def _next_rest(
    hull: Hull, gravity: Array, push: Array, left_m_s2: float, force: Array, velocity: Array
) -> float:
    """Roll on from a stable pose that is left at an acceleration; that at which the next is left.

    -1 if the rock topples, or if no acceleration unseats it; -2 if only steps tell, from the pose and velocity with
    which it lands, under a force.
    """
    if left_m_s2 == np.inf:
        return _TOPPLES
    g = math.sqrt(square(gravity))
    past = _PAST_THE_EDGE * (left_m_s2 + g)
    weight = plus(gravity, left_m_s2 + past, push)
    while _holds(hull, weight):  # an edge along the push
        past *= 2.0
        weight = plus(gravity, left_m_s2 + past, push)
    force[0], force[1], force[2] = weight
    if weight[2] >= 0.0:
        return _TOPPLES
    about, _ = _falls_about(hull, weight)
    before = hull.com[0], hull.com[1], hull.com[2]
    _roll(hull, about, _landing(hull, about))
    _touch(hull)
    if not _is_open(hull):
        return _TOPPLES
    energy_j_kg = max(dot(weight, plus(hull.com, -1.0, before)), 0.0)
    if _stays(hull, weight, energy_j_kg):  # its landing costs some of what leads back over the edge
        return _leaves(hull, gravity, push, left_m_s2)
    out, height = about.out, hull.com[2]
    velocity[0], velocity[1], velocity[2] = height * out[0], height * out[1], -_reach(hull, about)
    velocity[3], velocity[4], velocity[5] = -out[1], out[0], 0.0
    times = math.sqrt(energy_j_kg / kinetic_j_kg(hull.turn, hull.inertia_m2, velocity))
    for k in range(6):
        velocity[k] *= times
    return _OPEN


@compiled
def _rest_near(hull: Hull, gravity: Array, push: Array, force: Array, least_m_s2: float) -> float:
    """Roll without speed under a force to where it holds the rock; the acceleration at which that pose is left.

    It sinks along the force as it rolls; where rounding lets it sink no more it is balanced, and left at once. -1 if it
    topples.
    """
    weight, lowest = (force[0], force[1], force[2]), np.inf
    rotation_of(hull.pose, hull.turn)
    _move(hull)
    _touch(hull)
    while weight[2] < 0.0 and _is_open(hull):
        if _holds(hull, weight):
            upright = turned(hull.turn, hull.upright)[2] >= _LEAST_UPWARD
            return _leaves(hull, gravity, push, least_m_s2) if upright else _TOPPLES
        before, lowest = lowest, -dot(weight, hull.com)
        if not lowest < before:
            return least_m_s2
        about, on_vertex = _falls_about(hull, weight)
        angle = _landing(hull, about)
        if on_vertex:
            angle = min(angle, max(0.25 * angle, _VERTEX_STEP_RAD))
        _roll(hull, about, angle)
        _touch(hull)
    return _TOPPLES


@inner
def _is_open(hull: Hull) -> bool:
    """Whether a rock has neither tilted nor fallen so far that it has toppled."""
    return turned(hull.turn, hull.upright)[2] >= _LEAST_OPEN and hull.com[2] >= hull.least_m


@inner
def _barrier_j_kg(hull: Hull, force: Vector) -> float:
    """Least energy that takes a rock over an edge of its support: to its balance, or to where it lands."""
    least = np.inf
    for k in range(hull.corners[0]):
        right, up = _edge(hull, k)
        length = math.hypot(right, up)
        out = (up / length, -right / length)
        about = _Turn((hull.ring[k, 0], hull.ring[k, 1]), out)
        climb = _climb(hull, about, force, np.pi)
        if climb < least:
            least = min(least, _climb(hull, about, force, _landing(hull, about)))
    return least


@inner
def _climb(hull: Hull, about: _Turn, force: Vector, angle: float) -> float:
    """Energy per mass that a rotation by an angle takes, or less of it to where it is in balance."""
    com, out, reach = hull.com, about.out, _reach(hull, about)
    push, down = out[0] * force[0] + out[1] * force[1], -force[2]
    to_balance = math.atan2(-push * com[2] - down * reach, down * com[2] - push * reach)
    turned_rad = min(angle, max(to_balance, 0.0))
    sine, versed = math.sin(turned_rad), 1.0 - math.cos(turned_rad)
    return push * (versed * reach - sine * com[2]) - down * (versed * com[2] + sine * reach)


@inner
def _reach(hull: Hull, turn: _Turn) -> float:
    """Distance of the centre of mass beyond an axis."""
    return turn.out[0] * (hull.com[0] - turn.pivot[0]) + turn.out[1] * (hull.com[1] - turn.pivot[1])


@inner
def _edge(hull: Hull, k: int) -> tuple[float, float]:
    start, end = hull.ring[k], hull.ring[(k + 1) % hull.corners[0]]
    return end[0] - start[0], end[1] - start[1]


@inner
def _moment(hull: Hull, k: int, force: Vector) -> float:
    """Stabilising moment of a force on the centre of mass about an edge of the support."""
    (right, up), com = _edge(hull, k), hull.com
    twice_area = (com[0] - hull.ring[k, 0]) * up - (com[1] - hull.ring[k, 1]) * right
    return (com[2] * (right * force[1] - up * force[0]) + twice_area * force[2]) / math.hypot(right, up)


@inner
def _holds(hull: Hull, weight: Vector) -> bool:
    rounding = -_ROUNDING * hull.com[2] * math.sqrt(square(weight))
    holds = hull.corners[0] > 2 and weight[2] < 0.0
    for k in range(hull.corners[0] if holds else 0):
        holds = holds and _moment(hull, k, weight) >= rounding
    return holds


@inner
def _leaves(hull: Hull, gravity: Array, push: Array, least: float) -> float:
    """Smallest acceleration, at least `least`, at which the moment about an edge vanishes."""
    root = np.inf
    for k in range(hull.corners[0]):
        change = _moment(hull, k, (push[0], push[1], push[2]))
        if change < 0.0:
            root = min(root, -_moment(hull, k, (gravity[0], gravity[1], gravity[2])) / change)
    return max(root, least)


@inner
def _landing(hull: Hull, about: _Turn) -> float:
    """Angle of a rotation about an edge or vertex at which another point lands."""
    # A touching point behind the pivot is at an angle of pi and rises: it cannot be the next contact.
    across, over, (pivot, out) = -1.0, 0.0, about
    for k in range(len(hull.moved)):
        point = hull.moved[k]
        reach = (point[0] - pivot[0]) * out[0] + (point[1] - pivot[1]) * out[1]
        height = max(point[2], 0.0)
        if reach * over > across * height and reach**2 + point[2] ** 2 > hull.tolerance_m**2:
            across, over = reach, height
        elif height == 0.0 and reach > hull.tolerance_m:
            across, over = 1.0, 0.0
    return math.atan2(over, across)


@inner
def _roll(hull: Hull, about: _Turn, angle: float) -> None:
    """Turn about an edge or vertex."""
    pivot, out = (about.pivot[0], about.pivot[1], 0.0), about.out
    arm = turned_back(hull.turn, minus(pivot, hull.com))
    move(hull.pose, (0.0, 0.0, 0.0, -out[1], out[0], 0.0), angle)
    rotation_of(hull.pose, hull.turn)
    hull.com[0], hull.com[1], hull.com[2] = minus(pivot, turned(hull.turn, arm))
    _move(hull)


@inner
def _move(hull: Hull) -> None:
    """Move the points to the pose, let down so that the lowest touches."""
    lowest = np.inf
    for k in range(len(hull.moved)):
        hull.moved[k, 0], hull.moved[k, 1], hull.moved[k, 2] = plus(
            hull.com, 1.0, turned(hull.turn, hull.points[k])
        )
        lowest = min(lowest, hull.moved[k, 2])
    for k in range(len(hull.moved)):
        hull.moved[k, 2] -= lowest
    hull.com[2] -= lowest


@inner
def _falls_about(hull: Hull, weight: Vector) -> tuple[_Turn, bool]:
    """The axis at the point of the support nearest to the piercing point, and whether that point is a vertex."""
    com = hull.com
    x, y = com[0] - weight[0] * com[2] / weight[2], com[1] - weight[1] * com[2] / weight[2]
    corners, ring, least = hull.corners[0], hull.ring, np.inf
    pivot, on_edge, along = (ring[0, 0], ring[0, 1]), False, (0.0, 0.0)
    for k in range(corners if corners > 1 else 0):
        right, up = _edge(hull, k)
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
def _touch(hull: Hull) -> None:
    """Find the support polygon in the pose; of contacts in one line, within the tolerance, their two ends."""
    count, corners, ring, places = 0, 0, hull.ring, hull.touching
    for k in range(len(hull.moved)):
        if hull.moved[k, 2] <= hull.tolerance_m:
            places[count, 0], places[count, 1] = hull.moved[k, 0], hull.moved[k, 1]
            count += 1
    first, _ = _farthest(places, count, 0)
    other, length = _farthest(places, count, first)
    at, wide = first, False
    while corners < count:  # from corner to corner (Jarvis 1973)
        ring[corners, 0], ring[corners, 1] = places[at, 0], places[at, 1]
        wide = wide or abs(_left(places[first], places[other], places[at])) > hull.tolerance_m * length
        corners, following = corners + 1, first if at != first else other
        for k in range(count):
            side = _left(places[at], places[following], places[k])
            if side < 0.0 or (
                side == 0.0 and _apart(places[at], places[k]) > _apart(places[at], places[following])
            ):
                following = k
        at = following
        if at == first:
            break
    hull.corners[0] = corners
    if count > 1 and not wide:
        hull.corners[0] = 2
        ring[0, 0], ring[0, 1] = places[first, 0], places[first, 1]
        ring[1, 0], ring[1, 1] = places[other, 0], places[other, 1]


@inner
def _farthest(places: Array, count: int, index: int) -> tuple[int, float]:
    """Of the first of some places (n, 2) the one that is farthest from another, and how far."""
    far, most = index, 0.0
    for k in range(count):
        away = _apart(places[k], places[index])
        if away > most:
            far, most = k, away
    return far, most


@inner
def _apart(a: Array, b: Array) -> float:
    return math.hypot(b[0] - a[0], b[1] - a[1])


@inner
def _left(a: Array, b: Array, c: Array) -> float:
    """Twice the area of a triangle of places (2,); positive where the way a, b, c turns left."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
