"""A rock that moves without gathering speed, by steps that start at rest."""

from __future__ import annotations

import numpy as np

from toppling.models.compiled import Array, compiled
from toppling.models.ground.pairs import moved_m
from toppling.models.ground.rigid import copy
from toppling.models.ground.stepping import Grounded, advance


@compiled
def settle(sim: Grounded, force_m_s2: Array, sweeps: int, stop_m: float) -> float:
    """Let the rock down from its latest pose without gathering speed; way of its last step, m.

    Every step starts at rest under a constant specific force; the way is that of the point that moved most.
    """
    pose, before, velocity, travel_m = sim.pose[sim.counts[1]], sim.work.start, sim.work.still, np.inf
    step_s = sim.step_s
    for _ in range(sweeps):
        copy(pose, before)
        for k in range(6):
            velocity[k] = 0.0
        increment = (force_m_s2[0] * step_s, force_m_s2[1] * step_s, force_m_s2[2] * step_s)
        advance(sim, step_s, increment, pose, velocity, True, np.inf)
        travel_m = moved_m(before, pose, sim.lists.farthest_m)
        if travel_m < stop_m:
            break
    return travel_m
