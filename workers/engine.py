"""PyBullet, and the only module that knows it: worlds of a rock of contact points over a plane, for compiled code.

Bullet is called through its C interface, which PyBullet's shared library exports beside the Python module: from Python
to build a world, from compiled code to step it, where a step's Python would cost as much as the step.

A world may be turned about the normal against the support frame, which puts the axes of friction where they serve
(:mod:`workers.friction_axes`); what goes in and comes out is in the support frame.
"""

from __future__ import annotations

import ctypes
import importlib.util
import math
import tempfile
from collections import OrderedDict
from functools import cache
from typing import Any

import llvmlite.binding
import numpy as np
from numba import carray, types
from numba.extending import intrinsic
from numpy.typing import NDArray

from toppling.models.contact import ContactProperties
from toppling.workers.compiled import Array, Vector, compiled, inner
from toppling.workers.contact_points import ContactModel
from toppling.workers.options import SolverOptions
from toppling.workers.quaternion import to_body, to_world

STARTS_TO_SLIP, STILL_SLIPS = 0.999, 0.7
"""Shares of the limit of friction from which a contact that stuck slips, and down to which one that slipped still does:
the solver's iterations leave the friction of a sliding contact a little below what its normal force allows."""

STILL_MOVES = 1e-2
"""Share of gravity's velocity in a step: a contact whose points all move along the plane by less has stopped, however
much its friction holds up. The solver leaves a contact that sticks up to a tenth of it."""

COLD_ITERATIONS = 200
"""Of the contact solver in the first step of a new state, at least."""

WORLD = np.dtype(
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
        ("grip", "f8", 3),  # latest resultant of friction, support frame
    ]
)
"""A world, as compiled code sees it."""

_PATH = str(importlib.util.find_spec("pybullet").origin)  # type: ignore[union-attr]
_LIBRARY = ctypes.CDLL(_PATH)
llvmlite.binding.load_library_permanently(_PATH)  # where compiled code, cached code too, finds its functions

_ADDRESS, _NUMBER, _INDEX = types.intp, types.float64, types.int32


def _compiled(name: str, result: Any, *arguments: Any) -> Any:
    """A C function, for compiled code."""
    return types.ExternalFunction(name, result(*arguments))


_submit = _compiled("b3SubmitClientCommandAndWaitStatus", _ADDRESS, _ADDRESS, _ADDRESS)
_parameters = _compiled("b3InitPhysicsParamCommand", _ADDRESS, _ADDRESS)
_set_gravity = _compiled("b3PhysicsParamSetGravity", _INDEX, _ADDRESS, _NUMBER, _NUMBER, _NUMBER)
_set_step = _compiled("b3PhysicsParamSetTimeStep", _INDEX, _ADDRESS, _NUMBER)
_set_iterations = _compiled("b3PhysicsParamSetNumSolverIterations", _INDEX, _ADDRESS, _INDEX)
_set_near = _compiled("b3PhysicsParamSetContactBreakingThreshold", _INDEX, _ADDRESS, _NUMBER)
_set_residual = _compiled("b3PhysicsParamSetSolverResidualThreshold", _INDEX, _ADDRESS, _NUMBER)
_set_rebound_from = _compiled("b3PhysicsParamSetRestitutionVelocityThreshold", _INDEX, _ADDRESS, _NUMBER)
_step = _compiled("b3InitStepSimulationCommand", _ADDRESS, _ADDRESS)
_request_state = _compiled("b3RequestActualStateCommandInit", _ADDRESS, _ADDRESS, _INDEX)
_get_state = _compiled("b3GetStatusActualState", _INDEX, _ADDRESS, *[_ADDRESS] * 7)
_pose = _compiled("b3CreatePoseCommandInit", _ADDRESS, _ADDRESS, _INDEX)
_set_place = _compiled("b3CreatePoseCommandSetBasePosition", _INDEX, _ADDRESS, _NUMBER, _NUMBER, _NUMBER)
_set_attitude = _compiled(
    "b3CreatePoseCommandSetBaseOrientation", _INDEX, _ADDRESS, _NUMBER, _NUMBER, _NUMBER, _NUMBER
)
_set_velocity = _compiled("b3CreatePoseCommandSetBaseLinearVelocity", _INDEX, _ADDRESS, _ADDRESS)
_set_spin = _compiled("b3CreatePoseCommandSetBaseAngularVelocity", _INDEX, _ADDRESS, _ADDRESS)
_collision_filter = _compiled("b3CollisionFilterCommandInit", _ADDRESS, _ADDRESS)
_set_filter = _compiled("b3SetCollisionFilterGroupMask", _INDEX, _ADDRESS, _INDEX, _INDEX, _INDEX, _INDEX)
_dynamics = _compiled("b3InitChangeDynamicsInfo", _ADDRESS, _ADDRESS)
_change_friction = _compiled(
    "b3ChangeDynamicsInfoSetLateralFriction", _INDEX, _ADDRESS, _INDEX, _INDEX, _NUMBER
)
_change_restitution = _compiled(
    "b3ChangeDynamicsInfoSetRestitution", _INDEX, _ADDRESS, _INDEX, _INDEX, _NUMBER
)
_request_contacts = _compiled("b3InitRequestContactPointInformation", _ADDRESS, _ADDRESS)
_get_contacts = _compiled("b3GetContactPointInformation", types.void, _ADDRESS, _ADDRESS)


