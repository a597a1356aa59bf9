"""Time stepping of a rock with contacts that have normals of their own, cut where a contact closes.

Moreau's midpoint rule (1988): half a step with the velocity that the rock has; the contacts of that pose give it
another, with which it takes the other half. A contact that would close within the step faster than a preset resolves
cuts it: what is left of the step follows on the impact. So does a slip that begins, ends or reverses within the step.
Angular momentum is kept over a step, so free flight conserves it.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from toppling.models.compiled import Array, Indices, Vector, compiled, inner
from toppling.models.ground.cones import solve_cones
from toppling.models.ground.contacts import (
    CONTACT,
    LEANING,
    MOST,
    SolverRoom,
    Touching,
    contacts_in,
    solver_room,
    velocity_of,
)
from toppling.models.ground.facets import NO_FACETS, Facets, rounded_contacts
from toppling.models.ground.mesh import NO_MESH, ContactMesh
from toppling.models.ground.pairs import RADIUS, Lists, empty_lists, find, latest_pairs, moved_m
from toppling.models.ground.plane import PlanePoints, is_over_plane, plane_contacts
from toppling.models.ground.rigid import (
    copy,
    cross,
    dot,
    invert,
    minus,
    move,
    plus,
    rotation_of,
    spin,
    square,
    times,
    turned,
    velocity_increment_m_s,
)
from toppling.models.ground.rolling import NO_ROLLING, RollingSurface, rolling_contacts

_MOST_IMPACTS = 20
"""Maximum number of impacts in a step; contacts that close later in it are met at its end."""

TOUCHING_SHARE = 2e-6
"""Gap over R up to which a contact carries, and is not closed further."""

_TOUCHING_PLANE_SHARE = 1e-8
"""Such a gap of contacts with the plane, whose normals are equal and whose gaps are exact."""

_NEAR = 20.0
"""Factor on that gap up to which contacts that land and contacts that carry belong to one impact."""

_MARGIN_SHARE = 1e-4
"""Gap over R up to which contacts enter a step, besides those that close at twice their present speed."""

_ENOUGH, _ENOUGH_IN_IMPACT = 2e-6, 1e-9
"""Tolerances on contact velocities, over the speed that gravity gives in a step and over that of an impact."""

_CUT_TOO_EARLY = (1e-6, 1e-6, 1e-4, np.inf)
"""Share of a substep by which a contact may close before its end, in the first and further tries to end it there."""

_SHORTEST_PART = 1e-3
"""Share of a step, of its first part and of its second, which no slip cuts off."""

_RETURNED = 0.2
"""Share of a penetration that a step takes back, by moving the rock without giving it speed."""

_FARTHER = 4.0
"""Factor by which a step that goes farther than it has looked looks farther."""

SECTORS = 16
"""Number of directions in which the loads on a rock at rest lean."""


class Work(NamedTuple):
    """Work arrays of a step, which allocates none."""

    middle: Array  # (7,): pose in the middle of it
    free: Array  # (6,): velocity, at first without contacts
    momentum: Array  # (3,): angular
    shift: Array  # (6,): out of what was penetrated
    turn: Array  # (3, 3)
    inverse: Array  # (3, 3): of the inertia
    spare: Any  # (1,): a contact
    start: Array  # (7,): pose before a step that gathers no speed
    still: Array  # (6,): its velocity
    solver: SolverRoom
    leanings: Array  # (sectors, 2): of loads that are held
    since_s: Array  # (1,): since the rock had the pose in which its latest contacts were found
    reach_m: Array  # (1,): way over which a step looks for contacts, at most


def _work_room() -> Work:
    """Room for one step."""
    return Work(
        np.zeros(7), np.zeros(6), np.zeros(3), np.zeros(6), np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(1, CONTACT),
        np.zeros(7), np.zeros(6), solver_room(MOST), np.zeros((SECTORS, 2)),
        np.zeros(1), np.full(1, np.inf),
    )  # fmt: skip


class Grounded(NamedTuple):
    """A rock on its way through a motion, support frame; poses (7,), velocities (6,) as in the plane's kernel."""

    over: PlanePoints  # where the ground is the plane z = 0
    rolling: RollingSurface  # with which a rounded base touches that plane
    rock: ContactMesh  # body axes; none until the rock comes to where the ground is no plane
    ground: ContactMesh
    facets: Facets  # below a rounded base: then no points and edges of it are in the rock's mesh
    lists: Lists
    contacts: Any  # those of the latest substep, records of CONTACT
    trial: Any
    # (8,): contacts; poses after the first; steps; substeps; those whose impulses do not agree; steps of an engine;
    # those taken at once beyond one; whether the latest contacts are those with the plane
    counts: Indices
    inertia_m2: Array
    size_m: float
    friction: tuple[float, float]
    restitution: float
    resolved_m_s: float
    gravity_m_s2: Array
    excitation: Array  # (samples, 6) of :func:`excitation.excitation`
    sample_s: float
    step_s: float
    at_once: int  # steps, at most: those of a rock that does nothing but roll
    time_s: Array
    pose: Array
    velocity: Array
    work: Work


