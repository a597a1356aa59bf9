"""A rock at rest on its pedestal: as the scene has it where it stands, else let down without gathering speed."""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.spatial.transform import Rotation

from toppling.models.caching import cached
from toppling.models.compiled import Array
from toppling.models.errors import InputError
from toppling.models.ground.points import contact_of
from toppling.models.ground.rigid import yaw_between
from toppling.models.pedestal import FARTHEST_SETTLING
from toppling.models.scene import Scene
from toppling.models.statics import at_rest, equilibrium_possible
from toppling.workers.termination import friction_that_stops

_PASSES = 3

_RESTING_SHARE = 1e-5
"""Gap over R of the lowest point below which a rock is on its plane."""


@cached
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
            "contact.slides_forever",
            f"friction_kinetic is {kinetic} on a slope of {scene.pedestal.slope_deg:.1f} degrees: "
            "a rock that slips never stops",
            where=f"scene {scene.id}",
            expected=f"at least tan(slope), {least:.3f}",
            remedy="raise it: a rock that lies still after a slip shows that it is higher",
        )
    if scene.rolls or not scene.ground.is_plane:
        rock = scene.grounded.rock_at_rest(scene.rock, scene.pedestal, f"scene {scene.id}")
        return dataclasses.replace(scene, rock=rock)
    seated = _on_its_pedestal(scene)
    # Several passes: an uneven pedestal's feet change a little with the pose they were made for.
    for _ in range(_PASSES):
        if equilibrium_possible(
            seated.rock, seated.pedestal, seated.gravity_m_s2, seated.contact.friction_static, np.zeros(3)
        )[0]:
            break
        rest = at_rest(seated.rock, seated.pedestal, seated.gravity_m_s2)
        if rest is None:
            raise _falls(scene, "it falls over")
        seated = dataclasses.replace(seated, rock=seated.rock.moved(*rest))
    if scene.contact.friction_static < least:
        raise _falls(scene, f"it slides, as its friction is less than tan(slope), {least:.3f}")
    moved_m = float(np.linalg.norm(seated.rock.com_m - scene.rock.com_m))
    if moved_m > FARTHEST_SETTLING * scene.rock.height_m:
        raise _falls(scene, f"its centre of mass moves by {moved_m:.3g} m")
    return seated


def seated(seat: Array, pose: Array) -> Array:
    """The pose (7,) in which a rock comes to rest where it is, with its turn about the normal since its seat."""
    attitude = Rotation.from_euler("z", yaw_between(seat, pose)) * Rotation.from_quat(seat[3:])
    return np.concatenate([pose[:2], seat[2:3], attitude.as_quat()])


def _on_its_pedestal(scene: Scene) -> Scene:
    """The scene with its rock shifted along the normal to where its lowest foot touches."""
    contact = contact_of(scene)
    lowest_m = float(contact.gaps_m(contact.start_pose).min())
    if abs(lowest_m) <= _RESTING_SHARE * contact.half_diagonal_m:
        return scene
    return dataclasses.replace(scene, rock=scene.rock.moved(np.eye(3), -lowest_m * scene.pedestal.normal))


def _falls(scene: Scene, what: str) -> InputError:
    return InputError(
        "rock.does_not_stand",
        f"left alone, the rock does not stand: {what}",
        where=f"scene {scene.id}",
        expected="a rock that stands by itself in the pose of the scene",
        remedy="check the mesh's up axis, the slope, the friction and the split of rock and pedestal",
    )
