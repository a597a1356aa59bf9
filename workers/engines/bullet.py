"""The program's steps, which PyBullet carries out and whose contacts it finds for itself: all of them, or a share.

A step takes the rock from one pose to the next. PyBullet is given the first of them and the velocity that leads to the
other, and must come there; the gap that it finds between the hull of the rock and its ground must be ours too.
"""

from __future__ import annotations

import math
import os
import zlib
from collections import OrderedDict
from pathlib import Path
from typing import NamedTuple

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from toppling.models.caching import cached
from toppling.models.compiled import Array, Flags, Indices, compiled
from toppling.models.ground.body import GroundedBody
from toppling.models.ground.plane import is_over_plane
from toppling.models.ground.points import ContactModel
from toppling.models.ground.rigid import rotation_of
from toppling.models.ground.stepping import Grounded
from toppling.models.terminal import standard_error_to
from toppling.workers.engines.protocol import StepCheckError, Steps
from toppling.workers.problem import Problem
from toppling.workers.stepping import Watch, take_steps

with Path(os.devnull).open("w") as nowhere, standard_error_to(nowhere.fileno()):
    import pybullet  # which writes to standard error when it was built

ALLOWED = 1e-9
"""Tolerance over R on a pose."""

GAP_ALLOWED = 2.0 * math.sqrt(3.0) / 10216
"""Tolerance over R on the least gap. PyBullet keeps a hull's corners to 1/10216 of its extent along each axis."""

_NEAR = 0.05
"""Gap over R up to which both find contacts."""

_ABOVE = 1e-4
"""Share of the distance from the points' mean to the centre of mass."""

_DISTANCE = 8
"""Field of a contact that `getClosestPoints` returns: its gap, m."""

_BLOCK = 64
"""Steps that are drawn together."""

_FINEST = 20_000
"""Corners of a convex rock times triangles of its ground: with more, a step would take PyBullet above .1 ms."""

_GROUND, _ROCK = 0, 1
"""Bodies of a world."""

_MOST_WORLDS = 8
"""Worlds that a process keeps, as many as a worker keeps scenes; the least recently used one is rebuilt."""

_SPIN_ROUNDS = 20
"""Most rounds of the fixed point that finds the spin before a step; each gains a factor of about 1 / (step x spin)."""


class _World(NamedTuple):
    """A world of PyBullet, in which a rock does not collide: contacts are asked for, and brake nothing."""

    model: ContactModel | GroundedBody
    client: int
    inertia_m2: Array
    near_m: float


_WORLDS: OrderedDict[int, _World] = OrderedDict()
"""Worlds by the identity of what they model, which is kept there so that its identity stays its own."""


