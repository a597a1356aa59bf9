"""Steps of a rock, block after block, until it must be looked at. Compiled."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from toppling.models.compiled import Array, Vector, compiled, inner
from toppling.models.ground.equilibrium import STILL, held_until, is_still
from toppling.models.ground.pairs import moved_m
from toppling.models.ground.rigid import copy, dot, minus, normal_in_body, square
from toppling.models.ground.rolling import FIRST_KEY
from toppling.models.ground.stepping import Grounded, advance, leaves_plane, step
from toppling.workers.problem import Problem

_LONG_STEPS = 4
"""Steps that a rock which does nothing but roll takes at once: its swings last hundreds of them."""


class Watch(NamedTuple):
    """Conditions of the next check of a rock: until one is met no rule ends the shake."""

    up: Vector  # support frame
    upright: Vector  # the interface's normal in body axes in the pose of the scene
    fastest_m_s: float  # a speed above it does, and a state that is not finite
    fallen_m: float  # a centre of mass that has lost more height
    lowest_m: float  # or that is lower over the interface
    least_cosine: float  # of a tilt above the largest one
    until_s: float  # every block from then on
    over_s: float  # the motion; a rock that is held to its end is looked at
    deepest_m: Array  # (1,): deepest contact at the end of a block, written here
    skips: bool  # the time in which a rock that does not move is held
    # (3,), written here: the time so skipped; when a rock was last seen not to move; until when it is held since.
    rest_s: Array
    moves: bool  # else the rock is only asked whether it rests where it is


def steps_at_once(problem: Problem) -> int:
    """Those that a rock may take at once while it does nothing but roll."""
    return max(min(_LONG_STEPS, int(problem.options.longest_step_s / problem.time_step_s)), 1)


@compiled
def take_steps(sim: Grounded, block: int, watch: Watch) -> int:
    """Go on by blocks of so many steps until one calls for a look, or there is no room for another.

    Returns
    -------
    int
        Index of the pose in which the last block began; -1 where the rock is about to leave its plane, and has no
        meshes yet: the block is not taken.
    """
    if not watch.moves:
        _rest_where_it_is(sim, block, watch)
        return sim.counts[1]
    while True:
        since, grid = sim.counts[1], sim.counts[2]
        while sim.counts[2] < grid + block:
            if len(sim.rock.faces) == 0 and leaves_plane(sim):
                return -1
            last = sim.counts[1]
            copy(sim.pose[last], sim.pose[last + 1])
            copy(sim.velocity[last], sim.velocity[last + 1])
            sim.counts[6] = (sim.at_once if _only_rolls(sim) else 1) - 1
            step(sim, sim.counts[2] * sim.step_s, sim.pose[last + 1], sim.velocity[last + 1])
            sim.counts[1], sim.counts[2] = last + 1, sim.counts[2] + 1 + sim.counts[6]
            sim.time_s[last + 1] = sim.counts[2] * sim.step_s
        for k in range(sim.counts[0]):
            watch.deepest_m[0] = max(watch.deepest_m[0], -sim.contacts[k].gap_m)
        if _has_stood(sim, since):
            _rest(sim, since, block, watch)
        if _calls_for_look(sim, watch, since) or sim.counts[1] + block + 2 >= len(sim.time_s):
            return since


@inner
def _only_rolls(sim: Grounded) -> bool:
    """Whether a rock touches with the one place on which it rolls."""
    return len(sim.rolling.corners) > 0 and sim.counts[0] == 1 and sim.contacts[0].key >= FIRST_KEY


@inner
def _has_stood(sim: Grounded, since: int) -> bool:
    """Whether the rock has not moved since a pose, but by rounding."""
    last = sim.counts[1]
    path_m = moved_m(sim.pose[since], sim.pose[last], sim.size_m)
    return path_m <= STILL * sim.size_m and is_still(sim, sim.velocity[last])


@inner
def _rest_where_it_is(sim: Grounded, block: int, watch: Watch) -> None:
    """Let a rock rest in its latest pose, if its contacts hold it there on ground that is still."""
    last, g = sim.counts[1], sim.gravity_m_s2
    copy(sim.pose[last], sim.pose[last + 1])
    for k in range(6):
        sim.velocity[last + 1, k] = 0.0
    increment = (g[0] * sim.step_s, g[1] * sim.step_s, g[2] * sim.step_s)
    advance(sim, sim.step_s, increment, sim.pose[last + 1], sim.velocity[last + 1], True, np.inf)
    if is_still(sim, sim.velocity[last + 1]):
        _rest(sim, last, block, watch)


@inner
def _rest(sim: Grounded, since: int, block: int, watch: Watch) -> None:
    """Let the rock rest as it was a block ago, and note until when its contacts hold it: so long it may be left alone.

    Up to the last sample before one that they do not hold, by whole blocks: what follows is the same to the bit.
    """
    last, grid = sim.counts[1], sim.counts[2]
    for index in range(since, last + 1):
        copy(sim.pose[since], sim.pose[index])
        for k in range(6):
            sim.velocity[index, k] = 0.0
    if not (watch.rest_s[1] == sim.time_s[since] and watch.rest_s[2] > sim.time_s[last]):
        until = held_until(sim, int(sim.time_s[last] / sim.sample_s))
        watch.rest_s[2] = np.inf if until >= len(sim.excitation) else (until - 1) * sim.sample_s
    for k in range(sim.counts[0]):
        sim.contacts[k].impulse[0] = sim.contacts[k].impulse[1] = sim.contacts[k].impulse[2] = 0.0
    steps = 0
    if watch.skips and watch.rest_s[2] < np.inf:
        steps = int(watch.rest_s[2] / sim.step_s) - grid
        steps -= steps % block
    if steps > 0:
        copy(sim.pose[last], sim.pose[last + 1])
        copy(sim.velocity[last], sim.velocity[last + 1])
        sim.counts[1], sim.counts[2] = last + 1, grid + steps
        sim.time_s[last + 1] = sim.counts[2] * sim.step_s
        watch.rest_s[0] += steps * sim.step_s
    watch.rest_s[1] = sim.time_s[sim.counts[1]]


@inner
def _calls_for_look(sim: Grounded, watch: Watch, since: int) -> bool:
    last = sim.counts[1]
    time_s = sim.time_s[last]
    if sim.counts[4] > 0 or time_s >= watch.until_s:
        return True
    if watch.rest_s[1] == time_s and (watch.rest_s[2] == np.inf) and (watch.skips or time_s > watch.over_s):
        return True
    if dot(minus(sim.pose[0], sim.pose[last]), watch.up) > watch.fallen_m:
        return True
    for index in range(since, last + 1):
        upright = dot(normal_in_body(sim.pose[index]), watch.upright) >= watch.least_cosine
        slow = math.sqrt(square(sim.velocity[index])) <= watch.fastest_m_s
        if not (upright and slow and sim.pose[index, 2] >= watch.lowest_m):
            return True
    return False
