"""Where a rock's rim goes on over a side that no station saw: as the outline that was seen does, within what it may."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull
from scipy.stats import qmc

from toppling.models.arrays import Array
from toppling.models.frames import horizontal_unit_vector
from toppling.models.scan.doubt import SECTORS, sectors, widest_gap_deg

DRAWN = 16
"""Outlines that are drawn; lines of the weight take turns."""
_UNSEEN_DEG = 70.0
"""From so wide a range without any of the rim on: four feet at the corners of a block lie 60 degrees apart."""
_SURMISED_DEG = 50.0
"""The same from the middle of what was seen, from which such a range looks narrower."""
_LEAST_SHARE = 0.1
"""Of the points of an average direction, in one in which the rim was seen."""
_LOWEST_SHARE = 0.2
"""Of the points in a direction, the lowest, which tell how far the rim is there."""
_WAVES = 8
"""Around an outline."""
_FIRST_SHARE, _SECOND_SHARE, _HIGHER_SHARE = 0.15, 0.15, 0.6
"""Standard deviation of an outline's waves over its radius: of the mean and the first, of the second, and of a higher
one times the square of its number. An ellipse whose axes are as 3 to 2 has a second wave of .2."""
_NOISE_SHARE = 0.05
"""The same of the radius seen in one direction."""
_WIDEST_SHARE = 1.6
"""Of the radius, to which a drawn outline reaches at most."""
SIDE_TANGENT = 3.0
"""Of the side that rises from a drawn outline, over the pedestal."""


@dataclass(frozen=True, eq=False)
class UnseenSide:
    """Outlines of a rim about a middle, over the range of directions in which nobody saw it."""

    middle_m: Array  # (2,): u, v
    ends_m: Array  # (2, 2): last places of the rim that were seen, counter-clockwise over the unseen range
    radius_m: float
    mean: Array  # (2 _WAVES + 1,): waves of the likeliest outline, over the radius
    drawn: Array  # (DRAWN, 2 _WAVES + 1): the same of draws

    @classmethod
    def of(cls, low: Array) -> UnseenSide | None:
        """From points (n, 3) of the rock near its interface, as u, v, h; None where the rim was seen around.

        A base is taken to be as deep as it is wide, seen from the side that was seen, but for what its waves add.
        """
        hull = low[ConvexHull(low[:, :2]).vertices, :2]
        middle_m, radius_m = hull.mean(axis=0), 0.0
        # The middle depends on where the range lies, and the range on the middle.
        for least_deg in (_SURMISED_DEG, _UNSEEN_DEG, _UNSEEN_DEG):
            range_deg, toward_deg = widest_gap_deg(_shown(low[:, :2] - middle_m))
            if range_deg < least_deg:
                return None
            toward = horizontal_unit_vector(toward_deg)[:2]
            across = hull @ [-toward[1], toward[0]]
            radius_m = 0.5 * float(np.ptp(across))
            front = float((hull @ toward).min()) + radius_m
            middle_m = front * toward + 0.5 * (across.min() + across.max()) * np.array(
                [-toward[1], toward[0]]
            )
        turn, away_m = _rim_seen(low, middle_m)
        begin = np.deg2rad(toward_deg)
        from_begin = np.mod(turn - begin, 2.0 * np.pi)
        ends = [from_begin.argmax(), from_begin.argmin()]
        mean, covariance = _conditioned(turn, away_m / radius_m - 1.0)
        return cls(
            middle_m,
            middle_m + away_m[ends, None] * np.column_stack([np.cos(turn[ends]), np.sin(turn[ends])]),
            radius_m,
            mean,
            qmc.MultivariateNormalQMC(mean, covariance, rng=np.random.default_rng([2026, 42])).random(DRAWN),
        )

    def share_out(self, places_m: Array, number: int | None = None) -> Array:
        """Distances (...) of places (..., 2 or 3) from the middle over that of a draw's outline, or the likeliest's.

        Where the rim was not seen no outline lies within the straight line between its ends.
        """
        offset = places_m[..., :2] - self.middle_m
        turn = np.arctan2(offset[..., 1], offset[..., 0])
        waves = self.mean if number is None else self.drawn[number % DRAWN]
        radius = np.minimum(1.0 + _features(turn) @ waves, _WIDEST_SHARE) * self.radius_m
        near, far = np.linalg.norm(self.ends_m - self.middle_m, axis=1)
        into, wide = self._into(turn)
        if wide < np.pi:
            chord = near * far * np.sin(wide) / (near * np.sin(into) + far * np.sin(wide - into))
            radius = np.where(into < wide, np.maximum(radius, chord), radius)
        return np.asarray(np.linalg.norm(offset, axis=-1) / np.maximum(radius, _LEAST_SHARE * self.radius_m))

    def beyond_m(self, places_m: Array, number: int | None = None) -> Array:
        """How far places (..., 2 or 3) lie beyond such an outline, in the unseen range; elsewhere 0."""
        share = self.share_out(places_m, number)
        away = np.linalg.norm(places_m[..., :2] - self.middle_m, axis=-1)
        beyond = away * (1.0 - 1.0 / np.maximum(share, 1.0))
        return np.where(self.in_range(places_m), beyond, 0.0)

    def in_range(self, places_m: Array) -> NDArray[np.bool_]:
        """Whether places (..., 2 or 3) lie in the unseen range, as seen from the middle."""
        offset = places_m[..., :2] - self.middle_m
        into, wide = self._into(np.arctan2(offset[..., 1], offset[..., 0]))
        return np.asarray(into < wide)

    def _into(self, turn: Array) -> tuple[Array, float]:
        """How far directions lie beyond the unseen range's begin, and how wide it is, radians."""
        first, last = np.arctan2(*(self.ends_m - self.middle_m).T[::-1])
        return np.mod(turn - first, 2.0 * np.pi), float(np.mod(last - first, 2.0 * np.pi))

    @property
    def reach_m(self) -> Array:
        """Lowest and highest u, v of all outlines (2, 2)."""
        return self.middle_m + _WIDEST_SHARE * self.radius_m * np.array([[-1.0, -1.0], [1.0, 1.0]])