@intrinsic
def _pointer(typing_context: Any, address: Any) -> Any:  # noqa: ARG001  (numba's signature)
    """An address as a pointer."""

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], context.get_value_type(signature.return_type))

    return types.voidptr(types.intp), code


@inner
def place(world: Any, pose: Array, velocity: Array, near_share: float, axes_rad: float) -> None:
    """Place the rock (7,) and set it going with a velocity (6,); forgets all contacts.

    From here on contacts are prepared within `near_share` of R, and friction acts along axes that are turned by
    `axes_rad` from the support frame's.
    """
    client, world.axes_rad = world.client, axes_rad
    command = _parameters(client)
    _set_near(command, near_share)
    _set_iterations(command, world.cold_iterations)
    _submit(client, command)
    world.cold = 1
    command = _pose(client, world.rock)
    _set_pose(world, command, pose, 0.0)
    _submit(client, command)
    command = _pose(client, world.rock)
    _set_velocities(world, command, velocity, (velocity[3], velocity[4], velocity[5]))
    _submit(client, command)
    # Takes the rock out of the broad phase and back: only so do contacts get the new threshold.
    command = _collision_filter(client)
    _set_filter(command, world.rock, -1, 1, -1)
    _submit(client, command)


@inner
def step(
    world: Any, points_m: Array, step_s: float, force_m_s2: Vector, pose: Array, velocity: Array
) -> None:
    """Advance by one step under a constant specific force, contacts solved by the engine.

    The pose (7,) that it leads to, and its velocity and angular velocity (6,), are put into the last two arguments.
    """
    client = world.client
    command = _parameters(client)
    if step_s != world.step_s:
        _set_step(command, step_s)
        world.step_s = step_s
    x, y, z = _turned(world, force_m_s2[0], force_m_s2[1], force_m_s2[2])
    _set_gravity(command, x, y, z)
    _submit(client, command)
    world.weightless = 0
    _submit(client, _step(client))
    if world.cold:
        world.cold = 0
        command = _parameters(client)
        _set_iterations(command, world.iterations)
        _submit(client, command)
    if world.friction_static != world.friction_kinetic:
        _follow_slip(world, points_m)
    _read(world, pose, velocity)


@inner
def glide(world: Any, step_s: float, placed: bool, raised_m: float, pose: Array, velocity: Array) -> None:
    """Advance by one step with a velocity that meets all contacts; the engine would take from it what does not.

    It has the rock higher by `raised_m`, since a point that comes to the surface on an arc is nearer on its tangent;
    `placed` says that it already has it there. The pose (7,) is replaced by the one that the step leads to, and the
    velocity (6,) by what the engine moved with.
    """
    client = world.client
    if step_s != world.step_s or not world.weightless:
        command = _parameters(client)
        _set_step(command, step_s)
        _set_gravity(command, 0.0, 0.0, 0.0)
        _submit(client, command)
        world.step_s, world.weightless = step_s, 1
    command = _pose(client, world.rock)
    if not placed:
        _set_pose(world, command, pose, raised_m)
    before = _before_turning(world, pose, velocity, step_s)
    _set_velocities(world, command, velocity, before)
    _submit(client, command)
    _submit(client, _step(client))
    world.grip[:] = 0.0
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
        command = _dynamics(world.client)
        _change_restitution(command, world.ground, -1, restitution)
        _submit(world.client, command)
        if restitution > 0.0:
            step(world, points_m, step_s, force_m_s2, pose, velocity)