def unmoved(
    over: PlanePoints, farthest_m: float, inertia_m2: Array, size_m: float, friction: tuple[float, float]
) -> Grounded:
    """A rock over its plane on ground that nothing moves, with room for one pose; the latter and loads are yet none."""
    return Grounded(
        over, NO_ROLLING, NO_MESH, NO_MESH, NO_FACETS, empty_lists(size_m, farthest_m, room=1),
        np.zeros(MOST, CONTACT), np.zeros(MOST, CONTACT), np.zeros(8, np.int64), inertia_m2, size_m, friction,
        0.0, 0.0, np.zeros(3), np.zeros((2, 6)), 1.0, 1.0, 1, np.zeros(1), np.zeros((1, 7)), np.zeros((1, 6)),
        _work_room(),
    )  # fmt: skip


@inner
def step(sim: Grounded, begin_s: float, pose: Array, velocity: Array) -> None:
    """Move by as many steps as are taken at once, cut at impacts."""
    elapsed, step_s = 0.0, _step_s(sim)
    for impact in range(_MOST_IMPACTS + 1):
        left = step_s - elapsed
        if left <= 1e-9 * step_s:
            return
        cut, since = np.inf, begin_s + elapsed
        if impact == 0:
            left *= _share_until_slip_turns(sim, since, left, velocity)
        for early in _CUT_TOO_EARLY:
            increment = velocity_increment_m_s(
                sim.excitation, sim.sample_s, sim.gravity_m_s2, since, since + left
            )
            cut = advance(sim, left, increment, pose, velocity, impact == _MOST_IMPACTS, early)
            left, done = min(cut, left), not 0.0 < cut < left
            if done:
                break
        elapsed += left
        sim.counts[3] += 1
        if cut < np.inf:
            _impact(sim, pose, velocity)


@inner
def _slipped(sim: Grounded, contact: Any) -> bool:
    """Whether the impulse of a contact lies on the cone of kinetic friction."""
    along = dot(contact.impulse, contact.normal)
    limit = sim.friction[1] * along
    off = square(contact.impulse) - along * along - limit * limit
    return limit > 0.0 and abs(off) <= 1e-9 * limit * limit


