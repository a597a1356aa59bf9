"""Whether clouds show one place, in one unit of length."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from toppling.models.arrays import Array
from toppling.models.errors import refusals
from toppling.models.scan.read import Cloud

_OVERLAP_SHARE = 0.02
"""Points of two stations this near, in sizes of a cloud, show the same place."""
_LEAST_OVERLAP, _LEAST_IN_FILE = 0.05, 0.005
"""Share of a file's points, and of one of its stations', that must show a place that another one shows too: strips of
a flight may lie side by side."""
_SAMPLED, _SAMPLED_OF_STATION = 20_000, 5_000
"""Points of a file, and of a station, that are compared."""
_LEAST_SHARE = 0.01
"""A station with fewer of its file's points changes nothing."""
_LENGTHS_M = {"feet": 0.3048, "inches": 0.0254, "centimetres": 0.01, "millimetres": 0.001}
_FITS_BETTER = 0.2
"""Share of the points that conversion must bring into place to give a file away; known ones gain 0.25 or more."""


_no_overlap = refusals(
    expected="stations of one survey, registered to one coordinate system, in metres",
    remedy="register the stations, or convert what is not in metres, and export again; or leave this one out",
)


def check_overlap(cloud: Cloud) -> None:
    """Refuse stations that do not show the same place, or show it in other units.

    Raises InputError if a file's cloud, or a station of a file, shares next to nothing with the others, or fits them
    better in another unit of length.
    """
    if not cloud.station.any():
        return  # files of one station are pieces of one model
    ends = np.cumsum([points for _, points in cloud.files])
    parts = np.split(cloud.points_m, ends[:-1])
    if len(parts) > 1:
        names, samples = [name for name, _ in cloud.files], [_some(part, _SAMPLED) for part in parts]
        _check(names, samples, cloud.origin_m, _LEAST_OVERLAP)
    names, samples = _stations(cloud)
    if len(samples) > len(parts):
        _check(names, samples, cloud.origin_m, _LEAST_IN_FILE)


def _check(names: list[str], samples: list[Array], origin_m: Array, least: float) -> None:
    """Refuse the one of several clouds that overlaps the others least, if by less than such a share."""
    against = [_Against.of(samples, number) for number in range(len(samples))]
    _refuse_other_units(against, names, origin_m)
    shown = [each.shared() for each in against]
    alone = [number for number, share in enumerate(shown) if share < least]
    if not alone:
        return
    alone.sort(key=lambda number: (shown[number], -against[number].ratio))
    others = [names[number] for number in alone[1:]]
    also = f"; the same holds for {', '.join(others)}" if others else ""
    ratio = against[alone[0]].ratio
    units = "" if 0.4 < ratio < 2.5 else f"; it is {ratio:.3g} times as large: other units?"
    raise _no_overlap("scan.no_overlap", f"does not overlap the other clouds{also}{units}", names[alone[0]])


def _stations(cloud: Cloud) -> tuple[list[str], list[Array]]:
    """Names of the stations, and some points of each."""
    names, samples, start = [], [], 0
    for name, count in cloud.files:
        station = cloud.station[start : start + count]
        sizes = np.bincount(station)
        numbers = np.flatnonzero(sizes)
        for place, number in enumerate(numbers):
            if sizes[number] < _LEAST_SHARE * count:
                continue
            names.append(name + (f", station {place + 1} of {len(numbers)}" if len(numbers) > 1 else ""))
            rows = start + np.flatnonzero(station == number)
            samples.append(cloud.points_m[_some(rows, _SAMPLED_OF_STATION)])
        start += count
    return names, samples


def _some(rows: NDArray, count: int) -> NDArray:
    return rows[:: max(1, len(rows) // count)]


@dataclass(frozen=True, eq=False)
class _Against:
    """One file's points against those of all others."""

    points_m: Array
    others_m: Array
    others_size_m: float
    ratio: float
    rise: float

    @classmethod
    def of(cls, samples: list[Array], number: int) -> "_Against":
        """Compare sizes, in space and in height, with those that are typical of the others."""
        others = [sample for other, sample in enumerate(samples) if other != number]
        size = float(np.median([_size(other) for other in others]))
        rise = float(np.median([_size(other[:, 2:]) for other in others]))
        points = samples[number]
        ratio, steep = _size(points) / size, _size(points[:, 2:]) / max(rise, 1e-9 * size)
        return cls(points, np.concatenate(others), size, ratio, steep)

    def shared(self) -> float:
        """Share of the file's points that show a place of the others, or of theirs that show one of its own."""
        reach = _OVERLAP_SHARE * self.others_size_m
        return max(_near(self.points_m, self.others_m, reach), _near(self.others_m, self.points_m, reach))

    def fit_gained(self, unit: float, origin_m: Array) -> float:
        """How much better file and others fit each other after conversion, 0 where the sizes tell against it.

        The smaller of the two shares counts: through any cloud of sloping ground some points of a smaller one lie on
        a larger one. A wide view and a close one differ in size too, but not in height.
        """
        if not (0.75 < self.ratio * unit < 1.33 and 0.6 < self.rise * unit < 1.67):
            return 0.0
        converted = (self.points_m + origin_m) * unit - origin_m
        reach = _OVERLAP_SHARE * self.others_size_m * min(1.0, self.ratio)
        as_is, after = (
            min(_near(points, self.others_m, reach), _near(self.others_m, points, reach))
            for points in (self.points_m, converted)
        )
        return after - as_is


def _refuse_other_units(against: list[_Against], names: list[str], origin_m: Array) -> None:
    """Blame the file whose conversion brings it and the others together best."""
    gains = [
        (each.fit_gained(unit, origin_m), unit < 1.0, unit, number)
        for number, each in enumerate(against)
        for length in _LENGTHS_M.values()
        for unit in (length, 1.0 / length)
    ]
    # Of two files each fits the other by conversion; that with the larger numbers is not in metres.
    gain, larger, unit, number = max(gains, key=lambda each: (each[0] > _FITS_BETTER, each[1], each[0]))
    if gain > _FITS_BETTER:
        name = next(word for word, length in _LENGTHS_M.items() if length in (unit, 1.0 / unit))
        explanation = (
            f"read as {name} it fits the others" if larger else f"the others, read as {name}, fit it"
        )
        raise _no_overlap(
            "scan.station_in_other_units",
            f"is in other units than the other clouds: {explanation}",
            names[number],
        )


def _size(points: Array) -> float:
    return float(np.linalg.norm(np.ptp(np.quantile(points, [0.02, 0.98], axis=0), axis=0)))


def _near(points: Array, others: Array, reach_m: float) -> float:
    """Share of the points that have one of the others within reach."""
    distance, _ = cKDTree(others).query(points, distance_upper_bound=reach_m)
    return float(np.isfinite(distance).mean())
