"""Time stepping of a rock with contacts that have normals of their own, cut where a contact closes.

Moreau's midpoint rule (1988): half a step with the velocity that the rock has; the contacts of that pose give it
another, with which it takes the other half. A contact that would close within the step faster than a preset resolves
cuts it: what is left of the step follows on the impact. Angular momentum is kept over a step, so free flight
conserves it.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from toppling.models.compiled import Array, Indices, Vector, compiled, inner
from toppling.models.ground.cones import solve_cones
from toppling.models.ground.contacts import LEANING, Pairs, contacts_in, moved_m, refresh, rotation_of
from toppling.models.ground.excitation import velocity_increment_m_s
from toppling.models.ground.mesh import ContactMesh

MOST_IMPACTS = 20
"""In a step; contacts that close later in it are met at its end."""

TOUCHING_SHARE = 2e-6
"""Of R: a contact so near carries."""

MARGIN_SHARE = 0.01
"""Of R: contacts so near are looked at in a step, and as many more as the rock may move in it."""

SLACK_SHARE = 0.05
"""Of R: way of the rock over which the features that may touch are kept."""

ENOUGH = 2e-6
"""Over the speed that gravity gives in a step: changes of impulses that are let go."""

CUT_TOO_EARLY = (1e-6, 1e-3, np.inf)
"""Share of a substep by which a contact may close before its end, in the first and further tries to end it there."""

TIPPED_RAD = 0.8
"""A rock that tips slowly is followed so far."""

TIPPING_SHARE = 0.004
"""Of R: way of one of its steps."""

PASSED = 0.9
"""Share of the largest acceleration that was held, below which it is past it."""

FOLLOWED_SHARE = 0.1
"""Of R: way on which it is followed past the largest."""

MOST_POSES = 300

RETURNED = 0.2
"""Share of a penetration that a step takes back, by moving the rock without giving it speed."""


class Grounded(NamedTuple):
    """A rock on its way through a motion, support frame; poses (7,), velocities (6,) as in the plane's kernel."""

    rock: ContactMesh  # body axes
    ground: ContactMesh
    pairs: Pairs
    contacts: Any  # those of the latest substep, records of CONTACT
    trial: Any
    counts: Indices  # contacts; poses after the first; steps; substeps; sweeps; steps of an engine
    inertia_m2: Array
    size_m: float
    farthest_m: float  # from the centre of mass
    friction: tuple[float, float]
    restitution: float
    resolved_m_s: float
    gravity_m_s2: Array
    excitation: Array  # (samples, 6) of :func:`excitation.excitation`
    sample_s: float
    step_s: float
    time_s: Array
    pose: Array
    velocity: Array


@compiled(allocates=True)
def take_steps(sim: Grounded, steps: int) -> None:
    """Go on by so many steps; the trajectory's arrays have room."""
    for _ in range(steps):
        last = sim.counts[1]
        sim.pose[last + 1], sim.velocity[last + 1] = sim.pose[last], sim.velocity[last]
        begin = sim.counts[2] * sim.step_s
        _step(sim, begin, sim.pose[last + 1], sim.velocity[last + 1])
        sim.counts[1], sim.counts[2] = last + 1, sim.counts[2] + 1
        sim.time_s[last + 1] = sim.counts[2] * sim.step_s


@compiled
def settle(sim: Grounded, force_m_s2: Array, sweeps: int, stop_m: float) -> float:
    """Let the rock down from its latest pose without gathering speed; way of its last step, m.

    Every step starts at rest under a constant specific force.
    """
    pose, way = sim.pose[sim.counts[1]], np.inf
    step_s = sim.step_s
    for _ in range(sweeps):
        way = _crept_m(
            sim, pose, (force_m_s2[0] * step_s, force_m_s2[1] * step_s, force_m_s2[2] * step_s), step_s
        )
        if way < stop_m:
            break
    return way


