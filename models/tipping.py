"""Quasi-static path of a rock on a surface: the acceleration that it supports in each pose into which it is tipped.

Which loads the contacts of a pose support is a linear programme over their friction cones
(:mod:`toppling.models.ground.equilibrium`). Under a load just beyond the largest supported one the rock moves by small
steps, each the least change of a free motion that satisfies the contacts (non-negative least squares). The path ends
where the rock slides: no larger constant acceleration leaves it at rest.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from scipy.spatial.transform import Rotation

from toppling.models.compiled import Array
from toppling.models.frames import horizontal_unit_vector
from toppling.models.ground.body import GroundedBody
from toppling.models.ground.curved import FIRST_KEY as FIRST_SMOOTH_KEY
from toppling.models.ground.equilibrium import farthest_load, shortest, wrenches
from toppling.models.ground.stepping import Grounded, contacts_at_pose

_STEP_SHARE = 0.008
"""Length of a step along the path, as a fraction of the half diagonal R."""

_LEAST_STEP_SHARE = 2e-4
"""Shortest step, as a fraction of R: towards a pose in which other contacts carry, or the peak of a rolling rock."""

_TOUCHING_SHARE = 1e-6
"""Gap up to which a contact carries, as a fraction of R."""

_PRESSED_SHARE = 5e-5
"""Length of the step that closes the gaps opened by a rotation to first order, as a fraction of R."""

_TIPPED_COSINE = math.cos(0.4)  # of half the largest tilt of the path, 0.8 rad

_FOLLOWED_SHARE = 0.4
"""Distance along the path past its peak, as a fraction of R, which covers the facets of a coarse rounded base."""

_PASSED = 0.9
"""Fraction of the largest supported acceleration below which its peak is passed."""

_GATHERED = 3e-3
"""Energy per mass below which a rock counts as at rest, over g R: that of the unevenness of a rough base."""

_MOST_GRAVITIES = 30.0  # acceleration, over g, beyond which a pose supports any
_MOST_STEPS = 600  # of a path
_MOST_TRIALS = 12  # of the length of a step


def largest_held_m_s2(body: GroundedBody, azimuths_deg: Iterable[float]) -> list[tuple[float, float]]:
    """Largest constant horizontal ground acceleration at which a rock is in equilibrium, by azimuth.

    In the pose in which it rests, or in one that it tips into without gathering speed; 0 for a rock that falls by
    itself, however it comes to lie.
    """
    stands = body.rests_nearby
    return [(float(each), _followed_m_s2(body, float(each)) if stands else 0.0) for each in azimuths_deg]


def _followed_m_s2(body: GroundedBody, azimuth_deg: float) -> float:
    """Largest acceleration supported along the path of one azimuth.

    Where a pose supports less than the best so far, the rock gathers energy: the difference times the distance along
    the push. It is at rest again once poses that support more have taken as much.
    """
    size_m, g, load = body.size_m, body.gravity_m_s2, body.load_m_s2()
    push = -horizontal_unit_vector(azimuth_deg) @ body.scene_from_support
    sim, start = body.clockless(body.resting_pose, 1.0, body.curved), body.resting_pose
    # Once off the wall, a rock that leaned gathers speed: that it would stand upright as well is no answer.
    followed_m = 0.0 if body.leans else _FOLLOWED_SHARE * size_m
    best = before = gathered_j_kg = 0.0
    way_m = _STEP_SHARE * size_m
    last = peak = pressed = _pressed(body, start, _near(sim, start, size_m), load)
    for _ in range(_MOST_STEPS):
        pose, near = pressed, _near(sim, pressed, size_m)
        touching = near[near["gap_m"] < _TOUCHING_SHARE * size_m]
        held = _held_m_s2(body, touching, push, best)
        rolls = len(touching) > 0 and touching["key"].min() >= FIRST_SMOOTH_KEY
        rests, along = held is not None or rolls, float((pose[:3] - last[:3]) @ push)
        if held is None:
            held = _balanced_m_s2(touching, load, push, before)
        if held > _MOST_GRAVITIES * g:
            return np.inf
        if rolls and last is peak and pose is not peak and held < best and way_m > _LEAST_STEP_SHARE * size_m:
            # The peak lies between the two poses: go back, and take shorter steps.
            pose, near, way_m = last, _near(sim, last, size_m), 0.25 * way_m
        else:
            gathered_j_kg = max(gathered_j_kg + (best - 0.5 * (held + before)) * along, 0.0)
            if held > best and rests and gathered_j_kg <= _GATHERED * size_m * g:
                best, gathered_j_kg, peak = held, 0.0, pose
            elif held < _PASSED * best and _moved_m(peak, pose, body.farthest_m) > followed_m:
                break
            last, before, way_m = pose, held, _STEP_SHARE * size_m
        tilted = abs(start[3:] @ pose[3:]) < _TIPPED_COSINE
        if tilted or np.linalg.norm(pose[:3] - start[:3]) > size_m:
            break
        force = load + (1.02 * max(best, held) + 0.01 * g) * push
        tipped = _tipped(body, pose, near, force, way_m)
        if tipped is None:
            break
        pressed = _pressed(body, tipped, _near(sim, tipped, size_m), force)
    return best


def _near(sim: Grounded, pose: Array, size_m: float) -> np.ndarray:
    return sim.trial[: contacts_at_pose(sim, pose, 2.0 * _STEP_SHARE * size_m)].copy()


def _balanced_m_s2(touching: np.ndarray, load: Array, push: Array, otherwise: float) -> float:
    """Acceleration under which the line of action passes a contact, seen along the level across the push."""
    if not len(touching):
        return otherwise
    across = np.cross(push, load)
    return float(
        (-(np.cross(touching["arm_m"], load) @ across) / (np.cross(touching["arm_m"], push) @ across)).max()
    )


def _moved_m(start: Array, end: Array, radius_m: float) -> float:
    cosine = min(abs(float(start[3:] @ end[3:])), 1.0)
    return float(np.linalg.norm(end[:3] - start[:3])) + 2.0 * math.sqrt(1.0 - cosine**2) * radius_m


def _held_m_s2(body: GroundedBody, touching: np.ndarray, push: Array, more_than: float) -> float | None:
    if not len(touching):
        return None
    columns = wrenches(touching["arm_m"], touching["normal"], body.friction[0])
    return farthest_load(columns, body.load_m_s2(), push, body.size_m, more_than=more_than)


def _tipped(
    body: GroundedBody, pose: Array, near: np.ndarray, force_m_s2: Array, share_m: float
) -> Array | None:
    """The next pose under a force, before or where contacts that did not touch carry; None for a rock that slides."""
    touching_m = _TOUCHING_SHARE * body.size_m
    gap, arms, normals, friction = near["gap_m"], near["arm_m"], near["normal"], body.friction[0]
    columns, floors, scale = _conditions(body, near)
    touches, free = gap < touching_m, np.zeros(6)
    free[:3] = force_m_s2 * (share_m / np.linalg.norm(force_m_s2))
    grows = True
    for _ in range(_MOST_TRIALS):
        twist = (free + shortest(columns, floors - free @ columns)) / scale
        moves = twist[:3] + np.cross(twist[3:], arms)
        rises = (moves * normals).sum(axis=1)
        gone_m = float(np.linalg.norm(twist[:3]) + np.linalg.norm(twist[3:]) * body.farthest_m)
        then = gap + rises < touching_m
        lands = (then & ~touches & (near["key"] < FIRST_SMOOTH_KEY)).any()
        if gone_m > 1.5 * share_m:
            free *= share_m / gone_m
            grows = False
        elif lands and (touches & ~then).any() and gone_m > _LEAST_STEP_SHARE * body.size_m:
            free *= 0.5
            grows = False
        elif grows and 0.0 < gone_m < 0.5 * share_m:
            free *= min(share_m / gone_m, 1e3)
        else:
            break
    across = np.linalg.norm(moves - rises[:, None] * normals, axis=1)
    bears = touches & (gap + rises - friction * across < touching_m)
    if bears.any() and across[bears].min() > 0.5 * gone_m:
        return None
    return _placed(pose, twist)


def _pressed(body: GroundedBody, pose: Array, near: np.ndarray, force_m_s2: Array) -> Array:
    """A pose whose contacts are open or deep by what turning does beyond its first order, pressed by a force."""
    columns, floors, scale = _conditions(body, near)
    free = np.zeros(6)
    free[:3] = force_m_s2 * (_PRESSED_SHARE * body.size_m / np.linalg.norm(force_m_s2))
    return _placed(pose, (free + shortest(columns, floors - free @ columns)) / scale)


def _conditions(body: GroundedBody, near: np.ndarray) -> tuple[Array, Array, Array]:
    """Edges of the contacts' cones, what a twist must at least do along each, and the scale of twists."""
    scale = np.repeat([1.0, math.sqrt(body.inertia_m2.mean())], 3)
    columns = wrenches(near["arm_m"], near["normal"], body.friction[0]) / scale[:, None]
    return columns, -np.repeat(near["gap_m"], columns.shape[1] // max(len(near), 1)), scale


def _placed(pose: Array, twist: Array) -> Array:
    turned = Rotation.from_rotvec(twist[3:]) * Rotation.from_quat(pose[3:])
    return np.concatenate([pose[:3] + twist[:3], turned.as_quat()])
