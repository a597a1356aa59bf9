"""A rock at rest on its pedestal: as the scene has it where it stands, else let down without gathering speed."""

from __future__ import annotations

import dataclasses
from functools import lru_cache
from typing import Any

import numpy as np

from toppling.models.contact import ContactProperties
from toppling.models.errors import InputError
from toppling.models.scene import Scene
from toppling.models.statics import TOPPLED_TILT_DEG, equilibrium_possible
from toppling.workers import engine
from toppling.workers import quaternion as quat
from toppling.workers.compiled import Array, compiled
from toppling.workers.contact_points import contact_of
from toppling.workers.observation import travel_m
from toppling.workers.options import PRESETS, SolverOptions
from toppling.workers.termination import friction_that_stops

PASSES = 3

OPTIONS = PRESETS["standard"]

PREPARED_STEPS, PREPARED_SHARE = OPTIONS.contact.prepared_steps, 2e-5
"""Contacts are prepared within the one times g (step)^2, and within the other share of R."""

SOLVER = SolverOptions(iterations=200, residual_share=1e-3)

STOPPED_SHARE = 1e-5
"""Way in a look, over R, below which a rock that settles is no longer stopped: each stop costs it its contacts."""

STEPS_IN_A_LOOK = 4


def settled(scene: Scene, pool: engine.EnginePool | None = None) -> Scene:
    """The scene with its rock at rest: as it is where statics holds it, else let down without gathering speed.

    Raises
    ------
    InputError
        If the rock does not come to rest, or only far from the pose of the scene, or slides for ever once it slips.
    """
    return _settled(scene, pool or engine.process_pool())


@lru_cache(maxsize=8)  # scenes compare by identity
def _settled(scene: Scene, pool: engine.EnginePool) -> Scene:
    kinetic, least = scene.contact.friction_kinetic, friction_that_stops(scene)
    if kinetic < min(scene.contact.friction_static, least):
        raise InputError(
            f"friction_kinetic is {kinetic} on a slope of {scene.pedestal.slope_deg:.1f} degrees: "
            "a rock that slips never stops",
            where=f"scene {scene.id}",
            expected=f"at least tan(slope), {least:.3f}",
            remedy="raise it: a rock that lies still after a slip shows that it is higher",
        )
    seated = _on_its_pedestal(scene)
    # Several passes: an uneven pedestal's feet change a little with the pose they were made for.
    for _ in range(PASSES):
        if equilibrium_possible(
            seated.rock, seated.pedestal, seated.gravity_m_s2, seated.contact.friction_static, np.zeros(3)
        )[0]:
            break
        seated = _let_down(seated, pool)
    way_m = float(np.linalg.norm(seated.rock.com_m - scene.rock.com_m))
    if way_m > 0.1 * scene.rock.height_m:
        raise _falls(scene, f"its centre of mass moves by {way_m:.3g} m")
    return seated


def _on_its_pedestal(scene: Scene) -> Scene:
    """The scene with its rock shifted along the normal to where its lowest foot touches."""
    contact = contact_of(scene)
    lowest_m = float(contact.gaps_m(contact.start_pose).min())
    if abs(lowest_m) <= OPTIONS.contact.resting_share * contact.half_diagonal_m:
        return scene
    return dataclasses.replace(scene, rock=scene.rock.moved(np.eye(3), -lowest_m * scene.pedestal.normal))


def _let_down(scene: Scene, pool: engine.EnginePool) -> Scene:
    """The scene with its rock where it comes to rest when all speed is taken from it again and again."""
    contact = contact_of(scene)
    turn = contact.scene_from_support
    gravity = np.array([0.0, 0.0, -scene.gravity_m_s2]) @ turn
    step_s = OPTIONS.time_step_s(contact.half_diagonal_m, scene.gravity_m_s2)
    world = pool.world(contact, len(contact.points_body_m))
    surface = ContactProperties.of(scene.contact.friction_static)  # let down without a rebound
    engine.configure_for(world, surface, SOLVER)
    pose = contact.touching(contact.start_pose)
    size_m, g_m_s2 = contact.half_diagonal_m, scene.gravity_m_s2
    still = _swing_out(world[0], contact.points_body_m, size_m, g_m_s2, gravity, step_s, pose)
    relative = quat.matrix(quat.product(pose[3:], quat.inverse(contact.start_quaternion_xyzw)))
    rotation = turn @ relative @ turn.T
    tilt = np.rad2deg(np.arccos(np.clip(rotation[2, 2], -1.0, 1.0)))
    if tilt > TOPPLED_TILT_DEG:
        raise _falls(scene, f"it tilts by {tilt:.1f} degrees")
    if still > 0.0:
        raise _falls(scene, f"it still moves at {still:.1g} m/s, tilted by {tilt:.1f} degrees")
    com = pose[:3] @ turn.T + contact.origin_m
    return dataclasses.replace(scene, rock=scene.rock.moved(rotation, com - rotation @ scene.rock.com_m))


@compiled
def _swing_out(
    world: Any,
    points_m: Array,
    half_diagonal_m: float,
    gravity_m_s2: float,
    force_m_s2: Array,
    step_s: float,
    pose: Array,
) -> float:
    """Let a rock swing, and go at rest from the lowest point of each swing; its last speed, m/s, or 0 at rest."""
    impulse, still = gravity_m_s2 * step_s, np.zeros(6)
    force = (force_m_s2[0], force_m_s2[1], force_m_s2[2])
    near = max(PREPARED_STEPS * (impulse * step_s) / half_diagonal_m, PREPARED_SHARE)
    engine.configure(world, impulse, near, 0.0)
    engine.place(world, pose, still, near, 0.0)
    strict = 3e-7 * half_diagonal_m  # the solver lets a rock at rest creep by a quarter of it
    previous, travel, before, velocity = np.inf, np.inf, pose.copy(), np.empty(6)
    for look in range(5000):
        # A base that rolls may swing on by a millionth of its size for ever.
        limit = strict if look < 1000 else 10.0 * strict
        for _ in range(STEPS_IN_A_LOOK):
            before[:] = pose
            engine.step(world, points_m, step_s, force, pose, velocity)
        travel = travel_m(before, pose, half_diagonal_m)
        # Past the lowest point of this swing: let it go from here at rest. What is left in the end dies by itself.
        if travel < previous and travel > STOPPED_SHARE * half_diagonal_m:
            engine.place(world, pose, still, near, 0.0)
        if max(travel, previous) < limit:
            return 0.0
        previous = travel
    return max(travel, previous) / step_s


def _falls(scene: Scene, what: str) -> InputError:
    return InputError(
        f"left alone, the rock does not stand: {what}",
        where=f"scene {scene.id}",
        expected="a rock that stands by itself in the pose of the scene",
        remedy="check the mesh's up axis, the slope, the friction and the split of rock and pedestal",
    )