@inner
def _share_until_slip_turns(sim: Grounded, since_s: float, step_s: float, velocity: Array) -> float:
    """Share of a step after which a rock at rest begins to slip, or friction would drive the slips that it brakes.

    Friction is that of the end of a step: until a slip within it begins or reverses, it would be false.
    """
    none, middle_s, turning = (0.0, 0.0, 0.0), since_s + 0.5 * step_s, sim.work.momentum
    force, moment, pressed, rubs, twists = none, none, none, none, none
    for i in range(sim.counts[0]):
        contact = sim.contacts[i]
        p, n, along = contact.impulse, contact.normal, dot(contact.impulse, contact.normal)
        force, moment = plus(force, 1.0, p), plus(moment, 1.0, cross(contact.arm_m, p))
        pressed = plus(pressed, along, n)
        if _slipped(sim, contact):
            rub = plus(p, -along, n)
            rubs, twists = plus(rubs, 1.0, rub), plus(twists, 1.0, cross(contact.arm_m, rub))
    rests = _fastest_m_s(velocity, (none, sim.size_m)) <= enough_in_step_m_s(sim)
    if not square(pressed) > 0.0 or not (rests or square(rubs) + square(twists) > 0.0):
        return 1.0
    ground = sim.excitation, sim.sample_s, sim.gravity_m_s2
    first = velocity_increment_m_s(*ground, since_s, middle_s)
    second = velocity_increment_m_s(*ground, middle_s, since_s + step_s)
    if rests:
        early, late = _lacks(sim, first, pressed), _lacks(sim, second, pressed)
        before, after = 1.5 * early - 0.5 * late, 1.5 * late - 0.5 * early
    else:
        times(sim.work.inverse, moment, turning)
        before = dot(rubs, velocity) + dot(twists, velocity[3:])
        gained = dot(rubs, force) + dot(twists, turning)
        gained *= 0.5 * step_s / sim.work.since_s[0]
        after = before + gained + dot(rubs, first) + dot(rubs, second)
    part = before / (before - after) if before < 0.0 < after else 1.0
    return part if _SHORTEST_PART < part < 1.0 - _SHORTEST_PART else 1.0


@inner
def _lacks(sim: Grounded, load: Vector, push: Vector) -> float:
    """Force that static friction lacks to hold a load on contacts that push together in a direction."""
    along = -dot(load, push) / math.sqrt(square(push))
    return math.sqrt(max(square(load) - along * along, 0.0)) - sim.friction[0] * along


@inner
def _step_s(sim: Grounded) -> float:
    """Time of the steps that are taken at once."""
    return (1 + sim.counts[6]) * sim.step_s


@inner
def advance(
    sim: Grounded,
    step_s: float,
    increment: Vector,
    pose: Array,
    velocity: Array,
    whole: bool,
    early: float,
) -> float:
    """Move for some time, unless a contact closes sooner: then nothing moves, and that time is returned.

    Infinite where none closes; the time itself where one closes just at its end; 0 where one that has come to touch
    closes at the start.
    """
    middle, free, momentum = sim.work.middle, sim.work.free, sim.work.momentum
    turn, inverse = sim.work.turn, sim.work.inverse
    copy(pose, middle)
    rotation_of(pose, turn)
    spin(turn, sim.inertia_m2, velocity[3:], momentum)
    move(middle, velocity, 0.5 * step_s)
    rotation_of(middle, turn)
    invert(turn, sim.inertia_m2, inverse)
    times(inverse, momentum, free[3:])
    # At the end of the step that momentum is one of another attitude.
    turning = cross(momentum, free[3:])
    for k in range(3):
        free[k] = velocity[k] + increment[k]
        share = inverse[k, 0] * turning[0] + inverse[k, 1] * turning[1] + inverse[k, 2] * turning[2]
        free[3 + k] += 0.5 * step_s * share
    reach_m = step_s * _fastest_of_both_m_s(velocity, free, ((0.0, 0.0, 0.0), sim.lists.farthest_m))
    reach_m = min(reach_m, sim.work.reach_m[0])
    count = _contacts(sim, middle, _margin_m(sim, step_s, reach_m, velocity, free))
    count = _choose(sim, count, step_s, 0.5 * reach_m, velocity, whole)
    if count < 0:
        return 0.0
    drift = _warm(sim, count, step_s, velocity)
    for k in range(3):
        free[k] -= drift[k]
    sim.counts[4] += 0 if solve_cones(touching(sim, count, free, enough_in_step_m_s(sim))) else 1
    for k in range(3):
        free[k] += drift[k]
    closes, lands = np.inf, -1
    if not whole:
        for i in range(count, len(sim.trial)):
            contact = sim.trial[i]
            if contact.lands == 0:
                break
            rate = _rate(contact, free)
            at_end = contact.gap_m + 0.5 * step_s * (rate + 0.25 * step_s * _arc_m_s2(contact, free))
            if at_end < 0.0 and -rate > sim.resolved_m_s:
                before = _rate(contact, velocity)
                soon = max(step_s - _since_closed_s(at_end, rate, before, step_s), 1e-6 * _step_s(sim))
                if soon < closes:
                    closes, lands = soon, i
        if closes < (1.0 - early) * step_s:
            return closes
    for k in range(count):
        sim.contacts[k] = sim.trial[k]
    sim.counts[0], sim.work.since_s[0] = count, 0.5 * step_s
    move(middle, free, 0.5 * step_s)
    copy(middle, pose)
    copy(free, velocity)
    _take_back(sim, count, step_s, pose, velocity)
    return step_s if lands >= 0 else np.inf


