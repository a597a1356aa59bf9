"""One world of PyBullet, a rock of contact points over a plane, as compiled code places, steps and reads it.

A world may be turned about the normal against the support frame, which puts the axes of friction where they serve
(:mod:`toppling.workers.contact.friction`); what goes in and comes out is in the support frame.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from toppling.models.compiled import Array, Vector, inner
from toppling.models.numba_alone import carray
from toppling.workers.contact.gaps import slip_m_s
from toppling.workers.engines.bullet import binding
from toppling.workers.quaternion import to_body, to_world
from toppling.workers.simulation import copy

_STARTS_TO_SLIP, _STILL_SLIPS = 0.999, 0.7
"""Shares of the limit of friction from which a contact that stuck slips, and down to which one that slipped still does:
the solver's iterations leave the friction of a sliding contact a little below what its normal force allows."""

_STILL_MOVES = 1e-2
"""Share of gravity's velocity in a step: a contact whose points all move along the plane by less has stopped, however
much its friction holds up. The solver leaves a contact that sticks up to a tenth of it."""

COLD_ITERATIONS = 200
"""Of the contact solver in the first step of a new state, at least."""

WORLD = np.dtype(
    (
        np.record,
        [
            ("client", "i8"),  # address of Bullet's client
            ("rock", "i4"),
            ("ground", "i4"),
            ("points", "i8"),  # how many of the rock's contact points it holds, from the first
            ("step_s", "f8"),
            ("weightless", "i8"),  # whether its gravity is off
            ("cold", "i8"),  # whether the next step is the first in a new state
            ("iterations", "i8"),
            ("cold_iterations", "i8"),
            ("residual_share", "f8"),  # of the impulse: the solver stops once none changes by more
            ("impulse_m_s", "f8"),  # velocity that gravity gives in a step
            ("near_share", "f8"),  # of R: within it contacts are prepared, unless told otherwise
            ("axes_rad", "f8"),  # to which it is turned against the support frame
            ("inertia_m2", "f8", 3),  # principal, over mass
            ("friction", "f8"),  # present coefficient
            ("friction_static", "f8"),
            ("friction_kinetic", "f8"),
            ("restitution", "f8"),
            ("friction_resultant", "f8", 3),  # latest resultant of friction, support frame
        ],
    )
)


@inner
def place(world: Any, pose: Array, velocity: Array, near_share: float, axes_rad: float) -> None:
    """Place the rock (7,) and set it going with a velocity (6,); forgets all contacts.

    From here on contacts are prepared within `near_share` of R, and friction acts along axes that are turned by
    `axes_rad` from the support frame's.
    """
    client, world.axes_rad = world.client, axes_rad
    command = binding.parameters(client)
    binding.set_near(command, near_share)
    binding.set_iterations(command, world.cold_iterations)
    binding.submit(client, command)
    world.cold = 1
    command = binding.pose_command(client, world.rock)
    _set_pose(world, command, pose, 0.0)
    binding.submit(client, command)
    command = binding.pose_command(client, world.rock)
    _set_velocities(world, command, velocity, (velocity[3], velocity[4], velocity[5]))
    binding.submit(client, command)
    # Takes the rock out of the broad phase and back: only so do contacts get the new threshold.
    command = binding.collision_filter(client)
    binding.set_filter(command, world.rock, -1, 1, -1)
    binding.submit(client, command)


@inner
def step(
    world: Any, points_m: Array, step_s: float, force_m_s2: Vector, pose: Array, velocity: Array
) -> None:
    """Advance by one step under a constant specific force, contacts solved by the engine.

    The pose (7,) that it leads to, and its velocity and angular velocity (6,), are put into the last two arguments.
    """
    client = world.client
    command = binding.parameters(client)
    if step_s != world.step_s:
        binding.set_step(command, step_s)
        world.step_s = step_s
    x, y, z = _turned(world, force_m_s2[0], force_m_s2[1], force_m_s2[2])
    binding.set_gravity(command, x, y, z)
    binding.submit(client, command)
    world.weightless = 0
    binding.submit(client, binding.step_command(client))
    if world.cold:
        world.cold = 0
        command = binding.parameters(client)
        binding.set_iterations(command, world.iterations)
        binding.submit(client, command)
    if world.friction_static != world.friction_kinetic:
        _follow_slip(world, points_m)
    _read(world, pose, velocity)


@inner
def advance_prescribed(
    world: Any, step_s: float, placed: bool, raised_m: float, pose: Array, velocity: Array
) -> None:
    """Advance by one step with a velocity that meets all contacts; the engine would take from it what does not.

    It has the rock higher by `raised_m`, since a point that comes to the surface on an arc is nearer on its tangent;
    `placed` says that it already has it there. The pose (7,) is replaced by the one that the step leads to, and the
    velocity (6,) by what the engine moved with.
    """
    client = world.client
    if step_s != world.step_s or not world.weightless:
        command = binding.parameters(client)
        binding.set_step(command, step_s)
        binding.set_gravity(command, 0.0, 0.0, 0.0)
        binding.submit(client, command)
        world.step_s, world.weightless = step_s, 1
    command = binding.pose_command(client, world.rock)
    if not placed:
        _set_pose(world, command, pose, raised_m)
    before = _before_turning(world, pose, velocity, step_s)
    _set_velocities(world, command, velocity, before)
    binding.submit(client, command)
    binding.submit(client, binding.step_command(client))
    forget_friction(world)
    _read(world, pose, velocity)
    pose[2] -= raised_m


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