@inner
def configure(world: Any, impulse_m_s: float, near_share: float, rebound_from_m_s: float) -> None:
    """Suit the world to steps in which gravity gives this velocity; its contact sticks until it slips.

    Contacts are prepared within `near_share` of R, unless told otherwise; slower impacts than `rebound_from_m_s` do not
    rebound.
    """
    world.impulse_m_s, world.near_share = impulse_m_s, near_share
    command = _parameters(world.client)
    residual = world.residual_share * impulse_m_s
    _set_residual(command, residual * residual)
    _set_rebound_from(command, rebound_from_m_s)
    _submit(world.client, command)
    world.grip[:] = 0.0
    set_friction(world, world.friction_static)


@inner
def hold_as(world: Any, other: Any) -> None:
    """Let the contact stick or slip as in another world, from which this one takes the rock over."""
    for k in range(3):
        world.grip[k] = other.grip[k]
    set_friction(world, other.friction)


@inner
def set_friction(world: Any, friction: float) -> None:
    """Set the present coefficient of friction."""
    # Bullet multiplies the two bodies' coefficients; the rock's is 1.
    command = _dynamics(world.client)
    _change_friction(command, world.ground, -1, friction)
    _submit(world.client, command)
    world.friction = friction


@compiled
def slip_m_s(velocity: Array, arm_m: Vector) -> float:
    """Speed along the plane of the point of a rock that is so far from its centre of mass; z is the normal."""
    along = velocity[0] + velocity[4] * arm_m[2] - velocity[5] * arm_m[1]
    across = velocity[1] + velocity[5] * arm_m[0] - velocity[3] * arm_m[2]
    return math.sqrt(along * along + across * across)


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
    _set_place(command, x, y, z)
    x, y, z, w = pose[3], pose[4], pose[5], pose[6]
    cos, sin = math.cos(0.5 * world.axes_rad), math.sin(0.5 * world.axes_rad)
    _set_attitude(command, cos * x + sin * y, cos * y - sin * x, cos * z - sin * w, cos * w + sin * z)


@inner
def _set_velocities(world: Any, command: int, velocity: Array, spin_rad_s: Vector) -> None:
    """The centre of mass moves as `velocity` (6,) says."""
    vector = np.empty(3)
    vector[0], vector[1], vector[2] = _turned(world, velocity[0], velocity[1], velocity[2])
    _set_velocity(command, vector.ctypes.data)
    vector[0], vector[1], vector[2] = _turned(world, spin_rad_s[0], spin_rad_s[1], spin_rad_s[2])
    _set_spin(command, vector.ctypes.data)


@inner
def _read(world: Any, pose: Array, velocity: Array) -> None:
    """Pose (7,) and velocities (6,) of the rock, support frame."""
    state = _state(world)
    pose[:3] = _turned_back(world, state[0], state[1], state[2])
    velocity[:3] = _turned_back(world, state[7], state[8], state[9])
    velocity[3:] = _turned_back(world, state[10], state[11], state[12])
    x, y, z, w = state[3], state[4], state[5], state[6]
    cos, sin = math.cos(0.5 * world.axes_rad), math.sin(0.5 * world.axes_rad)
    pose[3], pose[4], pose[5], pose[6] = (
        cos * x - sin * y,
        cos * y + sin * x,
        cos * z + sin * w,
        cos * w - sin * z,
    )


@inner
def _state(world: Any) -> Array:
    """Place, attitude, velocity and angular velocity (13,) of the rock, in the world's own frame."""
    pointers = np.empty(7, np.int64)
    to = pointers.ctypes.data
    status = _submit(world.client, _request_state(world.client, world.rock))
    _get_state(status, to, to + 8, to + 16, to + 24, to + 32, to + 40, to + 48)
    out = np.empty(13)
    out[:7] = carray(_pointer(pointers[4]), 7, np.float64)
    out[7:] = carray(_pointer(pointers[5]), 6, np.float64)
    return out


@inner
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
        world.grip[:] = 0.0
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


