"""A rock at rest: whether its contact can hold it, and the time that it may be left alone."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from toppling.models.motions.motion import Motion
from toppling.models.scene import Scene
from toppling.models.statics import holds_still, polygon
from toppling.workers.contact_points import ContactModel
from toppling.workers.integrator import Integrator
from toppling.workers.observation import Observation
from toppling.workers.quaternion import matrix

Array = NDArray[np.float64]

TOUCHING_SHARE = 1e-5
"""Contact points within this share of R of the plane carry a rock at rest: the engine holds them ten times closer."""

PLANE = np.array([0.0, 0.0, 1.0])
"""Normal of the interface in the support frame."""


class Rest:
    """Whether the rock rests, held by its contact, and what is left out while it does.

    Parameters
    ----------
    scene : Scene
    contact : ContactModel
    motion : Motion
    integrator : Integrator
    block : int
        Whole steps between two looks.
    rest_speed_m_s : float
        A rock whose points are slower rests.
    rests : bool
        Whether it does at the start.
    """

    def __init__(
        self,
        scene: Scene,
        contact: ContactModel,
        motion: Motion,
        integrator: Integrator,
        block: int,
        rest_speed_m_s: float,
        rests: bool,
    ) -> None:
        turn = contact.scene_from_support
        self._gravity = np.array([0.0, 0.0, -scene.gravity_m_s2]) @ turn
        self._forces = np.vstack([self._gravity - motion.acceleration_m_s2 @ turn, self._gravity])
        """Specific force at the motion's samples, and after the last of them."""
        self._scene, self._contact, self._motion, self._integrator = scene, contact, motion, integrator
        self._block, self._speed_m_s = block, rest_speed_m_s
        self.rests = rests
        """For the whole of the last block."""
        self.came_to_rest = False
        self.skipped_s = 0.0

    def keep(self, seen: Observation, since: int) -> bool:
        """Take back what the solver let the rock creep since a pose in which it rested, if its contact holds it there.

        In the block in which it comes to rest it stays where it is: only what follows is known to be creep. Returns
        whether something was taken back.
        """
        integrator, sample_s, rested = self._integrator, self._motion.time_step_s, self.rests
        slow = seen.drift_m_s < self._speed_m_s
        self.came_to_rest = slow and seen.speed_m_s < self._speed_m_s
        began_s = integrator.sim.time_s[since]
        meanwhile = self._forces[int(began_s / sample_s) : math.ceil(seen.time_s / sample_s) + 1]
        if len(meanwhile) == 0:  # the motion was over before
            meanwhile = self._gravity[None]
        stays = slow if rested else self.came_to_rest
        self.rests = stays and bool(self._holds(meanwhile, since if rested else integrator.last).all())
        if rested and self.rests:
            integrator.rest_until(since, integrator.grid)
            return True
        return False

    def is_held(self) -> bool:
        """Whether the contact can hold the rock where it is on ground at rest."""
        return bool(self._holds(self._gravity[None], self._integrator.last)[0])

    def lasts(self) -> bool:
        """Skip to the last block before equilibrium becomes impossible; true if it stays possible to the end.

        The specific forces that friction and the support can hold form a convex cone, and the motion is linear between
        its samples: a rock at rest stays so up to the last sample of those that all lie in the cone. Blocks are skipped
        whole, so that what comes after is to the bit what it is without the skip.
        """
        integrator, sample_s, step_s = (
            self._integrator,
            self._motion.time_step_s,
            self._integrator.sim.whole_step_s,
        )
        first = int(integrator.time_s / sample_s)
        forces = self._forces[first:]
        soon = int(self._block * step_s / sample_s) + 1
        if not self._holds(forces[:soon], integrator.last).all():  # spares a look at the whole record
            return False
        held = self._holds(forces, integrator.last)
        if held.all():
            return True
        until_s = (first + max(int(np.argmin(held)) - 1, 0)) * sample_s
        blocks = (int(until_s / step_s) - integrator.grid) // self._block
        if blocks > 0:
            self.skipped_s += blocks * self._block * step_s
            integrator.rest_until(integrator.last, integrator.grid + blocks * self._block)
        return False

    def _holds(self, forces_m_s2: Array, index: int) -> NDArray[np.bool_]:
        """Whether the points that touch in a pose can hold the rock under each specific force, support frame."""
        pose, touching_m = self._integrator.sim.pose[index], TOUCHING_SHARE * self._contact.half_diagonal_m
        com = pose[:3].copy()
        points = com + self._contact.points_body_m @ matrix(pose[3:]).T
        corners = polygon(points[points[:, 2] <= touching_m], PLANE, touching_m)
        return holds_still(corners, com, PLANE, self._scene.contact.friction_static, forces_m_s2)
