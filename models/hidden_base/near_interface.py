"""Observed parts of rock and pedestal near their interface, and the rim of a base where its side was not seen."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import ConvexHull, cKDTree
from scipy.special import ndtri

from toppling.models.arrays import Array, Flags, Indices
from toppling.models.pedestal import STEEP
from toppling.models.scan.crevice import not_strays
from toppling.models.scan.interface import SECTORS, sectors, widest_gap_deg
from toppling.models.scan.surfels import NEIGHBOURS

_RIM_PER_HEIGHT, _OVER_PER_HEIGHT = 0.06, 0.24
"""Heights over the interface up to which the seen underside shapes the hidden one: anywhere, and over what was seen of
the pedestal, where the gap is known."""
BESIDE_PER_HEIGHT, BESIDE_PER_GAP = 0.01, 0.3
"""A rim was seen to its end where the pedestal was seen so near, plus so many times its gap."""


@dataclass(frozen=True, eq=False)
class NearInterface:
    """Points of rock and pedestal near the interface."""

    low: Array  # (n, 3): the rock's, as u, v, h over the interface
    lit: Array  # (m, 3): the pedestal's
    height_m: float  # of the rock
    # (k, 3): places of the rim below sides that were seen higher up only, u, v, and their standard deviation.
    led_down: Array = field(default_factory=lambda: np.zeros((0, 3)))
    patches: Array = field(default_factory=lambda: np.zeros((0, 3)))  # (p, 3): the rock's surface all over
    apart: tuple[Array, Array] | None = None  # of `seen_apart`


def near_the_interface(rock: Array, pedestal: Array, height_m: float) -> tuple[Flags, Flags]:
    """Which points shape the base: the rock's low ones and the pedestal's beside and below it, without strays.

    Parameters
    ----------
    rock, pedestal : (n, 3) arrays
        Points of each as u, v, h over the interface plane.
    height_m : float
        Height of the rock.
    """
    lit = not_strays(pedestal, alone=6.0)
    low = rock[:, 2] < _OVER_PER_HEIGHT * height_m
    low[low] = not_strays(rock[low])
    high = np.flatnonzero(low & (rock[:, 2] > _RIM_PER_HEIGHT * height_m))
    if lit.any():
        away_m = cKDTree(pedestal[lit, :2]).query(rock[high, :2])[0]
        high = high[away_m > BESIDE_PER_HEIGHT * height_m + BESIDE_PER_GAP * rock[high, 2]]
    low[high] = False
    return low, lit


LEVELS = 24
"""Number of levels over a rock's height at which outlines are taken."""
_LEAST_PATCHES = 3
"""Fewest patches of a level in a direction."""
_FITTED = 8
"""Lowest levels in which a side was seen, which tell its slope."""
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
        side = flat_m[normals[:, 2] < STEEP]
        if len(side) < _LEAST_PATCHES or np.ptp(side[:, 2]) == 0.0:
            return cls(middle_m, np.zeros(LEVELS), np.full((LEVELS, SECTORS), np.nan))
        low_m, high_m = side[:, 2].min(), side[:, 2].max()
        level = np.minimum(LEVELS * (side[:, 2] - low_m) / (high_m - low_m), LEVELS - 1).astype(int)
        offset = side[:, :2] - middle_m
        away_m, cell = np.linalg.norm(offset, axis=1), level * SECTORS + sectors(offset)
        radii = np.full(LEVELS * SECTORS, np.nan)
        for number in np.flatnonzero(np.bincount(cell, minlength=len(radii)) >= _LEAST_PATCHES):
            radii[number] = np.median(away_m[cell == number])
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
            slope, intercept_m = np.polyfit(lowest_m - lowest_m[0], farther_m, 1)
            away_m = mean_m[level] + intercept_m - slope * min(depth_m, span_m)
            turn = (sector + 0.5) * 2.0 * np.pi / SECTORS - np.pi
            direction = np.array([np.cos(turn), np.sin(turn)])
            places.append(np.append(self.middle_m + max(away_m, 0.0) * direction, _SPREAD * depth_m))
        return np.array(places).reshape(-1, 3)

    def _mean_m(self, shown: Indices) -> Array:
        """Mean distance (LEVELS,) of the sides in some directions; between levels that show a side, on the way."""
        at = np.arange(LEVELS)
        known = [np.flatnonzero(np.isfinite(self.radii_m[:, k])) for k in shown]
        profiles = [np.interp(at, own, self.radii_m[own, k]) for k, own in zip(shown, known, strict=True)]
        return np.asarray(np.mean(profiles, axis=0))


