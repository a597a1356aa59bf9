"""The program's steps, which PyBullet carries out and whose contacts it finds for itself: all of them, or a share.

A step takes the rock from one pose to the next. PyBullet is given the first of them and the velocity that leads to the
other, and must come there; the gap that it finds between the rock's hull and the plane must be ours too. It has the
rock higher, so that its own solver never brakes it.
"""

from __future__ import annotations

import math
import os
import zlib
from collections import OrderedDict
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from toppling.models.compiled import Array, Flags, compiled
from toppling.models.ground.plane import is_over_plane
from toppling.models.ground.points import ContactModel
from toppling.models.ground.stepping import Grounded
from toppling.models.ground.vectors import rotation_of
from toppling.models.terminal import standard_error_to
from toppling.workers.engines.protocol import StepCheckError, Steps
from toppling.workers.problem import Problem
from toppling.workers.stepping import Watch, take_steps

with Path(os.devnull).open("w") as nowhere, standard_error_to(nowhere.fileno()):
    import pybullet  # which writes to standard error when it was built

ALLOWED = 1e-9
"""Of R: by which a pose may differ."""

GAP_ALLOWED = 2.0 * math.sqrt(3.0) / 10216
"""Of R: by which the least gap may differ. PyBullet keeps a hull's corners to 1/10216 of its extent along each axis."""

_RAISED, _NEAR = 0.05, 0.1
"""Of R: by how much PyBullet has the rock higher, and gaps up to which it looks for contacts."""

_ABOVE = 1e-4
"""Of the way from the points' middle to the centre of mass."""

_DISTANCE = 8
"""Field of a contact that `getContactPoints` returns: its gap, m."""

_MOST_WORLDS = 8
"""Worlds that a process keeps, as many as a worker keeps scenes; the least recently used one is rebuilt."""

_SPIN_ROUNDS = 20
"""Rounds of the fixed point that finds the spin before a step; each gains a factor of about 1 / (step x spin)."""

_WORLDS: OrderedDict[int, tuple[ContactModel, int, int]] = OrderedDict()
"""Contact model, client and rock's body of each world, by the identity of the model."""


class CheckedSteps:
    """Takes the steps of one shake, and has PyBullet repeat those over the plane.

    Raises
    ------
    StepCheckError
        If PyBullet moves the rock elsewhere, or finds another gap.
    """

    def __init__(self, problem: Problem) -> None:
        self._problem = problem
        self._random = np.random.default_rng(zlib.crc32(problem.motion.acceleration_m_s2.tobytes()))
        # On a rounded base or a mesh PyBullet's hull touches elsewhere than our surfaces.
        self._checks = not problem.rolls and problem.scene.ground.is_plane

    def __call__(self, sim: Grounded, block: int, watch: Watch) -> int:
        """Go on by blocks of so many steps, as :func:`toppling.workers.stepping.take_steps`."""
        begin = sim.counts[1]
        since = int(take_steps(sim, block, watch))
        if self._checks and sim.counts[1] > begin:
            self._repeat(sim, begin, sim.counts[1])
        return since

    def _repeat(self, sim: Grounded, begin: int, end: int) -> None:
        """Let PyBullet take a share of the steps between two poses."""
        time_s, pose = sim.time_s[begin : end + 1], sim.pose[begin : end + 1]
        # A longer step is one in which the rock rested.
        drawn = (np.diff(time_s) < 1.5 * sim.step_s) & (
            self._random.random(end - begin) < self._problem.options.checked_steps
        )
        which = np.flatnonzero(drawn)
        which = which[_over_plane(sim, pose[which])]
        if len(which) == 0:
            return
        sim.counts[5] += len(which)
        start, reached = pose[which], pose[which + 1]
        there, gap_m = carried_out(self._problem.contact, start, reached, sim.step_s)
        unlike = _difference(there, reached, sim.size_m).max(axis=1)
        seen_m = (_NEAR - _RAISED) * sim.size_m
        least_m = self._problem.contact.gaps_m(start).min(axis=0)
        gap_off = np.abs(gap_m.clip(max=seen_m) - least_m.clip(max=seen_m)) / sim.size_m
        for off, allowed in ((unlike, ALLOWED), (gap_off, GAP_ALLOWED)):
            if not (off <= allowed).all():
                first = int(np.argmin(off <= allowed))
                raise StepCheckError(float(time_s[which[first]]), float(off[first]), allowed)


@compiled(allocates=True)
def _over_plane(sim: Grounded, poses: Array) -> Flags:
    """In which of some poses (n, 7) the plane is all that the rock may touch."""
    found = np.zeros(len(poses), np.bool_)
    for i in range(len(poses)):
        rotation_of(poses[i], sim.work.turn)
        found[i] = is_over_plane(sim.over, poses[i], sim.work.turn, sim.lists.farthest_m, 0.0)
    return found


