"""Steps of a rock on a surface, block after block, until it must be looked at. Compiled."""

from __future__ import annotations

import math
from typing import NamedTuple

from toppling.models.compiled import Array, Vector, compiled, inner
from toppling.models.ground.curved import only_rolls
from toppling.models.ground.holding import STILL, held_until, is_still
from toppling.models.ground.rigid import square
from toppling.models.ground.stepping import Grounded, step
from toppling.models.ground.vectors import copy, dot, minus
from toppling.workers.observation import travel_m
from toppling.workers.problem import Problem
from toppling.workers.quaternion import normal_in_body


class GroundWatch(NamedTuple):
    """What calls for a look at a rock on a surface: until it does nothing ends the shake."""

    up: Vector  # support frame
    upright: Vector  # the interface's normal in body axes in the pose of the scene
    fastest_m_s: float  # a speed above it does, and a state that is not finite
    fallen_m: float  # a centre of mass that has lost more height
    least_cosine: float  # of a tilt above the largest one
    drift_m_s: float  # a block with less drift
    look_at_s: float  # no drift before this time
    until_s: float  # every block from then on
    deepest_m: Array  # (1,): deepest contact at the end of a block, written here
    skips: bool  # the time in which a rock that does not move is held
    # (3,), written here: the time so skipped; when a rock was last seen not to move; until when it is held since.
    rest_s: Array


_LONG_STEPS = 4
"""Steps that a rock which does nothing but roll takes at once: its swings last hundreds of them."""


def steps_at_once(problem: Problem) -> int:
    """Those that a rock may take at once while it does nothing but roll."""
    return max(min(_LONG_STEPS, int(problem.options.longest_step_s / problem.time_step_s)), 1)


@compiled
def take_steps(sim: Grounded, block: int, watch: GroundWatch) -> int:
    """Go on by blocks of so many steps until one calls for a look, or there is no room for another.

    Returns
    -------
    int
        Index of the pose in which the last block began.
    """
    while True:
        since = sim.counts[1]
        for _ in range(block):
            last = sim.counts[1]
            copy(sim.pose[last], sim.pose[last + 1])
            copy(sim.velocity[last], sim.velocity[last + 1])
            at_once = sim.at_once if only_rolls(sim.curved, sim.contacts, sim.counts[0]) else 1
            sim.counts[6] = at_once - 1
            step(sim, sim.counts[2] * sim.step_s, sim.pose[last + 1], sim.velocity[last + 1])
            sim.counts[1], sim.counts[2] = last + 1, sim.counts[2] + at_once
            sim.time_s[last + 1] = sim.counts[2] * sim.step_s
        for k in range(sim.counts[0]):
            watch.deepest_m[0] = max(watch.deepest_m[0], -sim.contacts[k].gap_m)
        if watch.skips and _has_stood(sim, since):
            _skip_rest(sim, block, watch)
        if _calls_for_look(sim, watch, since) or sim.counts[1] + block + 1 >= len(sim.time_s):
            return since


@inner
def _has_stood(sim: Grounded, since: int) -> bool:
    """Whether the rock has not moved since a pose, but by rounding."""
    last = sim.counts[1]
    way_m = travel_m(sim.pose[since], sim.pose[last], sim.size_m)
    return way_m <= STILL * sim.size_m and is_still(sim, sim.velocity[last])


@inner
def _skip_rest(sim: Grounded, block: int, watch: GroundWatch) -> None:
    """Skip whole blocks up to the last sample before one that the contacts of a rock at rest do not hold."""
    last, grid = sim.counts[1], sim.counts[2]
    until = held_until(sim, int(sim.time_s[last] / sim.sample_s))
    until_s = (until - 1) * sim.sample_s
    steps = int(until_s / sim.step_s) - grid
    steps -= steps % block
    if steps > 0:
        copy(sim.pose[last], sim.pose[last + 1])
        copy(sim.velocity[last], sim.velocity[last + 1])
        sim.counts[1], sim.counts[2] = last + 1, grid + steps
        sim.time_s[last + 1] = sim.counts[2] * sim.step_s
        watch.rest_s[0] += steps * sim.step_s
    watch.rest_s[1], watch.rest_s[2] = sim.time_s[sim.counts[1]], until_s


@inner
def _calls_for_look(sim: Grounded, watch: GroundWatch, since: int) -> bool:
    last = sim.counts[1]
    start, end, velocity, time_s = sim.pose[since], sim.pose[last], sim.velocity[last], sim.time_s[last]
    if sim.counts[4] > 0 or not math.sqrt(square(velocity)) <= watch.fastest_m_s or time_s >= watch.until_s:
        return True
    if dot(minus(sim.pose[0], end), watch.up) > watch.fallen_m:
        return True
    for index in range(since, last + 1):
        if not dot(normal_in_body(sim.pose[index]), watch.upright) >= watch.least_cosine:
            return True
    drift_m_s = travel_m(start, end, sim.size_m) / (time_s - sim.time_s[since])
    return time_s >= watch.look_at_s and drift_m_s < watch.drift_m_s
