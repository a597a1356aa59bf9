"""MuJoCo as the engine: the same rock, points or pieces, and motion, stepped in C over blocks of steps."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import linprog
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.transform import Rotation

from toppling.models.caching import cached
from toppling.models.compiled import Array, Indices
from toppling.models.errors import InputError
from toppling.models.ground.mesh import ContactMesh
from toppling.models.ground.pairs import moved_m
from toppling.models.ground.plane import FLAT_SHARE
from toppling.models.ground.points import contact_of
from toppling.models.ground.stepping import Grounded
from toppling.models.motions.motion import Motion
from toppling.models.relief import contact_feet_m
from toppling.models.scene import Scene
from toppling.workers.engines.protocol import Steps
from toppling.workers.problem import Problem
from toppling.workers.seating import seated
from toppling.workers.stepping import Watch, take_steps

_FILLED_SHARE = 1e-3
"""Share of a piece's volume by which the hull of joined cells may exceed the cells."""

_STEEP = 0.1
"""Upward part of a triangle's normal up to which the ground lies behind it, not below it."""


def _ground_pieces(ground: ContactMesh, depth_m: float) -> list[Array]:
    """Convex pieces, each of (n, 3) points: columns below triangles that face up, plates behind the others.

    Parameters
    ----------
    ground : ContactMesh
        Support frame.
    depth_m : float
        How far columns reach below the lowest vertex; plates are a tenth as thick.
    """
    corners = ground.vertices_m[ground.faces]
    below = corners.copy()
    rises = ground.normals[:, 2] > _STEEP
    below[..., 2] = corners[..., 2].min() - depth_m
    below[~rises] = corners[~rises] - 0.1 * depth_m * ground.normals[~rises, None, :]
    # A plate has the sign of no group but its own plane's.
    group = np.where(rises, -1, np.unique(ground.normals.round(6), axis=0, return_inverse=True)[1])
    return _joined(np.concatenate([corners, below], axis=1), ground.edge_of, group)


def _rock_pieces(rock: ContactMesh) -> list[Array] | None:
    """Convex pieces of a rock, each of (n, 3) points: its hull, or wedges that meet in a point that sees all of it.

    None where no point does.
    """
    corners = rock.vertices_m[rock.faces]
    centre = _sees_all(rock)
    if centre is None:
        return None
    cells = np.concatenate([corners, np.broadcast_to(centre, (len(corners), 1, 3))], axis=1)
    return _joined(cells, rock.edge_of, np.zeros(len(corners), np.int64))


