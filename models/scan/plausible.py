"""What no cloud of a rock has: too few points, degrees, coordinates in single precision or about the Earth's centre."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from toppling.models.arrays import bounds_of
from toppling.models.errors import InputError
from toppling.models.lengths import in_degrees
from toppling.models.scan.steps import single_precision_step

MINIMUM_POINTS = 1000
"""Fewer points than this cannot show a rock, its pedestal and the crevice between them."""
_COARSEST_STEP_M = 0.01
"""Coordinates stored in steps wider than this have lost the crevice."""
_DEGREES_PER_HEIGHT = 1e-3
"""Clouds so much narrower than high are none of a rock in one unit: x and y are degrees."""

_EARTH_AXES_M = np.array([6378137.0, 6378137.0, 6356752.3])
"""Half axes of the ellipsoid WGS 84."""
_FROM_ELLIPSOID_M = 12_000.0
"""Dry land lies nearer to it."""
_NO_HEIGHT_M = 9_000.0
"""No height of a survey is larger: z is none."""


def check_points(
    points: NDArray[np.float64], path: Path, left_out: Mapping[str, int], scale: tuple[float, float]
) -> None:
    """Refuse points, in the file's unit, that are no cloud of a rock.

    left_out: how many others the file holds, by what they are.
    Raises InputError if they are few, one and the same, in degrees, or stored in single precision far from zero.
    """
    if len(points) < MINIMUM_POINTS:
        others = [f"{count} that {what.rstrip(',')}" for what, count in left_out.items() if count]
        remedy = "check that the export was complete and that the file's extension names its format"
        if len(points) + sum(left_out.values()) >= MINIMUM_POINTS:
            remedy = f"export again so that they do not count as points that {_of_most(left_out).rstrip(',')}"
        raise InputError(
            f"holds {', and '.join([f'{len(points)} points', *others])}",
            where=str(path),
            expected=f"at least {MINIMUM_POINTS}",
            remedy=remedy,
        )
    low, high = bounds_of(points)
    size = high - low
    if not size.any():
        raise InputError(
            "all points are one and the same",
            where=str(path),
            expected="points of a rock and its pedestal",
            remedy="export the cloud again",
        )
    level = np.sort(np.maximum(-low, high)[:2])  # latitude is the smaller one, or comes first
    if 0.0 < size[:2].max() < _DEGREES_PER_HEIGHT * size[2] and level[0] <= 90.0 and level[1] <= 360.0:
        raise in_degrees(f"x and y span {size[0]:.3g} and {size[1]:.3g}, heights {size[2]:.3g}", str(path))
    step = single_precision_step(points) * scale[0]
    if step > _COARSEST_STEP_M:
        if not (points % 1.0).any():
            raise InputError(
                f"coordinates are whole numbers: they come in steps of {scale[0]:.3g} m",
                where=str(path),
                expected=f"steps of at most {_COARSEST_STEP_M} m",
                remedy="export again with more decimals, or with a smaller scale (LAS); if the numbers are in a "
                "smaller unit, name it by --units",
            )
        raise InputError(
            f"survey coordinates are stored in single precision, in steps of {step:.3g} m",
            where=str(path),
            expected=f"steps of at most {_COARSEST_STEP_M} m",
            remedy="export in double precision (LAZ, XYZ, PLY with doubles), or with an offset taken away",
        )


def _of_most(left_out: Mapping[str, int]) -> str:
    return max(left_out, key=lambda what: left_out[what])


def check_returns(points: NDArray[np.float64], path: Path) -> None:
    """Refuse beams without a return that are written as points at the origin, far from where anything was seen.

    Raises InputError if there are such points.
    """
    nothing = points[:, 0] == 0.0
    if nothing.any():
        nothing &= (points[:, 1] == 0.0) & (points[:, 2] == 0.0)
    if not nothing.any():
        return
    low, high = bounds_of(points[~nothing])
    away = np.linalg.norm(np.maximum(np.maximum(low, -high), 0.0))
    if away > np.linalg.norm(high - low):
        raise InputError(
            f"{int(nothing.sum())} points lie at 0, 0, 0, {away:.3g} m from all others",
            where=str(path),
            expected="points that a beam came back from",
            remedy="leave beams without a return out of the export, or delete the points at 0, 0, 0",
        )


def is_geocentric(points_m: NDArray[np.float64]) -> bool:
    """Whether points (n, 3), metres, lie on the Earth about its centre: z points to the pole, and is no height."""
    place = _middle(points_m)
    from_ellipsoid_m = (np.linalg.norm(place / _EARTH_AXES_M) - 1.0) * _EARTH_AXES_M[0]
    return bool(abs(place[2]) > _NO_HEIGHT_M and abs(from_ellipsoid_m) < _FROM_ELLIPSOID_M)


def _middle(points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Median place of some of the points: all of twenty million would take a second."""
    return np.nanmedian(points_m[:: max(1, len(points_m) // 10_000)], axis=0)


def check_axes(points_m: NDArray[np.float64], path: Path) -> None:
    """Refuse points (n, 3), metres, about the Earth's centre: raises InputError with the way upward."""
    if not is_geocentric(points_m):
        return
    up = _middle(points_m) / _EARTH_AXES_M**2
    way = ",".join(f"{each:.6f}" for each in up / np.linalg.norm(up))
    raise InputError(
        "coordinates are about the Earth's centre (geocentric, as EPSG:4978): z points to the pole, not upward",
        where=str(path),
        expected="x east, y north and z up",
        remedy="export in a projected coordinate system, such as UTM, with heights; or give "
        f"--up={way}, the way upward there: x and y of the scene are then level, but not east and north",
    )