@inner
def _since_closed_s(gap_m: float, rate: float, rate_before: float, step_s: float) -> float:
    """How long ago a gap closed that is negative at the end of a step, of rates at its end and its start."""
    more_m_s2 = (rate_before - rate) / step_s
    return -2.0 * gap_m / (math.sqrt(max(rate * rate + 2.0 * more_m_s2 * gap_m, 0.0)) - rate)


@inner
def _choose(sim: Grounded, count: int, step_s: float, reach_m: float, velocity: Array, whole: bool) -> int:
    """Put contacts that may carry in this step first, with their floors; those that may land after them, marked.

    All within reach may carry: what one contact gives the rock may close another. -1 where one has come to touch, and
    still closes.
    """
    touching, chosen = touching_m(sim), 0
    for i in range(count):
        contact = sim.trial[i]
        at_start = contact.gap_m - 0.5 * step_s * _rate(contact, velocity)
        closing = -_rate(contact, sim.work.free)
        carries = whole or at_start <= touching or closing <= sim.resolved_m_s
        near = at_start < _NEAR * TOUCHING_SHARE * sim.size_m
        if near and not whole and (at_start <= touching or not carries):
            k = _place_among_latest(sim, contact)
            was_loaded = k >= 0 and dot(sim.contacts[k].impulse, contact.normal) > 0.0
            known = k >= 0 and (was_loaded or at_start < _NEAR * touching)
            if at_start <= touching and not known and -_rate(contact, velocity) > sim.resolved_m_s:
                return -1
            carries = carries or known
        contact.lands = 0 if carries else 1
        if carries:
            contact.floor_m_s = -2.0 * max(contact.gap_m - touching, 0.0) / step_s
            if contact.gap_m < reach_m + touching:
                if i != chosen:
                    sim.work.spare[0] = sim.trial[chosen]
                    sim.trial[chosen] = sim.trial[i]
                    sim.trial[i] = sim.work.spare[0]
                chosen += 1
    # Those that are neither end the list.
    end = chosen
    for i in range(chosen, count):
        if sim.trial[i].lands == 1:
            if i != end:
                sim.trial[end] = sim.trial[i]
            end += 1
    if end < len(sim.trial):
        sim.trial[end].lands = 0
    return chosen


@inner
def touching_m(sim: Grounded) -> float:
    """Gap up to which the latest contacts touch."""
    return (_TOUCHING_PLANE_SHARE if sim.counts[7] == 1 else TOUCHING_SHARE) * sim.size_m


@inner
def _place_among_latest(sim: Grounded, contact: Any) -> int:
    """Where a contact stands among those of the latest substep, of one key the nearest; -1 where it is none of them."""
    found, least = -1, np.inf
    for k in range(sim.counts[0]):
        if sim.contacts[k].key == contact.key:
            far = square(minus(sim.contacts[k].arm_m, contact.arm_m))
            if far < least:
                found, least = k, far
    return found


