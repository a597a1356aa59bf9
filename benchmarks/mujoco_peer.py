"""MuJoCo as a peer: a scene's rock in its world, shaken as `workers.shake` shakes it. For comparison only.

Rock and pedestal are what ours are: the rock's feet over the interface plane, gravity less the ground's acceleration
as the pull, given as a force on the centre of mass so that many steps are one call of C.

Its settings are the best of forty tried on the cases of `mujoco_front.py` (mean logarithm of the errors at steps of
1/512, 1/128 and 1/32 of sqrt(R/g)):

* `solref` 2 steps, the stiffest that it allows: 2.5, 4 and 8 are the worse, in proportion; 1 step, forced, explodes.
  Damping ratio 1.5: with 1, a dropped body rebounds by 5 % of its fall; 2 to 20 do not differ.
* `solimp` 0.9999: 0.99 to 0.999999 do not differ.
* Elliptic cone: with the pyramidal one, slip is off by 80 %.
* Semi-implicit Euler: 'implicitfast' and 'implicit' are the same, 'discrete' is worse, 'RK4' no better at three times
  the cost.
* Pulls from step middle to step middle, as ours: ten times better than means over the steps.
* A box and a cylinder as such, other bodies as a convex mesh. Spheres at the corners are the same on a block, five
  times dearer on a scanned rock, and brake a rolling rim.
* `noslip_iterations`, `impratio`, speculative contacts, `multiccd` and tighter tolerances have no effect; a contact
  margin, PGS and CG make it worse; without islands it is an eighth faster.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
from mujoco import rollout
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from toppling.models.frames import azimuth_deg, rotation_between
from toppling.models.motions.motion import Motion
from toppling.models.relief import contact_feet_m
from toppling.models.scene import Scene
from toppling.models.statics import TOPPLED_FALL, TOPPLED_TILT_DEG

Array = NDArray[np.float64]

CHUNK = 256
"""Steps in a call."""

LARGEST_TILT_DEG = 75.0
REST_SPEED = 5e-4
"""Over sqrt(g R), through a whole chunk."""

CAP_AFTER_MOTION = 60.0
"""Time after the motion, over sqrt(R / g)."""

ROUND_FROM_SIDES = 200
"""A prism of fewer sides is no cylinder: it stands on the middles of its edges, 1e-4 of the radius farther in."""

NORMAL = np.array([0.0, 0.0, 1.0])
"""Of the interface, in the world's frame."""

STATE = mujoco.mjtState.mjSTATE_FULLPHYSICS.value
FORCE = mujoco.mjtState.mjSTATE_XFRC_APPLIED.value


@dataclass(frozen=True)
class Peer:
    """MuJoCo at a time step of this share of sqrt(R / g)."""

    step_share: float


@dataclass(frozen=True, eq=False)
class _World:
    """A scene in MuJoCo: its z along the interface's normal, its origin in the interface."""

    model: Any
    data: Any
    scene_from_world: Array
    com_m: Array


def shake(
    scene: Scene,
    motion: Motion,
    preset: Peer,
    *,
    trajectory: bool = True,  # noqa: ARG001  the interface of ours
    shortcuts: bool = False,  # noqa: ARG001
    initial: dict[str, Any] | None = None,
    time_step: float | None = None,
) -> SimpleNamespace:
    """Shake with MuJoCo; the fields of the result that the cases look at are named as ours."""
    size, gravity = scene.rock.half_diagonal_m, scene.gravity_m_s2
    step_s = time_step or float(preset.step_share * np.sqrt(size / gravity))
    world = _world(scene, step_s)
    turn, up = world.scene_from_world, world.scene_from_world.T @ [0.0, 0.0, 1.0]
    state, warm = _start(world, scene, initial or {}), np.zeros((1, world.model.nv))
    forces = np.zeros((1, CHUNK, 6 * world.model.nbody))
    places, steps = [state[None, 1:8]], 0
    toppled: bool | None = None
    cap_s = motion.duration_s + CAP_AFTER_MOTION * np.sqrt(size / gravity)
    while toppled is None:
        middles = np.maximum(steps - 0.5 + np.arange(CHUNK + 1), 0.0) * step_s
        kicks = np.diff(motion.velocity_at(middles), axis=0) @ turn
        forces[0, :, 6:9] = (-gravity * up * np.diff(middles)[:, None] - kicks) / step_s
        out = np.empty((1, CHUNK, len(state)))
        _ROLLOUT.rollout(
            world.model, world.data, state[None], forces, control_spec=FORCE, nstep=CHUNK,
            initial_warmstart=warm, state=out,
        )  # fmt: skip
        state, warm[0], steps = out[0, -1].copy(), world.data.qacc_warmstart, steps + CHUNK
        places.append(out[0, :, 1:8])
        if not np.isfinite(state).all():
            break
        tilt_deg = np.rad2deg(np.arccos(np.clip(_after(out[0, :, 4:8], NORMAL) @ NORMAL, -1.0, 1.0)))
        if out[0, :, 3].min() < (1.0 - TOPPLED_FALL) * world.com_m[2] or tilt_deg.max() > LARGEST_TILT_DEG:
            toppled = True
        elif steps * step_s > motion.duration_s:
            speed = np.linalg.norm(out[0, :, 8:11], axis=1) + size * np.linalg.norm(out[0, :, 11:14], axis=1)
            if speed.max() < REST_SPEED * np.sqrt(gravity * size) or steps * step_s > cap_s:
                toppled = bool(tilt_deg[-1] > TOPPLED_TILT_DEG)
    return _result(world, scene, np.vstack(places), step_s, toppled)


