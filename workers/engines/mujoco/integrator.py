"""MuJoCo as the engine: the same rock, contact points and motion in MuJoCo, stepped in C over blocks of steps.

MuJoCo's contacts are springs and dampers as stiff as its time step allows, so that its error is of the first order in
the step. It has no coefficient of restitution, and one coefficient of friction. A rock is seated by our statics, ends
by our rules, and is described by our outcome.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from toppling.models.compiled import Array
from toppling.models.ground.plane import FLAT_SHARE
from toppling.models.ground.points import contact_of
from toppling.models.ground.stepping import Grounded
from toppling.models.kept import kept
from toppling.models.relief import contact_feet_m
from toppling.models.scene import Scene
from toppling.workers import quaternion as quat
from toppling.workers.engines.mujoco.free_body import Stepper, forces_in, forces_m_s2, hull, touch, world
from toppling.workers.engines.mujoco.surface import surface_world
from toppling.workers.engines.protocol import Steps
from toppling.workers.observation import travel_m
from toppling.workers.problem import Problem
from toppling.workers.stepping import Watch, take_steps

_MARGIN_SHARE = 1e-6
"""Of R: points so near are in contact, or rounding decides which corners of a block at rest are, and it slips askew."""

_SEATED_WITHIN_DEG = 0.5
"""A rock at rest that is tilted by less from its seat is back in it: what is left is the contacts' compression."""


class MujocoSteps:
    """Steps of one shake, with a look after each block."""

    def __init__(self, problem: Problem) -> None:
        self._problem, scene, step_s = problem, problem.scene, problem.time_step_s
        self._on_plane, contact = scene.ground.is_plane, problem.contact
        self._stepper = Stepper(*(_world if self._on_plane else surface_world)(scene, step_s))
        self._seat = problem.initial[0].copy() if problem.start is None and self._on_plane else None
        self._gravity_m_s2 = np.array([0.0, 0.0, -scene.gravity_m_s2]) @ contact.scene_from_support
        self._forces = forces_m_s2(problem.motion, step_s, self._gravity_m_s2, contact.scene_from_support)

    def __call__(self, sim: Grounded, block: int, watch: Watch) -> int:
        """Go on by this many steps; the pose in which they began."""
        first, grid = int(sim.counts[1]), int(sim.counts[2])
        new, scene = slice(first + 1, first + block + 1), self._problem.scene
        force_m_s2 = forces_in(self._forces, self._gravity_m_s2, grid, block)
        sim.pose[new], sim.velocity[new] = self._stepper.states(
            sim.pose[first], sim.velocity[first], force_m_s2
        )
        sim.time_s[new] = (grid + 1 + np.arange(block)) * sim.step_s
        sim.counts[[1, 2, 3, 5]] += block
        pose = sim.pose[sim.counts[1]]
        if self._on_plane:
            deepest_m = -self._problem.contact.gaps_m(pose).min()
        else:
            near = scene.grounded.contacts(pose, FLAT_SHARE * scene.grounded.size_m)
            deepest_m = -near["gap_m"].min(initial=0.0)
        watch.deepest_m[0] = max(watch.deepest_m[0], deepest_m)
        if self._seat is not None and self._is_slow(sim, first) and self._sits_down(sim):
            take_steps(sim, block, watch._replace(moves=False))
            self._stepper.restart()
        return first

    def _is_slow(self, sim: Grounded, since: int) -> bool:
        """Whether the rock has hardly moved since a pose."""
        last = sim.counts[1]
        way_m = travel_m(sim.pose[since], sim.pose[last], sim.size_m)
        speed_m_s = np.linalg.norm(sim.velocity[last, :3]) + sim.size_m * np.linalg.norm(
            sim.velocity[last, 3:]
        )
        slow = self._problem.rest_speed_m_s
        return bool(way_m < slow * (sim.time_s[last] - sim.time_s[since]) and speed_m_s < slow)

    def _sits_down(self, sim: Grounded) -> bool:
        """Take a rock at rest back to its seat, turned and shifted along the plane, if it is nearly there."""
        assert self._seat is not None  # as :meth:`__call__` has made sure
        pose, seat = sim.pose[sim.counts[1]], self._seat
        yaw = quat.yaw_between(seat, pose)
        turned = quat.product(np.array([0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw)]), seat[3:])
        between = quat.matrix(quat.product(pose[3:], quat.inverse(turned)))
        if not between[2, 2] > math.cos(math.radians(_SEATED_WITHIN_DEG)):
            return False
        pose[2], pose[3:] = seat[2], turned
        sim.velocity[sim.counts[1]] = 0.0
        return True


@kept
def _world(scene: Scene, step_s: float) -> tuple[Any, Any]:
    """A scene as MuJoCo's model and data: support frame, body axes."""
    import mujoco

    contact = contact_of(scene)
    spec, body = world(step_s, contact.com_m, contact.principal_inertia_m2)
    ground = spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1.0, 1.0, 1.0])
    ground.margin = _MARGIN_SHARE * contact.half_diagonal_m
    feet_m = (contact_feet_m(scene.rock, scene.pedestal) - scene.rock.com_m) @ contact.scene_from_support
    for geom in (ground, body.add_geom(**_shape(spec, feet_m @ contact.support_from_body))):
        touch(geom, step_s, scene.contact.friction_static)
    model = spec.compile()
    return model, mujoco.MjData(model)


def _shape(spec: Any, points_m: Array) -> dict[str, Any]:
    """A box as such, however it is turned, any other body as the convex hull of its feet.

    A plane meets a box at all its lower corners, a hull at some of them: which, rounding decides. Spheres at the points
    are the same on a block, five times dearer on a scanned rock, and brake a rolling rim.
    """
    import mujoco

    axes = _box_axes(points_m)
    if axes is not None:
        half, middle = 0.5 * np.ptp(points_m @ axes, axis=0), points_m.mean(axis=0)
        quaternion = np.roll(Rotation.from_matrix(axes).as_quat(), 1)
        return {"type": mujoco.mjtGeom.mjGEOM_BOX, "size": half, "pos": middle, "quat": quaternion}
    return hull(spec, "hull", points_m)


def _box_axes(points_m: Array) -> Array | None:
    """Right-handed axes (columns) of the box whose corners the points are, None where they are no box's.

    Principal axes would not do: two of a square plate's are anywhere in its plane.
    """
    if len(points_m) != 8:
        return None
    from_first = points_m[1:] - points_m[0]
    length_m = np.linalg.norm(from_first, axis=1)
    shortest = from_first[np.argmin(length_m)] / length_m.min()
    across = from_first[np.abs(from_first @ shortest) < 1e-6 * length_m.max()]
    if len(across) == 0:
        return None
    second = across[np.argmin(np.linalg.norm(across, axis=1))]
    second = second - (second @ shortest) * shortest
    second /= np.linalg.norm(second)
    axes = np.stack([shortest, second, np.cross(shortest, second)], axis=1)
    out_m = np.abs((points_m - points_m.mean(axis=0)) @ axes)
    return axes if np.allclose(out_m, out_m[0]) else None


def steps(problem: Problem) -> Steps:
    """What takes the steps of one shake; MuJoCo keeps nothing between shakes but models of scenes."""
    return MujocoSteps(problem)
