"""LAS, LAZ, E57 and PCD: formats whose libraries read in C++ and Rust, called in the guarded process alone.

Each takes a path and returns nothing but points (n, 3) and the station of each. What a header counts is compared with
what the file can hold before room is made for it.
"""

from pathlib import Path
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from toppling.models.errors import InputError

NOISE = (7, 18)
"""Classes of low and high noise in the LAS specification."""
POINTS_PER_BYTE = {".las": 1, ".laz": 256, ".e57": 8}
"""More than so many cannot be packed into a byte: a million points that are all equal take 7 kB of LAZ, 140 to one."""
POINTS_AT_ONCE = 500_000
PCD_HEADER_BYTES = 8192
LZF_RATIO = 100
"""Largest size over that compressed of PCD's: three bytes stand for at most 264."""
Points = tuple[None, list[NDArray]]


def las(path: Path) -> Points:
    """Read what was not deleted: points that are withheld are, by the specification, and noise was cleaned out."""
    import laspy

    with laspy.open(path) as source:
        header = source.header
        _check_count(header.point_count, path)
        if not source.header.are_points_compressed:
            room = path.stat().st_size - header.offset_to_point_data
            _check_room(header.point_count * header.point_format.size, room, header.point_count, path)
        points = np.empty((header.point_count, 3))
        station = np.empty(header.point_count, np.int32)
        filled = read = 0
        for every in source.chunk_iterator(POINTS_AT_ONCE):
            read += len(every)
            deleted = np.asarray(every.withheld, bool) | np.isin(every.classification, NOISE)
            chunk = every[~deleted] if deleted.any() else every
            rows = slice(filled, filled + len(chunk))
            points[rows, 0], points[rows, 1], points[rows, 2] = chunk.x, chunk.y, chunk.z
            station[rows] = chunk.point_source_id
            filled += len(chunk)
        if read != header.point_count:
            _refuse(
                f"holds {read} of the {header.point_count} points that its header counts: truncated", path
            )
    return None, [points[:filled], station[:filled]]


def e57(path: Path) -> Points:
    """Read every scan in the coordinates of the survey; each is a station."""
    import pye57

    source = pye57.E57(str(path))
    _check_count(sum(source.get_header(index).point_count for index in range(source.scan_count)), path)
    scans = []
    for index in range(source.scan_count):
        scan = source.read_scan(index, ignore_missing_fields=True, transform=True)
        scans.append(np.column_stack([scan["cartesianX"], scan["cartesianY"], scan["cartesianZ"]]))
    if not scans:
        return None, [np.empty((0, 3)), np.empty(0, np.int32)]
    lengths = [len(scan) for scan in scans]
    return None, [np.concatenate(scans), np.repeat(np.arange(len(scans), dtype=np.int32), lengths)]


def pcd(path: Path) -> Points:
    """Read by Open3D's tensor reader: it keeps doubles and extra properties, which its legacy reader drops."""
    import open3d as o3d

    count = _pcd_points(path)
    cloud = o3d.t.io.read_point_cloud(path)
    points = cloud.point.positions.numpy().astype(float) if "positions" in cloud.point else np.empty((0, 3))
    if len(points) != count:
        _refuse(f"{len(points)} points can be read where its header counts {count}", path)
    station = next(
        (cloud.point[key].numpy().ravel() for key in ("station", "point_source_id") if key in cloud.point),
        np.zeros(len(points)),
    )
    return None, [points, station.astype(np.int32)]


def _pcd_points(path: Path) -> int:
    """Points that a PCD's header counts, if the file can hold them: Open3D leaves what is missing unset."""
    with path.open("rb") as file:
        head = file.read(PCD_HEADER_BYTES)
    told: dict[str, list[str]] = {}
    at = 0
    for line in head.splitlines(keepends=True):
        at += len(line)
        key, *words = line.decode("latin-1").split() or ["#"]
        told[key] = words
        if key == "DATA":
            break
    room = path.stat().st_size - at
    try:
        (count,), (kind,) = map(int, told["POINTS"]), told["DATA"]
        sizes = list(map(int, told["SIZE"]))
        row = sum(
            size * int(many) for size, many in zip(sizes, told.get("COUNT", ["1"] * len(sizes)), strict=True)
        )
        sound = count == int(told["WIDTH"][0]) * int(told["HEIGHT"][0]) and min(sizes, default=0) > 0
    except (KeyError, ValueError, IndexError) as error:
        _refuse(f"its header is not understood ({type(error).__name__}: {error})", path)
    if not sound or row <= 0 or count < 0:
        _refuse("its header contradicts itself: POINTS, WIDTH, HEIGHT, SIZE, COUNT", path)
    if kind == "ascii":
        _check_room(2 * len(sizes) * count, room + 1, count, path)
        with path.open("rb") as file:
            file.seek(at)
            rows = sum(1 for line in file if line.split(maxsplit=1))
        if rows < count:
            _refuse(f"{rows} points follow where its header counts {count}: truncated", path)
    else:
        _check_room(row * count, room * (1 if kind == "binary" else LZF_RATIO), count, path)
    return count


def _check_count(count: int, path: Path) -> None:
    _check_room(count, path.stat().st_size * POINTS_PER_BYTE[path.suffix.lower()], count, path)


def _check_room(needed: int, room: int, count: int, path: Path) -> None:
    if needed > room:
        _refuse(f"its header counts {count} points, more than the file can hold: truncated or damaged", path)


def _refuse(what: str, path: Path) -> NoReturn:
    raise InputError(
        what,
        where=str(path),
        expected="a whole point cloud",
        remedy="copy or export the file again",
    )