@inner
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
    grip = world.grip
    turned = x * grip[0] + y * grip[1] + z * grip[2] < 0.0  # slip came to a halt on the way
    grip[0], grip[1], grip[2] = x, y, z
    sticks = world.friction == world.friction_static
    share = STARTS_TO_SLIP if sticks else STILL_SLIPS
    if turned or math.sqrt(x * x + y * y + z * z) < share * world.friction * pressing:
        return False
    if sticks:
        return True
    # Whether a point that touches moves along the plane after the step, which took it from where it touched.
    before = state[:3] - state[7:10] * world.step_s
    for contact in contacts:
        if contact[_NORMAL_FORCE] > 0.0:
            x, y, z = contact[_PLACE_A : _PLACE_A + 3] - before
            if slip_m_s(state[7:], (x, y, z)) > STILL_MOVES * world.impulse_m_s:
                return True
    return False


@inner
def _contacts(client: int) -> Array:
    """Bullet's contacts (k, 22): of its b3ContactPointData, whose leading integers take the room of three numbers."""
    told = np.zeros(2, np.int64)
    _submit(client, _request_contacts(client))
    _get_contacts(client, told.ctypes.data)
    count = told[0] & 0xFFFFFFFF
    if count == 0:
        return np.empty((0, 22))
    return carray(_pointer(told[1]), (count, 22), np.float64).copy()


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


def _called(name: str, result: Any, *arguments: Any) -> Any:
    """A C function, for Python."""
    function = getattr(_LIBRARY, name)
    function.restype, function.argtypes = result, arguments
    return function


class _Bullet:
    """What builds a world: Bullet's C functions by what they do."""

    P, N, K = ctypes.c_void_p, ctypes.c_double, ctypes.c_int
    THREE, FOUR = ctypes.c_double * 3, ctypes.c_double * 4

    connect = _called("b3ConnectPhysicsDirect", P)
    disconnect = _called("b3DisconnectSharedMemory", None, P)
    submit = _called("b3SubmitClientCommandAndWaitStatus", P, P, P)
    reset = _called("b3InitResetSimulationCommand", P, P)
    parameters = _called("b3InitPhysicsParamCommand", P, P)
    set_deterministic = _called("b3PhysicsParameterSetDeterministicOverlappingPairs", K, P, K)
    set_cone_friction = _called("b3PhysicsParamSetEnableConeFriction", K, P, K)
    set_slop = _called("b3PhysicsParamSetContactSlop", K, P, N)
    load_urdf = _called("b3LoadUrdfCommandInit", P, P, ctypes.c_char_p)
    set_urdf_flags = _called("b3LoadUrdfCommandSetFlags", K, P, K)
    body_of = _called("b3GetStatusBodyIndex", K, P)
    new_shape = _called("b3CreateCollisionShapeCommandInit", P, P)
    add_plane = _called("b3CreateCollisionShapeAddPlane", K, P, THREE, N)
    shape_of = _called("b3GetStatusCollisionShapeUniqueId", K, P)
    new_body = _called("b3CreateMultiBodyCommandInit", P, P)
    add_base = _called("b3CreateMultiBodyBase", K, P, N, K, K, THREE, FOUR, THREE, FOUR)
    dynamics = _called("b3InitChangeDynamicsInfo", P, P)
    set_friction = _called("b3ChangeDynamicsInfoSetLateralFriction", K, P, K, K, N)
    set_restitution = _called("b3ChangeDynamicsInfoSetRestitution", K, P, K, K, N)
    set_linear_damping = _called("b3ChangeDynamicsInfoSetLinearDamping", K, P, K, N)
    set_angular_damping = _called("b3ChangeDynamicsInfoSetAngularDamping", K, P, K, N)
    set_largest_speed = _called("b3ChangeDynamicsInfoSetMaxJointVelocity", K, P, K, N)
    set_activation = _called("b3ChangeDynamicsInfoSetActivationState", K, P, K, K)


USE_INERTIA_FROM_FILE = 2
"""Of a URDF: else that of the shapes' bounding boxes is taken."""

DISABLE_SLEEPING = 2
"""Of activation states."""


MOST_WORLDS = 6
"""In a process; each takes some 35 MB."""


