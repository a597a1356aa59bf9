"""How a rock starts: seated at rest, or in a state that the caller gives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from toppling.models.compiled import Array
from toppling.models.errors import InputError
from toppling.models.ground.points import ContactModel

_SUNK_SHARE = 1e-4
"""A start whose points are deeper than this share of R is raised; what is less the engine lets out gently."""

_STATE_SIZES = {"position_m": 3, "quaternion_xyzw": 4, "velocity_m_s": 3, "angular_velocity_rad_s": 3}

_DEEPEST_START_SHARE = 0.1
"""Maximum penetration over R of a start that a caller gives."""


@dataclass(frozen=True, eq=False)
class State:
    """Pose and velocity of the rock relative to the pedestal.

    Parameters
    ----------
    position_m : (3,) array or None
        Centre of mass, scene frame; None for where the scene has it.
    quaternion_xyzw : (4,) array
        Turn from the pose in the scene, as that is before the rock settles, to this one.
    velocity_m_s, angular_velocity_rad_s : (3,) array
        Scene axes.
    """

    position_m: ArrayLike | None = None
    quaternion_xyzw: ArrayLike = (0.0, 0.0, 0.0, 1.0)
    velocity_m_s: ArrayLike = (0.0, 0.0, 0.0)
    angular_velocity_rad_s: ArrayLike = (0.0, 0.0, 0.0)


def start_of(contact: ContactModel, start: State | None) -> tuple[Array, Array]:
    """Pose (7,) and velocity (6,), support frame; of the scene, at rest, where none is given.

    Raises InputError if the start is given too deep inside the ground.
    """
    if start is None:
        return contact.start_pose, np.zeros(6)
    pose, velocity = given_state(contact, start)
    return _out_of_the_ground(contact, pose), velocity


def given_state(contact: ContactModel, start: State) -> tuple[Array, Array]:
    """Pose (7,) and velocity (6,), support frame, as they are given."""
    turn = contact.scene_from_support
    position = contact.com_m
    if start.position_m is not None:
        position = (np.asarray(start.position_m, float) - contact.origin_m) @ turn
    given = np.asarray(start.quaternion_xyzw, float)
    relative = Rotation.from_quat([*given[:3] @ turn, given[3]])
    attitude = relative * Rotation.from_quat(contact.start_quaternion_xyzw)
    pose = np.concatenate([position, attitude.as_quat()])
    velocities = (start.velocity_m_s, start.angular_velocity_rad_s)
    velocity = np.concatenate([np.asarray(given, float) @ turn for given in velocities])
    return pose, velocity


def checked_start(initial: State | Mapping[str, Any]) -> State:
    """The start that a caller gave, as a State.

    A world that is given what is not finite loses its contacts, also for the jobs that come after: it is refused here.

    Raises InputError if a field is unknown, of the wrong size or not finite, or the quaternion is zero.
    """
    given = dict(initial) if isinstance(initial, Mapping) else vars(initial)
    for name, value in given.items():
        size = _STATE_SIZES.get(name)
        if size is None:
            raise InputError(
                "shake.start_unknown",
                f"initial has {name!r}",
                where="shake, initial",
                expected=", ".join(_STATE_SIZES),
                remedy="leave it out, or correct its name",
            )
        try:
            numbers = np.zeros(3) if value is None and name == "position_m" else np.asarray(value, float)
        except (TypeError, ValueError):
            numbers = np.array(np.nan)
        no_turn = name == "quaternion_xyzw" and not numbers.any()
        if numbers.shape != (size,) or not np.isfinite(numbers).all() or no_turn:
            raise InputError(
                "shake.start_unusable",
                f"{name} is {value}",
                where="shake, initial",
                expected=f"{size} finite numbers" + (", not all of them zero" if no_turn else ""),
                remedy="leave it out: the rock then starts with that of the scene, or at rest",
            )
    return State(**given)


def _out_of_the_ground(contact: ContactModel, pose: Array) -> Array:
    """A pose raised along the interface's normal to where its lowest point touches, unless it has hardly sunk in.

    The engine lets a point out in one step, and so the faster the deeper it is: a block that leaned by one degree, its
    corner .007 R deep, was shot up and toppled.

    Raises InputError if the lowest point is deeper than `_DEEPEST_START_SHARE` of the half diagonal.
    """
    deep_share = -float(contact.gaps_m(pose).min()) / contact.half_diagonal_m
    if deep_share > _DEEPEST_START_SHARE:
        raise InputError(
            "shake.starts_in_ground",
            f"the rock starts inside the ground, {deep_share:.2g} of its half diagonal deep",
            where="shake, initial",
            expected=f"a lowest point no deeper than {_DEEPEST_START_SHARE} of the half diagonal",
            remedy="raise position_m, which is that of the centre of mass",
        )
    return contact.touching(pose) if deep_share > _SUNK_SHARE else pose
