"""What decides whether a shake goes on: a few numbers of a block of steps and of the rock at its end. Compiled."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from toppling.models.compiled import Array, Vector, compiled, inner
from toppling.models.ground.body import RESTING_SHARE
from toppling.models.ground.plane import is_over_plane
from toppling.models.ground.stepping import Grounded
from toppling.models.ground.vectors import cross, dot, minus, plus, rotation_of
from toppling.workers.barrier import lying_arms_m
from toppling.workers.problem import Problem
from toppling.workers.quaternion import normal_in_body, rotation_between, to_body, to_world, yaw_between


class Body(NamedTuple):
    """A rock, as compiled code observes it; support frame."""

    points_m: Array  # (n, 3) that can touch the plane, body axes
    lying_m: Array  # (n, 3) from each of them to the centre of mass as the rock stood in the scene
    scene_pose: Array
    first_contact_m: Array  # (3,) centroid of what touches at the start, body axes
    first_place_m: Array  # (3,) where it is then
    up: Array  # (3,) upward unit vector
    gravity_m_s2: float

    @classmethod
    def of(cls, problem: Problem) -> Body:
        """Of a problem."""
        contact, (start_pose, _) = problem.contact, problem.initial
        if problem.scene.ground.is_plane:
            gaps = contact.gaps_m(start_pose)
            touching = gaps <= gaps.min() + RESTING_SHARE * contact.half_diagonal_m
            first = contact.points_body_m[touching].mean(axis=0)
        else:
            near = problem.scene.grounded.contacts(start_pose, RESTING_SHARE * contact.half_diagonal_m)
            first = np.array(to_body(*(near["arm_m"].mean(axis=0) if len(near) else np.zeros(3)), start_pose))
        return cls(
            points_m=np.ascontiguousarray(contact.points_body_m),
            lying_m=np.ascontiguousarray(lying_arms_m(contact)),
            scene_pose=contact.start_pose,
            first_contact_m=first,
            first_place_m=start_pose[:3] + to_world(*first, start_pose),
            up=np.ascontiguousarray(contact.scene_from_support[2]),
            gravity_m_s2=problem.scene.gravity_m_s2,
        )


class Observation(NamedTuple):
    """A block of steps, and the rock at its end; angles in degrees."""

    time_s: float
    fastest_m_s: float
    """Largest speed of the centre of mass in the block; NaN where a state is not finite."""
    largest_tilt_deg: float
    """In the block."""
    drift_m_s: float
    """Mean speed, over the block, of the point that moved most."""
    speed_m_s: float
    """Of the fastest point."""
    sliding_m_s: float
    """Along the ground, of the fastest contact that carries; infinite where none does."""
    energy_j_kg: float
    """Kinetic energy, and potential energy above that of the rock lying where it is on its plane, per mass."""
    tilt_deg: float
    yaw_deg: float
    """Turn about the normal since the pose of the scene, -180 to 180."""
    turned_deg: float
    """Size of the turn about the normal since the start, 0 to 180."""
    slip_m: float
    """Way along the interface of the material point that was the centroid of the first contact."""
    fallen_m: float
    """Height, along the plumb line, that the centre of mass has lost since the start."""
    lowest_m: float
    """Least height of the centre of mass over the interface in the block."""
    com_m: Vector
    over_plane: bool
    """Whether all that the rock may touch where it is lies in the interface plane."""


@compiled
def observe(sim: Grounded, body: Body, since: int) -> Observation:
    """Look at the steps since a pose."""
    last = sim.counts[1]
    pose, velocity = sim.pose[last], sim.velocity[last]
    fastest, cosine, lowest = _size(velocity), 1.0, np.inf
    for i in range(since, last + 1):
        here = sim.pose[i]
        fastest = max(fastest, _size(sim.velocity[i]))
        if not (math.isfinite(here[0]) and math.isfinite(here[1]) and math.isfinite(here[2])):
            fastest = np.nan
        cosine, lowest = min(cosine, _upright(here, body.scene_pose)), min(lowest, here[2])
    rotation_of(pose, sim.work.turn)
    lying = _lying_com_m(body, pose)
    first = to_world(body.first_contact_m[0], body.first_contact_m[1], body.first_contact_m[2], pose)
    x, y = pose[0] + first[0] - body.first_place_m[0], pose[1] + first[1] - body.first_place_m[1]
    turned = math.degrees(yaw_between(sim.pose[0], pose))
    up, lasted_s = body.up, sim.time_s[last] - sim.time_s[since]
    height = up[0] * (pose[0] - lying[0]) + up[1] * (pose[1] - lying[1]) + up[2] * (pose[2] - lying[2])
    return Observation(
        time_s=sim.time_s[last],
        fastest_m_s=fastest,
        largest_tilt_deg=math.degrees(math.acos(min(max(cosine, -1.0), 1.0))),
        drift_m_s=travel_m(sim.pose[since], pose, sim.size_m) / lasted_s if lasted_s > 0.0 else 0.0,
        speed_m_s=_size(velocity[:3]) + _size(velocity[3:]) * sim.size_m,
        sliding_m_s=_sliding_m_s(sim, velocity),
        energy_j_kg=_kinetic_j_kg(sim.inertia_m2, pose, velocity) + body.gravity_m_s2 * height,
        tilt_deg=math.degrees(math.acos(min(max(_upright(pose, body.scene_pose), -1.0), 1.0))),
        yaw_deg=math.degrees(yaw_between(body.scene_pose, pose)),
        turned_deg=abs((turned + 180.0) % 360.0 - 180.0),
        slip_m=math.sqrt(x * x + y * y),
        fallen_m=dot(minus(sim.pose[0], pose), up),
        lowest_m=lowest,
        com_m=(pose[0], pose[1], pose[2]),
        over_plane=is_over_plane(
            sim.over, pose, sim.work.turn, sim.lists.farthest_m, RESTING_SHARE * sim.size_m
        ),
    )


@inner
def _upright(pose: Array, scene_pose: Array) -> float:
    """Cosine of the angle of the interface's normal, carried along from the pose of the scene, to where it was."""
    return dot(normal_in_body(pose), normal_in_body(scene_pose))


@inner
def _sliding_m_s(sim: Grounded, velocity: Array) -> float:
    """Along the ground, of the fastest contact that carries."""
    fastest = -1.0
    for k in range(sim.counts[0]):
        n, arm = sim.contacts[k].normal, sim.contacts[k].arm_m
        if dot(sim.contacts[k].impulse, n) > 0.0:
            rate = plus(velocity, 1.0, cross((velocity[3], velocity[4], velocity[5]), arm))
            fastest = max(fastest, _size(plus(rate, -dot(rate, n), n)))
    return fastest if fastest >= 0.0 else np.inf


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
def _lying_com_m(body: Body, pose: Array) -> Vector:
    """Centre of mass if the rock lay where it is, on its lowest point."""
    nx, ny, nz = normal_in_body(pose)
    lowest, index = np.inf, 0
    for i in range(len(body.points_m)):
        height = body.points_m[i, 0] * nx + body.points_m[i, 1] * ny + body.points_m[i, 2] * nz
        if height < lowest:
            lowest, index = height, i
    arm = to_world(body.points_m[index, 0], body.points_m[index, 1], body.points_m[index, 2], pose)
    yaw = yaw_between(body.scene_pose, pose)
    cos, sin = math.cos(yaw), math.sin(yaw)
    x, y, z = body.lying_m[index]
    return pose[0] + arm[0] + cos * x - sin * y, pose[1] + arm[1] + sin * x + cos * y, z
