"""A rock that moves without gathering speed: let down to where it rests, and tipped by a constant acceleration."""

from __future__ import annotations

import math

import numpy as np

from toppling.models.compiled import Array, Vector, compiled, inner
from toppling.models.ground.pairs import moved_m
from toppling.models.ground.rigid import square
from toppling.models.ground.stepping import Grounded, advance
from toppling.models.ground.vectors import copy

_TIPPED_RAD = 0.8
"""A rock that tips slowly is followed so far."""

_TIPPING_SHARE = 0.004
"""Of R: way of one of its steps."""

_LONGEST = 16.0
"""Times the shortest step: a longer one goes past facets of a fine mesh that it should come to rest on."""

_MOST_STEPS = 200
"""Of the longest, to one pose."""

_LEAST = 0.25
"""Share of a step's way after which a rock that has landed is asked anew: on a dome it stands more wherever it is."""

_PASSED = 0.9
"""Share of the largest acceleration that was held, below which it is past it."""

_PRECISION = 2e-4
"""Share to which the largest acceleration is found."""

_COARSELY = 0.001
"""Of g: to this an acceleration is found that is less than the largest so far."""

_MOST_POSES = 4000

_BEYOND = 100.0
"""Of what counts as still: by so much more than it holds a rock is pushed. By .05 g it tips where it slides."""

_GATHERED = 3e-3
"""Of g R: energy that is no speed yet, as much as a rough base gathers from one of its corners to the next."""

_SETTLED_IN = 30
"""Short steps before a pose is asked, which close its gaps: over an open one a rock rolls aside, as if it were held."""


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
def largest_held_m_s2(sim: Grounded, push: Array, most_m_s2: float, followed_m: float) -> float:
    """Largest constant acceleration of the ground, against a unit push (3,), that a rock at rest stands.

    In its first pose, or in one that it tips into from there and comes to rest in: until it has tilted so far, or
    stands so much less after a way of `followed_m`, that nothing larger follows. Where a pose stands less than the
    best so far, the rock gathers energy, the difference times the way; it is at rest again once poses that stand
    more have taken as much. Infinite from `most_m_s2` on.
    """
    pose = sim.pose[0].copy()
    _close_gaps(sim, pose, push, 0.0)
    start = pose.copy()
    still, most_j_kg = _still_m_s2(sim), _GATHERED * sim.size_m * math.sqrt(square(sim.gravity_m_s2))
    peak, trial, last = pose.copy(), pose.copy(), pose.copy()
    best = held_before = gathered_j_kg = 0.0
    least_cosine = math.cos(0.5 * _TIPPED_RAD)
    for _ in range(_MOST_POSES):
        if _gives_way(sim, pose, push, (1.0 + _PRECISION) * best) < still:
            held = _held_m_s2(sim, pose, push, best, most_m_s2)
        else:
            held = _held_below_m_s2(sim, pose, push, best)
            if held < _PASSED * best and moved_m(peak, pose, sim.lists.farthest_m) > followed_m:
                return best
        if held > most_m_s2:
            return np.inf
        way_m = 0.0
        for k in range(3):
            way_m += (pose[k] - last[k]) * push[k]
        gathered_j_kg = max(gathered_j_kg + (best - 0.5 * (held + held_before)) * way_m, 0.0)
        if held > best and gathered_j_kg <= most_j_kg:
            best, gathered_j_kg = held, 0.0
            copy(pose, peak)
        copy(pose, last)
        held_before = held
        pushed = 1.02 * max(best, held) + _BEYOND * still
        _tip(sim, pose, trial, push, pushed, best)
        _close_gaps(sim, pose, push, pushed)
        cosine = abs(start[3] * pose[3] + start[4] * pose[4] + start[5] * pose[5] + start[6] * pose[6])
        if cosine < least_cosine or moved_m(start, pose, 0.0) > sim.size_m:
            break
    return best


