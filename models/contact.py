"""Friction and restitution where a rock touches its pedestal."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Real

from toppling.models.errors import InputError

FRICTION_SPREAD = 0.05
"""Coefficient of variation of friction in a realisation."""


@dataclass(frozen=True)
class ContactProperties:
    """Friction and restitution of the contact."""

    # Coulomb's coefficients, not negative, the kinetic one not above the static one.
    friction_static: float = 0.8
    friction_kinetic: float = 0.8
    restitution: float = 0.0  # Poisson's coefficient, 0 to 1: impulse of restitution over that of compression

    def __post_init__(self) -> None:
        for name, low, high in (
            ("friction_static", 0.0, math.inf),
            ("friction_kinetic", 0.0, self.friction_static),
            ("restitution", 0.0, 1.0),
        ):
            value = getattr(self, name)
            if not (math.isfinite(value) and low <= value <= high):
                raise InputError(
                    "contact.property_out_of_range",
                    f"{name} is {value}",
                    where="contact properties",
                    expected=f"a finite number from {low} to {high}",
                    remedy="rock on rock has friction 0.6 to 1.0 (Byerlee 1978) and restitution near 0",
                )

    @classmethod
    def of(cls, friction: float | Sequence[float], restitution: float = 0.0) -> ContactProperties:
        """Contact properties from one coefficient of friction or a (static, kinetic) pair."""
        static, kinetic = (friction, friction) if isinstance(friction, float | Real) else friction
        return cls(float(static), float(kinetic), float(restitution))
