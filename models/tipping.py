"""Statics of a rock on a surface, followed from pose to pose along the path on which a growing acceleration tips it.

In each pose the contacts tell up to which acceleration the rock stays without slip (:mod:`toppling.models.pivots`), and
which their friction cones hold (:mod:`toppling.models.ground.equilibrium`). Beyond the former it turns by small steps
about the axis that gains most energy, on one smooth contact along its equilibria.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

from toppling.models.caching import cached
from toppling.models.compiled import Array
from toppling.models.errors import InputError
from toppling.models.frames import horizontal_unit_vector
from toppling.models.ground.body import GroundedBody
from toppling.models.ground.contacts import LEANING, MOST
from toppling.models.ground.equilibrium import farthest_load, shortest, wrenches
from toppling.models.ground.rolling import FIRST_KEY as FIRST_SMOOTH_KEY
from toppling.models.ground.stepping import Grounded, contacts_at
from toppling.models.pivots import Turn, carried_on, crossed, tips_m_s2, turn_under
from toppling.models.statics import STEEP, TOPPLED_TILT_DEG, Limits

_STEP_SHARE = 0.008
"""Length of a step along the path, as a fraction of the half diagonal R."""

_LEAST_STEP_SHARE = 2e-4
"""Shortest step, as a fraction of R, towards the peak of a rolling rock."""

_TOUCHING_SHARES = (1e-6, 1e-5, 1e-4)
"""Gap up to which a contact carries, as a fraction of R: the least with which a path ends. On a fine rough base what a
step has hardly left lands again and again, unless it counts as touching."""

_PRESSED_SHARE = 1e-5
"""Length of the step that closes the gaps opened by a rotation, or left of a rock that was let down, over R."""

_TIPPED_COSINE = math.cos(math.radians(0.5 * TOPPLED_TILT_DEG))  # of half the largest tilt of the path

_GATHERED = 3e-3
"""Energy per mass over g R up to which a rock on smooth contacts counts as at rest, and none as fallen: it gathers so
much over the unevenness of its base, or in a fall of 4 degrees about an edge."""

_BEYOND = 0.01
"""Share by which the acceleration that moves the rock on, and a hundredth of g, exceed the largest at rest."""

_SHORT_OF = 1e-3
"""Share of the acceleration in a pose at whose border friction is not asked: contacts are known to some micrometres."""

_ROLLED_RAD, _BALANCED_RAD, _MOST_CORRECTIONS = 1e-3, 1e-4, 3
"""Angle by which a rock on one smooth contact is rolled to see how its balance changes; from its equilibrium, of one
that is in it; and rotations, at most, by which it gets there."""

_ROUNDING = 1e-12  # acceleration over g
_MOST_GRAVITIES = 30.0  # acceleration, over g, beyond which a pose supports any
_MOST_STEPS = 1200  # of a path


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

    Raises InputError if the path does not end.
    """
    for touching_share in _TOUCHING_SHARES:
        if (found := _path(body, azimuth_deg, touching_share)) is not None:
            return found
    raise InputError(
        "scene.statics_unfinished",
        f"the rock rocks over more than {_MOST_STEPS} contacts where the ground accelerates toward {azimuth_deg:g}",
        where="statics",
        expected="meshes of rock and ground on which its way to toppling can be followed",
        remedy="simplify the meshes",
    )


