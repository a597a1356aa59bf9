"""Clouds from files: every format ends as local points in metres and one double-precision origin."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from toppling.models.errors import InputError
from toppling.models.guarded import read_guarded
from toppling.models.ply import read_vertices
from toppling.models.scan.header import TEXT, named_columns

FORMATS = (".ply", ".pcd", ".xyz", ".pts", ".txt", ".csv", ".las", ".laz", ".e57")
MINIMUM_POINTS = 1000
"""Fewer points than this cannot show a rock, its pedestal and the crevice between them."""
GUARDED = {
    ".las": ("las", "laspy"),
    ".laz": ("las", "laspy"),
    ".e57": ("e57", "pye57"),
    ".pcd": ("pcd", "open3d"),
}
"""Formats that libraries read in C++ and Rust: the reader in `models.scan.binary`, and its library."""
EASTINGS_M = (1e5, 1e6)
"""Within these lie all eastings of UTM; northings lie beyond nearly everywhere."""
NORTHINGS_BELOW_M = 1e7
COARSEST_STEP_M = 0.01
"""Coordinates stored in steps wider than this have lost the crevice."""


@dataclass(frozen=True, eq=False)
class Cloud:
    """Points of one or more files in a local frame.

    Parameters
    ----------
    points_m : (n, 3) array
        Points less `origin_m`: x east, y north, z up.
    origin_m : (3,) array
        Survey coordinates of the local origin; whole metres, so that nothing is lost by the subtraction.
    station : (n,) int array
        Which tripod station saw the point (file by file, and within a file as the file says).
    files : tuple of (str, int)
        Names and numbers of points, in the order of the points.
    """

    points_m: NDArray[np.float64]
    origin_m: NDArray[np.float64]
    station: NDArray[np.int32]
    files: tuple[tuple[str, int], ...]


def read_clouds(paths: Sequence[str | Path]) -> Cloud:
    """Read files as one cloud; several files are stations of one survey in one coordinate system.

    Raises
    ------
    InputError
        If a file is absent, unreadable, of an unknown format, holds too few or non-finite points, survey coordinates
        in single precision, or points at 0, 0, 0 far from all others.
    """
    survey: list[NDArray[np.float64]] = []
    stations: list[NDArray[np.int32]] = []
    files: list[tuple[str, int]] = []
    for path in map(Path, paths):
        points, station = _read_file(path)
        _check_points(points, path)
        survey.append(points)
        stations.append(station + (stations[-1].max() + 1 if stations else 0))
        files.append((path.name, len(points)))
    origin = np.floor(np.median(np.vstack([each[:: max(1, len(each) // 10000)] for each in survey]), axis=0))
    for each in survey:
        each -= origin  # in place: twenty million points are half a gigabyte
    points = survey[0] if len(survey) == 1 else np.concatenate(survey)
    station = stations[0] if len(stations) == 1 else np.concatenate(stations)
    return Cloud(points, origin, station, tuple(files))


def _read_file(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Survey coordinates (n, 3) in double precision and the station of each point, counted from 0."""
    if not path.is_file():
        raise _unreadable("no such file", path)
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        raise _unreadable(f"unknown format '{suffix}'", path)
    try:
        if suffix in GUARDED:
            reader, library = GUARDED[suffix]
            points, station = read_guarded(f"toppling.models.scan.binary:{reader}", path, [library])[1]
        elif suffix == ".ply":
            points, station = _read_ply(path)
        else:
            points = _read_columns(path)
            station = np.zeros(len(points), np.int32)
    except InputError:
        raise
    except Exception as error:  # each reader raises whatever its parser raises
        raise _unreadable(f"cannot be read ({type(error).__name__}: {error})", path) from error
    return points, _counted(station)


def _read_ply(path: Path) -> tuple[NDArray[np.float64], NDArray]:
    read = read_vertices(path)
    if not {"x", "y", "z"} <= read.keys():
        return np.empty((0, 3)), np.empty(0, np.int32)
    points = np.column_stack([read[axis].astype(float) for axis in "xyz"])
    station = next(
        (read[key] for key in ("station", "point_source_id") if key in read), np.zeros(len(points))
    )
    return points, station.astype(np.int32)


