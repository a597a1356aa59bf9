"""PyBullet alone: a rock's convex hull on a plane, moved by the engine's own contacts and friction.

This is what a first program with PyBullet does, and the reason for the contact law in `workers`: the front
(`front.py`) shows its error against its cost beside the presets.
"""

import math

import numpy as np
import pybullet
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from toppling.models.motions.motion import Motion
from toppling.models.scene import Scene

STEPS_A_SECOND = (240, 1000, 4000)
"""The engine's own step, and what users choose who distrust it."""

REST_SPEED_FRACTION = 5e-4
"""In sqrt(g R): a rock slower than this after the motion has come to rest."""

LONGEST_AFTER = 60.0
"""In sqrt(R / g), after the motion: a rock that still moves is judged as it is."""

FALLEN_TILT_DEG, TOPPLED_TILT_DEG = 75.0, 45.0
"""Tilt at which a rock is known to fall, and beyond which one at rest lies."""


def topples(scene: Scene, motion: Motion, steps_a_second: int) -> tuple[bool, float, float, float]:
    """Shake a rock on its plane by PyBullet alone, in the frame of the ground.

    Returns whether it toppled, its largest tilt, deg, the time stepped through, s, and the deepest penetration,
    m.
    """
    client = pybullet.connect(pybullet.DIRECT)
    try:
        rock = _world(scene, client, steps_a_second)
        return _shaken(scene, motion, rock, client, 1.0 / steps_a_second)
    finally:
        pybullet.disconnect(client)


def _world(scene: Scene, client: int, steps_a_second: int) -> int:
    """Ground and rock, without the damping that the engine adds to every body; gives the rock's number."""
    rock, plane = scene.rock, scene.pedestal
    hull = rock.vertices_m[ConvexHull(rock.vertices_m).vertices] - rock.com_m
    moments, axes = np.linalg.eigh(rock.inertia_per_mass_m2)
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    pybullet.setTimeStep(1.0 / steps_a_second, physicsClientId=client)
    ground = pybullet.createMultiBody(
        0.0,
        pybullet.createCollisionShape(pybullet.GEOM_PLANE, planeNormal=plane.normal, physicsClientId=client),
        basePosition=plane.point_m,
        physicsClientId=client,
    )
    # The body's own axes are the principal ones, as the engine keeps three moments only.
    body = pybullet.createMultiBody(
        1.0,
        pybullet.createCollisionShape(pybullet.GEOM_MESH, vertices=hull @ axes, physicsClientId=client),
        basePosition=rock.com_m,
        baseOrientation=Rotation.from_matrix(axes).as_quat(),
        physicsClientId=client,
    )
    pybullet.changeDynamics(
        body, -1, localInertiaDiagonal=moments, linearDamping=0.0, angularDamping=0.0, physicsClientId=client
    )
    for entry, friction in (
        (ground, 1.0),
        (body, scene.contact.friction_static),
    ):  # the engine multiplies them
        pybullet.changeDynamics(
            entry, -1, lateralFriction=friction, restitution=scene.contact.restitution, physicsClientId=client
        )
    return body


def _shaken(
    scene: Scene, motion: Motion, rock: int, client: int, step_s: float
) -> tuple[bool, float, float, float]:
    size, gravity = scene.rock.half_diagonal_m, scene.gravity_m_s2
    last = math.ceil((motion.duration_s + LONGEST_AFTER * math.sqrt(size / gravity)) / step_s)
    velocity = motion.velocity_at(np.arange(last + 1) * step_s)
    # The ground's frame: each step has the mean acceleration of the ground over it, turned round.
    loads = np.array([0.0, 0.0, -gravity]) - np.diff(velocity, axis=0) / step_s
    at_rest = REST_SPEED_FRACTION * math.sqrt(gravity * size)
    begin, tilt, largest, deepest = _vertical(rock, client), 0.0, 0.0, 0.0
    for k, load in enumerate(loads.tolist()):
        pybullet.setGravity(*load, physicsClientId=client)
        pybullet.stepSimulation(physicsClientId=client)
        tilt = math.degrees(math.acos(min(1.0, float(_vertical(rock, client) @ begin))))
        largest = max(largest, tilt)
        if tilt > FALLEN_TILT_DEG:
            break
        if k * step_s > motion.duration_s:
            speeds = pybullet.getBaseVelocity(rock, physicsClientId=client)
            if max(map(abs, (*speeds[0], *(size * speed for speed in speeds[1])))) < at_rest:
                break
        if k % 16 == 0:
            touching = pybullet.getContactPoints(bodyA=rock, physicsClientId=client)
            deepest = max([deepest, *(-entry[8] for entry in touching)])
    return tilt > TOPPLED_TILT_DEG, largest, (k + 1) * step_s, deepest


def _vertical(rock: int, client: int) -> np.ndarray:
    """The vertical in the axes of the rock."""
    turn = pybullet.getBasePositionAndOrientation(rock, physicsClientId=client)[1]
    return np.array(pybullet.getMatrixFromQuaternion(turn)[6:])