def _path(body: GroundedBody, azimuth_deg: float, touching_share: float) -> tuple[float, float] | None:
    """The same with one tolerance of gaps; None if the path does not end.

    Where a pose supports less than the best so far, the rock gathers energy, and turns on as it did; contacts that land
    take of it. The path ends beyond the largest tilt, or where what stands beside the rock catches it.
    """
    size_m, g, load = body.size_m, body.gravity_m_s2, body.load_m_s2()
    push = -horizontal_unit_vector(azimuth_deg) @ body.scene_from_support
    sim, start = body.clockless(body.resting_pose, 1.0), body.resting_pose
    best, held, gathered_j_kg, slides, short, travel_m = 0.0, 0.0, 0.0, np.inf, 0, 0.25 * _STEP_SHARE * size_m
    pose = _pressed(body, start, _near(sim, start, travel_m), load * (_PRESSED_SHARE * size_m / g))
    last = peak = prior = pose
    turn, turns_on, pivot_m, corrections, rolled, moves, fell = None, None, pose[:3], 0, False, False, False
    for _ in range(_MOST_STEPS):
        near = _near(sim, pose, travel_m)
        touching = near[near["gap_m"] < touching_share * size_m]
        rolls = len(touching) > 0 and touching["key"].min() >= FIRST_SMOOTH_KEY
        off_rad = np.inf
        if rolls and len(touching) == 1:
            onward, back, off_rad = _rolled_on(sim, pose, touching, push, turn)
            if _BALANCED_RAD < off_rad < _STEP_SHARE and corrections < _MOST_CORRECTIONS:
                corrections += 1
                pose = _closed(body, sim, _about(pose, back, off_rad), travel_m)
                continue
        corrections = 0
        most = tips_m_s2(touching["arm_m"], touching["normal"], size_m, load, push)
        if len(touching):
            held = _balanced_m_s2(touching, load, push) if most is None else most
        rests = rolls or most is not None
        beyond = abs(start[3:] @ pose[3:]) < _TIPPED_COSINE or np.linalg.norm(pose[:3] - start[:3]) > size_m
        lost = rolled and last is peak and pose is not peak and (held < best or beyond)
        if lost and travel_m > _LEAST_STEP_SHARE * size_m:
            # The largest lies between the pose before and this one: go back, and take shorter steps between them.
            pose = last = prior
            near, short = _near(sim, pose, travel_m), 8
            travel_m = next_m = 0.25 * travel_m
            touching = near[near["gap_m"] < touching_share * size_m]
            if len(touching) == 1:
                onward, _, off_rad = _rolled_on(sim, pose, touching, push, turn)
        else:
            if beyond:
                break
            gathered_j_kg = max(gathered_j_kg + float((load + best * push) @ (pose[:3] - last[:3])), 0.0)
            if turn is not None:
                turn = Turn(pivot_m - pose[:3], turn.axis)
                axes = Rotation.from_quat(pose[3:]).as_matrix()
                inertia_m2 = axes * body.inertia_m2 @ axes.T
                turns_on, kept = carried_on(turn, touching["arm_m"], touching["normal"], inertia_m2, size_m)
                gathered_j_kg *= kept
            much = gathered_j_kg > _GATHERED * size_m * g
            fell = fell or (much and float(load @ (pose[:3] - last[:3])) > 0.0)
            moves = much
            if not rolls:
                apart = near[near["gap_m"] >= touching_share * size_m]
                moves = turns_on is not None and gathered_j_kg > _climb(turns_on, load + best * push, apart)
            if held > best + _ROUNDING * g and rests and not moves:
                if fell and not _stands_on_what_is_below(body, touching, push):
                    break
                if slides == np.inf:
                    between = best, min(held, _MOST_GRAVITIES * g)
                    slides = _slides_m_s2(body, touching, push, between, rolls and most is None)
                if held > _MOST_GRAVITIES * g:
                    return np.inf, slides
                best, gathered_j_kg, fell, peak, prior, rolled = held, 0.0, False, pose, last, rolls
            last, short = pose, short - 1
            next_m = _next_travel_m(near, travel_m if short > 0 else _STEP_SHARE * size_m, size_m)
        # Elsewhere than at rest it goes on under the acceleration that moved it, to where that holds it again.
        held_m_s2 = max(best, min(held, _MOST_GRAVITIES * g)) if rests else best
        force = load + ((1.0 + _BEYOND) * held_m_s2 + _BEYOND * g) * push
        turn = turns_on if moves else turn_under(touching["arm_m"], touching["normal"], size_m, force)
        turn = onward if off_rad < _STEP_SHARE else turn
        if turn is None:  # nothing carries it on
            best = max(best, held) if rests else best
            break
        pivot_m = pose[:3] + turn.arm_m
        apart = near[near["gap_m"] >= touching_share * size_m]
        pose, travel_m = _closed(body, sim, _turned(body, pose, apart, turn, travel_m), next_m), next_m
    else:
        return None
    return best, slides


def _climb(turn: Turn, force: Array, apart: np.ndarray) -> float:
    """Energy per mass up to a rotation's balance, or to where a contact lands; infinite where the force turns it."""
    com = -turn.arm_m + (turn.arm_m @ turn.axis) * turn.axis
    side = crossed(turn.axis, com)
    along, ahead = float(com @ force), float(side @ force)
    to_balance = math.atan2(-ahead, -along)
    if to_balance <= 0.0:
        return np.inf
    closing = -(crossed(turn.axis, apart["arm_m"] - turn.arm_m) * apart["normal"]).sum(axis=1)
    lands = closing * to_balance > apart["gap_m"]
    angle = float((apart["gap_m"][lands] / closing[lands]).min(initial=to_balance))
    return along * (1.0 - math.cos(angle)) - ahead * math.sin(angle)


def _stands_on_what_is_below(body: GroundedBody, touching: np.ndarray, push: Array) -> bool:
    """Whether contacts that are not steep carry a rock without the others."""
    low = touching[touching["normal"] @ body.scene_from_support[2] > STEEP]
    return tips_m_s2(low["arm_m"], low["normal"], body.size_m, body.load_m_s2(), push) is not None