def _difference(pose: Array, other: Array, size_m: float) -> Array:
    """Differences (n, 6) of two sequences of poses: of the place over R, and of the attitude, rad."""
    turn = Rotation.from_quat(pose[:, 3:]) * Rotation.from_quat(other[:, 3:]).inv()
    return np.abs(np.hstack([(pose[:, :3] - other[:, :3]) / size_m, turn.as_rotvec()]))


def carried_out(contact: ContactModel, start: Array, end: Array, step_s: float) -> tuple[Array, Array]:
    """Let PyBullet take a rock from some poses (n, 7) to others in one step each.

    Returns
    -------
    (n, 7) array, (n,) array
        The poses to which it comes, and the least gap that it finds in the first ones, m.
    """
    client, rock = _world_of(contact)
    pybullet.setPhysicsEngineParameter(fixedTimeStep=step_s, physicsClientId=client)
    raised_m = _RAISED * contact.half_diagonal_m
    before, after = Rotation.from_quat(start[:, 3:]), Rotation.from_quat(end[:, 3:])
    spin = (after * before.inv()).as_rotvec() / step_s
    spin = before.apply(_spin_before(before.inv().apply(spin), contact.principal_inertia_m2, step_s))
    place, attitude = (start[:, :3] + (0.0, 0.0, raised_m)).tolist(), start[:, 3:].tolist()
    speed, spins = ((end[:, :3] - start[:, :3]) / step_s).tolist(), spin.tolist()
    there, gap_m = [], []
    for k in range(len(place)):
        pybullet.resetBasePositionAndOrientation(rock, place[k], attitude[k], client)
        pybullet.resetBaseVelocity(rock, speed[k], spins[k], client)
        pybullet.stepSimulation(client)
        there.append(pybullet.getBasePositionAndOrientation(rock, client))
        found = pybullet.getContactPoints(rock, physicsClientId=client)
        gap_m.append(min((one[_DISTANCE] for one in found), default=_NEAR * contact.half_diagonal_m))
    reached = np.array([(*at, *turn) for at, turn in there])
    reached[:, 2] -= raised_m
    return reached, np.array(gap_m) - raised_m


def _spin_before(spin_rad_s: Array, inertia_m2: Array, step_s: float) -> Array:
    """Angular velocities (n, 3) that a step without moments turns into those given, in body axes.

    Bullet adds step x inertia^-1 ((inertia x spin) x spin), at the start of the step.
    """
    turning = step_s * (inertia_m2[[1, 2, 0]] - inertia_m2[[2, 0, 1]]) / inertia_m2
    before = spin_rad_s
    for _ in range(_SPIN_ROUNDS):
        before = spin_rad_s - turning * before[:, [1, 2, 0]] * before[:, [2, 0, 1]]
    return before


def _world_of(contact: ContactModel) -> tuple[int, int]:
    """Client and body of a world with the hull of a rock's contact points over a plane."""
    key = id(contact)  # the model is kept beside its world, so that its identity stays its own
    if key not in _WORLDS:
        is_full = len(_WORLDS) == _MOST_WORLDS
        client = _WORLDS.popitem(last=False)[1][1] if is_full else pybullet.connect(pybullet.DIRECT)
        _WORLDS[key] = contact, client, _build(client, contact)
    _WORLDS.move_to_end(key)
    return _WORLDS[key][1:]


def _build(client: int, contact: ContactModel) -> int:
    """Build a world; the rock's body."""
    pybullet.resetSimulation(physicsClientId=client)
    pybullet.setPhysicsEngineParameter(
        contactSlop=0.0,
        deterministicOverlappingPairs=1,
        contactBreakingThreshold=_NEAR,  # over the radius of its bounding sphere
        physicsClientId=client,
    )
    # With a place just above their middle, the points of one plane have a hull too.
    points_m = contact.points_body_m
    corners = [*points_m.tolist(), ((1.0 - _ABOVE) * points_m.mean(axis=0)).tolist()]
    hull = pybullet.createCollisionShape(pybullet.GEOM_MESH, vertices=corners, physicsClientId=client)
    rock = pybullet.createMultiBody(1.0, hull, physicsClientId=client)
    plane = pybullet.createCollisionShape(
        pybullet.GEOM_PLANE, planeNormal=[0.0, 0.0, 1.0], physicsClientId=client
    )
    ground = pybullet.createMultiBody(0.0, plane, physicsClientId=client)
    for body in (rock, ground):
        pybullet.changeDynamics(
            body, -1, lateralFriction=0.0, restitution=0.0, collisionMargin=0.0, physicsClientId=client
        )
    pybullet.changeDynamics(
        rock,
        -1,
        localInertiaDiagonal=contact.principal_inertia_m2.tolist(),
        linearDamping=0.0,
        angularDamping=0.0,
        maxJointVelocity=1e9,
        activationState=pybullet.ACTIVATION_STATE_DISABLE_SLEEPING,
        physicsClientId=client,
    )
    return int(rock)


def steps(problem: Problem) -> Steps:
    """What takes the steps of one shake."""
    return CheckedSteps(problem)