@compiled(allocates=True)
def largest_held_m_s2(sim: Grounded, push: Array, most_m_s2: float) -> float:
    """Largest constant acceleration of the ground, against a unit push (3,), that a rock at rest stands.

    In its first pose, or in one that it tips into from there without gathering speed: until it has tilted so far, or
    stands so much less, that nothing larger follows. Infinite from `most_m_s2` on.
    """
    pose, start = sim.pose[0].copy(), sim.pose[0].copy()
    still = 1e-4 * math.sqrt(_square(sim.gravity_m_s2))
    peak, trial = pose.copy(), pose.copy()
    best, here = 0.0, 0.05 * most_m_s2
    least_cosine = math.cos(0.5 * TIPPED_RAD)
    for _ in range(MOST_POSES):
        low, high = 0.0, here
        while _gives_way(sim, pose, push, high) < still:
            low, high = high, 1.5 * high
            if low > most_m_s2:
                return np.inf
        while high - low > 2e-4 * max(best, high):
            middle = 0.5 * (low + high)
            if _gives_way(sim, pose, push, middle) < still:
                low = middle
            else:
                high = middle
        if low > best:
            best, peak[:] = low, pose
        here = max(low, 0.02 * best)
        if low < PASSED * best and moved_m(peak, pose, sim.farthest_m) > FOLLOWED_SHARE * sim.size_m:
            return best
        pushed = 1.02 * max(low, best) + 500.0 * still
        way, step_s = 0.0, sim.step_s
        for _ in range(20):
            trial[:] = pose
            way = _crept_m(sim, trial, _load(sim, push, pushed, step_s), step_s)
            if way > 2.0 * TIPPING_SHARE * sim.size_m:
                step_s *= 0.5
            elif way < 0.5 * TIPPING_SHARE * sim.size_m and step_s < 200.0 * sim.step_s:
                step_s *= 1.5
            else:
                break
        pose[:] = trial
        for _ in range(4):
            _crept_m(sim, pose, _load(sim, push, pushed, sim.step_s), sim.step_s)
        cosine = abs(start[3] * pose[3] + start[4] * pose[4] + start[5] * pose[5] + start[6] * pose[6])
        if cosine < least_cosine or moved_m(start, pose, 0.0) > sim.size_m:
            break
    return best


@inner
def _load(sim: Grounded, push: Array, acceleration: float, time_s: float) -> Vector:
    """What gravity, and an acceleration along a push, add to a velocity in some time."""
    g = sim.gravity_m_s2
    return (
        time_s * (g[0] + acceleration * push[0]),
        time_s * (g[1] + acceleration * push[1]),
        time_s * (g[2] + acceleration * push[2]),
    )


@inner(allocates=True)
def _gives_way(sim: Grounded, pose: Array, push: Array, acceleration: float) -> float:
    """Acceleration along a push with which the centre of mass leaves a pose at rest, m/s2."""
    there, velocity = pose.copy(), np.zeros(6)
    _advance(sim, sim.step_s, _load(sim, push, acceleration, sim.step_s), there, velocity, True, np.inf)
    return (velocity[0] * push[0] + velocity[1] * push[1] + velocity[2] * push[2]) / sim.step_s


@inner(allocates=True)
def _crept_m(sim: Grounded, pose: Array, increment: Vector, step_s: float) -> float:
    """Move from rest for one step; the way of the point that moved most."""
    before, velocity = pose.copy(), np.zeros(6)
    _advance(sim, step_s, increment, pose, velocity, True, np.inf)
    return moved_m(before, pose, sim.farthest_m)


@inner
def _step(sim: Grounded, begin_s: float, pose: Array, velocity: Array) -> None:
    """One step, cut at its impacts."""
    gone = 0.0
    for impact in range(MOST_IMPACTS + 1):
        left = sim.step_s - gone
        if left <= 1e-9 * sim.step_s:
            return
        cut = np.inf
        for early in CUT_TOO_EARLY:
            since = begin_s + gone
            increment = velocity_increment_m_s(
                sim.excitation, sim.sample_s, sim.gravity_m_s2, since, since + left
            )
            cut = _advance(sim, left, increment, pose, velocity, impact == MOST_IMPACTS, early)
            if cut >= left:
                break
            left = cut
        gone += left
        sim.counts[3] += 1
        if cut < np.inf:
            _impact(sim, pose, velocity)


