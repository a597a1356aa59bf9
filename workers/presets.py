"""Numerical settings of a shake: presets chosen from the measured front of speed against error (docs/accuracy.md)."""

import math
from dataclasses import dataclass

from models.errors import InputError

PHYSICS_VERSION = "5"
"""Part of every job's id: raised whenever the same job may give another answer."""


@dataclass(frozen=True)
class Settings:
    """How finely a shake is resolved.

    Parameters
    ----------
    step_share : float
        Time step over sqrt(R / g), R the rock's half diagonal: rocks of one shape and all sizes are resolved alike.
    resolved_landing : float
        Landings slower than this share of sqrt(g R) are left to the contact solver, with an error of the first order;
        at 3e-3 they carry 1e-5 of the energy of a fall from R.
    iterations : int
        Most iterations of the contact solver in a step. Too few let a rock creep that stands on one corner.
    rest_speed : float
        A rock whose points move slower than this share of sqrt(g R), on feet that can hold it, rests. The solver lets
        a rock on few feet turn by up to 3e-4 of it.
    longest_step_s : float
        Upper bound of the time step, so that a large rock still follows the record.
    """

    step_share: float
    resolved_landing: float
    iterations: int
    rest_speed: float
    longest_step_s: float = 0.016

    def time_step_s(self, half_diagonal_m: float, gravity_m_s2: float) -> float:
        """Time step for a rock of this size, s."""
        return min(self.step_share * math.sqrt(half_diagonal_m / gravity_m_s2), self.longest_step_s)


PRESETS = {
    "fast": Settings(step_share=1 / 96, resolved_landing=3e-3, iterations=20, rest_speed=1e-3),
    "standard": Settings(step_share=1 / 128, resolved_landing=1e-3, iterations=50, rest_speed=5e-4),
    "reference": Settings(step_share=1 / 512, resolved_landing=1e-3, iterations=50, rest_speed=2e-4),
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
