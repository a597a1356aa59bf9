"""What makes it certain, before a motion has ended, that a rock will stand."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from models.motions.motion import Motion
from models.scene import Scene
from models.statics import quasi_static_toppling_m_s2
from workers.contact import LARGEST_OPEN_TILT_DEG, contact_of

Array = NDArray[np.float64]

REST_CERTAIN_SHARE = 0.1
"""Share of the least energy that overturns, below which a rock on ground at rest or weakly moved will stand."""

WEAK_SHARE = 0.25
"""A motion is weak that stays within this share of what would tip the rock slowly or drag it over its pedestal."""

AZIMUTH_STEP_DEG = 10.0


def weak_from_s(scene: Scene, motion: Motion) -> float:
    """Time from which a motion is weak, s: at 1 / WEAK_SHARE times its strength it would neither tip nor drag the rock.

    What tips it is the constant acceleration of that azimuth which, slowly applied, topples (:mod:`models.statics`).
    """
    stronger = motion.acceleration_m_s2 / WEAK_SHARE
    downward = scene.gravity_m_s2 + stronger[:, 2]
    azimuth = np.rad2deg(np.arctan2(stronger[:, 1], stronger[:, 0])) % 360.0
    before = (azimuth // AZIMUTH_STEP_DEG).astype(np.int64)
    ratio = _tipping_ratios(scene)
    least = np.minimum(ratio[before % len(ratio)], ratio[(before + 1) % len(ratio)])
    tips = np.hypot(stronger[:, 0], stronger[:, 1]) >= downward * least
    pulls = (np.array([0.0, 0.0, -scene.gravity_m_s2]) - stronger) @ contact_of(scene).scene_from_support
    drags = np.hypot(pulls[:, 0], pulls[:, 1]) >= -scene.contact.friction_kinetic * pulls[:, 2]
    strong = np.flatnonzero(tips | drags)
    return (strong[-1] + 1) * motion.time_step_s if len(strong) else 0.0


@lru_cache(maxsize=8)
def _tipping_ratios(scene: Scene) -> Array:
    """Constant horizontal acceleration that topples the rock, over gravity, by azimuth from 0 up."""
    azimuths = np.arange(0.0, 360.0, AZIMUTH_STEP_DEG).tolist()
    least = quasi_static_toppling_m_s2(scene.rock, scene.pedestal, scene.gravity_m_s2, azimuths)
    return np.array([value for _, value in least]) / scene.gravity_m_s2


@lru_cache(maxsize=8)
def least_overturning_j_kg(scene: Scene) -> float:
    """Least energy per mass that overturns the rock, J/kg.

    Whatever overturns it passes every tilt, so the least energy at the tilt where that is largest is needed in any
    case. At a tilt the rock stands on its lowest foot, which touches the plane where it lay above it at the start: so
    does the foot of a base that is nearly flat. For a block it is g R (1 - cos alpha).
    """
    contact = contact_of(scene)
    up = np.array([0.0, 0.0, 1.0]) @ contact.scene_from_support
    arms = -contact.points_body_m @ contact.support_from_body.T
    contact_points = (contact.com_m - arms) * (1.0, 1.0, 0.0)
    azimuth = np.deg2rad(np.arange(0.0, 360.0, AZIMUTH_STEP_DEG))
    axes = np.column_stack([np.cos(azimuth), np.sin(azimuth), np.zeros(len(azimuth))])
    least = []
    for tilt in np.deg2rad(np.arange(1.0, LARGEST_OPEN_TILT_DEG)):
        turned = arms @ Rotation.from_rotvec(tilt * axes).as_matrix().transpose(0, 2, 1)
        lowest = turned[..., 2].argmax(axis=1)
        com = contact_points[lowest] + turned[np.arange(len(axes)), lowest]
        least.append(((com - contact.com_m) @ up).min())
    return scene.gravity_m_s2 * max(float(max(least)), 0.0)
