"""Numerical options of a shake, all in one place, and the presets. docs/numerics.md says how the numbers were found."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import NamedTuple

PHYSICS_VERSION = "33"
"""Part of every job's id: raised whenever the same job may give another answer."""


@dataclass(frozen=True)
class SolverOptions:
    """How far the engine's contact solver goes in a step.

    Parameters
    ----------
    iterations : int
        At most.
    residual_share : float
        It stops before once no impulse (at unit mass) changes by more than this share of gravity's in a step.
    """

    iterations: int
    residual_share: float


class ContactOptions(NamedTuple):
    """Which contact points carry, and which the engine is told of. Lengths are shares of the half diagonal R.

    touching_share: points so near touch: they may carry, and an impact meets all of them.
    carrying_share: the same of points that the engine has left where they carry.
    resting_share: the same of a rock at rest, as a seat leaves it.
    penetrating_share: a point that is deeper has penetrated: its step is taken again in parts.
    repeated_parts: so many.
    raised_share: by which the engine has the rock higher where it only moves it: a point comes to the surface on an
    arc, and on its tangent it is nearer.
    checked_share: so near the engine looks at points where it only moves the rock: those that carry, by how it is
    raised.
    prepared_share, prepared_steps: the engine is told of points that come down in a step, of those nearer than the
    first, and of none farther than the second times g (step)^2.
    highest_offset: centripetal offset of a point that carries in an engine's step at most, over (step)^2 times its
    centripetal acceleration.
    allowed_speed: over sqrt(g R): so much faster a point may come nearer than its gap allows.
    friction_direction_rad, impact_friction_direction_rad: by which friction may be off the slip's direction, of a slip
    and of that which an impact leaves.
    """

    touching_share: float = 1e-8
    carrying_share: float = 3e-6
    resting_share: float = 1e-5
    penetrating_share: float = 1e-4
    repeated_parts: int = 4
    raised_share: float = 1e-5
    checked_share: float = 1.5e-5
    prepared_share: float = 5e-6
    prepared_steps: float = 0.8
    highest_offset: float = 1.5
    allowed_speed: float = 1e-10
    friction_direction_rad: float = 1e-3
    impact_friction_direction_rad: float = 1e-2


class ImpactOptions(NamedTuple):
    """How impacts are resolved. Times are shares of the step.

    most: impacts that are resolved within a step; points that land later in it are stopped at its end.
    at_once: a contact that comes sooner is met where the rock is.
    engine_step: duration of the step in which the engine solves an impact.
    engine_tries: of friction axes for it.
    terminal_share: of the way to an impact that points slip on: its last part, which has the velocity of its end.
    left_out: share of the gap of the nearest point that comes down, beyond which the engine is told of none on that
    way.
    """

    most: int = 40
    at_once: float = 1e-4
    engine_step: float = 0.06
    engine_tries: int = 3
    terminal_share: float = 0.1
    left_out: float = 0.5


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
        Points that land slower than this share of sqrt(g R) are stopped at the surface at the end of their step, with
        an error of the first order.
    rest_speed : float
        A rock whose points move slower than this share of sqrt(g R), on points that can hold it, rests.
    longest_step_s : float
        Upper bound of the time step, so that a large rock still follows the record.
    own_steps : bool
        Whether steps in which no point slips are taken without the engine: their motion is known.
    checked_steps : float
        Share of these, drawn by a seed, that the engine repeats; one that it takes otherwise is an error.
    """

    step_share: float
    resolved_impact: float
    rest_speed: float
    solver: SolverOptions
    longest_step_s: float = 0.016
    own_steps: bool = False
    checked_steps: float = 0.005
    contact: ContactOptions = field(default_factory=ContactOptions)
    impact: ImpactOptions = field(default_factory=ImpactOptions)
    termination: TerminationOptions = field(default_factory=TerminationOptions)

    def time_step_s(self, half_diagonal_m: float, gravity_m_s2: float) -> float:
        """Time step for a rock of this size, s."""
        return min(self.step_share * math.sqrt(half_diagonal_m / gravity_m_s2), self.longest_step_s)

    def with_step(self, step_share: float) -> NumericalOptions:
        """The same options with another time step over sqrt(R / g)."""
        return replace(self, step_share=step_share)


PRESETS = {
    "draft": NumericalOptions(1 / 48, 1e-4, 1e-3, SolverOptions(100, 1e-4), own_steps=True),
    "fast": NumericalOptions(1 / 96, 1e-4, 1e-3, SolverOptions(100, 1e-4), own_steps=True),
    "standard": NumericalOptions(1 / 128, 2e-5, 5e-4, SolverOptions(300, 1e-5)),
    "reference": NumericalOptions(1 / 512, 1e-6, 2e-4, SolverOptions(1000, 1e-6)),
}
