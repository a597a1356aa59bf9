"""What one shake is to solve: a rock, a motion, where it starts and how finely it is resolved."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from toppling.models.compiled import Flags
from toppling.models.kept import kept
from toppling.models.motions.motion import Motion
from toppling.models.scene import Scene
from toppling.workers.contact.contact_points import ContactModel, contact_of
from toppling.workers.options import NumericalOptions
from toppling.workers.start import Array, State, start_of

_AZIMUTH_STEP_DEG = 10.0

_LOOKED_AT = 1024
"""Samples of the motion at a time."""


@dataclass(frozen=True, eq=False)
class Problem:
    """A shake as every integrator takes it.

    start: where and how fast the rock starts; None where it rests as the scene has it.
    shortcuts: whether time in which nothing can move is skipped, and the shake ends as soon as its answer is certain.
    """

    scene: Scene
    motion: Motion
    options: NumericalOptions
    time_step_s: float
    start: State | None
    shortcuts: bool

    @cached_property
    def contact(self) -> ContactModel:
        """The scene's."""
        return contact_of(self.scene)

    @cached_property
    def initial(self) -> tuple[Array, Array]:
        """Pose (7,) and velocity (6,) at time 0, support frame.

        Raises InputError if the start is given too deep inside the ground.
        """
        return start_of(self.contact, self.start)

    @property
    def rolls(self) -> bool:
        """Whether the rock rolls on a rounded base: nothing brakes it, and it swings on after the motion."""
        base = self.scene.rounded_base
        return base is not None and base.rolls

    @property
    def rest_speed_m_s(self) -> float:
        """A rock whose points are slower rests."""
        return self.options.rest_speed * self.speed_m_s

    @property
    def speed_m_s(self) -> float:
        """sqrt(g R), which speeds are shares of."""
        return math.sqrt(self.scene.gravity_m_s2 * self.contact.half_diagonal_m)

    @property
    def unit_s(self) -> float:
        """sqrt(R / g), which times are shares of."""
        return math.sqrt(self.contact.half_diagonal_m / self.scene.gravity_m_s2)

    @cached_property
    def speed_limit_m_s(self) -> float:
        """A speed that the motion, the start and a fall of ten R more together cannot give."""
        motion, half_diagonal_m = self.motion, self.contact.half_diagonal_m
        given_m_s = float(np.linalg.norm(motion.acceleration_m_s2, axis=1).sum() * motion.time_step_s)
        fall_m = 10.0 * half_diagonal_m
        if self.start is not None:
            pose, velocity = self.initial
            fall_m += max(float(pose[2]), 0.0)
            given_m_s += float(np.linalg.norm(velocity[:3]))
            given_m_s += float(np.linalg.norm(velocity[3:])) * half_diagonal_m
        return 2.0 * (given_m_s + float(np.sqrt(2.0 * self.scene.gravity_m_s2 * fall_m)))

    @cached_property
    def weak_from_s(self) -> float:
        """Time from which the motion is weak, s: much stronger it would neither tip nor drag the rock.

        What tips it is the least constant acceleration of any azimuth that, slowly applied, topples
        (:mod:`models.statics`): of any, since a rock that has turned has its weakest side elsewhere.
        """
        motion = self.motion
        for end in range(len(motion.acceleration_m_s2), 0, -_LOOKED_AT):  # mostly found near the end
            begin = max(end - _LOOKED_AT, 0)
            strong = np.flatnonzero(~self._is_weak(motion.acceleration_m_s2[begin:end]))
            if len(strong):
                return float((begin + strong[-1] + 1) * motion.time_step_s)
        return 0.0

    def _is_weak(self, acceleration_m_s2: Array) -> Flags:
        """Of samples (n, 3) of the motion those (n,) that are weak."""
        scene = self.scene
        stronger = acceleration_m_s2 / self.options.termination.weak_share
        downward = scene.gravity_m_s2 + stronger[:, 2]
        holds = np.hypot(stronger[:, 0], stronger[:, 1]) < downward * _tipping_ratio(scene)
        force = (np.array([0.0, 0.0, -scene.gravity_m_s2]) - stronger) @ self.contact.scene_from_support
        grips = np.hypot(force[:, 0], force[:, 1]) < -scene.contact.friction_kinetic * force[:, 2]
        return np.asarray(holds & grips)


@kept
def _tipping_ratio(scene: Scene) -> float:
    """Least constant horizontal acceleration that topples the rock, over gravity."""
    azimuths = np.arange(0.0, 360.0, _AZIMUTH_STEP_DEG).tolist()
    least = scene.quasi_static_toppling_m_s2(azimuths)
    return min(value for _, value in least) / scene.gravity_m_s2
