"""The program's steps, which PyBullet carries out and whose contacts it finds for itself: all of them, or a share.

A step takes the rock from one pose to the next. PyBullet is given the first of them and the velocity that leads to the
other, and must come there; what of the rock it finds near the plane must be near it by our measure too. It has the rock
higher by as much as keeps its own solver from braking it.
"""

from __future__ import annotations

import math
import zlib
from typing import Any

import numpy as np

from toppling.models.compiled import Array, Vector, compiled, inner
from toppling.models.ground.plane import is_over_plane
from toppling.models.ground.stepping import Grounded
from toppling.models.ground.vectors import copy, dot, minus, plus, rotation_of, turned
from toppling.models.numba_alone import carray
from toppling.workers.engines.bullet import binding
from toppling.workers.engines.bullet.worlds import RADIUS_SHARE, WORLD, world_of
from toppling.workers.engines.protocol import StepCheckError, Steps
from toppling.workers.problem import Problem
from toppling.workers.quaternion import normal_in_body, rotation_between, to_body, to_world
from toppling.workers.stepping import Watch, take_steps

_SETS_DEG = (8.0, 25.0, 75.0)
"""Tilts up to which sets of the rock's points serve: a world of all is slow."""

ALLOWED = 1e-9
"""Of R: by which a pose may differ."""

_NEAR_WITHIN = 1e-6
"""Of R: by which the gap of a contact that PyBullet finds may differ from that of a point of ours."""

_RAISED_SHARE, _RAISED_OVER, _LOOKED_AT = 1e-5, 1.2, 1.5
"""Of R: by how much PyBullet has the rock higher at least; over the depth of a point; within what it looks."""


class CheckedSteps:
    """Takes steps of one shake, and has PyBullet repeat those over the plane.

    Raises
    ------
    StepCheckError
        If it comes elsewhere.
    """

    def __init__(self, problem: Problem) -> None:
        self._problem, contact = problem, problem.contact
        self._worlds = np.zeros(len(_SETS_DEG), WORLD)
        self._worlds["points"] = np.searchsorted(contact.onset_deg, _SETS_DEG, side="right")
        self._draw = np.full(2, zlib.crc32(problem.motion.acceleration_m_s2.tobytes()), np.uint64)
        self._points = np.ascontiguousarray(contact.points_body_m)
        self._upright = np.ascontiguousarray(contact.support_from_body[2])
        # On a rounded base or a mesh PyBullet's points touch elsewhere than ours.
        self._checks = not problem.rolls and problem.scene.ground.is_plane

    def __call__(self, sim: Grounded, block: int, watch: Watch) -> int:
        """Go on by blocks of so many steps, as :func:`toppling.workers.stepping.take_steps`."""
        at = np.array([sim.counts[1], -1])  # the pose to go on from, and the set that has no world yet
        since = int(take_steps(sim, block, watch))
        while self._checks and at[0] < sim.counts[1]:
            rock = self._worlds, self._points, self._upright
            unlike = _check(sim, rock, self._draw, self._problem.options.checked_steps, at)
            if unlike > ALLOWED:
                raise StepCheckError(float(sim.time_s[at[0]]), float(unlike), ALLOWED)
            if at[1] >= 0:
                self._worlds[at[1]] = world_of(self._problem.contact, int(self._worlds["points"][at[1]]))[0]
                at[1] = -1
        return since


@compiled
def _check(sim: Grounded, rock: Any, draw: Array, share: float, at: Array) -> float:
    """Let the engine take the steps from a pose on, or a share of them; by how much a pose differs, over R, at most.

    It goes on until one does, or a set of points has no world yet.
    """
    worlds, points, upright = rock
    while at[0] < sim.counts[1]:
        start, end = sim.pose[at[0]], sim.pose[at[0] + 1]
        step_s = sim.time_s[at[0] + 1] - sim.time_s[at[0]]
        if step_s < 1.5 * sim.step_s and _is_drawn(draw, share):  # else it rested
            rotation_of(start, sim.work.turn)
            if is_over_plane(sim.over, start, sim.work.turn, sim.lists.farthest_m, 0.0):
                tilt_rad = math.acos(
                    min(dot(normal_in_body(start), upright), dot(normal_in_body(end), upright), 1.0)
                )
                which = 0
                while which < len(worlds) - 1 and math.degrees(tilt_rad) > 0.9 * _SETS_DEG[which]:
                    which += 1
                if worlds[which].client == 0:
                    at[1] = which
                    draw[0] = draw[1]
                    return 0.0
                sim.counts[5] += 1
                unlike = _repeat(sim, worlds[which], points, start, end, step_s)
                if not unlike <= ALLOWED:
                    return max(unlike, 2.0 * ALLOWED)
        at[0] += 1
    return 0.0


@inner
def _is_drawn(draw: Array, share: float) -> bool:
    """Whether a step is to be repeated: a seeded share, by a congruential generator (Knuth's MMIX)."""
    draw[1] = draw[0]
    draw[0] = draw[0] * np.uint64(6364136223846793005) + np.uint64(1442695040888963407)
    return float(draw[0] >> np.uint64(11)) * 2.0**-53 < share