def _shown(ways: Array) -> NDArray[np.int64]:
    count = np.bincount(sectors(ways), minlength=SECTORS)
    return np.flatnonzero(count >= max(3.0, _LEAST_SHARE * count.mean()))


def _rim_seen(low: Array, middle_m: Array) -> tuple[Array, Array]:
    """Directions (k,), radians, in which the rim was seen, and its distance (k,) from a middle."""
    offset = low[:, :2] - middle_m
    sector, away = sectors(offset), np.linalg.norm(offset, axis=1)
    shown = _shown(offset)
    radii = []
    for each in shown:
        own = sector == each
        foot = low[own, 2] <= np.quantile(low[own, 2], _LOWEST_SHARE)
        radii.append(float(np.median(away[own][foot])))
    return (shown + 0.5) * 2.0 * np.pi / SECTORS - np.pi, np.array(radii)


def _features(turn: Array) -> Array:
    waves = np.arange(1, _WAVES + 1) * turn[..., None]
    return np.concatenate([np.ones((*turn.shape, 1)), np.cos(waves), np.sin(waves)], axis=-1)


def _conditioned(turn: Array, seen: Array) -> tuple[Array, Array]:
    """Mean (m,) and covariance (m, m) of an outline's waves that agree with radii seen in some directions."""
    number = np.arange(1, _WAVES + 1)
    std = np.where(number == 1, _FIRST_SHARE, np.where(number == 2, _SECOND_SHARE, _HIGHER_SHARE / number**2))
    prior = np.concatenate([[_FIRST_SHARE], std, std])
    features = _features(turn)
    covariance = np.linalg.inv(features.T @ features / _NOISE_SHARE**2 + np.diag(1.0 / prior**2))
    return covariance @ features.T @ seen / _NOISE_SHARE**2, 0.5 * (covariance + covariance.T)
