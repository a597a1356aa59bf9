"""Statics of a rock on a surface, followed from pose to pose along the path on which a growing acceleration tips it.

In each pose the contacts tell up to which acceleration the rock stays without slip (:mod:`toppling.models.pivots`), and
which their friction cones hold (:mod:`toppling.models.ground.equilibrium`). Beyond the former it turns by small steps
about the axis that gains most energy.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

from toppling.models.caching import cached
from toppling.models.compiled import Array
from toppling.models.frames import horizontal_unit_vector
from toppling.models.ground.body import GroundedBody
from toppling.models.ground.contacts import LEANING, MOST
from toppling.models.ground.equilibrium import farthest_load, shortest, wrenches
from toppling.models.ground.facets import FIRST_KEY as FIRST_SMOOTH_KEY
from toppling.models.ground.stepping import Grounded, contacts_at
from toppling.models.pivots import Turn, crossed, kept_share, tips_m_s2, turn_under
from toppling.models.statics import Limits

_STEP_SHARE = 0.008
"""Length of a step along the path, as a fraction of the half diagonal R."""

_LEAST_STEP_SHARE = 2e-4
"""Shortest step, as a fraction of R, towards the peak of a rolling rock."""

_TOUCHING_SHARE = 1e-6
"""Gap up to which a contact carries, as a fraction of R."""

_PRESSED_SHARE = 1e-5
"""Length of the step that closes the gaps opened by a rotation to first order, as a fraction of R."""

_TIPPED_COSINE = math.cos(0.4)  # of half the largest tilt of the path, 0.8 rad

_GATHERED = 3e-3
"""Energy per mass over g R up to which a rock counts as at rest: it gathers as much over the unevenness of its base, or
in a fall of 4 degrees about an edge."""

_BEYOND = 0.01
"""Share by which the acceleration that moves the rock on, and a hundredth of g, exceed the largest at rest."""

_SHORT_OF = 1e-3
"""Share of the acceleration in a pose at whose border friction is not asked: contacts are known to some micrometres."""

_MOST_GRAVITIES = 30.0  # acceleration, over g, beyond which a pose supports any
_MOST_STEPS = 600  # of a path


@cached
def limits_on_surface(body: GroundedBody, azimuths_deg: tuple[float, ...]) -> list[Limits]:
    """Statics of a rock by azimuth of the ground's acceleration; both 0 for one that falls by itself."""
    stands = body.rests_nearby
    return [
        Limits(float(azimuth), *(_followed(body, float(azimuth)) if stands else (0.0, 0.0)))
        for azimuth in azimuths_deg
    ]


def _followed(body: GroundedBody, azimuth_deg: float) -> tuple[float, float]:
    """Accelerations at which the rock tips, and slides, on the path of one azimuth.

    Where a pose supports less than the best so far, the rock gathers energy, of which it loses what contacts that land
    take. The path ends where it is beyond its balance, as gravity alone carries it on, with too much of that energy.
    """
    size_m, g, load = body.size_m, body.gravity_m_s2, body.load_m_s2()
    push = -horizontal_unit_vector(azimuth_deg) @ body.scene_from_support
    sim, start = body.clockless(body.resting_pose, 1.0), body.resting_pose
    best, held, gathered_j_kg, short, rolled = 0.0, 0.0, 0.0, 0, False
    slides, travel_m = np.inf, 0.25 * _STEP_SHARE * size_m
    settles_m = load * (_PRESSED_SHARE * size_m / g)  # some contacts of a rock that was let down nearly touch
    pose = _pressed(body, start, _near(sim, start, travel_m), settles_m)
    last = peak = prior = pose
    turn, pivot_m = None, pose[:3]
    for _ in range(_MOST_STEPS):
        near = _near(sim, pose, travel_m)
        touching = near[near["gap_m"] < _TOUCHING_SHARE * size_m]
        rolls = len(touching) > 0 and touching["key"].min() >= FIRST_SMOOTH_KEY
        most = tips_m_s2(touching["arm_m"], touching["normal"], size_m, load, push)
        if most is not None:
            held = most
        elif len(touching):
            held = _balanced_m_s2(touching, load, push)
        rests = rolls or most is not None
        if (
            rolled
            and last is peak
            and pose is not peak
            and held < best
            and travel_m > _LEAST_STEP_SHARE * size_m
        ):
            # The largest lies between the pose before and this one: go back, and take shorter steps between them.
            pose = last = prior
            near, short = _near(sim, pose, travel_m), 8
            travel_m = next_m = 0.25 * travel_m
            touching = near[near["gap_m"] < _TOUCHING_SHARE * size_m]
        else:
            gathered_j_kg = max(gathered_j_kg + float((load + best * push) @ (pose[:3] - last[:3])), 0.0)
            if turn is not None:
                turn = Turn(pivot_m - pose[:3], turn.axis)
                gathered_j_kg *= kept_share(turn, touching["arm_m"], touching["normal"], size_m)
            moves = gathered_j_kg > _GATHERED * size_m * g
            if moves and load @ (pose[:3] - last[:3]) > 0.0:
                break
            if held > best and rests and not moves:
                if slides == np.inf:
                    between = best, min(held, _MOST_GRAVITIES * g)
                    slides = _slides_m_s2(body, touching, push, between, rolls and most is None)
                if held > _MOST_GRAVITIES * g:
                    return np.inf, slides
                best, gathered_j_kg, peak, prior, rolled = held, 0.0, pose, last, rolls
            last, short = pose, short - 1
            next_m = travel_m if short > 0 else _STEP_SHARE * size_m
            if len(near) == MOST:  # beyond the farthest of them others may land
                next_m = min(next_m, max(0.5 * float(near["gap_m"].max()), _LEAST_STEP_SHARE * size_m))
        tilted = abs(start[3:] @ pose[3:]) < _TIPPED_COSINE
        if tilted or np.linalg.norm(pose[:3] - start[:3]) > size_m:
            break
        # Elsewhere than at rest it goes on under the acceleration that moved it, to where that holds it again.
        held_m_s2 = max(best, min(held, _MOST_GRAVITIES * g)) if rests else best
        force = load + ((1.0 + _BEYOND) * held_m_s2 + _BEYOND * g) * push
        turn = turn_under(touching["arm_m"], touching["normal"], size_m, force)
        if turn is None:  # nothing carries it on
            best = max(best, held) if rests else best
            break
        pivot_m = pose[:3] + turn.arm_m
        turned, travel_m = _turned(body, pose, near, turn, travel_m), next_m
        pose = _closed(body, turned, _near(sim, turned, travel_m))
    return best, slides


