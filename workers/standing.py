"""When a rock on a surface will stand: statics of what is left of the motion, and the energy that is left after it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from heapq import heapreplace

import numpy as np
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.transform import Rotation

from toppling.models.caching import cached
from toppling.models.compiled import Array
from toppling.models.errors import InputError
from toppling.models.ground.body import SETTLING_STEP, GroundedBody
from toppling.models.ground.equilibrium import are_held, wrenches
from toppling.models.ground.stepping import settle

TOUCHING_SHARE = 1e-3
"""Gap over R of the contacts that carry a rock at rest; one that creeps to rest ends with smaller gaps."""

_SURE_SHARE = 0.9
"""Share of the friction that must suffice to hold a rock which certainly rests."""

_MANY_CONTACTS = 24
"""Number of contacts beyond which a programme over all of them costs more than the steps, as on a fine dome."""

_SETTLING_STEPS, _SETTLING_ROUNDS = 100, 3
"""Number of steps and of rounds in which a rock that is let down from its present pose must come to stand."""

_UNMOVED_SHARE = 0.02
"""Displacement over R of a rock that has hardly moved."""

_WAYS, _TILT_STEP_DEG, _FARTHEST_DEG = 8, 2.0, 40.0
"""Number of directions, step and largest angle with which a rock is tipped to find the least energy to overturn it."""


def holds(
    body: GroundedBody, pose: Array, loads_m_s2: Array, *, rolls: bool = False, share: float = _SURE_SHARE
) -> bool:
    """Whether contacts in a pose hold loads (n, 3) with a share of friction; those on their cone's border are asked.

    Loads as specific forces, in the axes of the support. rolls: or in one that a rounded base would roll into.
    """
    if (loads_m_s2[:, 2] >= 0.0).any():
        return False
    found = body.near_contacts if rolls else body.contacts
    near = _outermost_contacts(found(pose, TOUCHING_SHARE * body.size_m))
    columns = wrenches(near["arm_m"], near["normal"], share * body.friction[0])
    leaning = np.hypot(loads_m_s2[:, 0], loads_m_s2[:, 1]) / -loads_m_s2[:, 2]
    if not are_held(columns, loads_m_s2[leaning.argmax()][None], body.size_m).all():
        return False
    return bool(are_held(columns, _outermost(loads_m_s2), body.size_m).all())


def _outermost_contacts(near: np.ndarray) -> np.ndarray:
    """Select the outermost contacts in some directions: loads that these hold are held by all."""
    if len(near) <= _MANY_CONTACTS:
        return near
    angle = 2.0 * np.pi * np.arange(_MANY_CONTACTS) / _MANY_CONTACTS
    directions = np.column_stack([np.cos(angle), np.sin(angle)])
    return near[np.unique((directions @ near["place_m"][:, :2].T).argmax(axis=1))]


def _outermost(loads_m_s2: Array) -> Array:
    """Select the extreme loads, of which all other loads with a downward part are convex mixtures up to scale."""
    leaning = loads_m_s2[:, :2] / -loads_m_s2[:, 2:]
    try:
        return np.asarray(loads_m_s2[ConvexHull(leaning).vertices])
    except QhullError:  # fewer than three, or all on a line
        apart = leaning - leaning[0]
        along = apart @ apart[np.linalg.norm(apart, axis=1).argmax()]
        return np.asarray(loads_m_s2[[along.argmin(), along.argmax()]])


def let_down(body: GroundedBody, pose: Array) -> Array | None:
    """The pose in which a rock comes to stand from another one without gathering speed; None if it does not soon."""
    if body.rolls_on_facets:
        rest = body.rolled_to_rest(pose)
        return rest if holds(body, rest, body.load_m_s2()[None], rolls=True) else None
    rock, ground = body.moving
    sim = body.clockless(pose, SETTLING_STEP * math.sqrt(body.size_m / body.gravity_m_s2))
    sim = sim._replace(rock=rock, ground=ground)
    load = body.load_m_s2()
    for _ in range(_SETTLING_ROUNDS):
        if holds(body, sim.pose[0], load[None]):
            return sim.pose[0].copy()
        settle(sim, load, _SETTLING_STEPS, 1e-7 * body.size_m)
    return None


def energy_j_kg(body: GroundedBody, pose: Array, velocity: Array, rest: Array) -> float:
    """Energy per mass of a moving rock, above that in a pose at rest."""
    spin = Rotation.from_quat(pose[3:]).inv().apply(velocity[3:])
    raised_m = (pose[:3] - rest[:3]) @ body.scene_from_support[2]
    kinetic = 0.5 * (velocity[:3] @ velocity[:3] + spin @ (body.inertia_m2 * spin))
    return float(kinetic + body.gravity_m_s2 * raised_m)


def least_overturning_j_kg(body: GroundedBody, rest: Array, enough_j_kg: float = math.inf) -> float:
    """Least energy per mass that tips a rock over, of some directions, rolling on its outermost contacts.

    Where that is more than `enough_j_kg`, something between the two. The energy of the pose in which it stood serves
    as long as it has hardly moved from there.
    """
    start = body.resting_pose
    half_turn = math.acos(min(abs(float(start[3:] @ rest[3:])), 1.0))
    moved_m = float(np.linalg.norm(rest[:3] - start[:3])) + 2.0 * half_turn * body.farthest_m
    if moved_m < _UNMOVED_SHARE * body.size_m:
        return _least_where_it_stood_j_kg(body)
    return _least_j_kg(body, rest, enough_j_kg)


@cached
def _least_where_it_stood_j_kg(body: GroundedBody) -> float:
    return _least_j_kg(body, body.resting_pose, math.inf)


def _least_j_kg(body: GroundedBody, rest: Array, enough_j_kg: float) -> float:
    """Advance the direction whose height is least: the first in which the rock sinks needs the least energy."""
    east, north, up = body.scene_from_support
    start_m = float(rest[:3] @ up)
    outward = [math.cos(rad) * east + math.sin(rad) * north for rad in 2.0 * np.pi * np.arange(_WAYS) / _WAYS]
    heights_m = [_heights_m(body, rest, direction) for direction in outward]
    waiting = [(start_m, sector) for sector in range(_WAYS)]
    while True:
        highest_m, sector = waiting[0]
        so_far_j_kg = body.gravity_m_s2 * max(highest_m - start_m, 0.0)
        height_m = next(heights_m[sector], -math.inf) if so_far_j_kg <= enough_j_kg else -math.inf
        if height_m < highest_m:
            return so_far_j_kg
        heapreplace(waiting, (height_m, sector))


def _heights_m(body: GroundedBody, rest: Array, outward: Array) -> Iterator[float]:
    """Heights of the centre of mass of a rock that is tipped until it loses the ground; infinite if it never does."""
    up = body.scene_from_support[2]
    turn, pose = Rotation.from_rotvec(math.radians(_TILT_STEP_DEG) * np.cross(up, outward)), rest
    for _ in range(int(_FARTHEST_DEG / _TILT_STEP_DEG)):
        near = body.contacts(pose, TOUCHING_SHARE * body.size_m)
        if len(near) == 0:
            return
        pivot = near["place_m"][np.argmax(near["place_m"] @ outward)]
        attitude = (turn * Rotation.from_quat(pose[3:])).as_quat()
        try:
            pose = body.touching(np.concatenate([pivot + turn.apply(pose[:3] - pivot), attitude]))
        except InputError:  # it has lost the ground
            return
        yield float(pose[:3] @ up)
    yield math.inf