@inner
def rebound(
    world: Any, points_m: Array, step_s: float, force_m_s2: Vector, pose: Array, velocity: Array
) -> None:
    """Advance by the step that begins as points touch down: they leave with Newton's share of their speed.

    Contacts that are only prepared must not rebound: Bullet would give them e times their speed less what closes the
    gap, and so take speed from the fall.
    """
    if world.restitution == 0.0:
        step(world, points_m, step_s, force_m_s2, pose, velocity)
        return
    # Bullet multiplies the two bodies' coefficients; the rock's is 1.
    for restitution in (world.restitution, 0.0):
        command = binding.dynamics(world.client)
        binding.change_restitution(command, world.ground, -1, restitution)
        binding.submit(world.client, command)
        if restitution > 0.0:
            step(world, points_m, step_s, force_m_s2, pose, velocity)


@inner
def configure(world: Any, impulse_m_s: float, near_share: float, rebound_from_m_s: float) -> None:
    """Suit the world to steps in which gravity gives this velocity; its contact sticks until it slips.

    Contacts are prepared within `near_share` of R, unless told otherwise; slower impacts than `rebound_from_m_s` do not
    rebound.
    """
    world.impulse_m_s, world.near_share = impulse_m_s, near_share
    command = binding.parameters(world.client)
    residual = world.residual_share * impulse_m_s
    binding.set_residual(command, residual * residual)
    binding.set_rebound_from(command, rebound_from_m_s)
    binding.submit(world.client, command)
    forget_friction(world)
    set_friction(world, world.friction_static)


@inner
def forget_friction(world: Any) -> None:
    """What friction held in the latest step says nothing of the next."""
    for k in range(3):
        world.friction_resultant[k] = 0.0


@inner
def hold_as(world: Any, other: Any) -> None:
    """Let the contact stick or slip as in another world, from which this one takes the rock over."""
    for k in range(3):
        world.friction_resultant[k] = other.friction_resultant[k]
    set_friction(world, other.friction)


@inner
def set_friction(world: Any, friction: float) -> None:
    """Set the present coefficient of friction."""
    # Bullet multiplies the two bodies' coefficients; the rock's is 1.
    command = binding.dynamics(world.client)
    binding.change_friction(command, world.ground, -1, friction)
    binding.submit(world.client, command)
    world.friction = friction


@inner
def _turned(world: Any, x: float, y: float, z: float) -> Vector:
    """A vector of the support frame in the world's own."""
    cos, sin = math.cos(world.axes_rad), math.sin(world.axes_rad)
    return cos * x + sin * y, cos * y - sin * x, z


@inner
def _turned_back(world: Any, x: float, y: float, z: float) -> Vector:
    """A vector of the world's own frame in the support frame."""
    cos, sin = math.cos(world.axes_rad), math.sin(world.axes_rad)
    return cos * x - sin * y, cos * y + sin * x, z


@inner
def _set_pose(world: Any, command: int, pose: Array, raised_m: float) -> None:
    x, y, z = _turned(world, pose[0], pose[1], pose[2] + raised_m)
    binding.set_place(command, x, y, z)
    x, y, z, w = pose[3], pose[4], pose[5], pose[6]
    cos, sin = math.cos(0.5 * world.axes_rad), math.sin(0.5 * world.axes_rad)
    binding.set_attitude(command, cos * x + sin * y, cos * y - sin * x, cos * z - sin * w, cos * w + sin * z)


@inner(allocates=True)
def _set_velocities(world: Any, command: int, velocity: Array, spin_rad_s: Vector) -> None:
    """The centre of mass moves as `velocity` (6,) says."""
    vector = np.empty(3)
    vector[0], vector[1], vector[2] = _turned(world, velocity[0], velocity[1], velocity[2])
    binding.set_velocity(command, vector.ctypes.data)
    vector[0], vector[1], vector[2] = _turned(world, spin_rad_s[0], spin_rad_s[1], spin_rad_s[2])
    binding.set_spin(command, vector.ctypes.data)


@inner(allocates=True)
def _read(world: Any, pose: Array, velocity: Array) -> None:
    """Pose (7,) and velocities (6,) of the rock, support frame."""
    state = _state(world)
    pose[0], pose[1], pose[2] = _turned_back(world, state[0], state[1], state[2])
    velocity[0], velocity[1], velocity[2] = _turned_back(world, state[7], state[8], state[9])
    velocity[3], velocity[4], velocity[5] = _turned_back(world, state[10], state[11], state[12])
    x, y, z, w = state[3], state[4], state[5], state[6]
    cos, sin = math.cos(0.5 * world.axes_rad), math.sin(0.5 * world.axes_rad)
    pose[3], pose[4], pose[5], pose[6] = (
        cos * x - sin * y,
        cos * y + sin * x,
        cos * z + sin * w,
        cos * w - sin * z,
    )


