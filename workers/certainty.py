"""When it is certain, before a motion has ended, that a rock will stand.

On ground at rest that is a matter of energy, which does not grow. On ground that still moves weakly it is measured
(docs/shortcuts.md), not proven: a motion in step with the rocking might feed it.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from toppling.models.motions.motion import Motion
from toppling.models.scene import Scene
from toppling.models.statics import TOPPLED_TILT_DEG, quasi_static_toppling_m_s2
from toppling.workers.contact import ContactModel, contact_of
from toppling.workers.quaternion import inverse, matrix, product

Array = NDArray[np.float64]

REST_CERTAIN_SHARE = 0.1
"""Share of the least energy that overturns, below which a rock on ground at rest or weakly moved will stand."""

WEAK_SHARE = 0.25
"""A motion is weak that stays within this share of what would tip the rock slowly or drag it over its pedestal."""

WEAK_TILT_DEG, WEAK_YAW_DEG = 3.0, 30.0
"""What tips the rock is known for the pose that it started in, so only near that pose is a motion called weak."""

AZIMUTH_STEP_DEG = 10.0

AXES_STEP_DEG = 2.0
"""Between axes of tilt. Between them the centre of mass is taken as lower by up to 1.5e-4 of its lever arm."""

TURNS = 72
"""About the normal, for which the least energy is known: a slope has another side of the rock downhill in each."""


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


def least_overturning_j_kg(scene: Scene, tilt_deg: float = 0.0, turn_deg: float | None = 0.0) -> float:
    """Least energy per mass that overturns a rock tilted so far, J/kg; counts as :func:`potential_j_kg` does.

    Whatever overturns it passes every larger tilt, up to that at which it counts as toppled: the least energy at the
    tilt where that is largest is needed in any case. For a block it is g R (1 - cos alpha). It is what a rock needs
    that rocks on the edges and corners of its base. One that rolls down a slope on a rounded base gains what this does
    not count: on 15 degrees up to a sixth.

    Parameters
    ----------
    scene : Scene
    tilt_deg : float
        Whole degrees below do not count: a peak that was passed holds nothing.
    turn_deg : float or None
        Turn about the interface's normal from the pose of the scene, which says what sides a slope has downhill; None
        for the weakest turn of all.
    """
    by_turn = _least_by_turn_j_kg(scene)
    turns = slice(None) if turn_deg is None else [round(turn_deg * TURNS / 360.0) % len(by_turn)]
    by_tilt = by_turn[turns].min(axis=0)
    return float(by_tilt[min(int(np.ceil(tilt_deg)), len(by_tilt) - 1) :].max())


def potential_j_kg(scene: Scene, com_m: Array, attitude: Array) -> float:
    """Potential energy per mass of a rock above that of the same one lying where it is, J/kg.

    What a slope gave to a rock that slid does not count, since friction took it.

    Parameters
    ----------
    scene : Scene
    com_m : (3,) array
        Centre of mass, support frame.
    attitude : (4,) array
        Of the body frame, support frame.
    """
    contact = contact_of(scene)
    up = contact.scene_from_support[2]
    return float(scene.gravity_m_s2 * up @ (com_m - lying_com_m(contact, com_m, attitude)))


def lying_com_m(contact: ContactModel, com_m: Array, attitude: Array) -> Array:
    """Centre of mass (3,) if the rock lay where it is: turned as now, its lowest foot on the same spot."""
    feet = contact.points_body_m @ matrix(attitude).T
    lowest = int(feet[:, 2].argmin())
    foot = (com_m + feet[lowest]) * (1.0, 1.0, 0.0)
    turned = Rotation.from_euler("z", turn_rad(attitude, contact.start_quaternion_xyzw))
    return np.asarray(foot + turned.apply(_lying_m(contact)[lowest]))


def turn_rad(attitude: Array, since: Array) -> float:
    """Turn since another attitude about the interface's normal: what is left of a rotation without the tilt."""
    _, _, z, w = product(attitude, inverse(since))
    return float(2.0 * np.arctan2(z, w))


@lru_cache(maxsize=8)
def _lying_m(contact: ContactModel) -> Array:
    """From each foot (n, 3) to the centre of mass as the rock stood at the start, support frame.

    A foot touches the plane where it lay above it then: so does the foot of a base that is nearly flat.
    """
    return contact.com_m * (0.0, 0.0, 1.0) + _arms_m(contact) * (1.0, 1.0, 0.0)


def _arms_m(contact: ContactModel) -> Array:
    return -contact.points_body_m @ contact.support_from_body.T


@lru_cache(maxsize=8)
def _least_by_turn_j_kg(scene: Scene) -> Array:
    """Least potential energy per mass (turns, tilts) at each whole degree of tilt; on the level one turn is all."""
    lifts_m, up = _lifts_m(contact_of(scene)), contact_of(scene).scene_from_support[2]
    turns_rad = np.arange(0.0, 2.0 * np.pi, 2.0 * np.pi / TURNS) if up[2] < 1.0 else np.zeros(1)
    ups = Rotation.from_euler("z", -turns_rad[:, None]).apply(up)
    return np.array([scene.gravity_m_s2 * (lifts_m @ one).min(axis=1) for one in ups])


def _lifts_m(contact: ContactModel) -> Array:
    """Ways (tilts, ways, 3) of the centre of mass from where the rock lay to each whole degree of tilt, support frame.

    Tilted about axes all around, it stands on its lowest foot. Where neighbouring axes have different ones it may stand
    on both between: there its centre of mass is lowest, since that of a rock on one foot rises and falls with the axis
    as a cosine and lies above its chords. Left out, a slab that is turned by 5 degrees against the axes would seem to
    need up to twelve times the energy.
    """
    arms, lying = _arms_m(contact), _lying_m(contact)
    azimuth = np.arange(0.0, 2.0 * np.pi, np.deg2rad(AXES_STEP_DEG))
    axes = np.column_stack([np.cos(azimuth), np.sin(azimuth), np.zeros(len(azimuth))])
    here = np.arange(len(axes))
    after = np.roll(here, -1)

    def lifts_m(turned: Array, foot: NDArray[np.intp]) -> Array:
        return np.einsum("aij,aj->ai", turned, arms[foot]) - lying[foot]

    by_tilt = []
    for tilt in np.deg2rad(np.arange(0.0, TOPPLED_TILT_DEG + 1.0)):
        turned = Rotation.from_rotvec(tilt * axes).as_matrix()
        heights = turned[:, 2] @ arms.T  # of the centre of mass over each foot
        foot = heights.argmax(axis=1)
        other = foot[after]
        above = heights[here, foot] - heights[here, other]
        below = heights[after, other] - heights[after, foot]
        share = (above / np.maximum(above + below, 1e-300))[:, None]
        both = [
            (1.0 - share) * lifts_m(turned, one) + share * lifts_m(turned[after], one)  # with both feet down
            for one in (foot, other)
        ]
        by_tilt.append(np.vstack([lifts_m(turned, foot), *both]))
    return np.array(by_tilt)
