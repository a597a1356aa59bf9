"""A rock that swings on its pedestal and is stopped at the lowest point of each swing, until it rests."""

from __future__ import annotations

from typing import Any

import numpy as np

from toppling.models.compiled import Array, compiled
from toppling.models.contact import ContactProperties
from toppling.models.scene import Scene
from toppling.workers.contact.contact_points import contact_of
from toppling.workers.engines.bullet import world as bullet
from toppling.workers.engines.bullet.pool import EnginePool, configure_for
from toppling.workers.observation import travel_m
from toppling.workers.options import PRESETS, SolverOptions
from toppling.workers.simulation import copy

OPTIONS = PRESETS["standard"]

_PREPARED_STEPS, _PREPARED_SHARE = OPTIONS.contact.prepared_steps, 2e-5
"""Contacts are prepared within the one times g (step)^2, and within the other share of R."""

_SOLVER = SolverOptions(iterations=200, residual_share=1e-3)

_STOPPED_SHARE = 1e-5
"""Way in a look, over R, below which a rock that settles is no longer stopped: each stop costs it its contacts."""

_STEPS_IN_A_LOOK = 4


def let_down(scene: Scene, pool: EnginePool) -> tuple[Array, float]:
    """Pose (7,) of a rock at rest after all speed was taken from it again and again; its last speed, m/s, 0 at rest."""
    contact = contact_of(scene)
    gravity = np.array([0.0, 0.0, -scene.gravity_m_s2]) @ contact.scene_from_support
    step_s = OPTIONS.time_step_s(contact.half_diagonal_m, scene.gravity_m_s2)
    world = pool.world(contact, len(contact.points_body_m))
    surface = ContactProperties.of(scene.contact.friction_static)  # let down without a rebound
    configure_for(world, surface, _SOLVER)
    pose = contact.touching(contact.start_pose)
    size_m, g_m_s2 = contact.half_diagonal_m, scene.gravity_m_s2
    still = _swing_out(world[0], contact.points_body_m, size_m, g_m_s2, gravity, step_s, pose)
    pool.give_back(contact, len(contact.points_body_m))  # the rock is shaken as it is seated, another body
    return pose, still


@compiled(allocates=True)
def _swing_out(
    world: Any,
    points_m: Array,
    half_diagonal_m: float,
    gravity_m_s2: float,
    force_m_s2: Array,
    step_s: float,
    pose: Array,
) -> float:
    """Let a rock swing, and go at rest from the lowest point of each swing; its last speed, m/s, or 0 at rest."""
    impulse, still = gravity_m_s2 * step_s, np.zeros(6)
    force = (force_m_s2[0], force_m_s2[1], force_m_s2[2])
    near = max(_PREPARED_STEPS * (impulse * step_s) / half_diagonal_m, _PREPARED_SHARE)
    bullet.configure(world, impulse, near, 0.0)
    bullet.place(world, pose, still, near, 0.0)
    strict = 3e-7 * half_diagonal_m  # the solver lets a rock at rest creep by a quarter of it
    previous, travel, before, velocity = np.inf, np.inf, pose.copy(), np.empty(6)
    for look in range(5000):
        # A base that rolls may swing on by a millionth of its size for ever.
        limit = strict if look < 1000 else 10.0 * strict
        for _ in range(_STEPS_IN_A_LOOK):
            copy(pose, before)
            bullet.step(world, points_m, step_s, force, pose, velocity)
        travel = travel_m(before, pose, half_diagonal_m)
        # Past the lowest point of this swing: let it go from here at rest. What is left in the end dies by itself.
        if travel < previous and travel > _STOPPED_SHARE * half_diagonal_m:
            bullet.place(world, pose, still, near, 0.0)
        if max(travel, previous) < limit:
            return 0.0
        previous = travel
    return max(travel, previous) / step_s
