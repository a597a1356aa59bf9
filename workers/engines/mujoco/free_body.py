"""A free body in MuJoCo: how its world is set, and how it is stepped in C over a block of steps."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np

from toppling.models.compiled import Array
from toppling.models.motions.motion import Motion
from toppling.workers import quaternion as quat

_STIFFNESS_STEPS, _DAMPING_RATIO, _IMPEDANCE = 2.0, 1.5, 0.9999
"""Time constant of a contact in steps, the stiffest that MuJoCo allows; its damping, with which nothing rebounds."""


class Stepper:
    """What steps one body of a model."""

    def __init__(self, model: Any, data: Any) -> None:
        self._model, self._data = model, data
        self._warm = np.zeros((1, 6))

    def states(self, pose: Array, velocity: Array, force_m_s2: Array) -> tuple[Array, Array]:
        """Poses (n, 7) and velocities (n, 6) after each of n steps, under forces (n, 3) on a unit mass."""
        steps = len(force_m_s2)
        applied = np.zeros((1, steps, 12))  # of the world's body and the rock's
        applied[0, :, 6:9] = force_m_s2
        spin = quat.matrix(pose[3:]).T @ velocity[3:]
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


def forces_m_s2(motion: Motion, step_s: float, gravity_m_s2: Array, scene_from_support: Array) -> Array:
    """Force (n, 3) on a unit mass in each step of a motion, support axes: a leapfrog needs it from middle to middle."""
    middles_s = np.maximum(np.arange(math.ceil(motion.duration_s / step_s) + 2) - 0.5, 0.0) * step_s
    velocity = motion.velocity_at(middles_s) @ scene_from_support
    lasting_s = np.diff(middles_s)[:, None]
    return np.asarray((gravity_m_s2 * lasting_s - np.diff(velocity, axis=0)) / step_s)


def forces_in(forces: Array, gravity_m_s2: Array, first: int, steps: int) -> Array:
    """The forces of some steps; after the last one gravity is left."""
    out = np.tile(gravity_m_s2, (steps, 1))
    moved = forces[first : first + steps]
    out[: len(moved)] = moved
    return out


def _turned(quaternion_xyzw: Array, carried: Array) -> Array:
    """Vectors (n, 3), each turned by an attitude (n, 4)."""
    vector, scalar = quaternion_xyzw[:, :3], quaternion_xyzw[:, 3:]
    across = np.cross(vector, carried)
    return np.asarray(carried + 2.0 * (scalar * across + np.cross(vector, across)))


@lru_cache(maxsize=1)
def _rollout() -> tuple[Any, int]:
    """What steps in C, and the bit that says it is given forces. MuJoCo has no types."""
    from mujoco import mjtState, rollout

    return rollout.Rollout(nthread=0), int(mjtState.mjSTATE_XFRC_APPLIED.value)