@inner
def _warm(sim: Grounded, count: int, step_s: float, velocity: Array) -> Vector:
    """Start from the impulses of the latest substep, as if that had been a whole step, and look half a step ahead.

    The rock has had this velocity since its contacts were found last: what their places have gained in velocity tells
    how these go on turning until the end of the step. There a contact is to have its gap and, if it sticks, to be at
    rest: else a rock hovers, creeps and loses energy in proportion to the step.

    Returns
    -------
    tuple
        Velocity along the ground that a rock which is at rest at its contacts then has now, m/s.
    """
    spin, since_s = (velocity[3], velocity[4], velocity[5]), sim.work.since_s[0] + 0.5 * step_s
    farthest_m, ahead = 2.0 * math.sqrt(square(spin)) * since_s * sim.lists.farthest_m, 0.5 * step_s / since_s
    gained, push, pressed = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0
    for k in range(sim.counts[0]):
        sim.contacts[k].lands = 0
    for i in range(count):
        contact, k = sim.trial[i], _place_among_latest(sim, sim.trial[i])
        if k < 0:
            continue
        last = sim.contacts[k]
        if _slipped(sim, last):
            # Against this and the slip at the end friction is of second order, and turns as smoothly as the slip.
            moves = velocity_of(contact.arm_m, velocity)
            limit = sim.friction[1] * dot(last.impulse, last.normal)
            slip = plus(moves, -dot(moves, contact.normal), contact.normal)
            braked = 0.5 * step_s / sim.work.since_s[0] * limit / max(math.sqrt(square(slip)), 1e-300)
            for axis in range(3):
                contact.slip_m_s[axis] = slip[axis] / (1.0 + braked)
        if last.lands == 0:  # of one key only one goes on with its impulse
            for axis in range(3):
                contact.impulse[axis] = step_s / _step_s(sim) * last.impulse[axis]
            last.lands = 1
        offset = minus(contact.arm_m, last.arm_m)
        if square(offset) > farthest_m * farthest_m:  # farther than it has turned: at once on another place
            continue
        along = dot(contact.impulse, contact.normal)
        rises_m_s = ahead * (_rate(contact, velocity) - _rate(last, velocity))
        off_m = contact.gap_m - touching_m(sim) - 0.25 * step_s * rises_m_s
        # One that carries is not let go by what its gap is off, however short the substep is.
        within_s = _step_s(sim) if along > 0.0 else step_s
        contact.floor_m_s = -max(2.0 * off_m / within_s + rises_m_s, 0.0)
        gained, push = plus(gained, along, cross(spin, offset)), plus(push, along, contact.normal)
        pressed += along
    pushes = square(push)
    if not pushes > 0.0:
        return 0.0, 0.0, 0.0
    gained, share = plus(gained, -dot(gained, push) / pushes, push), -ahead / pressed
    return share * gained[0], share * gained[1], share * gained[2]


@inner
def _impact(sim: Grounded, pose: Array, velocity: Array) -> None:
    """Change the velocity at once by the contacts that touch in a pose.

    By what would bring it to rest there, and restitution times that again: no impact adds energy, whatever its contacts
    (Fremond 1995; Moreau 1988, with one coefficient along normals and tangents).
    """
    rotation_of(pose, sim.work.turn)
    invert(sim.work.turn, sim.inertia_m2, sim.work.inverse)
    on_plane, near_m = sim.counts[7] == 1, _NEAR * TOUCHING_SHARE * sim.size_m
    # The cut before it may miss the moment at which a contact closes by what arcs differ from lines.
    near_m += 0.0 if on_plane else 0.5 * square(velocity[3:]) * _step_s(sim) ** 2 * sim.size_m
    found, count = _contacts(sim, pose, near_m), 0
    for i in range(found):
        contact = sim.trial[i]
        known = contact.gap_m < _NEAR * touching_m(sim) or _place_among_latest(sim, contact) >= 0
        if known or not on_plane:
            if i != count:
                sim.trial[count] = sim.trial[i]
            count += 1
    enough_m_s = _ENOUGH_IN_IMPACT * _fastest_m_s(velocity, ((0.0, 0.0, 0.0), sim.size_m))
    sim.counts[4] += 0 if solve_cones(touching(sim, count, velocity, enough_m_s)) else 1
    for k in range(6):
        velocity[k] += sim.restitution * (velocity[k] - sim.work.solver.free[k])
    sim.counts[0], sim.work.since_s[0] = count, 0.0
    for i in range(count):
        sim.contacts[i] = sim.trial[i]
        sim.contacts[i].impulse[0] = sim.contacts[i].impulse[1] = sim.contacts[i].impulse[2] = 0.0


