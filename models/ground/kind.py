"""Whether one plane is enough for a rock on its pedestal, or its surface is needed, and why."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from toppling.models.compiled import Array
from toppling.models.ground.body import FOUND_WITHIN, GroundedBody

_LOOKED_AT_SHARE = 0.03
"""Of the rock's height: what is nearer to a rock at rest it touches when it tilts a little."""

_MOST_LOOKED_AT = 1 << 14
"""Contacts: below a flat base on a fine mesh the nearest few hundred all lie in one plane."""

FLAT_SHARE = 0.01
"""Of the rock's height: contacts so near the interface plane lie in it."""

FLAT_DEG = 2.0
"""Contacts whose normal is off the plane's by less have its normal."""

_TILTS_DEG = (2.0, 4.0, 7.0, 11.0, 16.0, 22.0, 30.0, 40.0, 52.0)
"""To which the rock is tilted, to see what stands beside it: beyond, it has fallen and cannot lodge."""

_ROLLED_RAD = np.radians(16.5)
"""Tilt up to which a base that meets ground below the plane rolls on it; farther on it may hook a cliff's face."""

_CARRYING = 0.5
"""Upward part of the normal of ground on which a base rolls."""

_WAYS = 12
"""In which it is tilted."""


@dataclass(frozen=True)
class GroundKind:
    """What a scene's ground is taken for.

    Parameters
    ----------
    is_plane : bool
        Whether contacts with one normal in one plane are enough.
    why : str
        In words, for plans and pages.
    """

    is_plane: bool
    why: str

    @property
    def sentence(self) -> str:
        """The same as one sentence."""
        what = (
            "one plane" if self.is_plane else "the pedestal's own surface, each contact along its own normal"
        )
        return f"the rock stands on {what}: {self.why}"


def kind_of(body: GroundedBody, height_m: float) -> GroundKind:
    """Look at the contacts of a rock where it rests, and of one that is tilted.

    Parameters
    ----------
    body : GroundedBody
    height_m : float
        Of the rock.
    """
    if body.rolls_on_dome:
        return GroundKind(False, "its flat base rolls on a smooth dome")
    pose = body.touching(body.pose)
    near = body.contacts(pose, _LOOKED_AT_SHARE * height_m, leaning=1.0, most=_MOST_LOOKED_AT)
    # A touching rock penetrates nowhere: edges that seem to lie past each other.
    near = near[near["gap_m"] > -1e-6 * height_m]
    off_deg = np.degrees(np.arccos(np.clip(near["normal"][:, 2], -1.0, 1.0)))
    off_m = np.abs(near["place_m"][:, 2])
    if off_m.max(initial=0.0) > FLAT_SHARE * height_m:
        what = f"a contact lies {off_m.max() / height_m:.2f} of the rock's height off the interface plane"
        return GroundKind(False, what)
    if off_deg.max(initial=0.0) > FLAT_DEG:
        return GroundKind(
            False, f"a contact's normal is {off_deg.max():.0f} degrees off the interface plane's"
        )
    met = _met_as_it_tilts(body, pose, near, height_m)
    return GroundKind(met is None, met or "all contacts lie in one plane")


def _met_as_it_tilts(body: GroundedBody, pose: Array, near: np.ndarray, height_m: float) -> str | None:
    """What of the ground off its plane a tilting rock meets, in words; None if nothing."""
    if len(near) == 0:
        return None
    places = near["place_m"]
    for way in 2.0 * np.pi * np.arange(_WAYS) / _WAYS:
        outward = np.array([np.cos(way), np.sin(way), 0.0])
        pivot = places[np.argmax(places @ outward)]
        for tilt in np.radians(_TILTS_DEG):
            turn = Rotation.from_rotvec(tilt * np.array([-outward[1], outward[0], 0.0]))
            com = pivot + turn.apply(pose[:3] - pivot)
            tilted = np.concatenate([com, (turn * Rotation.from_quat(pose[3:])).as_quat()])
            met = body.contacts(tilted, FOUND_WITHIN * body.size_m)
            met = met[met["gap_m"] < FLAT_SHARE * height_m]
            ground_m = met["place_m"][:, 2] - met["gap_m"] * met["normal"][:, 2]
            highest_m = ground_m.max(initial=0.0)
            if highest_m > FLAT_SHARE * height_m:
                return f"the rock meets what stands {highest_m / height_m:.2f} of its height over the plane"
            if tilt <= _ROLLED_RAD and _rolls_off(met, ground_m, FLAT_SHARE * height_m):
                return f"tilted by {np.degrees(tilt):.0f} degrees, the rock meets ground that falls away below it"
    return None


def _rolls_off(met: np.ndarray, ground_m: Array, off_m: float) -> bool:
    """Whether ground that lies below the plane stops a rock which tilts about its outermost contact with that plane."""
    return bool(((ground_m < -off_m) & (met["gap_m"] < -off_m) & (met["normal"][:, 2] > _CARRYING)).any())