DRAWN = 16
"""Outlines that are drawn; lines of the weight take turns."""
_UNSEEN_DEG = 70.0
"""Least width of a range of directions without any of the rim: four feet at corners lie 60 degrees apart."""
_SURMISED_DEG = 50.0
"""Least such range as it looks from the middle of what was seen, from which it is narrower."""
_LEAST_SHARE = 0.1
"""Share of an average direction's points with which the rim was seen in a direction."""
_LOWEST_SHARE = 0.2
"""Share of a direction's points, the lowest, that tell how far the rim is there."""
_LEAST_TURN_DEG, _MOST_TURN_DEG = 25.0, 88.0
"""Least and largest angle between the straight line and an outline at its ends: roughness shows normals that an outline
does not have, and of a side seen from the front alone a half circle is left."""
_FULLEST = 2.5
"""Weight of the fullest drawn outline over that of the circle's arc; of eight known rocks .6 to 2.2."""
_SAMPLES, _DIRECTIONS = 65, 720
"""Places of an arc, and directions in which an outline's radius is kept."""
_LED_SHARE = 0.5
"""Share of the directions without a rim; in fewer, a side seen higher up is the limb of what was seen."""
_HORIZONTAL = 0.3
"""Horizontal part of a normal below which it tells nothing of an outline."""
_MOST_NORMALS = 3000
"""Maximum number of points of a rim whose normals are estimated."""
SIDE_TANGENT = 3.0
"""Slope of the side that rises from a drawn outline, over the pedestal."""


