"""The least energy that overturns a rock."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from toppling.models.caching import cached
from toppling.models.compiled import Array
from toppling.models.ground.points import ContactModel, contact_of
from toppling.models.scene import Scene
from toppling.models.statics import TOPPLED_TILT_DEG

_AXES_STEP_DEG = 2.0
"""Angle between axes of tilt; between them the centre of mass is up to 1.5e-4 of its lever arm too low."""

_YAWS = 72
"""About the normal, for which the least energy is known: a slope has another side of the rock downhill in each."""


def least_overturning_j_kg(scene: Scene, tilt_deg: float = 0.0, yaw_deg: float | None = 0.0) -> float:
    """Least energy per mass that overturns a rock tilted so far, J/kg, above that of the same one lying.

    Whatever overturns it passes every larger tilt, up to that at which it counts as toppled: the least energy at the
    tilt where that is largest is needed in any case. For a block it is g R (1 - cos alpha). It is what a rock needs
    that rocks on the edges and corners of its base. One that rolls down a slope on a rounded base gains what this does
    not count: on 15 degrees up to a sixth.

    tilt_deg: whole degrees below do not count: a peak that was passed holds nothing.
    yaw_deg: turn about the interface's normal from the pose of the scene, which says what sides a slope has downhill;
    None for the weakest of all.
    """
    by_yaw = _least_by_yaw_j_kg(scene)
    yaws = slice(None) if yaw_deg is None else [round(yaw_deg * _YAWS / 360.0) % len(by_yaw)]
    by_tilt = by_yaw[yaws].min(axis=0)
    return float(by_tilt[min(int(np.ceil(tilt_deg)), len(by_tilt) - 1) :].max())


@cached
def lying_arms_m(contact: ContactModel) -> Array:
    """From each contact point (n, 3) to the centre of mass as the rock stood at the start, support frame.

    A point touches the plane where it lay above it then: so does that of a base that is nearly flat.
    """
    return contact.com_m * (0.0, 0.0, 1.0) + _arms_m(contact) * (1.0, 1.0, 0.0)


def _arms_m(contact: ContactModel) -> Array:
    return -contact.points_body_m @ contact.support_from_body.T


@cached
def _least_by_yaw_j_kg(scene: Scene) -> Array:
    """Least potential energy per mass (yaws, tilts) at each whole degree of tilt; on the level one yaw is all."""
    rises_m, up = _rises_m(contact_of(scene)), contact_of(scene).scene_from_support[2]
    yaws_rad = np.arange(0.0, 2.0 * np.pi, 2.0 * np.pi / _YAWS) if up[2] < 1.0 else np.zeros(1)
    ups = Rotation.from_euler("z", -yaws_rad[:, None]).apply(up)
    return np.array([scene.gravity_m_s2 * (rises_m @ axis).min(axis=1) for axis in ups])


def _rises_m(contact: ContactModel) -> Array:
    """Ways (tilts, ways, 3) of the centre of mass from where the rock lay to each whole degree of tilt, support frame.

    Tilted about axes all around, it stands on its lowest point. Where neighbouring axes have different ones it may
    stand on both between: there its centre of mass is lowest, since that of a rock on one point rises and falls with
    the axis as a cosine and lies above its chords. Left out, a slab that is turned by 5 degrees against the axes
    would seem to need up to twelve times the energy.
    """
    arms, lying = _arms_m(contact), lying_arms_m(contact)
    azimuth = np.arange(0.0, 2.0 * np.pi, np.deg2rad(_AXES_STEP_DEG))
    axes = np.column_stack([np.cos(azimuth), np.sin(azimuth), np.zeros(len(azimuth))])
    here = np.arange(len(axes))
    after = np.roll(here, -1)

    def rises_m(turned: Array, point: NDArray[np.intp]) -> Array:
        return np.einsum("aij,aj->ai", turned, arms[point]) - lying[point]

    by_tilt = []
    for tilt in np.deg2rad(np.arange(0.0, TOPPLED_TILT_DEG + 1.0)):
        turned = Rotation.from_rotvec(tilt * axes).as_matrix()
        heights = turned[:, 2] @ arms.T  # of the centre of mass over each point
        point = heights.argmax(axis=1)
        other = point[after]
        above = heights[here, point] - heights[here, other]
        below = heights[after, other] - heights[after, point]
        share = (above / np.maximum(above + below, 1e-300))[:, None]
        both = [
            (1.0 - share) * rises_m(turned, up) + share * rises_m(turned[after], up)  # with both points down
            for up in (point, other)
        ]
        by_tilt.append(np.vstack([rises_m(turned, point), *both]))
    return np.array(by_tilt)
