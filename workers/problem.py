"""What one shake is to solve: a rock, a motion, where it starts and how finely it is resolved."""

from __future__ import annotations

import math
from dataclasses import dataclass

from toppling.models.motions.motion import Motion
from toppling.models.scene import Scene
from toppling.workers.contact_points import ContactModel, Pose, contact_of
from toppling.workers.options import NumericalOptions
from toppling.workers.start import State, Vector, start_of


@dataclass(frozen=True, eq=False)
class Problem:
    """A shake as every integrator takes it.

    Parameters
    ----------
    scene : Scene
    contact : ContactModel
        The scene's.
    motion : Motion
    options : NumericalOptions
    time_step_s : float
    pose, velocity_m_s, angular_velocity_rad_s
        State at time 0, support frame.
    rests : bool
        Whether the rock rests there.
    shortcuts : bool
        Whether time in which nothing can move is skipped, and the shake ends as soon as its answer is certain.
    """

    scene: Scene
    contact: ContactModel
    motion: Motion
    options: NumericalOptions
    time_step_s: float
    pose: Pose
    velocity_m_s: Vector
    angular_velocity_rad_s: Vector
    rests: bool
    shortcuts: bool

    @classmethod
    def of(
        cls,
        scene: Scene,
        motion: Motion,
        options: NumericalOptions,
        time_step_s: float,
        start: State | None,
        shortcuts: bool,
    ) -> Problem:
        """Of a scene, at rest where no start is given.

        Raises
        ------
        InputError
            If the start is given too deep inside the ground.
        """
        contact = contact_of(scene)
        state = start_of(contact, start)
        return cls(scene, contact, motion, options, time_step_s, *state, start is None, shortcuts)

    @property
    def speed_m_s(self) -> float:
        """sqrt(g R), which speeds are shares of."""
        return math.sqrt(self.scene.gravity_m_s2 * self.contact.half_diagonal_m)

    @property
    def rest_speed_m_s(self) -> float:
        """A rock whose points are slower rests."""
        return self.options.rest_speed * self.speed_m_s
