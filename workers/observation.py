"""What decides whether a shake goes on: a few numbers of a block of steps and of the rock at its end. Compiled."""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

import numpy as np
from scipy.spatial import ConvexHull

from toppling.models.compiled import Array, Vector, compiled, inner
from toppling.models.kept import kept
from toppling.models.scene import Scene
from toppling.workers.barrier import lying_arms_m
from toppling.workers.contact.contact_points import contact_of
from toppling.workers.contact.gaps import slip_m_s
from toppling.workers.problem import Problem
from toppling.workers.quaternion import normal_in_body, rotation_between, to_body, to_world, yaw_between
from toppling.workers.simulation import Simulation, X, Y, Z, largest_tilt_deg

_TOUCHING_AT_START_SHARE = 1e-4
"""Of R: contact points so near the lowest one touch at the start."""


class Body(NamedTuple):
    """A rock, as compiled code observes it; support frame."""

    lying_m: Array  # (n, 3) from each contact point to the centre of mass as the rock stood in the scene
    scene_pose: Array
    first_contact_m: Array  # (3,) centroid of the points that touch at the start, body axes
    first_place_m: Array  # (3,) where it is then
    up: Array  # (3,) upward unit vector
    ends: Array  # of the pedestal: those of :func:`_ends_of_pedestal`
    gravity_m_s2: float

    @classmethod
    def of(cls, problem: Problem) -> Body:
        """Of a problem."""
        contact, (start_pose, _) = problem.contact, problem.initial
        gaps = contact.gaps_m(start_pose)
        touching = gaps <= gaps.min() + _TOUCHING_AT_START_SHARE * contact.half_diagonal_m
        first = contact.points_body_m[touching].mean(axis=0)
        return cls(
            lying_m=np.ascontiguousarray(lying_arms_m(contact)),
            scene_pose=contact.start_pose,
            first_contact_m=first,
            first_place_m=start_pose[:3] + to_world(*first, start_pose),
            up=np.ascontiguousarray(contact.scene_from_support[2]),
            ends=np.ascontiguousarray(_ends_of_pedestal(problem.scene)),
            gravity_m_s2=problem.scene.gravity_m_s2,
        )


class Displacement(Protocol):
    """How far a rock is from where it stood."""

    @property
    def turned_deg(self) -> float:
        """Size of its turn about the normal since the start, 0 to 180."""

    @property
    def slip_m(self) -> float:
        """Way along the interface of the material point that was the centroid of the first contact."""


class Observation(NamedTuple):
    """A block of steps, and the rock at its end; angles in degrees."""

    time_s: float
    fastest_m_s: float
    """Largest speed of the centre of mass in the block; NaN where the state is not finite."""
    lowest_m: float
    """Least height of the centre of mass over the interface in the block."""
    largest_tilt_deg: float
    drift_m_s: float
    """Mean speed, over the block, of the point that moved most."""
    speed_m_s: float
    """Of the fastest point."""
    sliding_m_s: float
    """Of the lowest contact point along the interface."""
    energy_j_kg: float
    """Kinetic energy, and potential energy above that of the rock lying where it is, per mass."""
    tilt_deg: float
    yaw_deg: float
    """Turn about the normal since the pose of the scene, -180 to 180."""
    turned_deg: float
    """Size of the turn about the normal since the start, 0 to 180."""
    slip_m: float
    """Way along the interface of the material point that was the centroid of the first contact."""
    beyond_end: bool
    """Whether its centre of mass is plumb beyond the end of its pedestal, and were so if it lay there."""


class Watch(NamedTuple):
    """What calls for a look at a rock: until it does no rule of termination applies, and the rock does not rest."""

    body: Body
    fastest_m_s: float
    """A speed above it does, and a state that is not finite."""
    lowest_m: float
    """A height of the centre of mass below it."""
    tilt_deg: float
    """A tilt above it."""
    drift_m_s: float
    """A block with less drift."""
    until_s: float
    """Every block from then on."""


@inner
def calls_for_look(sim: Simulation, watch: Watch, since: int) -> bool:
    """Whether the steps since a pose call for a look at the rock."""
    seen = observe(sim, watch.body, since)
    goes_on = (
        seen.fastest_m_s <= watch.fastest_m_s
        and seen.lowest_m >= watch.lowest_m
        and seen.largest_tilt_deg <= watch.tilt_deg
        and seen.drift_m_s >= watch.drift_m_s
        and seen.time_s <= watch.until_s
    )
    return not goes_on or seen.beyond_end


