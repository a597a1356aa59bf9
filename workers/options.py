"""Numerical settings of a shake: presets chosen from the measured front of speed against error (docs/accuracy.md)."""

import math
from dataclasses import dataclass

from toppling.models.errors import InputError

PHYSICS_VERSION = "12"
"""Part of every job's id: raised whenever the same job may give another answer."""


@dataclass(frozen=True)
class Solver:
    """How far the contact solver goes in a step.

    It starts from no contact impulses at all and takes them from foot to foot. On a base of many feet, neighbours along
    the rim can hardly be told apart: weight goes over to the leading ones in proportion to the iterations, and until
    then the rock turns as if its base were smaller. With 20 iterations a prism of 24 sides overturned .15 % too easily,
    with 50 .09 %; prisms of 12 to 48 sides at worst .073 % with the 100 of `fast`, .034 % with the 300 of `standard`
    and .015 % with the 1000 of `reference` (physics version 12).

    Parameters
    ----------
    iterations : int
        At most.
    residual_share : float
        It stops before once no impulse (at unit mass) changes by more than this share of gravity's in a step.
    """

    iterations: int
    residual_share: float


@dataclass(frozen=True)
class Settings:
    """How finely a shake is resolved.

    Parameters
    ----------
    step_share : float
        Time step over sqrt(R / g), R the rock's half diagonal: rocks of one shape and all sizes are resolved alike.
    resolved_landing : float
        Landings slower than this share of sqrt(g R) are left to the contact solver, with an error of the first order.
        They carry next to no energy (5e-7 of a fall from R at 1e-3), but a rock that still rocks by so little as the
        next strong wave comes goes on from there, and one that was stopped does not.
    solver : Solver
    rest_speed : float
        A rock whose points move slower than this share of sqrt(g R), on feet that can hold it, rests. The solver lets
        a rock on few feet turn by up to 3e-4 of it.
    longest_step_s : float
        Upper bound of the time step, so that a large rock still follows the record.
    parts_when_low : int
        A power of two, by which steps and slowest resolved landings are divided from rest until the rock has lifted.
    """

    step_share: float
    resolved_landing: float
    solver: Solver
    rest_speed: float
    longest_step_s: float = 0.016
    parts_when_low: int = 1

    def time_step_s(self, half_diagonal_m: float, gravity_m_s2: float) -> float:
        """Time step for a rock of this size, s."""
        return min(self.step_share * math.sqrt(half_diagonal_m / gravity_m_s2), self.longest_step_s)


PRESETS = {
    "fast": Settings(
        1 / 96, resolved_landing=1e-3, solver=Solver(100, 1e-4), rest_speed=1e-3, parts_when_low=4
    ),
    "standard": Settings(
        1 / 128, resolved_landing=2e-4, solver=Solver(300, 1e-5), rest_speed=5e-4, parts_when_low=4
    ),
    "reference": Settings(1 / 512, resolved_landing=5e-5, solver=Solver(1000, 1e-6), rest_speed=2e-4),
}


def settings_of(preset: str) -> Settings:
    """Settings of a preset.

    Raises
    ------
    InputError
        If there is no preset of this name.
    """
    if preset not in PRESETS:
        raise InputError(
            f"no preset {preset!r}",
            where="preset",
            expected=", ".join(PRESETS),
            remedy="'standard' suits most runs",
        )
    return PRESETS[preset]