def hollow_m(rock: ContactMesh, within_m: float) -> float:
    """How far a rock's surface lies within its convex hull at most; the true depth is larger by up to `within_m`.

    A triangle is divided while its deepest place may be deeper: that is at most as deep, below any one face of the
    hull, as the lowest of its corners.
    """
    planes = np.unique(ConvexHull(rock.vertices_m).equations, axis=0)
    waiting, deepest = [rock.vertices_m[rock.faces]], 0.0
    while waiting:
        part = waiting.pop()
        corners, rest = part[:200], part[200:]
        below = -(corners @ planes[:, :3].T + planes[:, 3])  # (triangles, 3, planes)
        deepest = max(deepest, below.min(axis=2).max(), below.mean(axis=1).min(axis=1).max())
        a, b, c = np.moveaxis(corners[below.max(axis=1).min(axis=1) > deepest + within_m], 1, 0)
        d, e, f = (a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0
        parts = np.concatenate(
            [np.stack(corners_m, axis=1) for corners_m in ((a, d, f), (d, b, e), (f, e, c), (d, e, f))]
        )
        waiting += [left for left in (rest, parts) if len(left)]
    return float(deepest)


def _sees_all(rock: ContactMesh) -> Array | None:
    """The point farthest inside all planes of a rock's triangles; None where they leave no room."""
    offset = (rock.normals * rock.vertices_m[rock.faces[:, 0]]).sum(axis=1)
    planes = np.column_stack([rock.normals, np.ones(len(offset))])
    solved = linprog(
        [0.0, 0.0, 0.0, -1.0], A_ub=planes, b_ub=offset, bounds=[(None, None)] * 3 + [(0.0, None)]
    )
    if solved.status != 0 or solved.x[3] <= 1e-3 * np.abs(rock.vertices_m).max():
        return None
    return np.asarray(solved.x[:3])


def _joined(cells: Array, edge_of: Indices, group: Indices) -> list[Array]:
    """Points of convex pieces: neighbouring cells (m, k, 3) of one group, joined while their hull is not larger."""
    pieces = {
        number: _Piece(cell, volume, neighbours)
        for number, (cell, neighbours) in enumerate(zip(cells, _neighbours(edge_of), strict=True))
        if (volume := _volume(cell)) > 0.0
    }
    owner = list(range(len(cells)))
    fresh = set(pieces)
    while fresh:  # in rounds, so that pieces grow alike and few hulls are large
        grown: set[int] = set()
        for number in sorted(fresh):
            if number not in pieces or number in grown:
                continue
            for other in sorted({owner[k] for k in pieces[number].neighbours} - {number} - grown):
                if other not in pieces or group[other] != group[number]:
                    continue
                both = pieces[number].joined(pieces[other])
                if both is not None:
                    pieces[number] = both
                    del pieces[other]
                    owner = [number if part == other else part for part in owner]
                    grown.add(number)
                    break
        fresh = grown
    return [piece.points[ConvexHull(piece.points).vertices] for piece in pieces.values()]


class _Piece(NamedTuple):
    points: Array
    volume: float
    neighbours: list[int]  # triangles beside its own

    def joined(self, other: _Piece) -> _Piece | None:
        """Both as one, if that is convex."""
        points = np.unique(np.vstack([self.points, other.points]), axis=0)
        volume = self.volume + other.volume
        if _volume(points) > (1.0 + _FILLED_SHARE) * volume:
            return None
        return _Piece(points, volume, self.neighbours + other.neighbours)


def _neighbours(edge_of: Indices) -> list[list[int]]:
    """Triangles that share an edge with each."""
    at_edge: dict[int, list[int]] = {}
    for triangle, edges in enumerate(edge_of):
        for edge in edges:
            at_edge.setdefault(int(edge), []).append(triangle)
    return [
        [other for edge in edges for other in at_edge[int(edge)] if other != triangle]
        for triangle, edges in enumerate(edge_of)
    ]


def _volume(points: Array) -> float:
    try:
        return float(ConvexHull(points).volume)
    except QhullError:
        return 0.0


_STIFFNESS_STEPS, _DAMPING_RATIO, _IMPEDANCE = 2.0, 1.5, 0.9999
"""Time constant of a contact in steps, the stiffest that MuJoCo allows; its damping, with which nothing rebounds."""


class Stepper:
    """Stepper of a single body of a model."""

    def __init__(self, model: Any, data: Any) -> None:
        self._model, self._data = model, data
        self._warm = np.zeros((1, 6))

    def states(self, pose: Array, velocity: Array, force_m_s2: Array) -> tuple[Array, Array]:
        """Poses (n, 7) and velocities (n, 6) after each of n steps, under forces (n, 3) on a unit mass."""
        steps = len(force_m_s2)
        applied = np.zeros((1, steps, 12))  # of the world's body and the rock's
        applied[0, :, 6:9] = force_m_s2
        spin = Rotation.from_quat(pose[3:]).inv().apply(velocity[3:])
        state = np.array([[0.0, *pose[:3], pose[6], *pose[3:6], *velocity[:3], *spin]])
        out = np.empty((1, steps, state.shape[1]))
        rollout, force_bit = _rollout()
        rollout.rollout(
            self._model, self._data, state, applied, control_spec=force_bit, nstep=steps,
            initial_warmstart=self._warm, state=out,
        )  # fmt: skip
        self._warm[0] = self._data.qacc_warmstart
        # MuJoCo's states: time, place, attitude as w, x, y, z, velocity, spin in body axes.
        poses = np.hstack([out[0, :, 1:4], out[0, :, 5:8], out[0, :, 4:5]])
        return poses, np.hstack([out[0, :, 8:11], _turned(poses[:, 3:], out[0, :, 11:14])])

    def restart(self) -> None:
        """Forget the latest contact forces: what comes depends on the pose alone."""
        self._warm[:] = 0.0


def world(step_s: float, pose: Array, inertia_m2: Array) -> tuple[Any, Any]:
    """A model without ground, to be completed, and its body of unit mass."""
    import mujoco

    spec = mujoco.MjSpec()
    spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
    option = spec.option
    option.timestep, option.gravity = step_s, np.zeros(3)
    option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    option.cone, option.solver = mujoco.mjtCone.mjCONE_ELLIPTIC, mujoco.mjtSolver.mjSOL_NEWTON
    option.tolerance, option.iterations = 1e-10, 100
    option.disableflags = mujoco.mjtDisableBit.mjDSBL_ISLAND
    body = spec.worldbody.add_body(name="rock", pos=pose[:3])
    body.add_freejoint()
    body.mass, body.ipos, body.explicitinertial = 1.0, np.zeros(3), True
    body.inertia = inertia_m2
    return spec, body


def touch(geom: Any, step_s: float, friction: float) -> None:
    """Give a geometry the contact of this program."""
    geom.condim, geom.friction = 3, [friction, 0.0, 0.0]
    geom.solref = [_STIFFNESS_STEPS * step_s, _DAMPING_RATIO]
    geom.solimp = [_IMPEDANCE, _IMPEDANCE, 1e-3, 0.5, 2.0]


def hull(spec: Any, name: str, points_m: Array) -> dict[str, Any]:
    """The convex hull of points (n, 3) as a geometry."""
    import mujoco

    mesh = spec.add_mesh(
        name=name, uservert=points_m.ravel(), inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
    )
    return {"type": mujoco.mjtGeom.mjGEOM_MESH, "meshname": mesh.name}


def _forces_m_s2(motion: Motion, step_s: float, gravity_m_s2: Array, scene_from_support: Array) -> Array:
    """Force (n, 3) on a unit mass in each step of a motion, support axes: a leapfrog needs it from middle to middle."""
    middles_s = np.maximum(np.arange(math.ceil(motion.duration_s / step_s) + 2) - 0.5, 0.0) * step_s
    velocity = motion.velocity_at(middles_s) @ scene_from_support
    lasting_s = np.diff(middles_s)[:, None]
    return np.asarray((gravity_m_s2 * lasting_s - np.diff(velocity, axis=0)) / step_s)


def _forces_in(forces: Array, gravity_m_s2: Array, first: int, steps: int) -> Array:
    """The forces of some steps; after the last one gravity is left."""
    out = np.tile(gravity_m_s2, (steps, 1))
    moved = forces[first : first + steps]
    out[: len(moved)] = moved
    return out


def _turned(quaternion_xyzw: Array, vectors: Array) -> Array:
    """Vectors (n, 3), each turned by an attitude (n, 4)."""
    vector, scalar = quaternion_xyzw[:, :3], quaternion_xyzw[:, 3:]
    across = np.cross(vector, vectors)
    return np.asarray(vectors + 2.0 * (scalar * across + np.cross(vector, across)))


@lru_cache(maxsize=1)
def _rollout() -> tuple[Any, int]:
    """MuJoCo's rollout in C, and the bit that states that it is given forces. MuJoCo has no types."""
    from mujoco import mjtState, rollout

    return rollout.Rollout(nthread=0), int(mjtState.mjSTATE_XFRC_APPLIED.value)


_MOST_PIECES = {"rock": 100, "ground": 3000}
"""Maximum number of convex pieces to collide: more take minutes to prepare, and seconds a step."""


@cached
def _surface_world(scene: Scene, step_s: float) -> tuple[Any, Any]:
    """A scene on its surface as MuJoCo's model and data: support frame, body axes.

    Raises
    ------
    InputError
        If the rock or its ground is not of convex pieces, or of too many.
    """
    import mujoco

    grounded = scene.grounded
    spec, body = world(step_s, grounded.pose[:3], grounded.inertia_m2)
    flat_m = FLAT_SHARE * scene.rock.height_m
    hollow = hollow_m(grounded.rock, 0.01 * flat_m)
    if hollow <= flat_m:
        rock = [grounded.rock.vertices_m]
    else:
        wedges = _rock_pieces(grounded.rock)
        if wedges is None or len(wedges) > _MOST_PIECES["rock"]:
            raise _too_hollow(hollow / scene.rock.height_m, wedges)
        rock = wedges
    ground = _ground_pieces(grounded.ground, 2.0 * grounded.size_m)
    if len(ground) > _MOST_PIECES["ground"]:
        raise InputError(
            "engine.too_many_pieces",
            f"the pedestal's surface is of {len(ground)} convex pieces",
            where="engine mujoco",
            expected=f"at most {_MOST_PIECES['ground']} near the rock",
            remedy="leave the engine out, or give a surface of fewer triangles",
        )
    for where, pieces in ((body, rock), (spec.worldbody, ground)):
        for number, points in enumerate(pieces):
            name = f"{'rock' if where is body else 'ground'} {number}"
            touch(where.add_geom(**hull(spec, name, points)), step_s, scene.contact.friction_static)
    model = spec.compile()
    return model, mujoco.MjData(model)


def _too_hollow(share: float, wedges: list[Any] | None) -> InputError:
    what = "no point sees all of it" if wedges is None else f"it is of {len(wedges)} convex pieces"
    return InputError(
        "engine.rock_hollow",
        f"the rock is hollow by {share:.2g} of its height, and {what}",
        where="engine mujoco",
        expected=f"a convex rock, or one of at most {_MOST_PIECES['rock']} convex pieces that meet in a point",
        remedy="leave the engine out: the default knows any closed mesh",
    )


_MARGIN_SHARE = 1e-6
"""Gap over R up to which points are in contact: with none, rounding decides which corners carry a block at rest."""

_SEATED_WITHIN_DEG = 0.5
"""A rock at rest that is tilted by less from its seat is back in it: what is left is the contacts' compression."""


class MujocoSteps:
    """Steps of one shake, with a look after each block."""

    def __init__(self, problem: Problem) -> None:
        self._problem, scene, step_s = problem, problem.scene, problem.time_step_s
        self._on_plane, contact = scene.ground.is_plane, problem.contact
        self._stepper = Stepper(*(_world if self._on_plane else _surface_world)(scene, step_s))
        self._seat = problem.initial[0].copy() if problem.start is None and self._on_plane else None
        self._gravity_m_s2 = np.array([0.0, 0.0, -scene.gravity_m_s2]) @ contact.scene_from_support
        self._forces = _forces_m_s2(problem.motion, step_s, self._gravity_m_s2, contact.scene_from_support)

    def __call__(self, sim: Grounded, block: int, watch: Watch) -> int:
        """Go on by this many steps; the pose in which they began."""
        first, grid = int(sim.counts[1]), int(sim.counts[2])
        new, scene = slice(first + 1, first + block + 1), self._problem.scene
        force_m_s2 = _forces_in(self._forces, self._gravity_m_s2, grid, block)
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
        path_m = moved_m(sim.pose[since], sim.pose[last], sim.size_m)
        velocity = sim.velocity[last]
        speed_m_s = np.linalg.norm(velocity[:3]) + sim.size_m * np.linalg.norm(velocity[3:])
        slow = self._problem.rest_speed_m_s
        return bool(path_m < slow * (sim.time_s[last] - sim.time_s[since]) and speed_m_s < slow)

    def _sits_down(self, sim: Grounded) -> bool:
        """Take a rock at rest back to its seat, turned and shifted along the plane, if it is nearly there."""
        assert self._seat is not None  # as :meth:`__call__` has made sure
        pose, seat = sim.pose[sim.counts[1]], self._seat
        turned = seated(seat, pose)
        between = Rotation.from_quat(pose[3:]) * Rotation.from_quat(turned[3:]).inv()
        if not between.as_matrix()[2, 2] > math.cos(math.radians(_SEATED_WITHIN_DEG)):
            return False
        pose[:] = turned
        sim.velocity[sim.counts[1]] = 0.0
        return True


@cached
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
    """Stepper of a single shake; MuJoCo keeps nothing between shakes but models of scenes."""
    return MujocoSteps(problem)