@inner
def touching(sim: Grounded, count: int, velocity: Array, enough_m_s: float) -> Touching:
    """The first contacts, and the velocity that they are to change."""
    return Touching(sim.trial, count, sim.friction, sim.work.inverse, velocity, enough_m_s, sim.work.solver)


@inner
def enough_in_step_m_s(sim: Grounded) -> float:
    """Velocity of a contact that is let go in a step."""
    return _ENOUGH * math.sqrt(square(sim.gravity_m_s2)) * _step_s(sim)


@inner
def _margin_m(sim: Grounded, step_s: float, reach_m: float, velocity: Array, free: Array) -> float:
    """Gap up to which contacts are looked at in the pose of the middle of a step."""
    near_m = _MARGIN_SHARE * sim.size_m
    margin = near_m + reach_m
    if _is_over_plane(sim, sim.work.middle, margin):
        return margin
    if len(sim.facets.apart_m) > 0:
        return margin
    find(sim.rock, sim.ground, sim.work.middle, margin, sim.lists)
    pairs = latest_pairs(sim.lists)
    ball = turned(sim.work.turn, pairs.middle_m[0]), pairs.lengths_m[RADIUS]
    return min(margin, near_m + step_s * _fastest_of_both_m_s(velocity, free, ball))


@inner
def _is_over_plane(sim: Grounded, pose: Array, margin_m: float) -> bool:
    """Whether the plane tells all contacts of a pose, whose rotation is known; it does while there is no mesh."""
    return len(sim.rock.faces) == 0 or is_over_plane(
        sim.over, pose, sim.work.turn, sim.lists.farthest_m, margin_m
    )


@inner
def leaves_plane(sim: Grounded) -> bool:
    """Whether the latest pose is one of which only the meshes tell the contacts."""
    pose, velocity = sim.pose[sim.counts[1]], sim.velocity[sim.counts[1]]
    rotation_of(pose, sim.work.turn)
    whole = (0.0, 0.0, 0.0), sim.lists.farthest_m
    margin_m = _MARGIN_SHARE * sim.size_m + sim.step_s * _fastest_m_s(velocity, whole)
    return not is_over_plane(sim.over, pose, sim.work.turn, sim.lists.farthest_m, margin_m)


@inner
def _fastest_of_both_m_s(velocity: Array, free: Array, ball: tuple[Vector, float]) -> float:
    return max(_fastest_m_s(velocity, ball), _fastest_m_s(free, ball))


@inner
def _fastest_m_s(velocity: Array, ball: tuple[Vector, float]) -> float:
    """Speed of the fastest point in a ball at an arm from the centre of mass, at most."""
    arm_m, radius_m = ball
    spin = (velocity[3], velocity[4], velocity[5])
    middle = plus(velocity, 1.0, cross(spin, arm_m))
    return math.sqrt(square(middle)) + math.sqrt(square(spin)) * radius_m


@inner
def _take_back(sim: Grounded, count: int, step_s: float, pose: Array, velocity: Array) -> None:
    """Move the rock out of what it has penetrated, by a share, without giving it speed."""
    deepest = 0.0
    for i in range(count):
        contact = sim.contacts[i]
        gap = contact.gap_m + 0.5 * step_s * _rate(contact, velocity)
        contact.floor_m_s = max(-gap, 0.0) * _RETURNED
        deepest = max(deepest, -gap)
    if deepest <= 0.1 * TOUCHING_SHARE * sim.size_m:
        return
    shift, inverse = sim.work.shift, sim.work.inverse
    for k in range(6):
        shift[k] = 0.0
    for _ in range(8):
        for i in range(count):
            contact = sim.contacts[i]
            missing = contact.floor_m_s - _rate(contact, shift)
            if missing <= 0.0:
                continue
            n, r = contact.normal, contact.arm_m
            arm = cross(r, n)
            mobility = 1.0
            for a in range(3):
                for b in range(3):
                    mobility += arm[a] * inverse[a, b] * arm[b]
            push = missing / mobility
            for k in range(3):
                shift[k] += push * n[k]
                shift[3 + k] += push * (
                    inverse[k, 0] * arm[0] + inverse[k, 1] * arm[1] + inverse[k, 2] * arm[2]
                )
    move(pose, shift, 1.0)