class EnginePool:
    """Worlds of a process, each kept while the same rock is shaken again; the least recently used one is rebuilt."""

    def __init__(self) -> None:
        self._worlds: OrderedDict[tuple[int, int], tuple[ContactModel, NDArray[np.void]]] = OrderedDict()

    def world(self, contact: ContactModel, points: int) -> NDArray[np.void]:
        """World (1,) of dtype WORLD that holds the first `points` of a rock's contact points."""
        key = (id(contact), points)  # the model is kept beside its world, so that its identity stays its own
        if key not in self._worlds:
            if len(self._worlds) < MOST_WORLDS:
                client = int(_Bullet.connect())
            else:  # worlds are reset, not removed, since only that frees their memory
                client = int(self._worlds.popitem(last=False)[1][1]["client"][0])
            self._worlds[key] = contact, _build(client, contact, points)
        self._worlds.move_to_end(key)
        return self._worlds[key][1]

    def forget(self) -> None:
        """Make all worlds anew: one that a rock has left in no finite state holds no rock any more."""
        while self._worlds:
            _Bullet.disconnect(int(self._worlds.popitem()[1][1]["client"][0]))


def _build(client: int, contact: ContactModel, points: int) -> NDArray[np.void]:
    bullet = _Bullet
    bullet.submit(client, bullet.reset(client))
    command = bullet.parameters(client)
    bullet.set_deterministic(command, 1)
    bullet.set_cone_friction(command, 1)
    bullet.set_slop(command, 0.0)
    bullet.submit(client, command)
    with tempfile.NamedTemporaryFile("w", suffix=".urdf") as file:
        file.write(_urdf(contact.centres_body_m[:points], contact.radius_m, contact))
        file.flush()
        command = bullet.load_urdf(client, file.name.encode())
        bullet.set_urdf_flags(command, USE_INERTIA_FROM_FILE)
        rock = bullet.body_of(bullet.submit(client, command))
    command = bullet.dynamics(client)
    bullet.set_friction(command, rock, -1, 1.0)
    bullet.set_restitution(command, rock, -1, 1.0)
    bullet.set_linear_damping(command, rock, 0.0)
    bullet.set_angular_damping(command, rock, 0.0)
    bullet.set_largest_speed(command, rock, 1e9)
    bullet.set_activation(command, rock, DISABLE_SLEEPING)
    bullet.submit(client, command)
    command = bullet.new_shape(client)
    bullet.add_plane(command, bullet.THREE(0.0, 0.0, 1.0), 0.0)
    plane = bullet.shape_of(bullet.submit(client, command))
    command = bullet.new_body(client)
    origin, upright = bullet.THREE(0.0, 0.0, 0.0), bullet.FOUR(0.0, 0.0, 0.0, 1.0)
    bullet.add_base(command, 0.0, plane, -1, origin, upright, origin, upright)
    ground = bullet.body_of(bullet.submit(client, command))
    world = np.zeros(1, WORLD)
    world["client"], world["rock"], world["ground"], world["points"] = client, rock, ground, points
    world["inertia_m2"] = contact.principal_inertia_m2
    return world


def _urdf(centres_m: Array, radius_m: float, contact: ContactModel) -> str:
    """Spheres as one compound body: the other ways to make one keep sixteen shapes at most. One short line each."""
    spheres = "\n".join(
        f'<collision><origin xyz="{x!r} {y!r} {z!r}"/><geometry><sphere radius="{radius_m!r}"/></geometry></collision>'
        for x, y, z in centres_m.tolist()
    )
    ixx, iyy, izz = contact.principal_inertia_m2.tolist()
    return (
        '<robot name="rock">\n<link name="base">\n<inertial>\n<mass value="1"/>\n'
        f'<inertia ixx="{ixx!r}" iyy="{iyy!r}" izz="{izz!r}" ixy="0" ixz="0" iyz="0"/>\n</inertial>\n'
        f"{spheres}\n</link>\n</robot>\n"
    )


@cache
def process_pool() -> EnginePool:
    """The pool of this process, for who has none of his own."""
    return EnginePool()


def configure_for(world: NDArray[np.void], surface: ContactProperties, solver: SolverOptions) -> None:
    """Give a world (1,) the contact's properties and the solver's limits."""
    world["friction_static"], world["friction_kinetic"] = surface.friction_static, surface.friction_kinetic
    world["restitution"] = surface.restitution
    world["iterations"], world["residual_share"] = solver.iterations, solver.residual_share
    world["cold_iterations"] = max(solver.iterations, COLD_ITERATIONS)
