"""Numerical options of a shake, all in one place, and the presets. docs/numerics.md says how the numbers were found."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

PHYSICS_VERSION = "46"
"""Part of every job's id: raised whenever the same job may give another answer."""


@dataclass(frozen=True)
class TerminationOptions:
    """When a shake has ended. Times are over sqrt(R / g), speeds over sqrt(g R).

    block: steps between two looks.
    certain_share, calm_share: of the least energy that overturns: with less, a rock will stand, on ground at rest,
    which adds none, and on ground that moves weakly.
    weak_share: a motion is weak that stays within this share of what would tip the rock slowly or drag it over its
    pedestal.
    weak_tilt_deg, weak_yaw_deg: what tips the rock is known for its first pose, so only near that is a motion called
    weak.
    calmed_after: after the motion, until which a rock is given to come near rest; from then on it is enough that its
    energy cannot overturn it.
    cap_after: the same until which that must be so, or its fate is undecided.
    moved_share: of R: a rock that slid farther has moved.
    moved_deg: a rock that turned farther has moved.
    """

    block: int = 64
    certain_share: float = 0.8
    calm_share: float = 0.3
    weak_share: float = 0.25
    weak_tilt_deg: float = 3.0
    weak_yaw_deg: float = 30.0
    calmed_after: float = 60.0
    cap_after: float = 300.0
    moved_share: float = 0.01
    moved_deg: float = 1.0


@dataclass(frozen=True)
class NumericalOptions:
    """How finely a shake is resolved.

    Parameters
    ----------
    step_share : float
        Time step over sqrt(R / g), R the rock's half diagonal: rocks of one shape and all sizes are resolved alike.
    resolved_impact : float
        Contacts that close slower than this share of sqrt(g R) are stopped at the end of their step, with an error of
        the first order.
    rest_speed : float
        A rock whose points move slower than this share of sqrt(g R), on points that can hold it, rests.
    longest_step_s : float
        Upper bound of the time step, so that a large rock still follows the record.
    checked_steps : float
        Share of the steps, drawn by a seed, that the engine repeats; one that it takes otherwise is an error.
    """

    step_share: float
    resolved_impact: float
    rest_speed: float
    checked_steps: float = 1.0
    longest_step_s: float = 0.016
    termination: TerminationOptions = field(default_factory=TerminationOptions)

    def time_step_s(self, half_diagonal_m: float, gravity_m_s2: float) -> float:
        """Time step for a rock of this size, s."""
        return min(self.step_share * math.sqrt(half_diagonal_m / gravity_m_s2), self.longest_step_s)

    def with_step(self, step_share: float) -> NumericalOptions:
        """These options with another time step over sqrt(R / g)."""
        return replace(self, step_share=step_share)


PRESETS = {
    "fast": NumericalOptions(1 / 96, 1e-4, 1e-3, checked_steps=0.005),
    "standard": NumericalOptions(1 / 128, 2e-5, 5e-4),
    "reference": NumericalOptions(1 / 512, 1e-6, 2e-4),
}
