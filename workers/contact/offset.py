"""How far active points stand off their surface, as an engine's step of some duration wants it. Compiled."""

from __future__ import annotations

import numpy as np

from toppling.models.compiled import Array, inner
from toppling.workers.contact.gaps import find_centripetal, look
from toppling.workers.quaternion import normal_in_body
from toppling.workers.simulation import GAP, LEAST, NOT, Simulation, points_in_use


@inner
def largest_offset_m(sim: Simulation) -> float:
    """Gap from which a point does not carry in an engine's step: those that do stand off by an offset at most.

    Of the pose looked at.
    """
    fixed, last, largest = sim.fixed[0], sim.state[0].last, 0.0
    find_centripetal(sim, sim.velocity[last])
    for i in range(points_in_use(sim)):
        largest = max(largest, abs(sim.candidates[LEAST, i]))
    return max(fixed.highest_offset * fixed.step_s**2 * largest, fixed.carrying_m)


@inner
def sphere_height_m(sim: Simulation, pose: Array) -> float:
    """Height over a candidate of the centre of the sphere that stands for it, which is over it in the scene's pose."""
    x, y, z = normal_in_body(pose)
    upright = sim.fixed[0].upright
    return sim.fixed[0].radius_m * (x * upright[0] + y * upright[1] + z * upright[2])


@inner
def set_normal_offset(sim: Simulation, step_s: float) -> None:
    """Look at the latest pose, set to the height that belongs to an engine's step of this duration; 0 is the surface.

    Such a step leads a point that carries off the plane along its tangent, by half of (step)^2 times its centripetal
    acceleration, and the next one takes that back. After a change of step the offset is another one.
    """
    state, fixed, last = sim.state[0], sim.fixed[0], sim.state[0].last
    look(sim, last)
    if state.offset_for_s == step_s:
        return
    state.offset_for_s = step_s
    pose, spheres_m = sim.pose[last], 0.0
    if step_s > 0.0:  # the engine's points are small spheres
        spheres_m = sphere_height_m(sim, pose) - fixed.radius_m
    offset_m = largest_offset_m(sim)  # leaves the centripetal accelerations in LEAST
    lowest = np.inf
    for i in range(points_in_use(sim)):
        away = 0.5 * step_s**2 * sim.candidates[LEAST, i]
        lowest = min(lowest, sim.candidates[GAP, i] + spheres_m - away)
    raised_m = -lowest
    # Else the rock is aloft, or a point has penetrated.
    if raised_m != 0.0 and -offset_m < raised_m < fixed.penetrating_share * fixed.half_diagonal_m:
        pose[2] += raised_m
        state.placed = NOT
        look(sim, last)