@inner(allocates=True)
def _advance(
    sim: Grounded,
    step_s: float,
    increment: Vector,
    pose: Array,
    velocity: Array,
    whole: bool,
    early: float,
) -> float:
    """Move for some time, unless a contact closes sooner: then nothing moves, and that time is returned.

    Infinite where none closes; the time itself where one closes just at its end.
    """
    middle, turn, inverse = pose.copy(), np.empty((3, 3)), np.empty((3, 3))
    momentum, free = np.empty(3), np.empty(6)
    rotation_of(pose, turn)
    _spin(turn, sim.inertia_m2, velocity[3:], momentum)
    _move(middle, velocity, 0.5 * step_s)
    rotation_of(middle, turn)
    _invert(turn, sim.inertia_m2, inverse)
    for k in range(3):
        free[k] = velocity[k] + increment[k]
        free[3 + k] = inverse[k, 0] * momentum[0] + inverse[k, 1] * momentum[1] + inverse[k, 2] * momentum[2]
    far = moved_m(pose, middle, sim.farthest_m)
    margin = MARGIN_SHARE * sim.size_m + 2.0 * far
    _look(sim, middle, margin)
    count = contacts_in(sim.rock, sim.ground, sim.pairs, middle, margin, LEANING, sim.trial)
    count = _choose(sim, count, step_s, velocity, free, whole)
    _warm(sim, count, step_s)
    sim.counts[4] += solve_cones(sim.trial, count, sim.friction, inverse, free, _enough_m_s(sim))
    closes, lands = np.inf, -1
    if not whole:
        for i in range(count, len(sim.trial)):
            one = sim.trial[i]
            if one.lands == 0:
                break
            rate = _rate(one, free)
            at_end = one.gap_m + 0.5 * step_s * rate
            if at_end < 0.0 and -rate > sim.resolved_m_s:
                soon = max(step_s + at_end / -rate, 1e-6 * sim.step_s)
                if soon < closes:
                    closes, lands = soon, i
        if closes < (1.0 - early) * step_s:
            return closes
    for k in range(count):
        sim.contacts[k] = sim.trial[k]
    sim.counts[0] = count
    _move(middle, free, 0.5 * step_s)
    pose[:], velocity[:] = middle, free
    _take_back(sim, count, step_s, inverse, pose, velocity)
    return step_s if lands >= 0 else np.inf


@inner(allocates=True)
def _choose(sim: Grounded, count: int, step_s: float, velocity: Array, free: Array, whole: bool) -> int:
    """Put contacts that carry in this step first, with their floors; those that may land after them, marked."""
    touching, chosen = TOUCHING_SHARE * sim.size_m, 0
    for i in range(count):
        one = sim.trial[i]
        rate = _rate(one, velocity)
        at_start = one.gap_m - 0.5 * step_s * rate
        closing = -_rate(one, free)
        carries = whole or at_start <= touching or closing <= sim.resolved_m_s
        if not carries and _was_active(sim, one.key) and at_start < 20.0 * touching:
            carries = True
        one.lands = 0 if carries else 1
        if carries:
            one.floor_m_s = -2.0 * max(one.gap_m, 0.0) / step_s
            if one.gap_m < 0.5 * step_s * max(closing, 0.0) + touching:
                if i != chosen:
                    kept = sim.trial[chosen : chosen + 1].copy()
                    sim.trial[chosen] = sim.trial[i]
                    sim.trial[i] = kept[0]
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
def _was_active(sim: Grounded, key: int) -> bool:
    known = False
    for k in range(sim.counts[0]):
        known = known or sim.contacts[k].key == key
    return known


@inner
def _warm(sim: Grounded, count: int, step_s: float) -> None:
    """Start from the impulses of the latest substep, as if that had been a whole step."""
    for i in range(count):
        one = sim.trial[i]
        for k in range(sim.counts[0]):
            if sim.contacts[k].key == one.key:
                share = step_s / sim.step_s
                for axis in range(3):
                    one.impulse[axis] = share * sim.contacts[k].impulse[axis]


@inner(allocates=True)
def _impact(sim: Grounded, pose: Array, velocity: Array) -> None:
    """Change the velocity at once by the contacts that touch in a pose."""
    turn, inverse = np.empty((3, 3)), np.empty((3, 3))
    rotation_of(pose, turn)
    _invert(turn, sim.inertia_m2, inverse)
    margin = 20.0 * TOUCHING_SHARE * sim.size_m
    _look(sim, pose, margin)
    count = contacts_in(sim.rock, sim.ground, sim.pairs, pose, margin, LEANING, sim.trial)
    for i in range(count):
        closing = -_rate(sim.trial[i], velocity)
        sim.trial[i].floor_m_s = sim.restitution * closing if closing > sim.resolved_m_s else 0.0
    sim.counts[4] += solve_cones(sim.trial, count, sim.friction, inverse, velocity, _enough_m_s(sim))
    sim.counts[0] = count
    for i in range(count):
        sim.contacts[i] = sim.trial[i]
        sim.contacts[i].impulse[0] = sim.contacts[i].impulse[1] = sim.contacts[i].impulse[2] = 0.0