@inner(allocates=True)
def _state(world: Any) -> Array:
    """Place, attitude, velocity and angular velocity (13,) of the rock, in the world's own frame."""
    pointers = np.empty(7, np.int64)
    to = pointers.ctypes.data
    status = binding.submit(world.client, binding.request_state(world.client, world.rock))
    binding.get_state(status, to, to + 8, to + 16, to + 24, to + 32, to + 40, to + 48)
    out = np.empty(13)
    copy(carray(binding.pointer(pointers[4]), 7, np.float64), out[:7])
    copy(carray(binding.pointer(pointers[5]), 6, np.float64), out[7:])
    return out


@inner(allocates=True)
def _follow_slip(world: Any, points_m: Array) -> None:
    """Choose the coefficient of the next step: the kinetic one while the contact as a whole slips.

    It slips where the resultant of its friction uses up what the present coefficient allows, and once it does until its
    points stand still. One state for all points: they belong to one rigid body, and differ only while it turns on the
    spot. A rock in the air lands as one that slips if its lowest point moves along the plane by more than a step in
    which the solver let go of a point can give it.
    """
    contacts = _contacts(world.client)
    state = _state(world)
    touches = False
    for contact in contacts:
        touches = touches or contact[_NORMAL_FORCE] > 0.0
    if not touches:
        forget_friction(world)
        slips = slip_m_s(state[7:], _lowest_arm_m(points_m[: world.points], state)) > world.impulse_m_s
    else:
        slips = _slips_on(world, contacts, state)
    static, kinetic = world.friction_static, world.friction_kinetic
    wanted = kinetic if slips else static
    if touches and slips and world.friction == static:
        # Slip began within the step that is over, which held it with static friction to its end, on the average half a
        # step too long: the next one takes that back. Left out, every slip came out a step short.
        wanted = max(kinetic - 0.5 * (static - kinetic), 0.0)
    if wanted != world.friction:
        set_friction(world, wanted)


@inner(allocates=True)
def _slips_on(world: Any, contacts: Array, state: Array) -> bool:
    """Whether a contact that touches slips in the next step."""
    pressing, x, y, z = 0.0, 0.0, 0.0, 0.0
    for contact in contacts:
        if contact[_NORMAL_FORCE] > 0.0:
            pressing += contact[_NORMAL_FORCE]
            first, second = contact[_FRICTION_1], contact[_FRICTION_2]
            x += first * contact[_DIRECTION_1] + second * contact[_DIRECTION_2]
            y += first * contact[_DIRECTION_1 + 1] + second * contact[_DIRECTION_2 + 1]
            z += first * contact[_DIRECTION_1 + 2] + second * contact[_DIRECTION_2 + 2]
    x, y, z = _turned_back(world, x, y, z)
    before = world.friction_resultant
    turned = x * before[0] + y * before[1] + z * before[2] < 0.0  # slip came to a halt on the way
    before[0], before[1], before[2] = x, y, z
    sticks = world.friction == world.friction_static
    share = _STARTS_TO_SLIP if sticks else _STILL_SLIPS
    if turned or math.sqrt(x * x + y * y + z * z) < share * world.friction * pressing:
        return False
    if sticks:
        return True
    # Whether a point that touches moves along the plane after the step, which took it from where it touched.
    start = state[:3] - state[7:10] * world.step_s
    for contact in contacts:
        if contact[_NORMAL_FORCE] > 0.0:
            x, y, z = contact[_PLACE_A : _PLACE_A + 3] - start
            if slip_m_s(state[7:], (x, y, z)) > _STILL_MOVES * world.impulse_m_s:
                return True
    return False


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


_PLACE_A, _NORMAL_FORCE, _FRICTION_1, _FRICTION_2, _DIRECTION_1, _DIRECTION_2 = 3, 13, 14, 15, 16, 19


@inner
def _lowest_arm_m(points_m: Array, state: Array) -> Vector:
    """From the centre of mass to the lowest of some points, in the world's own frame."""
    x, y, z, w = state[3], state[4], state[5], state[6]
    lowest, index = np.inf, 0
    for i in range(len(points_m)):
        a, b, c = points_m[i, 0], points_m[i, 1], points_m[i, 2]
        height = 2 * (x * z - y * w) * a + 2 * (y * z + x * w) * b + (1 - 2 * (x * x + y * y)) * c
        if height < lowest:
            lowest, index = height, i
    a, b, c = points_m[index, 0], points_m[index, 1], points_m[index, 2]
    along = (1 - 2 * (y * y + z * z)) * a + 2 * (x * y - z * w) * b + 2 * (x * z + y * w) * c
    across = 2 * (x * y + z * w) * a + (1 - 2 * (x * x + z * z)) * b + 2 * (y * z - x * w) * c
    return along, across, lowest
