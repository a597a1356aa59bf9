"""Where a rock's rim goes on over a side that no station saw: as the outline that was seen does, within what it may."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, cKDTree

from toppling.models.arrays import Array
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
_LEAST_TURN_DEG, _MOST_TURN_DEG = 25.0, 88.0
"""Between the straight line and an outline at its ends: roughness shows normals that an outline does not have, and of a
side seen from the front alone a half circle is left."""
_FULLEST = 2.5
"""Weight of the fullest drawn outline over that of the circle's arc; of eight known rocks .6 to 2.2."""
_SAMPLES, _DIRECTIONS = 65, 720
"""Places of an arc, and directions in which an outline's radius is kept."""
_HORIZONTAL = 0.3
"""Horizontal part of a normal below which it tells nothing of an outline."""
_MOST_NORMALS, _NEIGHBOURS = 3000, 16
"""Of a foot's points, and of points that a normal is of."""
SIDE_TANGENT = 3.0
"""Of the side that rises from a drawn outline, over the pedestal."""


@dataclass(frozen=True, eq=False)
class UnseenSide:
    """Outlines of a rim about a middle, over the range of directions in which nobody saw it."""

    middle_m: Array  # (2,): u, v
    ends_m: Array  # (2, 2): last places of the rim that were seen, counter-clockwise over the unseen range
    radius_m: float  # half of what is seen of the width
    radii_m: Array  # (1 + DRAWN, _DIRECTIONS + 1): of the likeliest outline and of draws, by direction

    @classmethod
    def of(cls, low: Array, normals: Array | None = None) -> UnseenSide | None:
        """From points (n, 3) of the rock near its interface, as u, v, h; None where the rim was seen around.

        What was not seen turns through the normals that were not seen, as a circle's arc or, in draws, between the
        straight line and the corner where its tangents meet.

        normals: (k, 3), of the rock's sides; those of the points unless given.
        """
        hull = low[ConvexHull(low[:, :2]).vertices, :2]
        ways, middle_m = normals, hull.mean(axis=0)
        # The middle depends on where the range lies, and the range on the middle.
        for least_deg in (_SURMISED_DEG, _UNSEEN_DEG, _UNSEEN_DEG):
            range_deg, toward_deg = widest_gap_deg(_shown(low[:, :2] - middle_m))
            if range_deg < least_deg:
                return None
            turn, away_m = _rim_seen(low, middle_m)
            from_begin = np.mod(turn - np.deg2rad(toward_deg), 2.0 * np.pi)
            ends = [from_begin.argmax(), from_begin.argmin()]
            ends_m = middle_m + away_m[ends, None] * _directions(turn[ends])
            ways = _normals(low, middle_m) if ways is None else ways
            corner_m, weight = _corner(ends_m, ways)
            along, back = _along_and_back(ends_m)
            across, deepest = hull @ along, _arc(ends_m, corner_m, weight)[_SAMPLES // 2] @ back
            # Of what is seen and the likeliest outline.
            middle_m = (
                0.5 * (deepest + (hull @ back).min()) * back + 0.5 * (across.min() + across.max()) * along
            )
        turn, away_m = _rim_seen(low, middle_m)
        drawn = weight * _FULLEST * (np.arange(DRAWN) + 0.5) / DRAWN
        arcs = [_arc(ends_m, corner_m, each) - middle_m for each in (weight, *drawn)]
        return cls(
            middle_m,
            ends_m,
            0.5 * float(np.ptp(across)),
            np.array([_radii(arc, turn, away_m) for arc in arcs]),
        )

    def share_out(self, places_m: Array, number: int | None = None) -> Array:
        """Distances (...) of places (..., 2 or 3) from the middle over that of a draw's outline, or the likeliest's.

        Where the rim was not seen no outline lies within the straight line between its ends.
        """
        offset = places_m[..., :2] - self.middle_m
        turn = np.mod(np.arctan2(offset[..., 1], offset[..., 0]), 2.0 * np.pi)
        radii = self.radii_m[0 if number is None else 1 + number % DRAWN]
        radius = np.interp(turn, np.linspace(0.0, 2.0 * np.pi, _DIRECTIONS + 1), radii)
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
        return self.middle_m + float(self.radii_m.max()) * np.array([[-1.0, -1.0], [1.0, 1.0]])


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


def _directions(turn: Array) -> Array:
    return np.column_stack([np.cos(turn), np.sin(turn)])


def _along_and_back(ends_m: Array) -> tuple[Array, Array]:
    """Unit vectors from the first end to the second, and square to it toward what was not seen."""
    along = (ends_m[1] - ends_m[0]) / np.linalg.norm(ends_m[1] - ends_m[0])
    return along, np.array([along[1], -along[0]])


def _corner(ends_m: Array, normals: Array) -> tuple[Array, float]:
    """Where the tangents at both ends meet (2,), and the weight of the arc between them that is a circle's.

    The tangents are square to the first normals that were seen on either side of the straight line's.
    """
    along, back = _along_and_back(ends_m)
    flat = normals[np.linalg.norm(normals[:, :2], axis=1) > _HORIZONTAL]
    shown = (
        _shown(np.column_stack([flat[:, :2] @ back, flat[:, :2] @ along])) + 0.5
    ) * 360.0 / SECTORS - 180.0
    after = min(shown[shown >= 0.0], default=180.0)
    before = min(-shown[shown <= 0.0], default=180.0)
    turns = np.deg2rad(np.clip([before, after], _LEAST_TURN_DEG, _MOST_TURN_DEG))
    wide_m = float(np.linalg.norm(ends_m[1] - ends_m[0]))
    deep_m = wide_m / (1.0 / np.tan(turns)).sum()
    corner_m = ends_m[0] + deep_m * (back + along / np.tan(turns[0]))
    return corner_m, float(np.cos(turns.mean()))


def _arc(ends_m: Array, corner_m: Array, weight: float) -> Array:
    """Places (_SAMPLES, 2) of a conic between two ends: a rational Bezier curve of second degree (Farin 2002)."""
    t = np.linspace(0.0, 1.0, _SAMPLES)[:, None]
    first, between, last = (1.0 - t) ** 2, 2.0 * weight * t * (1.0 - t), t**2
    return np.asarray((first * ends_m[0] + between * corner_m + last * ends_m[1]) / (first + between + last))


def _radii(arc_m: Array, turn: Array, away_m: Array) -> Array:
    """Distances (_DIRECTIONS + 1,) from a middle over a whole turn: of an arc about it, elsewhere of the rim seen."""
    of_arc = np.arctan2(arc_m[:, 1], arc_m[:, 0])
    first, last = of_arc[[0, -1]]
    elsewhere = np.mod(turn - first, 2.0 * np.pi) > np.mod(last - first, 2.0 * np.pi)
    return np.interp(
        np.linspace(0.0, 2.0 * np.pi, _DIRECTIONS + 1),
        np.concatenate([of_arc, turn[elsewhere]]),
        np.concatenate([np.linalg.norm(arc_m, axis=1), away_m[elsewhere]]),
        period=2.0 * np.pi,
    )


def _normals(points_m: Array, middle_m: Array) -> Array:
    """Normals (k, 3) of planes through the neighbourhood of some of the points (n, 3), away from a middle (2,)."""
    some = points_m[:: max(1, len(points_m) // _MOST_NORMALS)]
    near = some[cKDTree(some).query(some, min(_NEIGHBOURS, len(some)))[1]]
    off = near - near.mean(axis=1, keepdims=True)
    normals = np.linalg.eigh(np.einsum("kni,knj->kij", off, off))[1][:, :, 0]
    outward = (normals[:, :2] * (some[:, :2] - middle_m)).sum(axis=1)
    return np.asarray(normals * np.where(outward < 0.0, -1.0, 1.0)[:, None])