@inner(allocates=True)
def _repeat(sim: Grounded, world: Any, points: Array, start: Array, end: Array, step_s: float) -> float:
    """Let the engine take the rock from one pose to another; by how much it comes elsewhere, over R.

    Infinite where it finds a contact at which no point of ours is.
    """
    spin, way, turn = rotation_between(start, end), minus(end, start), sim.work.turn
    velocity = np.empty(6)
    for k in range(3):
        velocity[k], velocity[3 + k] = way[k] / step_s, spin[k] / step_s
    below_m = 0.0
    for i in range(world.points):
        arm = turned(turn, points[i])
        rate = velocity[2] + velocity[3] * arm[1] - velocity[4] * arm[0]
        gap = start[2] + arm[2]
        below_m = max(below_m, -gap, -gap - step_s * rate)
    size_m = sim.size_m
    raised_m = _RAISED_OVER * (max(below_m, _RAISED_SHARE * size_m) + RADIUS_SHARE * size_m)
    there, told = np.empty(7), _step(world, start, velocity, step_s, raised_m, raised_m * _LOOKED_AT / size_m)
    copy(told[:7], there)
    there[2] -= raised_m
    off = minus(there, end)
    unlike = max(abs(off[0]), abs(off[1]), abs(off[2])) / size_m
    off = rotation_between(there, end)
    unlike = max(unlike, abs(off[0]), abs(off[1]), abs(off[2]))
    for contact in _contacts(world.client):
        nearest_m = np.inf
        for i in range(world.points):
            place = plus(start, 1.0, turned(turn, points[i]))
            aside_m = max(abs(place[0] - contact[_PLACE]), abs(place[1] - contact[_PLACE + 1]))
            gap_m = contact[_DISTANCE] - raised_m + RADIUS_SHARE * size_m
            nearest_m = min(nearest_m, max(aside_m - 2.0 * RADIUS_SHARE * size_m, abs(gap_m - place[2])))
        if nearest_m > _NEAR_WITHIN * size_m:
            return np.inf
    return unlike


@inner(allocates=True)
def _step(
    world: Any, pose: Array, velocity: Array, step_s: float, raised_m: float, near_share: float
) -> Array:
    """Place the rock (7,) higher, and take a step with a velocity (6,) and no gravity; the pose that it leads to."""
    client, vector = world.client, np.empty(3)
    command = binding.parameters(client)
    if step_s != world.step_s:
        binding.set_step(command, step_s)
        world.step_s = step_s
    binding.set_near(command, near_share)
    binding.submit(client, command)
    command = binding.pose_command(client, world.rock)
    binding.set_place(command, pose[0], pose[1], pose[2] + raised_m)
    binding.set_attitude(command, pose[3], pose[4], pose[5], pose[6])
    binding.submit(client, command)
    command = binding.pose_command(client, world.rock)
    copy(velocity[:3], vector)
    binding.set_velocity(command, vector.ctypes.data)
    vector[0], vector[1], vector[2] = _before_turning(world, pose, velocity, step_s)
    binding.set_spin(command, vector.ctypes.data)
    binding.submit(client, command)
    # Takes the rock out of the broad phase and back: only so do contacts get the new threshold.
    command = binding.collision_filter(client)
    binding.set_filter(command, world.rock, -1, 1, -1)
    binding.submit(client, command)
    binding.submit(client, binding.step_command(client))
    pointers = np.empty(7, np.int64)
    to = pointers.ctypes.data
    status = binding.submit(client, binding.request_state(client, world.rock))
    binding.get_state(status, to, to + 8, to + 16, to + 24, to + 32, to + 40, to + 48)
    out = np.empty(7)
    copy(carray(binding.pointer(pointers[4]), 7, np.float64), out)
    return out


@inner
def _before_turning(world: Any, pose: Array, velocity: Array, step_s: float) -> Vector:
    """Angular velocity that a step without moments turns into the one given.

    Bullet adds step x inertia^-1 (inertia x spin) x spin, at the start of the step, in body axes.
    """
    a, b, c = to_body(velocity[3], velocity[4], velocity[5], pose)
    p, q, r = a, b, c
    x, y, z = world.inertia_m2[0], world.inertia_m2[1], world.inertia_m2[2]
    for _ in range(20):
        u = a - step_s * (y - z) / x * q * r
        v = b - step_s * (z - x) / y * r * p
        w = c - step_s * (x - y) / z * p * q
        change = abs(u - p) + abs(v - q) + abs(w - r)
        p, q, r = u, v, w
        if change < 1e-17 * (abs(p) + abs(q) + abs(r)):
            break
    return to_world(p, q, r, pose)


@inner(allocates=True)
def _contacts(client: int) -> Array:
    """Bullet's contacts (k, 22): of its b3ContactPointData, whose leading integers take the room of three numbers."""
    told = np.zeros(2, np.int64)
    binding.submit(client, binding.request_contacts(client))
    binding.get_contacts(client, told.ctypes.data)
    count = told[0] & 0xFFFFFFFF
    if count == 0:
        return np.empty((0, 22))
    return carray(binding.pointer(told[1]), (count, 22), np.float64).copy()


_PLACE, _DISTANCE = 3, 12
"""Columns of a contact: place on the rock, and gap."""


def steps(problem: Problem) -> Steps:
    """What takes the steps of one shake."""
    return CheckedSteps(problem)