def _result(
    world: _World, scene: Scene, places: Array, step_s: float, toppled: bool | None
) -> SimpleNamespace:
    turn = Rotation.from_matrix(world.scene_from_world)
    attitude = Rotation.from_quat(places[:, [4, 5, 6, 3]])
    foot = np.array([0.0, 0.0, -world.com_m[2]])
    moved = places[-1, :3] - world.com_m
    upright = np.clip(attitude.apply(NORMAL) @ NORMAL, -1.0, 1.0)
    return SimpleNamespace(
        status="diverged" if toppled is None else "ok",
        toppled=toppled,
        max_tilt_deg=float(np.rad2deg(np.arccos(upright.min()))),
        topple_azimuth_deg=azimuth_deg(world.scene_from_world @ moved) if toppled else None,
        slip_m=float(np.hypot(*(moved + attitude[-1].apply(foot) - foot)[:2])),
        simulated_s=(len(places) - 1) * step_s,
        skipped_s=0.0,
        trajectory=SimpleNamespace(
            time_s=np.arange(len(places)) * step_s,
            position_m=places[:, :3] @ world.scene_from_world.T + scene.pedestal.point_m,
            quaternion_xyzw=(turn * attitude * turn.inv()).as_quat(),
        ),
    )


def _after(quaternion_wxyz: Array, carried: Array) -> Array:
    """A body's vector (3,), turned by each attitude, (n, 3)."""
    scalar, vector = quaternion_wxyz[:, :1], quaternion_wxyz[:, 1:]
    across = np.cross(vector, carried)
    return carried + 2.0 * (scalar * across + np.cross(vector, across))


def _start(world: _World, scene: Scene, initial: dict[str, Any]) -> Array:
    """State with the pose and the velocities that the case gives in the scene's frame."""
    turn = Rotation.from_matrix(world.scene_from_world)
    attitude = turn.inv() * Rotation.from_quat(initial.get("quaternion_xyzw", (0.0, 0.0, 0.0, 1.0))) * turn
    position = world.com_m
    if "position_m" in initial:
        position = turn.inv().apply(np.asarray(initial["position_m"]) - scene.pedestal.point_m)
    spin = turn.inv().apply(initial.get("angular_velocity_rad_s", np.zeros(3)))
    data = world.data
    mujoco.mj_resetData(world.model, data)
    data.qpos[:] = [*position, *attitude.as_quat()[[3, 0, 1, 2]]]
    data.qvel[:3] = turn.inv().apply(initial.get("velocity_m_s", np.zeros(3)))
    data.qvel[3:] = attitude.inv().apply(spin)  # in the body's own axes
    state = np.zeros(mujoco.mj_stateSize(world.model, STATE))
    mujoco.mj_getState(world.model, data, state, STATE)
    return state


@lru_cache(maxsize=16)  # scenes compare by identity
def _world(scene: Scene, step_s: float) -> _World:
    turn = rotation_between((0.0, 0.0, 1.0), scene.pedestal.normal)
    com = (scene.rock.com_m - scene.pedestal.point_m) @ turn
    feet = (contact_feet_m(scene.rock, scene.pedestal) - scene.pedestal.point_m) @ turn - com
    inertia = turn.T @ scene.rock.inertia_per_mass_m2 @ turn
    spec = mujoco.MjSpec()
    spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
    option = spec.option
    option.timestep, option.gravity = step_s, np.zeros(3)
    option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    option.cone, option.solver = mujoco.mjtCone.mjCONE_ELLIPTIC, mujoco.mjtSolver.mjSOL_NEWTON
    option.tolerance, option.iterations = 1e-10, 100
    option.disableflags = mujoco.mjtDisableBit.mjDSBL_ISLAND
    body = spec.worldbody.add_body(name="rock", pos=com)
    body.add_freejoint()
    body.mass, body.ipos, body.explicitinertial = 1.0, np.zeros(3), True
    body.fullinertia = [inertia[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    ground = spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1.0, 1.0, 1.0])
    for geom in (ground, body.add_geom(**_shape(spec, feet))):
        geom.condim, geom.friction = 3, [scene.contact.friction_static, 0.0, 0.0]
        geom.solref, geom.solimp = [2.0 * step_s, 1.5], [0.9999, 0.9999, 1e-3, 0.5, 2.0]
    model = spec.compile()
    return _World(model, mujoco.MjData(model), turn, com)


def _shape(spec: Any, feet_m: Array) -> dict[str, Any]:
    """A box or a nearly round upright cylinder as such, any other body as the convex hull of its feet."""
    middle, half = 0.5 * (feet_m.max(axis=0) + feet_m.min(axis=0)), 0.5 * np.ptp(feet_m, axis=0)
    out = np.abs(feet_m - middle)
    if len(feet_m) == 8 and np.allclose(out, half):
        return {"type": mujoco.mjtGeom.mjGEOM_BOX, "size": half, "pos": middle}
    upright = np.allclose(out[:, 2], half[2]) and np.allclose(np.hypot(out[:, 0], out[:, 1]), half[0])
    if upright and len(feet_m) >= 2 * ROUND_FROM_SIDES:
        return {"type": mujoco.mjtGeom.mjGEOM_CYLINDER, "size": [half[0], half[2], 0.0], "pos": middle}
    mesh = spec.add_mesh(
        name="hull", uservert=feet_m.ravel(), inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
    )
    return {"type": mujoco.mjtGeom.mjGEOM_MESH, "meshname": mesh.name}


_ROLLOUT = rollout.Rollout(nthread=0)
