"""Properties that no cloud of a rock has: few points, degrees, the frame of the Earth, coordinates in coarse steps."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from toppling.models.arrays import Array, Flags, Indices, bounds_of, distinct
from toppling.models.errors import InputError
from toppling.models.lengths import in_degrees
from toppling.models.rock import COARSEST_PER_HEIGHT

_REPORTED_PER_HEIGHT = 1e-3
"""Step of coordinates, over the rock's height, above which its effect is reported."""
_SAMPLE = 200_000
_MULTIPLES = 0.9
"""Share of the distances between neighbouring values that must be multiples of a step."""
_DRAWN = 1.5
"""Steps along a mesh's median edge below which it was drawn in them: rounded so, many triangles would have no area."""


def coordinate_steps(points: Array) -> Array:
    """Step (3,) in which each coordinate of points (n, 3) comes, 0 where none shows.

    Examples
    --------
    >>> coordinate_steps(np.random.default_rng(1).uniform(0.0, 5.0, (3000, 3)).round(2)).round(6)
    array([0.01, 0.01, 0.01])
    """
    finite = points if np.isfinite(points.sum()) else points[np.isfinite(points).all(axis=1)]
    sample = finite[:: max(1, len(finite) // _SAMPLE)]
    sample = sample[~marked_unmeasured(sample)]
    if len(sample) < 3:
        return np.zeros(3)
    return np.maximum([_step(sample[:, axis]) for axis in range(3)], _single_precision(sample))


def steps_of_mesh(vertices: Array, faces: Indices) -> Array:
    """Steps (3,) of the vertices (n, 3) of triangles (m, 3); a mesh whose edges are a step wide was drawn so."""
    steps = coordinate_steps(vertices)
    edges = np.abs(vertices[faces] - vertices[np.roll(faces, 1, axis=1)]).reshape(-1, 3)
    for axis in np.flatnonzero(steps):
        along = edges[edges[:, axis] > 0.0, axis]
        if len(along) and np.median(along) < _DRAWN * steps[axis]:
            steps[axis] = 0.0
    return np.maximum(steps, _single_precision(vertices[:: max(1, len(vertices) // _SAMPLE)]))


def _single_precision(sample: Array) -> Array:
    single = sample.astype(np.float32)
    steps = np.spacing(np.abs(single).max(axis=0)).astype(float)
    return np.where((single == sample).all(axis=0), steps, 0.0)


def _step(values: Array) -> float:
    """Step of one coordinate: the widest of some candidates that most distances are multiples of."""
    apart = np.diff(distinct(values))
    apart = apart[apart > 1e-12 * np.abs(values).max()]
    if len(apart) < 3:
        return 0.0
    for step in np.quantile(apart, [0.5, 0.1, 0.01, 0.0], method="lower"):
        counts = apart / step
        # Beyond a hundred steps a distance is near a multiple of anything.
        near = counts < 100.0
        if near.mean() > _MULTIPLES and (np.abs(counts - counts.round()) < 0.02)[near].mean() > _MULTIPLES:
            return float(step)
    return 0.0


def step_note(step_m: float, height_m: float, where: str = "coordinates") -> str:
    """Effect of the steps of coordinates on a rock's statics; empty where they are fine.

    step_m, height_m: widest step of the clouds, height of the rock. where: the file that has it.
    Raises InputError if they are so wide that the crevice is lost.
    """
    if step_m > COARSEST_PER_HEIGHT * height_m:
        raise InputError(
            "coordinates.too_coarse",
            f"coordinates come in steps of {step_m:.3g} m, and the rock is {height_m:.3g} m high",
            where=where,
            expected=f"steps of at most {COARSEST_PER_HEIGHT * height_m:.2g} m, a hundredth of the rock's height; "
            f"{_REPORTED_PER_HEIGHT * height_m:.1g} m or less lose nothing",
            remedy="export again with more decimals, a smaller scale (LAS), in double precision, or with an offset "
            "taken away",
        )
    if step_m <= _REPORTED_PER_HEIGHT * height_m:
        return ""
    # A rock topples at g r / z: the arm r is half a step off, and its centre of mass about half the height z up.
    return (
        f"coordinates come in steps of {step_m:.2g} m, 1/{height_m / step_m:.0f} of the rock's height: of the gap and "
        f"the bumps below the rock nothing finer was stored, heights and the edges that it turns on are uncertain by "
        f"up to {0.5 * step_m:.2g} m, and with them the least toppling acceleration by {step_m / height_m:.1g} g; "
        "export with more decimals or in double precision if the survey has them"
    )


def mesh_note(edge_m: float, patch_m: float) -> str:
    """Effect of a mesh of rock and pedestal on the rock's statics; empty where its edges are short, or for points.

    edge_m: median edge near the interface, 0 for points. patch_m: width of the patches in which the rock is seen.
    """
    if edge_m <= patch_m:
        return ""
    return (
        f"rock and pedestal are one mesh, with edges of {edge_m:.2g} m where they meet: it closes crevices that are a "
        "few of these wide, so that the rock may touch farther in, and topple sooner, than the intervals say; give the "
        "points that the mesh was made from, or scan the crevice more finely"
    )


MINIMUM_POINTS = 1000
"""Fewer points than this cannot show a rock, its pedestal and the crevice between them."""
_COARSEST_STEP_M = 0.01
"""Coordinates stored in steps wider than this have lost the crevice."""
_DEGREES_PER_HEIGHT = 1e-3
"""Clouds so much narrower than high are none of a rock in one unit: x and y are degrees."""

_EARTH_AXES_M = np.array([6378137.0, 6378137.0, 6356752.3])
"""Half axes of the ellipsoid WGS 84."""
_NO_DATA = (-9999.0, -99999.0, -32768.0)
"""Numbers that stand for none, and a size that no coordinate on Earth has in any unit."""
_NO_COORDINATE = 1e12
_NO_HEIGHT_M = 9_000.0
"""Largest height of dry land over the ellipsoid, rounded up."""


def check_points(points: Array, path: Path, left_out: Mapping[str, int], scale: tuple[float, float]) -> None:
    """Refuse points, in the file's unit, that are no cloud of a rock.

    left_out: how many others the file holds, by what they are.
    Raises InputError if they are few, one and the same, in degrees, or stored in single precision far from zero.
    """
    if len(points) < MINIMUM_POINTS:
        others = [f"{count} that {what.rstrip(',')}" for what, count in left_out.items() if count]
        remedy = "check that the export was complete and that the file's extension names its format"
        if len(points) + sum(left_out.values()) >= MINIMUM_POINTS:
            most = max(left_out, key=left_out.__getitem__)
            remedy = f"export again so that they do not count as points that {most.rstrip(',')}"
        raise InputError(
            "cloud.too_few_points",
            f"holds {', and '.join([f'{len(points)} points', *others])}",
            where=str(path),
            expected=f"at least {MINIMUM_POINTS}",
            remedy=remedy,
        )
    low, high = bounds_of(points)
    size = high - low
    if not size.any():
        raise InputError(
            "cloud.one_place",
            "all points are one and the same",
            where=str(path),
            expected="points of a rock and its pedestal",
            remedy="export the cloud again",
        )
    level = np.sort(np.maximum(-low, high)[:2])  # latitude is the smaller one, or comes first
    if 0.0 < size[:2].max() < _DEGREES_PER_HEIGHT * size[2] and level[0] <= 90.0 and level[1] <= 360.0:
        raise in_degrees(f"x and y span {size[0]:.3g} and {size[1]:.3g}, heights {size[2]:.3g}", str(path))
    sample = points[:: max(1, len(points) // 10_000)]
    step = float(_single_precision(sample).max(initial=0.0)) * scale[0]
    if step > _COARSEST_STEP_M:
        if not (points % 1.0).any():
            raise InputError(
                "coordinates.too_coarse",
                f"coordinates are whole numbers: they come in steps of {scale[0]:.3g} m",
                where=str(path),
                expected=f"steps of at most {_COARSEST_STEP_M} m",
                remedy="export again with more decimals, or with a smaller scale (LAS); if the numbers are in a "
                "smaller unit, name it by --units",
            )
        raise InputError(
            "coordinates.too_coarse",
            f"survey coordinates are stored in single precision, in steps of {step:.3g} m",
            where=str(path),
            expected=f"steps of at most {_COARSEST_STEP_M} m",
            remedy="export in double precision (LAZ, XYZ, PLY with doubles), or with an offset taken away",
        )


def marked_unmeasured(points: Array) -> Flags:
    """Which points (n, 3), in the file's unit, hold a number that programs write where nothing was measured.

    It is one only where it lies farther from all other points than these lie apart.

    Examples
    --------
    >>> marked_unmeasured(np.array([[1.0, 2.0, 3.0], [4.0, 5.0, -9999.0]])).tolist()
    [False, True]
    """
    none = np.zeros(len(points), bool)
    bounds = bounds_of(points) if len(points) else np.zeros((2, 3))
    if not (np.isin(bounds, _NO_DATA) | (np.abs(bounds) > _NO_COORDINATE)).any():
        return none
    marks = np.isin(points, _NO_DATA) | (np.abs(points) > _NO_COORDINATE)
    marked = np.asarray(marks.any(axis=1))
    if marked.all():
        return none
    low, high = bounds_of(points[~marked])
    off = np.maximum(low - points, points - high)[marked]
    return marked if (off[marks[marked]] > np.linalg.norm(high - low)).all() else none


def check_returns(points: Array, path: Path) -> None:
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
            "cloud.empty_returns",
            f"{int(nothing.sum())} points lie at 0, 0, 0, {away:.3g} m from all others",
            where=str(path),
            expected="points that a beam came back from",
            remedy="leave beams without a return out of the export, or delete the points at 0, 0, 0",
        )


def is_geocentric(points_m: Array) -> bool:
    """Whether points (n, 3), metres, lie on the Earth about its centre: z points to the pole, and is no height."""
    place = _middle(points_m)
    from_ellipsoid_m = (np.linalg.norm(place / _EARTH_AXES_M) - 1.0) * _EARTH_AXES_M[0]
    return bool(abs(place[2]) > _NO_HEIGHT_M and abs(from_ellipsoid_m) < _NO_HEIGHT_M)


def _middle(points_m: Array) -> Array:
    """Median place of some of the points: all of twenty million would take a second."""
    return np.nanmedian(points_m[:: max(1, len(points_m) // 10_000)], axis=0)


def check_axes(points_m: Array, path: Path) -> None:
    """Refuse points (n, 3), metres, about the Earth's centre: raises InputError with the way upward."""
    if not is_geocentric(points_m):
        return
    up = _middle(points_m) / _EARTH_AXES_M**2
    up_text = ",".join(f"{value:.6f}" for value in up / np.linalg.norm(up))
    raise InputError(
        "coordinates.geocentric",
        "coordinates are about the Earth's centre (geocentric, as EPSG:4978): z points to the pole, not upward",
        where=str(path),
        expected="x east, y north and z up",
        remedy="export in a projected coordinate system, such as UTM, with heights; or give "
        f"--up={up_text}, the way upward there: x and y of the scene are then level, but not east and north",
    )