def _read_columns(path: Path) -> NDArray[np.float64]:
    """Read x, y, z of a text file: the columns that a header names, else the first three."""
    with path.open(encoding=TEXT, errors="replace") as lines:
        head = [line for _, line in zip(range(20), lines, strict=False)]
    skip = next((i for i, line in enumerate(head) if _numbers(line) >= 3), None)
    if skip is None:
        return np.empty((0, 3))
    delimiter = "," if "," in head[skip] else ";" if ";" in head[skip] else None
    titles = list(filter(_no_count, head[:skip]))
    named = named_columns(titles, len(head[skip].strip().split(delimiter)), str(path))
    with path.open(encoding=TEXT, errors="replace") as lines:
        counted = path.suffix.lower() == ".pts"  # filtering costs time, so for these files alone
        points = np.loadtxt(
            filter(_no_count, lines) if counted else lines,
            delimiter=delimiter,
            skiprows=len(titles) if counted else skip,
            usecols=named or (0, 1, 2),
            ndmin=2,
            comments=("#", "//"),
        )
    if named is None:
        _check_easting_first(points, path)
    return points


def _no_count(line: str) -> bool:
    """Whether a line is none of the counts of points that stand before each scan in a PTS file."""
    return not line.strip().isdigit()


def _check_easting_first(points: NDArray[np.float64], path: Path) -> None:
    """Refuse what looks like northing before easting: the scene would be mirrored."""
    if not len(points):
        return
    x, y = np.abs(np.median(points[:, :2], axis=0))
    if EASTINGS_M[1] < x < NORTHINGS_BELOW_M and EASTINGS_M[0] < y < EASTINGS_M[1]:
        raise InputError(
            f"the first column, about {x:.0f}, looks like a northing and the second, about {y:.0f}, like an easting",
            where=str(path),
            expected="x (east), y (north), z in this order, or a header line that names them",
            remedy="put a line with the columns' names before the first point: y,x,z, or x,y,z if they are in order",
        )


def _numbers(line: str) -> int:
    """How many numbers a line begins with."""
    count = 0
    for word in line.replace(",", " ").replace(";", " ").split():
        try:
            float(word)
        except ValueError:
            break
        count += 1
    return count


def _counted(station: NDArray) -> NDArray[np.int32]:
    """Number the stations from 0, in the order of the file's own numbers."""
    if not len(station) or not station.any():
        return station.astype(np.int32)
    if station.min() >= 0 and station.max() < 1 << 16:
        used = np.bincount(station) > 0
        return (np.cumsum(used) - 1).astype(np.int32)[station]
    return np.unique(station, return_inverse=True)[1].astype(np.int32)


def _check_points(points: NDArray[np.float64], path: Path) -> None:
    if not np.isfinite(points.sum()) and not np.isfinite(points).all():
        bad = ~np.isfinite(points).all(axis=1)
        raise _unreadable(
            f"{int(bad.sum())} points are not finite, first point {int(np.argmax(bad))}",
            path,
        )
    if len(points) < MINIMUM_POINTS:
        raise InputError(
            f"holds {len(points)} points",
            where=str(path),
            expected=f"at least {MINIMUM_POINTS}",
            remedy="check that the export was complete and that the file's extension names its format",
        )
    if not np.ptp(points, axis=0).any():
        raise _unreadable("all points are one and the same", path)
    _check_returns(points, path)
    step = single_precision_step_m(points)
    if step > COARSEST_STEP_M:
        raise InputError(
            f"survey coordinates are stored in single precision, in steps of {step:.3g} m",
            where=str(path),
            expected=f"steps of at most {COARSEST_STEP_M} m",
            remedy="export in double precision (LAZ, XYZ, PLY with doubles), or with an offset taken away",
        )


def _check_returns(points: NDArray[np.float64], path: Path) -> None:
    """Refuse beams without a return that are written as points at the origin, far from where anything was seen."""
    nothing = (points[:, 0] == 0.0) & (points[:, 1] == 0.0) & (points[:, 2] == 0.0)
    if not nothing.any():
        return
    low, high = points[~nothing].min(axis=0), points[~nothing].max(axis=0)
    away = np.linalg.norm(np.maximum(np.maximum(low, -high), 0.0))
    if away > np.linalg.norm(high - low):
        raise InputError(
            f"{int(nothing.sum())} points lie at 0, 0, 0, {away:.3g} m from all others",
            where=str(path),
            expected="points that a beam came back from",
            remedy="leave beams without a return out of the export, or delete the points at 0, 0, 0",
        )


def single_precision_step_m(points: NDArray[np.float64]) -> float:
    """Widest step between neighbouring single-precision numbers at the coordinates, 0 if they are not such numbers."""
    sample = points[:: max(1, len(points) // 10_000)]
    single = sample.astype(np.float32)
    steps = np.spacing(np.abs(single).max(axis=0))
    return float(np.max(steps, where=(single == sample).all(axis=0), initial=0.0))


def _unreadable(what: str, path: Path) -> InputError:
    return InputError(
        what,
        where=str(path),
        expected="a point cloud: " + ", ".join(FORMATS),
        remedy="check the path, or export the cloud again as LAZ, PLY or XYZ in metres",
    )
