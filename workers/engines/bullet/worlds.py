"""Worlds of PyBullet, in each a rock of contact points over a plane: how they are built, and what a process keeps."""

from __future__ import annotations

import ctypes
import tempfile
from collections import OrderedDict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from toppling.models.ground.points import ContactModel
from toppling.workers.engines.bullet import binding

WORLD = np.dtype(
    (
        np.record,
        [("client", "i8"), ("rock", "i8"), ("points", "i8"), ("step_s", "f8"), ("inertia_m2", "f8", 3)],
    )
)
"""The client it lives in, the rock's body, how many points it has, its present step."""

RADIUS_SHARE = 1e-5
"""Of R: radius of the spheres that stand for points."""


def _called(name: str, result: Any, *arguments: Any) -> Any:
    """A C function, for Python."""
    function = getattr(binding.LIBRARY, name)
    function.restype, function.argtypes = result, arguments
    return function


class _Bullet:
    """What builds a world: Bullet's C functions by what they do."""

    P, N, K = ctypes.c_void_p, ctypes.c_double, ctypes.c_int
    THREE, FOUR = ctypes.c_double * 3, ctypes.c_double * 4

    connect = _called("b3ConnectPhysicsDirect", P)
    submit = _called("b3SubmitClientCommandAndWaitStatus", P, P, P)
    reset = _called("b3InitResetSimulationCommand", P, P)
    parameters = _called("b3InitPhysicsParamCommand", P, P)
    set_deterministic = _called("b3PhysicsParameterSetDeterministicOverlappingPairs", K, P, K)
    set_gravity = _called("b3PhysicsParamSetGravity", K, P, N, N, N)
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
    set_linear_damping = _called("b3ChangeDynamicsInfoSetLinearDamping", K, P, K, N)
    set_angular_damping = _called("b3ChangeDynamicsInfoSetAngularDamping", K, P, K, N)
    set_largest_speed = _called("b3ChangeDynamicsInfoSetMaxJointVelocity", K, P, K, N)
    set_activation = _called("b3ChangeDynamicsInfoSetActivationState", K, P, K, K)


_USE_INERTIA_FROM_FILE = 2
"""Of a URDF: else that of the shapes' bounding boxes is taken."""

_DISABLE_SLEEPING = 2
"""Of activation states."""

_MOST_WORLDS = 6
"""In a process; each takes some 35 MB."""

_WORLDS: OrderedDict[tuple[int, int], tuple[ContactModel, NDArray[np.void]]] = OrderedDict()
"""Of this process, each kept while the same rock is shaken again; the least recently used one is rebuilt."""


def world_of(contact: ContactModel, points: int) -> NDArray[np.void]:
    """World (1,) of dtype WORLD that holds the first `points` of a rock's contact points."""
    key = (id(contact), points)  # the model is kept beside its world, so that its identity stays its own
    if key not in _WORLDS:
        if len(_WORLDS) < _MOST_WORLDS:
            client = int(_Bullet.connect())
        else:  # worlds are reset, not removed, since only that frees their memory
            client = int(_WORLDS.popitem(last=False)[1][1]["client"][0])
        _WORLDS[key] = contact, _build(client, contact, points)
    _WORLDS.move_to_end(key)
    return _WORLDS[key][1]


def _build(client: int, contact: ContactModel, points: int) -> NDArray[np.void]:
    bullet = _Bullet
    bullet.submit(client, bullet.reset(client))
    command = bullet.parameters(client)
    bullet.set_deterministic(command, 1)
    bullet.set_slop(command, 0.0)
    bullet.set_gravity(command, 0.0, 0.0, 0.0)
    bullet.submit(client, command)
    with tempfile.NamedTemporaryFile("w", suffix=".urdf") as file:
        file.write(_urdf(contact, points))
        file.flush()
        command = bullet.load_urdf(client, file.name.encode())
        bullet.set_urdf_flags(command, _USE_INERTIA_FROM_FILE)
        rock = bullet.body_of(bullet.submit(client, command))
    command = bullet.dynamics(client)
    bullet.set_friction(command, rock, -1, 0.0)
    bullet.set_linear_damping(command, rock, 0.0)
    bullet.set_angular_damping(command, rock, 0.0)
    bullet.set_largest_speed(command, rock, 1e9)
    bullet.set_activation(command, rock, _DISABLE_SLEEPING)
    bullet.submit(client, command)
    command = bullet.new_shape(client)
    bullet.add_plane(command, bullet.THREE(0.0, 0.0, 1.0), 0.0)
    plane = bullet.shape_of(bullet.submit(client, command))
    command = bullet.new_body(client)
    origin, upright = bullet.THREE(0.0, 0.0, 0.0), bullet.FOUR(0.0, 0.0, 0.0, 1.0)
    bullet.add_base(command, 0.0, plane, -1, origin, upright, origin, upright)
    bullet.submit(client, command)
    world = np.zeros(1, WORLD)
    world["client"], world["rock"], world["points"] = client, rock, points
    world["inertia_m2"] = contact.principal_inertia_m2
    return world


def _urdf(contact: ContactModel, points: int) -> str:
    """Spheres as one compound body: the other ways to make one keep sixteen shapes at most. One short line each."""
    radius_m = RADIUS_SHARE * contact.half_diagonal_m
    spheres = "\n".join(
        f'<collision><origin xyz="{x!r} {y!r} {z!r}"/><geometry><sphere radius="{radius_m!r}"/></geometry></collision>'
        for x, y, z in contact.points_body_m[:points].tolist()
    )
    ixx, iyy, izz = contact.principal_inertia_m2.tolist()
    return (
        '<robot name="rock">\n<link name="base">\n<inertial>\n<mass value="1"/>\n'
        f'<inertia ixx="{ixx!r}" iyy="{iyy!r}" izz="{izz!r}" ixy="0" ixz="0" iyz="0"/>\n</inertial>\n'
        f"{spheres}\n</link>\n</robot>\n"
    )
