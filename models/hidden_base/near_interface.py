"""What was seen of rock and pedestal near their interface, which shapes the hidden base."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from toppling.models.arrays import Array
from toppling.models.scan.crevice import not_strays

_RIM_PER_HEIGHT = 0.06
"""Height over the interface up to which the seen underside shapes the hidden one."""


@dataclass(frozen=True, eq=False)
class NearInterface:
    """Points of rock and pedestal near the interface."""

    low: Array  # (n, 3): the rock's, as u, v, h over the interface
    lit: Array  # (m, 3): the pedestal's
    height_m: float  # of the rock
    # (k, 3): places of the rim below sides that were seen higher up only, u, v, and their standard deviation.
    led_down: Array = field(default_factory=lambda: np.zeros((0, 3)))


def near_the_interface(
    rock: Array, pedestal: Array, height_m: float
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which points shape the base: the rock's low ones and the pedestal's beside and below it, without strays.

    Parameters
    ----------
    rock, pedestal : (n, 3) arrays
        Points of each as u, v, h over the interface plane.
    height_m : float
        Height of the rock.
    """
    low = rock[:, 2] < _RIM_PER_HEIGHT * height_m
    lit = np.abs(pedestal[:, 2]) < 0.5 * _RIM_PER_HEIGHT * height_m
    low[low] = not_strays(rock[low])
    lit[lit] = not_strays(pedestal[lit], alone=6.0)
    return low, lit
