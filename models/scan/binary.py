"""LAS, LAZ, E57 and PCD: formats whose libraries read in C++ and Rust, called in the guarded process alone.

Each takes a path and returns what the file says of its coordinates, points (n, 3) in its unit and the station of each.
What a file says that nobody understands is a refusal there, which the user's word on the unit may overrule. What a
header counts is compared with what the file can hold before room is made for it.
"""

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from toppling.models.arrays import AT_ONCE, Array, Flags
from toppling.models.errors import InputError, refusals
from toppling.models.files.given import END_BYTES, check_lines, open_given
from toppling.models.lengths import check_remarks, other_unit_in
from toppling.models.scan import o3d, placement
from toppling.models.scan.plausible import coordinate_steps
from toppling.models.scan.text import NOWHERE, UNIT_ROTATION, Pose, in_survey

_NOISE = (7, 18)
"""Classes of low and high noise in the LAS specification."""
_POINTS_PER_BYTE = {".las": 1, ".laz": 256, ".e57": 8}
"""More than so many cannot be packed into a byte: a million points that are all equal take 7 kB of LAZ, 140 to one."""
_RECORDS = (100, 54), (243, 60)
"""Where a LAS file counts its records and its extended ones, and the fewest bytes that one takes."""
_LZF_RATIO = 100
"""Largest size over that compressed of PCD's: three bytes stand for at most 264."""
_INVALID = "cartesianInvalidState", "sphericalInvalidState"
_CARTESIAN = ("cartesianX", "cartesianY", "cartesianZ")
_SPHERICAL = ("sphericalRange", "sphericalAzimuth", "sphericalElevation")
Points = tuple[dict[str, Any], list[NDArray]]


_damaged = refusals(expected="a whole point cloud", remedy="copy or export the file again")


def las(path: Path) -> Points:
    """Read what was not deleted: points that are withheld are, by the specification, and noise was cleaned out.

    What was left out is counted under `left_out`: how many points, and what they are.
    """
    import laspy

    with path.open("rb") as file:
        head = file.read(247)
    # laspy makes each record that a header counts, also behind the end of the file; extended ones are since 1.4.
    for at, least_bytes in _RECORDS if head[25:26] >= b"\x04" else _RECORDS[:1]:
        count = int.from_bytes(head[at : at + 4], "little")
        _check_room(least_bytes * count, path.stat().st_size, count, path, "records")
    with laspy.open(path) as source:
        header = source.header
        system = _system_stated(lambda: _las_system(source, path))
        _check_count(header.point_count, path)
        if not source.header.are_points_compressed:
            room = path.stat().st_size - header.offset_to_point_data
            _check_room(header.point_count * header.point_format.size, room, header.point_count, path)
        points = np.empty((header.point_count, 3))
        station = np.empty(header.point_count, np.int32)
        filled = read = 0
        for every in source.chunk_iterator(AT_ONCE):
            read += len(every)
            deleted = _deleted(every)
            chunk = every[~deleted] if deleted.any() else every
            rows = slice(filled, filled + len(chunk))
            points[rows, 0], points[rows, 1], points[rows, 2] = chunk.x, chunk.y, chunk.z
            station[rows] = chunk.point_source_id
            filled += len(chunk)
        _check_room(header.point_count, read, header.point_count, path)
    points = points[:filled]
    left_out = {"are withheld or classed as noise": read - filled}
    stated = system | {"step": coordinate_steps(points).tolist(), "left_out": left_out}
    return stated, [points, station[:filled]]


def _deleted(points: Any) -> Flags:
    return np.asarray(points.withheld, bool) | np.isin(points.classification, _NOISE)


def classes(path: Path) -> Points:
    """Class of each point that `las` reads."""
    import laspy

    with laspy.open(path) as source:
        parts = [
            np.asarray(every.classification, np.uint8)[~_deleted(every)]
            for every in source.chunk_iterator(AT_ONCE)
        ]
    return {}, [np.concatenate(parts)]


def _system_stated(ask: Callable[[], placement.Reference | None]) -> dict[str, Any]:
    """Coordinate system that a file states, or why what it states is refused."""
    try:
        return {"reference": ask(), "refusal": None}
    except InputError as error:
        refusal = {"code": error.code, "what": error.what, "expected": error.expected, "remedy": error.remedy}
        return {"reference": None, "refusal": refusal}


