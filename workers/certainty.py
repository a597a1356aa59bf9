"""When it is certain, before a motion has ended, that a rock will stand.

On ground at rest that is a matter of energy, which never grows. On ground that still moves weakly it is measured
(docs/shortcuts.md), not proven: a motion in step with the rocking might feed it.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from models.motions.motion import Motion
from models.scene import Scene
from models.statics import TOPPLED_TILT_DEG, quasi_static_toppling_m_s2
from workers.contact import contact_of

Array = NDArray[np.float64]

REST_CERTAIN_SHARE = 0.1
"""Share of the least energy that overturns, below which a rock on ground at rest or weakly moved will stand."""

WEAK_SHARE = 0.25
"""A motion is weak that stays within this share of what would tip the rock slowly or drag it over its pedestal."""

WEAK_TILT_DEG, WEAK_YAW_DEG = 3.0, 30.0
"""What tips the rock is known for the pose that it started in, so only near that pose is a motion called weak."""

AZIMUTH_STEP_DEG = 10.0


def weak_from_s(scene: Scene, motion: Motion) -> float:
    """Time from which a motion is weak, s: at 1 / WEAK_SHARE times its strength it would neither tip nor drag the rock.

    What tips it is the least constant acceleration of any azimuth that, slowly applied, topples
    (:mod:`models.statics`): of any, since a rock that has turned has its weakest side elsewhere.
    """
    stronger = motion.acceleration_m_s2 / WEAK_SHARE
    downward = scene.gravity_m_s2 + stronger[:, 2]
    holds = np.hypot(stronger[:, 0], stronger[:, 1]) < downward * _tipping_ratio(scene)
    pulls = (np.array([0.0, 0.0, -scene.gravity_m_s2]) - stronger) @ contact_of(scene).scene_from_support
    grips = np.hypot(pulls[:, 0], pulls[:, 1]) < -scene.contact.friction_kinetic * pulls[:, 2]
    strong = np.flatnonzero(~(holds & grips))
    return (strong[-1] + 1) * motion.time_step_s if len(strong) else 0.0


@lru_cache(maxsize=8)
def _tipping_ratio(scene: Scene) -> float:
    """Least constant horizontal acceleration that topples the rock, over gravity."""
    azimuths = np.arange(0.0, 360.0, AZIMUTH_STEP_DEG).tolist()
    least = quasi_static_toppling_m_s2(scene.rock, scene.pedestal, scene.gravity_m_s2, azimuths)
    return min(value for _, value in least) / scene.gravity_m_s2


def least_overturning_j_kg(scene: Scene, tilt_deg: float = 0.0) -> float:
    """Least energy per mass, above that of the start, that overturns a rock tilted so far, J/kg.

    Whatever overturns it passes every larger tilt, up to that at which it counts as toppled: the least energy at the
    tilt where that is largest is needed in any case. For a block it is g R (1 - cos alpha).
    """
    by_tilt = _least_energies_j_kg(scene)
    return float(by_tilt[min(int(tilt_deg), len(by_tilt) - 1) :].max())


@lru_cache(maxsize=8)
def _least_energies_j_kg(scene: Scene) -> Array:
    """Least potential energy per mass at each whole degree of tilt, above that of the start.

    The rock stands on its lowest foot, which touches the plane where it lay above it at the start: so does the foot of
    a base that is nearly flat.
    """
    contact = contact_of(scene)
    up = np.array([0.0, 0.0, 1.0]) @ contact.scene_from_support
    arms = -contact.points_body_m @ contact.support_from_body.T
    contact_points = (contact.com_m - arms) * (1.0, 1.0, 0.0)
    azimuth = np.deg2rad(np.arange(0.0, 360.0, AZIMUTH_STEP_DEG))
    axes = np.column_stack([np.cos(azimuth), np.sin(azimuth), np.zeros(len(azimuth))])
    least = []
    for tilt in np.deg2rad(np.arange(0.0, TOPPLED_TILT_DEG + 1.0)):
        turned = arms @ Rotation.from_rotvec(tilt * axes).as_matrix().transpose(0, 2, 1)
        lowest = turned[..., 2].argmax(axis=1)
        com = contact_points[lowest] + turned[np.arange(len(axes)), lowest]
        least.append(((com - contact.com_m) @ up).min())
    return scene.gravity_m_s2 * np.array(least)