@inner
def _enough_m_s(sim: Grounded) -> float:
    return ENOUGH * math.sqrt(_square(sim.gravity_m_s2)) * sim.step_s


@inner(allocates=True)
def _take_back(
    sim: Grounded, count: int, step_s: float, inverse: Array, pose: Array, velocity: Array
) -> None:
    """Move the rock out of what it has penetrated, by a share, without giving it speed."""
    deepest = 0.0
    for i in range(count):
        one = sim.contacts[i]
        gap = one.gap_m + 0.5 * step_s * _rate(one, velocity)
        one.floor_m_s = max(-gap, 0.0) * RETURNED
        deepest = max(deepest, -gap)
    if deepest <= 0.1 * TOUCHING_SHARE * sim.size_m:
        return
    shift, arm = np.zeros(6), np.empty(3)
    for _ in range(8):
        for i in range(count):
            one = sim.contacts[i]
            missing = one.floor_m_s - _rate(one, shift)
            if missing <= 0.0:
                continue
            n, r = one.normal, one.arm_m
            arm[0] = r[1] * n[2] - r[2] * n[1]
            arm[1] = r[2] * n[0] - r[0] * n[2]
            arm[2] = r[0] * n[1] - r[1] * n[0]
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
    _move(pose, shift, 1.0)


@inner
def _look(sim: Grounded, pose: Array, margin: float) -> None:
    """Find the features that may touch, unless those found last still serve."""
    slack = SLACK_SHARE * sim.size_m
    if math.isnan(sim.pairs.pose[0]) or not moved_m(sim.pairs.pose, pose, sim.farthest_m) + margin < slack:
        refresh(sim.rock, sim.ground, pose, max(slack, 2.0 * margin), sim.pairs)


@inner
def _rate(one: Any, velocity: Array) -> float:
    """Rate of a contact's gap at a velocity (6,)."""
    n, r = one.normal, one.arm_m
    return (
        n[0] * (velocity[0] + velocity[4] * r[2] - velocity[5] * r[1])
        + n[1] * (velocity[1] + velocity[5] * r[0] - velocity[3] * r[2])
        + n[2] * (velocity[2] + velocity[3] * r[1] - velocity[4] * r[0])
    )


@inner
def _square(a: Any) -> float:
    return a[0] * a[0] + a[1] * a[1] + a[2] * a[2]


@inner
def _move(pose: Array, velocity: Array, time_s: float) -> None:
    """Move a pose (7,) with a constant velocity (6,): a straight way and an exact turn."""
    x, y, z = 0.5 * time_s * velocity[3], 0.5 * time_s * velocity[4], 0.5 * time_s * velocity[5]
    angle = math.sqrt(x * x + y * y + z * z)
    sinc = math.sin(angle) / angle if angle > 1e-12 else 1.0
    x, y, z, w = x * sinc, y * sinc, z * sinc, math.cos(angle)
    a, b, c, d = pose[3], pose[4], pose[5], pose[6]
    pose[0] += time_s * velocity[0]
    pose[1] += time_s * velocity[1]
    pose[2] += time_s * velocity[2]
    pose[3] = w * a + x * d + y * c - z * b
    pose[4] = w * b - x * c + y * d + z * a
    pose[5] = w * c + x * b - y * a + z * d
    pose[6] = w * d - x * a - y * b - z * c
    size = math.sqrt(pose[3] ** 2 + pose[4] ** 2 + pose[5] ** 2 + pose[6] ** 2)
    for k in range(3, 7):
        pose[k] /= size


@inner
def _spin(turn: Array, inertia_m2: Array, spin: Array, out: Array) -> None:
    """Angular momentum over mass (3,) of a spin."""
    for k in range(3):
        out[k] = 0.0
    for axis in range(3):
        along = turn[0, axis] * spin[0] + turn[1, axis] * spin[1] + turn[2, axis] * spin[2]
        for k in range(3):
            out[k] += turn[k, axis] * inertia_m2[axis] * along


@inner
def _invert(turn: Array, inertia_m2: Array, out: Array) -> None:
    """Inverse (3, 3) of the inertia over mass, in the axes of the support frame."""
    for i in range(3):
        for j in range(3):
            out[i, j] = (
                turn[i, 0] * turn[j, 0] / inertia_m2[0]
                + turn[i, 1] * turn[j, 1] / inertia_m2[1]
                + turn[i, 2] * turn[j, 2] / inertia_m2[2]
            )