def _las_system(source: Any, path: Path) -> placement.Reference | None:
    """Coordinate system by WKT or GeoTIFF's keys, whichever the header says is meant, or the other if it is alone.

    Raises InputError if both are there and differ in unit, or as those of `reference`.
    """
    from laspy.vlrs import known

    records = [*source.header.vlrs, *(source.evlrs or ())]
    content = {
        record.record_id: record.record_data_bytes()
        for record in records
        if record.user_id.strip("\0 ") == "LASF_Projection"
    }
    kinds = known.WktCoordinateSystemVlr, known.GeoKeyDirectoryVlr, known.GeoDoubleParamsVlr
    words, keys, doubles = (content.get(kind.official_record_ids()[0], b"") for kind in kinds)
    wkt = words.decode("latin-1").strip("\0 \r\n")
    meant = bool(wkt) and source.header.global_encoding.wkt
    try:
        by_keys = placement.of_geo_keys(keys, doubles, str(path)) if keys else None
    except InputError:
        if not meant:
            raise
        by_keys = None
    if not wkt:
        return by_keys
    by_wkt = placement.of_wkt(wkt, str(path))
    if by_keys is None:
        return by_wkt
    both = zip(by_wkt["metres_per_unit"], by_keys["metres_per_unit"], strict=True)
    across, up = (
        math.isclose(a, b, rel_tol=1e-9) for a, b in both
    )  # international and US feet differ by 2e-6
    if not (across and (up or by_wkt["note"] or by_keys["note"])):
        raise InputError(
            "coordinates.crs_contradicted",
            f"its two coordinate systems differ in unit: {by_wkt['name']} ({by_wkt['unit']}) in WKT, {by_keys['name']} "
            f"({by_keys['unit']}) in GeoTIFF keys",
            where=str(path),
            expected="one coordinate system, or two that say the same",
            remedy="say in which unit the coordinates are by --units, which wins over what the file says",
        )
    return by_wkt if meant else by_keys


def e57(path: Path) -> Points:
    """Read every scan in the coordinates of the survey; each that holds points is a station.

    Children of a structure are taken by their names: their order is the writer's. A scanner writes 0, 0, 0 in a scan's
    own frame where no beam came back.
    """
    import pye57

    source = pye57.E57(str(path))
    headers = [source.get_header(index) for index in range(source.scan_count)]
    headers = [header for header in headers if header.point_count]
    _check_count(sum(header.point_count for header in headers), path)
    invalid = 0

    def scans() -> Iterator[tuple[Array, Pose]]:
        nonlocal invalid
        for header in headers:
            points = _e57_points(source, header, path)
            invalid += header.point_count - len(points)
            yield points, _e57_pose(header.node, path)

    points, station, step, nowhere = in_survey(scans())
    stated = _system_stated(lambda: _e57_system(source, headers, path))
    stated |= {"step": step.tolist(), "left_out": {"are flagged invalid": invalid, NOWHERE: nowhere}}
    return stated, [points, station]


def _e57_points(source: Any, header: Any, path: Path) -> Array:
    """Valid points (n, 3) of a scan in its own frame."""
    fields = set(header.point_fields)
    possible = [axes for axes in (_CARTESIAN, _SPHERICAL) if set(axes) <= fields]
    if not possible:
        raise _damaged(
            "cloud.no_coordinates",
            f"a scan has the fields {', '.join(sorted(fields))}, and no coordinates",
            path,
        )
    points = _e57_columns(source, header, possible[0], path)
    if len(possible) > 1 and not np.isfinite(points[points.any(axis=1)]).all(axis=1).any():
        points = _e57_columns(source, header, possible[1], path)
    return points


def _e57_columns(source: Any, header: Any, axes: tuple[str, ...], path: Path) -> Array:
    """Those of a scan's points that are valid in such coordinates."""
    fields = set(header.point_fields)
    names = [*axes, *(name for name in _INVALID if name in fields and name[:4] == axes[0][:4])]
    data, buffers = source.make_buffers(names, header.point_count)
    reader = header.points.reader(buffers)
    read = reader.read()
    reader.close()
    if read != header.point_count:
        raise _damaged(
            "file.truncated",
            f"{read} points of a scan can be read where its header counts {header.point_count}",
            path,
        )
    points = np.column_stack([data[axis] for axis in axes]).astype(float)
    if axes == _SPHERICAL:
        far, around, up = points.T
        points = np.column_stack(
            [far * np.cos(up) * np.cos(around), far * np.cos(up) * np.sin(around), far * np.sin(up)]
        )
    return points[data[names[3]] == 0] if len(names) > 3 else points


def _e57_pose(node: Any, path: Path) -> Pose:
    """Pose of a scan in the frame of the file."""
    from scipy.spatial.transform import Rotation

    turn, shift = _part(node, "rotation", "xyzw", path), _part(node, "translation", "xyz", path)
    if turn is None:
        return None, shift
    if not (np.isfinite(turn).all() and abs(np.linalg.norm(turn) - 1.0) < UNIT_ROTATION):
        raise _damaged(
            "cloud.pose_unusable",
            f"a scan's pose turns by {turn.tolist()} (x, y, z, w), which is no unit quaternion",
            path,
        )
    return Rotation.from_quat(turn).as_matrix().T, shift


