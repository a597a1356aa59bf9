"""What was seen of rock and pedestal near their interface, and of sides that were seen higher up only."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from toppling.models.arrays import Array, Flags, Indices
from toppling.models.scan.crevice import not_strays
from toppling.models.scan.doubt import SECTORS, sectors

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


def near_the_interface(rock: Array, pedestal: Array, height_m: float) -> tuple[Flags, Flags]:
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


LEVELS = 24
"""Over a rock's height, in which outlines are taken."""
_LEAST_PATCHES = 3
"""Of a level in a direction."""
_FITTED = 8
"""Lowest levels in which a side was seen, which tell its slope."""
_STEEP = 0.5
"""The same for a side that is led down: it lies within 30 degrees of the vertical."""
_LEAST_SPAN = 0.35
"""Height over which a side must have been seen over the depth that it is led down: the far side's crown is no side."""
_SPREAD = 0.08
"""Standard deviation of an outline over the depth that it was led down: sides seldom turn by more than 10 degrees."""


@dataclass(frozen=True, eq=False)
class SidesSeen:
    """How far a rock's sides are from a middle, by level and direction."""

    middle_m: Array  # (2,): u, v
    levels_m: Array  # (LEVELS,): h
    radii_m: Array  # (LEVELS, SECTORS); NaN where nobody saw the side

    @classmethod
    def of(cls, flat_m: Array, normals: Array, middle_m: Array) -> SidesSeen:
        """From patches (n, 3) of a rock, as u, v, h, and their normals (n, 3)."""
        side = flat_m[normals[:, 2] < _STEEP]
        if len(side) < _LEAST_PATCHES or np.ptp(side[:, 2]) == 0.0:
            return cls(middle_m, np.zeros(LEVELS), np.full((LEVELS, SECTORS), np.nan))
        low_m, high_m = side[:, 2].min(), side[:, 2].max()
        level = np.minimum(LEVELS * (side[:, 2] - low_m) / (high_m - low_m), LEVELS - 1).astype(int)
        away_m, cell = (
            np.linalg.norm(side[:, :2] - middle_m, axis=1),
            level * SECTORS + sectors(side[:, :2] - middle_m),
        )
        radii = np.full(LEVELS * SECTORS, np.nan)
        for each in np.flatnonzero(np.bincount(cell, minlength=len(radii)) >= _LEAST_PATCHES):
            radii[each] = np.median(away_m[cell == each])
        levels_m = low_m + (np.arange(LEVELS) + 0.5) * (high_m - low_m) / LEVELS
        return cls(middle_m, levels_m, radii.reshape(LEVELS, SECTORS))

    def led_down(self, height_m: float) -> Array:
        """Places (k, 3) of the outline at a height below sides that were seen higher up only: u, v, standard deviation.

        Such a side goes on as the sides do that were seen at both heights, and with the slope that it had against them.
        """
        level = int(np.abs(self.levels_m - height_m).argmin())
        seen = np.isfinite(self.radii_m)
        places: list[Array] = []
        if not seen[level].any():
            return np.zeros((0, 3))
        mean_m = self._mean_m(np.flatnonzero(seen[level]))
        for sector in np.flatnonzero(~seen[level] & seen[level:].any(axis=0)):
            own = level + np.flatnonzero(seen[level:, sector])
            depth_m, span_m = self.levels_m[own[[0, -1]]] - [height_m, self.levels_m[own[0]]]
            if span_m < _LEAST_SPAN * depth_m:
                continue
            farther_m = (self.radii_m[:, sector] - mean_m)[own[:_FITTED]]
            lowest_m = self.levels_m[own[:_FITTED]]
            slope, foot_m = np.polyfit(lowest_m - lowest_m[0], farther_m, 1)
            away_m = mean_m[level] + foot_m - slope * min(depth_m, span_m)
            turn = (sector + 0.5) * 2.0 * np.pi / SECTORS - np.pi
            way = np.array([np.cos(turn), np.sin(turn)])
            places.append(np.append(self.middle_m + max(away_m, 0.0) * way, _SPREAD * depth_m))
        return np.array(places).reshape(-1, 3)

    def _mean_m(self, shown: Indices) -> Array:
        """Mean distance (LEVELS,) of the sides in some directions; between levels that show a side, on the way."""
        at = np.arange(LEVELS)
        known = [np.flatnonzero(np.isfinite(self.radii_m[:, k])) for k in shown]
        each = [np.interp(at, own, self.radii_m[own, k]) for k, own in zip(shown, known, strict=True)]
        return np.asarray(np.mean(each, axis=0))