@compiled
def observe(sim: Simulation, body: Body, since: int) -> Observation:
    """Look at the steps since a pose."""
    last, fixed = sim.state[0].last, sim.fixed[0]
    pose, velocity = sim.pose[last], sim.velocity[last]
    # Substeps count as no shorter: one to a contact may take next to no time, in which points are set to their height.
    shortest_step_s = sim.fixed[0].engine_step * sim.fixed[0].step_s
    fastest, lowest = 0.0, np.inf
    for i in range(since, last + 1):
        here = sim.pose[i]
        if not (math.isfinite(here[0]) and math.isfinite(here[1]) and math.isfinite(here[2])):
            fastest = np.nan
        lowest = min(lowest, here[2])
        if i > since:
            x, y, z = here[0] - sim.pose[i - 1, 0], here[1] - sim.pose[i - 1, 1], here[2] - sim.pose[i - 1, 2]
            way, duration = math.sqrt(x * x + y * y + z * z), sim.time_s[i] - sim.time_s[i - 1]
            fastest = max(fastest, way / max(duration, shortest_step_s))
    lying, arm = _lying_com_m(sim.candidates, body, pose)
    x, y, z = to_world(body.first_contact_m[0], body.first_contact_m[1], body.first_contact_m[2], pose)
    x, y = pose[0] + x - body.first_place_m[0], pose[1] + y - body.first_place_m[1]
    turned = math.degrees(yaw_between(sim.pose[0], pose))
    up, lasted_s = body.up, sim.time_s[last] - sim.time_s[since]
    height = up[0] * (pose[0] - lying[0]) + up[1] * (pose[1] - lying[1]) + up[2] * (pose[2] - lying[2])
    return Observation(
        time_s=sim.time_s[last],
        fastest_m_s=fastest,
        lowest_m=lowest,
        largest_tilt_deg=largest_tilt_deg(sim, since),
        drift_m_s=travel_m(sim.pose[since], pose, fixed.half_diagonal_m) / lasted_s
        if lasted_s > 0.0
        else 0.0,
        speed_m_s=_size(velocity[:3]) + _size(velocity[3:]) * fixed.half_diagonal_m,
        sliding_m_s=slip_m_s(velocity, arm),
        energy_j_kg=_kinetic_j_kg(fixed.inertia_m2, pose, velocity) + body.gravity_m_s2 * height,
        tilt_deg=largest_tilt_deg(sim, last),
        yaw_deg=math.degrees(yaw_between(body.scene_pose, pose)),
        turned_deg=abs((turned + 180.0) % 360.0 - 180.0),
        slip_m=math.sqrt(x * x + y * y),
        beyond_end=_is_beyond(body, pose[0], pose[1], pose[2])
        and _is_beyond(body, lying[0], lying[1], lying[2]),
    )


@inner
def _is_beyond(body: Body, x: float, y: float, z: float) -> bool:
    """Whether a plumb line through a place meets the interface plane beyond an end of the pedestal."""
    x, y = x - z * body.up[0] / body.up[2], y - z * body.up[1] / body.up[2]
    beyond = False
    for a, b, c in body.ends:
        beyond = beyond or a * x + b * y + c > 0.0
    return beyond


@kept
def _ends_of_pedestal(scene: Scene) -> Array:
    """Lines (n, 3) where a scanned pedestal ends, in the support frame: a x + b y + c > 0 beyond one."""
    if scene.pedestal.vertices_m is None:
        return np.zeros((0, 3))
    contact = contact_of(scene)
    up = contact.scene_from_support[2]

    def plumb_m(vertices_m: Array) -> Array:
        places = (vertices_m - contact.origin_m) @ contact.scene_from_support
        return np.asarray(places[:, :2] - places[:, 2:] * up[:2] / up[2])

    lines = ConvexHull(plumb_m(scene.pedestal.vertices_m)).equations
    room_m = -(plumb_m(scene.rock.vertices_m) @ lines[:, :2].T + lines[:, 2]).max(axis=0)
    return np.asarray(lines[room_m < END_WITHIN_HEIGHTS * scene.rock.height_m])


END_WITHIN_HEIGHTS = 0.5
"""A mesh that goes on for more of the rock's height beside it ends with the scan and not with the ground: a scanned
pedestal keeps .6 of it."""


@compiled
def travel_m(start: Array, end: Array, radius_m: float) -> float:
    """Way from pose to pose (7,) of the point that moved most of those within a radius, at most."""
    way = (end[0] - start[0], end[1] - start[1], end[2] - start[2])
    return _size(way) + _size(rotation_between(start, end)) * radius_m


@inner
def _size(vector: Array | Vector) -> float:
    return math.sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2])


@inner
def _kinetic_j_kg(inertia_m2: Array, pose: Array, velocity: Array) -> float:
    p, q, r = to_body(velocity[3], velocity[4], velocity[5], pose)
    turning = inertia_m2[0] * p * p + inertia_m2[1] * q * q + inertia_m2[2] * r * r
    return 0.5 * (velocity[0] ** 2 + velocity[1] ** 2 + velocity[2] ** 2 + turning)


@inner
def _lying_com_m(candidates: Array, body: Body, pose: Array) -> tuple[Vector, Vector]:
    """Centre of mass if the rock lay where it is, and the arm from the present one to the lowest contact point."""
    nx, ny, nz = normal_in_body(pose)
    lowest, index = np.inf, 0
    for i in range(candidates.shape[1]):
        height = candidates[X, i] * nx + candidates[Y, i] * ny + candidates[Z, i] * nz
        if height < lowest:
            lowest, index = height, i
    arm = to_world(candidates[X, index], candidates[Y, index], candidates[Z, index], pose)
    yaw = yaw_between(body.scene_pose, pose)
    cos, sin = math.cos(yaw), math.sin(yaw)
    x, y, z = body.lying_m[index]
    return (pose[0] + arm[0] + cos * x - sin * y, pose[1] + arm[1] + sin * x + cos * y, z), arm