class CheckedSteps:
    """Takes the steps of one shake, and has PyBullet repeat those over the plane, and over coarse meshes.

    Raises
    ------
    StepCheckError
        If PyBullet moves the rock elsewhere, or finds another gap.
    """

    def __init__(self, problem: Problem) -> None:
        self._problem = problem
        self._random = np.random.default_rng(zlib.crc32(problem.motion.acceleration_m_s2.tobytes()))

    def __call__(self, sim: Grounded, block: int, watch: Watch) -> int:
        """Go on by blocks of so many steps, as :func:`toppling.workers.stepping.take_steps`."""
        begin = sim.counts[1]
        since = int(take_steps(sim, block, watch))
        # A smooth base or dome touches elsewhere than the hull of its triangles.
        if not self._problem.scene.rolls and sim.counts[1] > begin:
            self._repeat(sim, begin, sim.counts[1])
        return since

    def _repeat(self, sim: Grounded, begin: int, end: int) -> None:
        """Let PyBullet take a share of the steps between two poses."""
        time_s, pose = sim.time_s[begin : end + 1], sim.pose[begin : end + 1]
        # Many steps take hardly longer than one. A longer step is one in which the rock rested.
        blocks = self._random.random(-(-(end - begin) // _BLOCK)) < self._problem.options.checked_steps
        drawn = np.repeat(blocks, _BLOCK)[: end - begin] & (np.diff(time_s) < 1.5 * sim.step_s)
        which = np.flatnonzero(drawn)
        over_plane = _over_plane(sim, pose[which])
        self._compare(sim, self._problem.contact, pose, time_s, which[over_plane])
        if not over_plane.all() and _is_coarse(body := self._problem.scene.grounded):
            self._compare(sim, body, pose, time_s, which[~over_plane])

    @staticmethod
    def _compare(
        sim: Grounded, model: ContactModel | GroundedBody, pose: Array, time_s: Array, which: Indices
    ) -> None:
        """Let PyBullet take the steps from some of the poses, and compare where it comes and what it finds."""
        if len(which) == 0:
            return
        sim.counts[5] += len(which)
        start, reached = pose[which], pose[which + 1]
        there, gap_m = after_steps(model, start, reached, sim.step_s)
        unlike = _difference(there, reached, sim.size_m).max(axis=1)
        least_m = _least_gaps_m(model, start, _NEAR * sim.size_m)
        gap_off = np.abs(gap_m - least_m) / sim.size_m
        for off, allowed in ((unlike, ALLOWED), (gap_off, GAP_ALLOWED)):
            if not (off <= allowed).all():
                first = int(np.argmin(off <= allowed))
                raise StepCheckError(float(time_s[which[first]]), float(off[first]), allowed)


@cached
def _is_coarse(body: GroundedBody) -> bool:
    """Whether PyBullet can repeat steps over a mesh: the rock is its hull, and what it touches is what is meshed."""
    return (
        not body.rolls_on_facets
        and len(body.rock.vertices_m) * len(body.ground.faces) <= _FINEST
        and bool(trimesh.Trimesh(body.rock.vertices_m, body.rock.faces, process=False).is_convex)
    )


def _least_gaps_m(model: ContactModel | GroundedBody, poses: Array, near_m: float) -> Array:
    """Least gap (n,) in each of some poses, or how near one is looked for."""
    if isinstance(model, ContactModel):
        return np.minimum(model.gaps_m(poses).min(axis=0), near_m)
    return np.array([model.contacts(pose, near_m)["gap_m"].min(initial=near_m) for pose in poses])


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


def after_steps(
    model: ContactModel | GroundedBody, start: Array, end: Array, step_s: float
) -> tuple[Array, Array]:
    """Let PyBullet take a rock from some poses (n, 7) to others in one step each.

    Returns
    -------
    (n, 7) array, (n,) array
        The poses to which it comes, and the least gap that it finds in the first ones, m.
    """
    _, client, inertia_m2, near_m = _world_of(model)
    pybullet.setPhysicsEngineParameter(fixedTimeStep=step_s, physicsClientId=client)
    before, after = Rotation.from_quat(start[:, 3:]), Rotation.from_quat(end[:, 3:])
    spin = (after * before.inv()).as_rotvec() / step_s
    spin = before.apply(_spin_before(before.inv().apply(spin), inertia_m2, step_s))
    # Flat lists: of rows that are lists themselves the garbage collector would look at every one, again and again.
    given = np.hstack([start, (end[:, :3] - start[:, :3]) / step_s, spin]).ravel().tolist()
    there, gap_m = [], []
    for k in range(0, len(given), 13):
        pybullet.resetBasePositionAndOrientation(_ROCK, given[k : k + 3], given[k + 3 : k + 7], client)
        least_m = near_m
        for contact in pybullet.getClosestPoints(_ROCK, _GROUND, near_m, physicsClientId=client):
            least_m = min(least_m, contact[_DISTANCE])
        gap_m.append(least_m)
        pybullet.resetBaseVelocity(_ROCK, given[k + 7 : k + 10], given[k + 10 : k + 13], client)
        pybullet.stepSimulation(client)
        for part in pybullet.getBasePositionAndOrientation(_ROCK, client):
            there += part
    return np.reshape(there, (-1, 7)), np.array(gap_m)


def _spin_before(spin_rad_s: Array, inertia_m2: Array, step_s: float) -> Array:
    """Angular velocities (n, 3) that a step without moments turns into those given, in body axes.

    Bullet adds step x inertia^-1 ((inertia x spin) x spin), at the start of the step.
    """
    turning = step_s * (inertia_m2[[1, 2, 0]] - inertia_m2[[2, 0, 1]]) / inertia_m2
    before = spin_rad_s
    for _ in range(_SPIN_ROUNDS):
        former, before = before, spin_rad_s - turning * before[:, [1, 2, 0]] * before[:, [2, 0, 1]]
        if np.array_equal(former, before):
            break
    return before


def _world_of(model: ContactModel | GroundedBody) -> _World:
    """World with the hull of a rock and its ground."""
    key = id(model)
    if key not in _WORLDS:
        is_full = len(_WORLDS) == _MOST_WORLDS
        client = _WORLDS.popitem(last=False)[1].client if is_full else pybullet.connect(pybullet.DIRECT)
        _WORLDS[key] = _built(client, model)
    _WORLDS.move_to_end(key)
    return _WORLDS[key]


def _built(client: int, model: ContactModel | GroundedBody) -> _World:
    pybullet.resetSimulation(physicsClientId=client)
    if isinstance(model, ContactModel):
        inertia_m2, size_m, points_m = model.principal_inertia_m2, model.half_diagonal_m, model.points_body_m
        # With a place just above their middle, the points of one plane have a hull too.
        corners_m = np.vstack([points_m, (1.0 - _ABOVE) * points_m.mean(axis=0)])
        ground = {"shapeType": pybullet.GEOM_PLANE, "planeNormal": [0.0, 0.0, 1.0]}
    else:
        inertia_m2, size_m, corners_m = model.inertia_m2, model.size_m, model.rock.vertices_m
        ground = {
            "shapeType": pybullet.GEOM_MESH,
            "vertices": model.ground.vertices_m.tolist(),
            "indices": model.ground.faces.ravel().tolist(),
            "flags": pybullet.GEOM_FORCE_CONCAVE_TRIMESH,
        }
    hull = {"shapeType": pybullet.GEOM_MESH, "vertices": corners_m.tolist()}
    for body, (mass_kg, shape) in enumerate(((0.0, ground), (1.0, hull))):
        made = pybullet.createCollisionShape(**shape, physicsClientId=client)
        assert pybullet.createMultiBody(mass_kg, made, physicsClientId=client) == body
        pybullet.changeDynamics(body, -1, collisionMargin=0.0, physicsClientId=client)
    pybullet.setCollisionFilterGroupMask(_ROCK, -1, 0, 0, client)
    pybullet.changeDynamics(
        _ROCK,
        -1,
        localInertiaDiagonal=inertia_m2.tolist(),
        linearDamping=0.0,
        angularDamping=0.0,
        maxJointVelocity=1e9,
        activationState=pybullet.ACTIVATION_STATE_DISABLE_SLEEPING,
        physicsClientId=client,
    )
    return _World(model, client, inertia_m2, _NEAR * size_m)


def steps(problem: Problem) -> Steps:
    """Stepper of a single shake."""
    return CheckedSteps(problem)