@compiled
def settle(sim: Grounded, force_m_s2: Array, sweeps: int, stop_m: float) -> float:
    """Let the rock down from its latest pose without gathering speed; way of its last step, m.

    Every step starts at rest under a constant specific force; the way is that of the point that moved most. It looks
    for contacts over the way that the rock then goes, which is a small part of a free fall in that time.
    """
    pose, before, velocity, travel_m = sim.pose[sim.counts[1]], sim.work.start, sim.work.still, np.inf
    step_s, reach_m, least_m = sim.step_s, sim.work.reach_m, _MARGIN_SHARE * sim.size_m
    reach_m[0] = least_m
    for _ in range(sweeps):
        copy(pose, before)
        while True:
            for k in range(6):
                velocity[k] = 0.0
            increment = (force_m_s2[0] * step_s, force_m_s2[1] * step_s, force_m_s2[2] * step_s)
            advance(sim, step_s, increment, pose, velocity, True, np.inf)
            travel_m = moved_m(before, pose, sim.lists.farthest_m)
            if not 2.0 * travel_m > reach_m[0]:
                break
            copy(before, pose)
            reach_m[0] *= _FARTHER
        reach_m[0] = max(_FARTHER * travel_m, least_m)
        if travel_m < stop_m:
            break
    reach_m[0] = np.inf
    return travel_m


@compiled
def contacts_at(bodies: Any, pose: Array, margin_m: float, leaning: float, lists: Lists, out: Any) -> int:
    """Contacts on the ground's own surface in a pose (7,), as of :func:`contacts.contacts_in`; how many."""
    rock, ground, facets = bodies
    find(rock, ground, pose, margin_m, lists)
    pairs = latest_pairs(lists)
    count = contacts_in(rock, ground, pairs, pose, margin_m, leaning, out)
    if len(facets.apart_m) > 0:
        count = rounded_contacts(facets, ground, pose, margin_m, pairs.turn, out, count)
    return count


@inner
def _contacts(sim: Grounded, pose: Array, margin: float) -> int:
    """Find the contacts with gaps up to a margin in a pose; how many."""
    sim.counts[7] = 1
    if _is_over_plane(sim, pose, margin):
        if len(sim.rolling.corners) > 0:
            return rolling_contacts(sim.rolling, pose, margin, sim.work.turn, sim.trial)
        lengths_m = sim.size_m, sim.lists.farthest_m
        return plane_contacts(sim.over, pose, sim.work.turn, lengths_m, margin, sim.trial)
    sim.counts[7] = 0
    bodies = sim.rock, sim.ground, sim.facets
    return contacts_at(bodies, pose, margin, LEANING, sim.lists, sim.trial)


@inner
def _arc_m_s2(contact: Any, velocity: Array) -> float:
    """Acceleration of a contact's gap because the rock turns, with no acceleration of its centre of mass."""
    spin = (velocity[3], velocity[4], velocity[5])
    return dot(contact.normal, cross(spin, cross(spin, contact.arm_m)))


@inner
def _rate(contact: Any, velocity: Array) -> float:
    """Rate of a contact's gap at a velocity (6,)."""
    n, r = contact.normal, contact.arm_m
    return (
        n[0] * (velocity[0] + velocity[4] * r[2] - velocity[5] * r[1])
        + n[1] * (velocity[1] + velocity[5] * r[0] - velocity[3] * r[2])
        + n[2] * (velocity[2] + velocity[3] * r[1] - velocity[4] * r[0])
    )