def _near(sim: Grounded, pose: Array, travel_m: float) -> np.ndarray:
    """Contacts that a step of some length may reach."""
    bodies = sim.rock, sim.ground, sim.facets
    return sim.trial[: contacts_at(bodies, pose, 2.0 * travel_m, LEANING, sim.lists, sim.trial)].copy()


def _balanced_m_s2(touching: np.ndarray, load: Array, push: Array) -> float:
    """Acceleration under which the line of action passes a contact, seen along the level across the push."""
    across = crossed(push, load)
    return float(
        (-(crossed(touching["arm_m"], load) @ across) / (crossed(touching["arm_m"], push) @ across)).max()
    )


def _slides_m_s2(
    body: GroundedBody, touching: np.ndarray, push: Array, between: tuple[float, float], rolls: bool
) -> float:
    """Least acceleration between two that friction does not hold in a pose; infinite where it holds all.

    rolls: the rock is balanced on smooth contacts, whose moment about the centre of mass is none but in this pose.
    """
    arms = 0.0 * touching["arm_m"] if rolls else touching["arm_m"]
    columns = wrenches(arms, touching["normal"], body.friction[0])
    low, high = between
    enough = high - _SHORT_OF * (high + body.gravity_m_s2)
    if farthest_load(columns, body.load_m_s2(), push, body.size_m, more_than=max(enough, low)) is not None:
        return np.inf
    far = farthest_load(columns, body.load_m_s2(), push, body.size_m)
    return low if far is None else max(far, low)


def _turned(body: GroundedBody, pose: Array, near: np.ndarray, turn: Turn, travel_m: float) -> Array:
    """A pose turned by a step, or by less to where another contact carries."""
    angle = travel_m / body.size_m
    closing = -(crossed(turn.axis, near["arm_m"] - turn.arm_m) * near["normal"]).sum(axis=1)
    lands = (near["gap_m"] >= _TOUCHING_SHARE * body.size_m) & (near["key"] < FIRST_SMOOTH_KEY)
    lands &= closing * angle > near["gap_m"] + _PRESSED_SHARE * body.size_m
    angle = float((near["gap_m"][lands] / closing[lands]).min(initial=angle))
    return _placed(
        pose, turn.arm_m - Rotation.from_rotvec(angle * turn.axis).apply(turn.arm_m), angle * turn.axis
    )


def _closed(body: GroundedBody, pose: Array, near: np.ndarray) -> Array:
    """A turned pose, moved by what turning does beyond its first order: onto the nearest contacts, deep in none.

    Along their normals where they are smooth: a change of the pose that also turned the rock would let it slip.
    """
    if len(near) == 0:
        return pose
    nearest = near[near["gap_m"].argmin()]
    least_m = 0.0 if nearest["key"] < FIRST_SMOOTH_KEY else -_PRESSED_SHARE * body.size_m
    travel_m = np.clip(nearest["gap_m"], least_m, _PRESSED_SHARE * body.size_m)
    normals = near["normal"][near["gap_m"] <= max(nearest["gap_m"], 0.0)].sum(axis=0)
    return _pressed(body, pose, near, -travel_m * normals / max(float(np.linalg.norm(normals)), 1e-9))


def _pressed(body: GroundedBody, pose: Array, near: np.ndarray, travel_m: Array) -> Array:
    """A pose moved along a short way (3,), changed by the least that lets no contact be deep."""
    scale = np.repeat([1.0, math.sqrt(body.inertia_m2.mean())], 3)
    columns = wrenches(near["arm_m"], near["normal"], 0.0) / scale[:, None]
    free = np.append(travel_m, np.zeros(3))
    twist = (free + shortest(columns, -near["gap_m"] - free @ columns)) / scale
    return _placed(pose, twist[:3], twist[3:])


def _placed(pose: Array, moved_m: Array, turned_rad: Array) -> Array:
    turned = Rotation.from_rotvec(turned_rad) * Rotation.from_quat(pose[3:])
    return np.concatenate([pose[:3] + moved_m, turned.as_quat()])