@dataclass(frozen=True, eq=False)
class UnseenSide:
    """Outlines of a rim about a middle, over the range of directions in which nobody saw it."""

    middle_m: Array  # (2,): u, v
    ends_m: Array  # (2, 2): last places of the rim that were seen, counter-clockwise over the unseen range
    radius_m: float  # half of what is seen of the width
    radii_m: Array  # (1 + DRAWN, _DIRECTIONS + 1): of the likeliest outline and of draws, by direction

    @classmethod
    def of(cls, low: Array, normals: Array | None = None, led_down: Array | None = None) -> UnseenSide | None:
        """From points (n, 3) of the rock near its interface, as u, v, h; None for a rim seen around, or too thinly.

        Below a side that was seen higher up the rim goes on as that is led down, in draws farther out or in. What no
        station saw at any height turns through the normals that were not seen, as a circle's arc or, in draws, between
        the straight line and the corner where its tangents meet.

        normals: (k, 3), of the rock's sides; those of the points unless given.
        led_down: (m, 3), of :meth:`SidesSeen.led_down`.
        """
        hull = low[ConvexHull(low[:, :2]).vertices, :2]
        directions, middle_m = normals, hull.mean(axis=0)
        # The middle depends on where the range lies, and the range on the middle.
        for least_deg in (_SURMISED_DEG, _UNSEEN_DEG, _UNSEEN_DEG):
            rim = _Rim.about(middle_m, low, led_down)
            seen = rim.only_seen
            if len(seen.sector) < 2 or seen.unknown_deg[0] < least_deg:
                return None
            ends_m, conic = seen.ends_m, None
            reached = np.vstack([hull, rim.places_m])
            if rim.unknown_deg[0] >= least_deg:
                directions = _normals(low, middle_m) if directions is None else directions
                conic = _Conic.between(rim.ends_m, directions)
                reached = np.vstack([reached, conic.arc_m()[_SAMPLES // 2]])
            # Of what is seen and the likeliest outline.
            axes = np.column_stack(_along_and_back(ends_m))
            low_m, high_m = (reached @ axes).min(axis=0), (reached @ axes).max(axis=0)
            middle_m = axes @ (0.5 * (low_m + high_m))
        rim = _Rim.about(middle_m, low, led_down)
        share = (np.arange(DRAWN) + 0.5) / DRAWN
        radii = [_radii(rim, conic, 0.0, 1.0)]
        radii += [_radii(rim, conic, *drawn) for drawn in zip(ndtri(share), _FULLEST * share, strict=True)]
        return cls(middle_m, ends_m, 0.5 * float(np.ptp(hull @ axes[:, 0])), np.array(radii))

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

    def in_range(self, places_m: Array) -> Flags:
        """Whether places (..., 2 or 3) lie in the unseen range, as seen from the middle."""
        offset = places_m[..., :2] - self.middle_m
        first, last = np.arctan2(*(self.ends_m - self.middle_m).T[::-1])
        into = np.mod(np.arctan2(offset[..., 1], offset[..., 0]) - first, 2.0 * np.pi)
        return np.asarray(into < np.mod(last - first, 2.0 * np.pi))

    @property
    def reach_m(self) -> Array:
        """Lowest and highest u, v of all outlines (2, 2)."""
        return self.middle_m + float(self.radii_m.max()) * np.array([[-1.0, -1.0], [1.0, 1.0]])


def shown_sectors(directions: Array) -> Indices:
    """Sectors (k,) with at least three of some directions (n, 2 or 3), and a tenth of an average sector's."""
    count = np.bincount(sectors(directions), minlength=SECTORS)
    return np.flatnonzero(count >= max(3.0, _LEAST_SHARE * count.mean()))


@dataclass(frozen=True, eq=False)
class _Rim:
    """Observations of a rim about a middle, by sectors of directions."""

    middle_m: Array  # (2,)
    sector: Indices  # (k,), in order
    away_m: Array  # (k,)
    std_m: Array  # (k,), 0 where the rim was seen

    @classmethod
    def about(cls, middle_m: Array, low: Array, led_down: Array | None) -> _Rim:
        """Rim by points (n, 3) near the interface, and by places (m, 3) with their standard deviation elsewhere."""
        sector, away_m = _rim_seen(low, middle_m)
        led = np.zeros((0, 3)) if led_down is None else led_down
        below, first = np.unique(sectors(led[:, :2] - middle_m), return_index=True)
        elsewhere = ~np.isin(below, sector)
        if elsewhere.sum() < _LED_SHARE * (SECTORS - len(sector)):
            elsewhere[:] = False
        led, sector = led[first[elsewhere]], np.append(sector, below[elsewhere])
        order = np.argsort(sector)
        away_m = np.append(away_m, np.linalg.norm(led[:, :2] - middle_m, axis=1))
        std_m = np.append(np.zeros(len(sector) - len(led)), led[:, 2])
        return cls(middle_m, sector[order], away_m[order], std_m[order])

    @property
    def only_seen(self) -> _Rim:
        """Rim without what was not seen."""
        seen = self.std_m == 0.0
        return _Rim(self.middle_m, self.sector[seen], self.away_m[seen], self.std_m[seen])

    @property
    def turn(self) -> Array:
        """Directions (k,), radians."""
        return (self.sector + 0.5) * 2.0 * np.pi / SECTORS - np.pi

    @property
    def places_m(self) -> Array:
        """Places (k, 2)."""
        return self.middle_m + self.away_m[:, None] * np.column_stack([np.cos(self.turn), np.sin(self.turn)])

    @property
    def unknown_deg(self) -> tuple[float, float]:
        """Width of the widest range of directions in which nothing is known, and its middle."""
        return widest_gap_deg(self.sector)

    @property
    def ends_m(self) -> Array:
        """Last places (2, 2) before that range and first after it, counter-clockwise."""
        from_begin = np.mod(self.turn - np.deg2rad(self.unknown_deg[1]), 2.0 * np.pi)
        return self.places_m[[from_begin.argmax(), from_begin.argmin()]]


def _rim_seen(low: Array, middle_m: Array) -> tuple[Indices, Array]:
    """Sectors (k,) in which the rim was seen, and its distance (k,) from a middle."""
    offset = low[:, :2] - middle_m
    sector, away = sectors(offset), np.linalg.norm(offset, axis=1)
    shown = shown_sectors(offset)
    radii = []
    for direction in shown:
        own = sector == direction
        lowest = low[own, 2] <= np.quantile(low[own, 2], _LOWEST_SHARE)
        radii.append(float(np.median(away[own][lowest])))
    return shown, np.array(radii)


def _along_and_back(ends_m: Array) -> tuple[Array, Array]:
    """Unit vectors from the first end to the second, and square to it toward what was not seen."""
    along = (ends_m[1] - ends_m[0]) / np.linalg.norm(ends_m[1] - ends_m[0])
    return along, np.array([along[1], -along[0]])


@dataclass(frozen=True, eq=False)
class _Conic:
    """A conic between two ends: a rational Bezier curve of second degree (Farin 2002)."""

    ends_m: Array  # (2, 2)
    corner_m: Array  # (2,): where the tangents at its ends meet
    weight: float  # of the corner, with which it is a circle's arc

    @classmethod
    def between(cls, ends_m: Array, normals: Array) -> _Conic:
        """Its tangents are square to the first normals that were seen on either side of the straight line's."""
        along, back = _along_and_back(ends_m)
        flat = normals[np.linalg.norm(normals[:, :2], axis=1) > _HORIZONTAL]
        shown = (
            shown_sectors(np.column_stack([flat[:, :2] @ back, flat[:, :2] @ along])) + 0.5
        ) * 360.0 / SECTORS - 180.0
        after = min(shown[shown >= 0.0], default=180.0)
        before = min(-shown[shown <= 0.0], default=180.0)
        turns = np.deg2rad(np.clip([before, after], _LEAST_TURN_DEG, _MOST_TURN_DEG))
        wide_m = float(np.linalg.norm(ends_m[1] - ends_m[0]))
        deep_m = wide_m / (1.0 / np.tan(turns)).sum()
        corner_m = ends_m[0] + deep_m * (back + along / np.tan(turns[0]))
        return cls(ends_m, corner_m, float(np.cos(turns.mean())))

    def arc_m(self, fullness: float = 1.0) -> Array:
        """Places (_SAMPLES, 2) of the curve with so many times the circle's weight."""
        t, weight = np.linspace(0.0, 1.0, _SAMPLES)[:, None], fullness * self.weight
        first, between, last = (1.0 - t) ** 2, 2.0 * weight * t * (1.0 - t), t**2
        whole = first * self.ends_m[0] + between * self.corner_m + last * self.ends_m[1]
        return np.asarray(whole / (first + between + last))


def _radii(rim: _Rim, conic: _Conic | None, out: float, fullness: float) -> Array:
    """Distances (_DIRECTIONS + 1,) from a middle over a whole turn: of a rim and of a conic where nothing is known.

    out: of what was not seen, in standard deviations.
    """
    turn, away_m = rim.turn, np.maximum(rim.away_m + out * rim.std_m, 0.0)
    if conic is not None:
        arc = conic.arc_m(fullness) - rim.middle_m
        of_arc = np.arctan2(arc[:, 1], arc[:, 0])
        first, last = of_arc[[0, -1]]
        elsewhere = np.mod(turn - first, 2.0 * np.pi) > np.mod(last - first, 2.0 * np.pi)
        turn = np.concatenate([of_arc, turn[elsewhere]])
        away_m = np.concatenate([np.linalg.norm(arc, axis=1), away_m[elsewhere]])
    return np.interp(np.linspace(0.0, 2.0 * np.pi, _DIRECTIONS + 1), turn, away_m, period=2.0 * np.pi)


def _normals(points_m: Array, middle_m: Array) -> Array:
    """Normals (k, 3) of planes through the neighbourhood of some of the points (n, 3), away from a middle (2,)."""
    some = points_m[:: max(1, len(points_m) // _MOST_NORMALS)]
    near = some[cKDTree(some).query(some, min(NEIGHBOURS, len(some)))[1]]
    off = near - near.mean(axis=1, keepdims=True)
    normals = np.linalg.eigh(np.einsum("kni,knj->kij", off, off))[1][:, :, 0]
    outward = (normals[:, :2] * (some[:, :2] - middle_m)).sum(axis=1)
    return np.asarray(normals * np.where(outward < 0.0, -1.0, 1.0)[:, None])