def _part(node: Any, part: str, names: str, path: Path) -> Array | None:
    """Numbers of a part of a scan's pose by their names; None if there is none."""
    if not node.isDefined("pose") or not node["pose"].isDefined(part):
        return None
    children = node["pose"][part]
    lacking = [name for name in names if not children.isDefined(name)]
    if lacking:
        raise _damaged(
            "cloud.pose_incomplete", f"the {part} of a scan's pose has no {', '.join(lacking)}", path
        )
    return np.array([children[name].value() for name in names], float)


def _e57_system(source: Any, headers: list[Any], path: Path) -> placement.Reference | None:
    """Coordinate system that a file states in words.

    Raises InputError if that is another unit than metres, which are E57's by its standard: nobody can tell which is
    right.
    """
    words = [_text(source.root, "coordinateMetadata"), *(_text(scan.node, "description") for scan in headers)]
    system = placement.of_words(words[0], str(path))
    unit = other_unit_in(words if system is None else words[1:])
    if unit or (system is not None and system["metres_per_unit"] != [1.0, 1.0]):
        stated = unit if system is None else f"{system['name']}, in {system['unit']}"
        raise InputError(
            "coordinates.unit_not_metres",
            f"its coordinates are said to be in another unit than metres ({stated}), which are E57's by its standard",
            where=str(path),
            expected="coordinates in metres, and no other unit in the file's words",
            remedy="see how large something known is, and say which unit is right by --units, such as --units m",
        )
    return system


def _text(node: Any, name: str) -> str:
    return str(node[name].value()) if node.isDefined(name) and hasattr(node[name], "value") else ""


def pcd(path: Path) -> Points:
    """Read by Open3D's tensor reader: it keeps doubles and extra properties, which its legacy reader drops."""
    count = _pcd_points(path)
    cloud = o3d.t.io.read_point_cloud(path)
    points = cloud.point.positions.numpy().astype(float) if "positions" in cloud.point else np.empty((0, 3))
    if len(points) != count:
        raise _damaged(
            "file.truncated", f"{len(points)} points can be read where its header counts {count}", path
        )
    station = next(
        (cloud.point[key].numpy().ravel() for key in ("station", "point_source_id") if key in cloud.point),
        np.zeros(len(points)),
    )
    with open_given(path, _damaged) as file:
        head = file.read(END_BYTES).partition(b"\nDATA")[0].decode("latin-1")
    remarks = [line.lstrip("# ") for line in head.splitlines() if line.startswith("#")]
    header = _system_stated(lambda: check_remarks(remarks, str(path)))
    return header | {"step": coordinate_steps(points).tolist()}, [points, station.astype(np.int32)]


def _pcd_points(path: Path) -> int:
    """Points that a PCD's header counts, if the file can hold them: Open3D leaves what is missing unset."""
    with open_given(path, _damaged) as file:
        head = file.read(END_BYTES)
    header: dict[str, list[str]] = {}
    at = 0
    for line in head.splitlines(keepends=True):
        at += len(line)
        key, *words = line.decode("latin-1").split() or ["#"]
        header[key] = words
        if key == "DATA":
            break
    room = path.stat().st_size - at
    try:
        (count,), (kind,) = map(int, header["POINTS"]), header["DATA"]
        sizes = list(map(int, header["SIZE"]))
        row = sum(
            size * int(many)
            for size, many in zip(sizes, header.get("COUNT", ["1"] * len(sizes)), strict=True)
        )
        sound = count == int(header["WIDTH"][0]) * int(header["HEIGHT"][0]) and min(sizes, default=0) > 0
    except (KeyError, ValueError, IndexError) as error:
        raise _damaged(
            "cloud.header_unreadable", f"its header is not understood ({type(error).__name__}: {error})", path
        ) from error
    if not sound or row <= 0 or count < 0:
        raise _damaged(
            "cloud.header_contradicted",
            "its header contradicts itself: POINTS, WIDTH, HEIGHT, SIZE, COUNT",
            path,
        )
    if kind == "ascii":
        _check_room(2 * len(sizes) * count, room + 1, count, path)
        with open_given(path, _damaged) as file:
            check_lines(file, path, _damaged)
            file.seek(at)
            rows = sum(1 for line in file if line.split(maxsplit=1))
        if rows < count:
            raise _damaged(
                "file.truncated", f"{rows} points follow where its header counts {count}: truncated", path
            )
    else:
        _check_room(row * count, room * (1 if kind == "binary" else _LZF_RATIO), count, path)
    return count


def _check_count(count: int, path: Path) -> None:
    _check_room(count, path.stat().st_size * _POINTS_PER_BYTE[path.suffix.lower()], count, path)


def _check_room(needed: int, room: int, count: int, path: Path, what: str = "points") -> None:
    if needed > room:
        raise _damaged(
            "file.truncated",
            f"its header counts {count} {what}, more than the file can hold: truncated or damaged",
            path,
        )
