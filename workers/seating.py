"""A rock at rest on its pedestal: as the scene has it where it stands, else let down without gathering speed."""

from __future__ import annotations

import dataclasses
from functools import lru_cache

import numpy as np

from toppling.models.errors import InputError
from toppling.models.scene import ContactProperties, Scene
from toppling.models.statics import TOPPLED_TILT_DEG, equilibrium_possible
from toppling.workers import quaternion as quat
from toppling.workers.contact import LARGEST_OPEN_TILT_DEG, REACH_DEG, contact_of
from toppling.workers.presets import Solver, settings_of
from toppling.workers.stepping import engine_for
from toppling.workers.way import STILL, travel_m

TOUCHING_SHARE = 1e-5
"""Feet within this share of R of the plane carry a rock at rest: the engine holds them within a tenth of it."""

PASSES = 3

SOLVER = Solver(iterations=200, residual_share=1e-3)

STOPPED_SHARE = 1e-5
"""Way in a look, over R, below which a rock that settles is no longer stopped: each stop costs it its contacts."""

STEPS_IN_A_LOOK = 4


@lru_cache(maxsize=8)
def settled(scene: Scene) -> Scene:
    """The scene with its rock at rest: as it is where statics holds it, else let down without gathering speed.

    Raises
    ------
    InputError
        If the rock does not come to rest, or only far from the pose of the scene, or slides for ever once it slips.
    """
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
        seated = _let_down(seated)
    way_m = float(np.linalg.norm(seated.rock.com_m - scene.rock.com_m))
    if way_m > 0.1 * scene.rock.height_m:
        raise _falls(scene, f"its centre of mass moves by {way_m:.3g} m")
    return seated


def friction_that_stops(scene: Scene) -> float:
    """Kinetic friction, tan(slope), below which a rock that slips on the pedestal slides for ever."""
    return float(np.tan(np.deg2rad(scene.pedestal.slope_deg)))


def _on_its_pedestal(scene: Scene) -> Scene:
    """The scene with its rock shifted along the normal to where its lowest foot touches."""
    contact = contact_of(scene)
    lowest_m = contact.lowest_m(contact.start_pose)
    if abs(lowest_m) <= TOUCHING_SHARE * contact.half_diagonal_m:
        return scene
    return dataclasses.replace(scene, rock=scene.rock.moved(np.eye(3), -lowest_m * scene.pedestal.normal))


def _let_down(scene: Scene) -> Scene:
    """The scene with its rock where it comes to rest when all speed is taken from it again and again."""
    contact = contact_of(scene)
    turn = contact.scene_from_support
    gravity = np.array([0.0, 0.0, -scene.gravity_m_s2]) @ turn
    settings = settings_of("standard")
    step_s = settings.time_step_s(contact.half_diagonal_m, scene.gravity_m_s2)
    impulse, slot = scene.gravity_m_s2 * step_s, len(REACH_DEG) - 1
    surface = ContactProperties.of(scene.contact.friction_static)  # let down without a rebound
    engine = engine_for(contact, LARGEST_OPEN_TILT_DEG, surface, impulse, impulse * step_s, 0.0, SOLVER, slot)
    pose = contact.touching(contact.start_pose)
    engine.set_state(pose, STILL, STILL)
    strict = 3e-7 * contact.half_diagonal_m  # the solver lets a rock at rest creep by a quarter of it
    previous = np.inf
    for look in range(5000):
        # A base that rolls may swing on by a millionth of its size for ever.
        limit = strict if look < 1000 else 10.0 * strict
        poses = [pose]
        engine.run(step_s, [gravity.tolist()] * STEPS_IN_A_LOOK, poses)
        way = travel_m(poses[-2], poses[-1], contact.half_diagonal_m)
        pose = poses[-1]
        # Past the lowest point of this swing: let it go from here at rest. What is left in the end dies by itself.
        if way < previous and way > STOPPED_SHARE * contact.half_diagonal_m:
            engine.set_state(pose, STILL, STILL)
        if max(way, previous) < limit:
            break
        previous = way
    relative = quat.matrix(quat.product(np.array(pose[1]), quat.inverse(contact.start_quaternion_xyzw)))
    rotation = turn @ relative @ turn.T
    tilt = np.rad2deg(np.arccos(np.clip(rotation[2, 2], -1.0, 1.0)))
    if tilt > TOPPLED_TILT_DEG:
        raise _falls(scene, f"it tilts by {tilt:.1f} degrees")
    if max(way, previous) >= limit:
        raise _falls(
            scene, f"it still moves at {max(way, previous) / step_s:.1g} m/s, tilted by {tilt:.1f} degrees"
        )
    com = np.array(pose[0]) @ turn.T + contact.origin_m
    return dataclasses.replace(scene, rock=scene.rock.moved(rotation, com - rotation @ scene.rock.com_m))


def _falls(scene: Scene, what: str) -> InputError:
    return InputError(
        f"left alone, the rock does not stand: {what}",
        where=f"scene {scene.id}",
        expected="a rock that stands by itself in the pose of the scene",
        remedy="check the mesh's up axis, the slope, the friction and the split of rock and pedestal",
    )