@inner
def _tip(sim: Grounded, pose: Array, trial: Array, push: Array, pushed: float, best: float) -> None:
    """Tip a pose by about a share of R, as one step from rest or several, of which one that lands may be the last."""
    share_m, still = _TIPPING_SHARE * sim.size_m, _still_m_s2(sim)
    step_s = sim.step_s
    for _ in range(20):
        copy(pose, trial)
        way = _crept_m(sim, trial, _load(sim, push, pushed, step_s), step_s)
        if way > 2.0 * share_m:
            step_s *= 0.5
        elif way < share_m and step_s < _LONGEST * sim.step_s:
            step_s *= 1.5
        else:
            break
    for _ in range(_MOST_STEPS):
        moved = moved_m(pose, trial, sim.lists.farthest_m) / share_m
        landed = moved > _LEAST and _gives_way(sim, trial, push, (1.0 + _PRECISION) * best) < still
        if moved >= 1.0 or landed:
            break
        _crept_m(sim, trial, _load(sim, push, pushed, step_s), step_s)
    copy(trial, pose)


@inner
def _close_gaps(sim: Grounded, pose: Array, push: Array, acceleration: float) -> None:
    """Let a pose down by short steps under an acceleration along a push."""
    for _ in range(_SETTLED_IN):
        _crept_m(sim, pose, _load(sim, push, acceleration, sim.step_s), sim.step_s)


@inner
def _still_m_s2(sim: Grounded) -> float:
    return 1e-4 * math.sqrt(square(sim.gravity_m_s2))


@inner
def _held_m_s2(sim: Grounded, pose: Array, push: Array, least: float, most: float) -> float:
    """Largest acceleration along a push that a pose at rest stands, which stands the least; more than `most` if any."""
    still = _still_m_s2(sim)
    low, high = least, max(1.1 * least, 0.05 * most)
    while _gives_way(sim, pose, push, high) < still:
        low, high = high, 1.5 * high
        if low > most:
            return low
    return _bisected_m_s2(sim, pose, push, (low, high), 0.0)


@inner
def _held_below_m_s2(sim: Grounded, pose: Array, push: Array, high: float) -> float:
    """Largest acceleration along a push that a pose stands, which stands less than `high`; negative if it falls."""
    g = math.sqrt(square(sim.gravity_m_s2))
    return _bisected_m_s2(sim, pose, push, (-g, high), _COARSELY * g)


@inner
def _bisected_m_s2(
    sim: Grounded, pose: Array, push: Array, limits: tuple[float, float], within: float
) -> float:
    """Largest acceleration along a push that a pose stands, between one that it does and one that it does not."""
    still, (low, high) = _still_m_s2(sim), limits
    while high - low > within + _PRECISION * abs(high):
        middle = 0.5 * (low + high)
        if _gives_way(sim, pose, push, middle) < still:
            low = middle
        else:
            high = middle
    return low


@inner
def _load(sim: Grounded, push: Array, acceleration: float, time_s: float) -> Vector:
    """What gravity, and an acceleration along a push, add to a velocity in some time."""
    g = sim.gravity_m_s2
    return (
        time_s * (g[0] + acceleration * push[0]),
        time_s * (g[1] + acceleration * push[1]),
        time_s * (g[2] + acceleration * push[2]),
    )


@inner
def _gives_way(sim: Grounded, pose: Array, push: Array, acceleration: float) -> float:
    """Acceleration along a push with which the centre of mass leaves a pose at rest, m/s2."""
    _note_start(sim, pose)
    there, velocity = sim.work.start, sim.work.still
    advance(sim, sim.step_s, _load(sim, push, acceleration, sim.step_s), there, velocity, True, np.inf)
    return (velocity[0] * push[0] + velocity[1] * push[1] + velocity[2] * push[2]) / sim.step_s


@inner
def _note_start(sim: Grounded, pose: Array) -> None:
    """Copy a pose, and no velocity, to where a step works."""
    copy(pose, sim.work.start)
    for k in range(6):
        sim.work.still[k] = 0.0


@inner
def _crept_m(sim: Grounded, pose: Array, increment: Vector, step_s: float) -> float:
    """Move from rest for one step; the way of the point that moved most."""
    _note_start(sim, pose)
    before, velocity = sim.work.start, sim.work.still
    advance(sim, step_s, increment, pose, velocity, True, np.inf)
    return moved_m(before, pose, sim.lists.farthest_m)