def _near(sim: Grounded, pose: Array, travel_m: float) -> np.ndarray:
    """Contacts that a step of some length may reach."""
    bodies = sim.rock, sim.ground, sim.facets
    return sim.trial[: contacts_at(bodies, pose, 2.0 * travel_m, LEANING, sim.lists, sim.trial)].copy()


def _next_travel_m(near: np.ndarray, travel_m: float, size_m: float) -> float:
    """Length of the next step: beyond the farthest of as many contacts as there is room for others may land."""
    if len(near) < MOST:
        return travel_m
    return min(travel_m, max(0.5 * float(near["gap_m"].max()), _LEAST_STEP_SHARE * size_m))


def _balanced_m_s2(touching: np.ndarray, load: Array, push: Array) -> float:
    """Acceleration under which the line of action passes a contact, seen along the level across the push."""
    across, arms_m = crossed(push, load), touching["arm_m"]
    return float((-(arms_m @ crossed(load, across)) / (arms_m @ crossed(push, across))).max())


def _rolled_on(
    sim: Grounded, pose: Array, contact: np.ndarray, push: Array, turn: Turn | None
) -> tuple[Turn, Turn, float]:
    """The rotations along the equilibria of a rock on one smooth contact and back to them, and how far back, rad.

    It is in equilibrium where the line of action passes the contact also seen along the push. How far it misses
    changes as the rock rolls about two axes.
    """
    load, arm, normal = sim.gravity_m_s2, contact["arm_m"][0], contact["normal"][0]
    across = crossed(push, load)
    axes = np.array([across, crossed(normal, across)])
    axes -= (axes @ normal)[:, None] * normal
    axes /= np.linalg.norm(axes, axis=1)[:, None]

    def missed(near: np.ndarray) -> float:
        force = load + _balanced_m_s2(near, load, push) * push
        return float(crossed(near["arm_m"][0], force) @ axes[1])

    now, changes = missed(contact), np.zeros(2)
    for k, axis in enumerate(axes):
        near = _near(sim, _about(pose, Turn(arm, axis), _ROLLED_RAD), _STEP_SHARE * sim.size_m)
        near = near[near["key"] == contact["key"][0]]
        changes[k] = (missed(near) - now) / _ROLLED_RAD if len(near) else 0.0
    square = max(float(changes @ changes), 1e-300)
    along = np.array([changes[1], -changes[0]]) / math.sqrt(square)
    if (axes[0] if turn is None else turn.axis) @ (along @ axes) < 0.0:
        along = -along
    back = -now * changes / square @ axes
    return Turn(arm, along @ axes), Turn(arm, back / max(off := float(np.linalg.norm(back)), 1e-300)), off


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


def _turned(body: GroundedBody, pose: Array, apart: np.ndarray, turn: Turn, travel_m: float) -> Array:
    """A pose turned by a step, or by less to where one of the contacts that are apart carries."""
    angle = travel_m / body.size_m
    closing = -(crossed(turn.axis, apart["arm_m"] - turn.arm_m) * apart["normal"]).sum(axis=1)
    lands = closing * angle > apart["gap_m"] + _PRESSED_SHARE * body.size_m
    lands &= apart["key"] < FIRST_SMOOTH_KEY
    angle = float((apart["gap_m"][lands] / closing[lands]).min(initial=angle))
    return _about(pose, turn, angle)


def _closed(body: GroundedBody, sim: Grounded, pose: Array, travel_m: float) -> Array:
    """A turned pose, moved by what turning does beyond its first order: onto the nearest contacts, deep in none.

    Along their normals where they are smooth: a change of the pose that also turned the rock would let it slip.
    """
    near = _near(sim, pose, travel_m)
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
    columns = np.hstack([near["normal"], crossed(near["arm_m"], near["normal"])]).T / scale[:, None]
    free = np.append(travel_m, np.zeros(3))
    twist = (free + shortest(columns, -near["gap_m"] - free @ columns)) / scale
    return _placed(pose, twist[:3], twist[3:])


def _about(pose: Array, turn: Turn, angle_rad: float) -> Array:
    """A pose turned by an angle."""
    aside = crossed(turn.axis, turn.arm_m)
    arm_m = math.sin(angle_rad) * aside + (1.0 - math.cos(angle_rad)) * crossed(turn.axis, aside)
    return _placed(pose, -arm_m, angle_rad * turn.axis)


def _placed(pose: Array, moved_m: Array, turned_rad: Array) -> Array:
    half = 0.5 * float(np.linalg.norm(turned_rad))
    x, y, z = 0.5 * np.sinc(half / np.pi) * turned_rad
    (a, b, c, d), w = pose[3:], math.cos(half)
    attitude = (
        w * a + d * x + y * c - z * b, w * b + d * y + z * a - x * c,
        w * c + d * z + x * b - y * a, w * d - x * a - y * b - z * c,
    )  # fmt: skip
    return np.concatenate([pose[:3] + moved_m, attitude])
