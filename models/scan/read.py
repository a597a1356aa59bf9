"""Clouds from files: every format ends as local points in metres and one double-precision origin."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from toppling.models.arrays import Array, Indices, bounds_of, inside_box
from toppling.models.errors import InputError, refusals
from toppling.models.files.guarded import read_guarded
from toppling.models.files.mesh_files import MESH_FORMATS, read_header, read_vertices, remarks_of
from toppling.models.lengths import METRES, NAMES, check_remarks
from toppling.models.scan.meshes import (
    UPWARD_Y,
    Mesh,
    check_frame,
    exposed,
    facing_up,
    is_mesh,
    mesh_as_in_file,
    outward,
    points_on,
)
from toppling.models.scan.placement import Placement, Reference
from toppling.models.scan.plausible import (
    check_axes,
    check_points,
    check_returns,
    coordinate_steps,
    marked_unmeasured,
    steps_of_mesh,
)
from toppling.models.scan.text import read_ptx, read_text

_TEXTS = (".xyz", ".xyzrgb", ".xyzn", ".xyzi", ".asc", ".pts", ".txt", ".csv", ".dat")
FORMATS = (".ply", ".pcd", *_TEXTS, ".ptx", ".las", ".laz", ".e57")
_LAS = ("las", ["laspy"])
_GUARDED = {".las": _LAS, ".laz": _LAS, ".e57": ("e57", ["pye57"]), ".pcd": ("pcd", ["open3d"])}
"""Formats that libraries read in C++ and Rust: the reader in `models.scan.binary`, and its libraries."""


_unreadable = refusals(
    expected=f"a point cloud ({', '.join(FORMATS)}) or a mesh ({', '.join(MESH_FORMATS)})",
    remedy="check the path, or export the cloud again as LAZ, PLY or XYZ in metres",
)


@dataclass(frozen=True)
class Source:
    """Coordinates as a file states them, and their conversion."""

    name: str
    points: int  # that stay
    left_out: int = 0  # points that were deleted, not finite, or copies of others
    # Of horizontal coordinates and of heights, as the file has them.
    metres_per_unit: tuple[float, float] = (1.0, 1.0)
    unit_by: str = ""  # who says so: empty if nobody does, and metres are assumed
    system: str = ""  # name of its coordinate system; empty if none is stated
    epsg: int | None = None
    step_m: float = 0.0  # widest step in which its coordinates come, 0 if none shows
    note: str = ""  # what the user should know of it; may be empty
    placed_by: str = ""  # what its coordinates were scaled, turned or shifted by; may be empty

    def with_less(self, copies: int) -> "Source":
        """Source with fewer points, the copies of others, which are stated."""
        notes = [self.note, f"{copies} points are copies of others and were left out" if copies else ""]
        note = "; ".join(filter(None, notes))
        return replace(self, points=self.points - copies, left_out=self.left_out + copies, note=note)

    def to_json(self) -> dict[str, Any]:
        """Entries for `scene.json`, without what is empty."""
        content: dict[str, Any] = {"name": self.name, "points": self.points, "step_m": self.step_m}
        if self.left_out:
            content["points_left_out"] = self.left_out
        if self.unit_by:
            content |= {"metres_per_unit": [*self.metres_per_unit], "unit_by": self.unit_by}
        if self.system:
            content |= {"coordinate_system": self.system, "epsg": self.epsg}
        if self.placed_by:
            content["placed_by"] = self.placed_by
        return content


@dataclass(frozen=True, eq=False)
class Cloud:
    """Points of one or more files in a local frame."""

    points_m: Array  # (n, 3): points less `origin_m`: x east, y north, z up
    # (3,): survey coordinates of the local origin; whole metres, so that nothing is lost by the subtraction.
    origin_m: Array
    # (n,): which tripod station saw the point (file by file, and within a file as the file says).
    station: NDArray[np.int32]
    files: tuple[tuple[str, int], ...]  # names and numbers of points, in the order of the points
    sources: tuple[Source, ...] = ()  # what each of the files said; empty if the points come from none
    # (n,): 0 rock, 1 pedestal, 2 neither, where they were separated before.
    label: NDArray[np.int8] | None = None
    meshes: tuple[Mesh | None, ...] = ()  # of each file that is one, survey coordinates

    @cached_property
    def bounds_m(self) -> Array:
        """Lowest and highest survey coordinates, (2, 3)."""
        return bounds_of(self.points_m) + self.origin_m

    def edge_m(self, low_m: Array, high_m: Array) -> float:
        """Median edge of the triangles of meshes within a box of the local frame, m; 0 where there is none."""
        edges_m = [np.zeros(0)]
        for vertices, faces in filter(None, self.meshes):
            corners = vertices[faces] - self.origin_m
            corners = corners[inside_box(corners.mean(axis=1), low_m, high_m)]
            edges_m.append(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).ravel())
        every = np.concatenate(edges_m)
        return float(np.median(every)) if len(every) else 0.0

    @property
    def coarsest(self) -> Source | None:
        """The file whose coordinates come in the widest step."""
        return max(self.sources, key=lambda source: source.step_m, default=None)


@dataclass(frozen=True, eq=False)
class _Read:
    """Points (n, 3) of a file in its unit, the station of each, and what the file says of them."""

    points: Array
    station: NDArray[np.int32]
    step: Array
    reference: Reference | None = None
    mesh: "_Mesh | None" = None
    note: str = ""
    # What was left out already: how many points, by what they are.
    left_out: Mapping[str, int] = field(default_factory=dict)


_Mesh = tuple[Array, Indices, Indices]
"""Vertices (k, 3), triangles (m, 3), and the triangle (n,) of each point."""


def read_clouds(
    paths: Sequence[str | Path],
    unit: str | None = None,
    placement: Placement | None = None,
    system: Reference | None = None,
) -> Cloud:
    """Read files as one cloud; several clouds are stations of one survey, several meshes pieces of one model.

    Parameters
    ----------
    paths : sequence of path
    unit : str, optional
        Of all coordinates, one of `models.lengths.METRES`; it wins over what the files say.
    placement : Placement, optional
        How coordinates become metres with z up, where they are neither.
    system : Reference, optional
        Coordinate system of the coordinates, once they are placed; it wins over what the files say.

    Raises
    ------
    InputError
        If a file is absent, unreadable, of an unknown format, holds too few points, coordinates in degrees or in a
        unit that is not understood, survey coordinates in single precision, or points at 0, 0, 0 far from all others;
        or a mesh shows that it is not in metres or that z is not up.
    """
    asked = _Stated(unit, placement or Placement(), system)
    survey: list[Array] = []
    stations: list[NDArray[np.int32]] = []
    sources: list[Source] = []
    meshes: dict[int, _Mesh] = {}
    first_mesh = None
    for path in map(Path, paths):
        read = _read_file(path, asked)
        points, station, source = _in_metres(read, path, asked)
        survey.append(points)
        after = int(stations[-1].max()) + 1 if stations else 0
        if read.mesh is not None:
            first_mesh = after if first_mesh is None else first_mesh
            after = first_mesh
            vertices, faces, triangle = read.mesh
            across, up = source.metres_per_unit
            placed = asked.placement.apply(vertices * (across, across, up))
            meshes[len(sources)] = placed, faces, triangle
        stations.append(station + np.int32(after))
        sources.append(source)
    _leave_out_buried(meshes, survey, stations, sources)
    origin = np.floor(np.median(np.vstack([part[:: max(1, len(part) // 10000)] for part in survey]), axis=0))
    points = _joined(survey, origin)
    station = stations[0] if len(stations) == 1 else np.concatenate(stations)
    files = tuple((source.name, source.points) for source in sources)
    surfaces = tuple(meshes[k][:2] if k in meshes else None for k in range(len(sources)))
    return Cloud(points, origin, station, files, tuple(sources), meshes=surfaces)


def _joined(survey: list[Array], origin_m: Array) -> Array:
    """All points less the origin; the parts go one by one, as twenty million points are half a gigabyte."""
    if len(survey) == 1:
        survey[0] -= origin_m
        return survey[0]
    points = np.empty((sum(map(len, survey)), 3))
    first = 0
    while survey:
        part = survey.pop(0)
        np.subtract(part, origin_m, out=points[first : first + len(part)])
        first += len(part)
    return points


def _leave_out_buried(
    meshes: dict[int, _Mesh], survey: list[Array], stations: list[NDArray[np.int32]], sources: list[Source]
) -> None:
    """Take points of meshes away that nobody can have seen, such as those of the ground below the rock."""
    if not meshes:
        return
    normals = np.concatenate([outward(vertices, faces)[of] for vertices, faces, of in meshes.values()])
    seen = exposed(
        np.concatenate([survey[number] for number in meshes]), normals, [mesh[:2] for mesh in meshes.values()]
    )
    ends = np.cumsum([len(survey[number]) for number in meshes])
    for number, own_seen in zip(meshes, np.split(seen, ends[:-1]), strict=True):
        survey[number], stations[number] = survey[number][own_seen], stations[number][own_seen]
        sources[number] = replace(sources[number], points=int(own_seen.sum()))


@dataclass(frozen=True, eq=False)
class _Stated:
    """Unit, placement and system of the coordinates, as the user states them."""

    unit: str | None
    placement: Placement
    system: Reference | None

    def __post_init__(self) -> None:
        if self.placement.says_scale and self.unit is not None:
            raise InputError(
                "placement.given_twice",
                f"--units {self.unit} is given beside {self.placement.by.partition(':')[0]}",
                where="--units",
                expected="one word on the scale",
                remedy="leave out --units: a measured length or control points say the scale",
            )

    @property
    def unit_given(self) -> bool:
        """Whether the user says how long a unit is."""
        return self.unit is not None or self.placement.says_scale or self.system is not None


def _in_metres(read: _Read, path: Path, asked: _Stated) -> tuple[Array, NDArray[np.int32], Source]:
    """Finite points in metres, z up, and what became of the others."""
    points, station, counted = read.points, read.station, {**read.left_out}
    if not np.isfinite(points.sum()):
        finite = np.isfinite(points).all(axis=1)
        points, station = points[finite], station[finite]
        counted["are not finite"] = int((~finite).sum())
    if (unmeasured := marked_unmeasured(points)).any():
        points, station = points[~unmeasured], station[~unmeasured]
        counted["are marked as not measured"] = int(unmeasured.sum())
    left_out = sum(counted.values())
    scale, by, note = _unit_of(read, asked)
    check_points(points, path, counted, scale)
    if scale != (1.0, 1.0):
        points *= (scale[0], scale[0], scale[1])
    check_returns(points, path)
    placement = asked.placement
    if not placement.says_up:
        check_axes(points, path)
    points = placement.apply(points) if placement.by else points
    notes = [f"{count} points {what} and were left out" for what, count in counted.items() if count]
    notes += [part for part in (read.note, note, placement.by and f"placed by {placement.by}") if part]
    stated = asked.system or (None if placement.says_scale else read.reference)
    source = Source(
        path.name,
        len(points),
        left_out,
        scale,
        by,
        stated["name"] if stated else "",
        stated["epsg"] if stated else None,
        float((read.step * (scale[0], scale[0], scale[1])).max()) * placement.scale,
        "; ".join(notes),
        placement.by,
    )
    return points, _counted(station), source


def _unit_of(read: _Read, asked: _Stated) -> tuple[tuple[float, float], str, str]:
    """Metres of a unit across and upward, who says so, and what should be told of it."""
    if asked.placement.says_scale:
        return (1.0, 1.0), "", ""
    stated, by = None, ""
    if read.reference is not None:
        across, up = read.reference["metres_per_unit"]
        stated, by = (across, up), f"{read.reference['name']}: {read.reference['unit']}"
    given = option = name = None
    if asked.unit is not None:
        given, option, name = (METRES[asked.unit],) * 2, f"--units {asked.unit}", NAMES[asked.unit]
    elif asked.system is not None:
        across, up = asked.system["metres_per_unit"]
        given, name = (across, up), f"{asked.system['name']} ({asked.system['unit']})"
        option = f"--crs: {name}"
    if given is not None and option is not None:
        # The two feet, which are one for a rock, differ by 2e-6.
        differs = stated is not None and not np.allclose(given, stated, atol=0.0)
        other = asked.system is not None and read.reference is not None and read.reference["epsg"]
        differs |= bool(other) and asked.system is not None and other != asked.system["epsg"]
        return given, option, f"read in {name}, though it says {by}" if differs else ""
    if stated is None or stated == (1.0, 1.0):
        return (1.0, 1.0), by, ""
    also = f"; {read.reference['note']}" if read.reference and read.reference["note"] else ""
    return stated, by, f"converted to metres as its coordinates are in other units ({by}){also}"


def _read_file(path: Path, asked: _Stated) -> _Read:
    """Coordinates of a file in double precision, in its unit."""
    if not path.is_file():
        raise _unreadable(
            "file.is_folder" if path.is_dir() else "file.absent",
            "a folder" if path.is_dir() else "no such file",
            path,
        )
    suffix, unit_given = path.suffix.lower(), asked.unit_given
    if suffix not in FORMATS + MESH_FORMATS:
        raise _unreadable("cloud.format_unknown", f"unknown format '{suffix}'", path)
    note = ""
    try:
        if is_mesh(path):
            return _read_mesh(path, asked)
        if suffix in _GUARDED:
            reader, libraries = _GUARDED[suffix]
            answer, (points, station) = read_guarded(f"toppling.models.scan.binary:{reader}", path, libraries)
            if answer["refusal"] and not unit_given:
                raise InputError(**answer["refusal"] | {"where": str(path)})
            step, left_out = np.array(answer["step"]), answer.get("left_out", {})
            return _Read(points, station, step, answer["reference"], left_out=left_out)
        if suffix == ".ptx":
            points, station, step, left_out = read_ptx(path)
            return _Read(points, station, step, left_out=left_out)
        if suffix == ".ply":
            points, station = _read_ply(path)
            remarks = read_header(path).remarks
        else:
            points, remarks, note = read_text(path, unit_given)
            station = np.zeros(len(points), np.int32)
    except InputError:
        raise
    except Exception as error:  # each reader raises whatever its parser raises
        raise _unreadable(
            "file.unreadable", f"cannot be read ({type(error).__name__}: {error})", path
        ) from error
    if not unit_given:
        check_remarks(remarks, str(path))
    return _Read(points, station, coordinate_steps(points), note=note)


def _read_mesh(path: Path, asked: _Stated) -> _Read:
    """Points on a mesh of one or several pieces, open or closed."""
    vertices, faces = mesh_as_in_file(path)
    if not asked.unit_given:
        check_remarks(remarks_of(path), str(path))
    check_frame(vertices, faces, path, asked.placement, unit_given=asked.unit_given)
    if path.suffix.lower() in UPWARD_Y and not asked.placement.says_up:
        vertices = vertices[:, [0, 2, 1]] * (1.0, -1.0, 1.0)
    if asked.placement.says_up:
        faces = facing_up(vertices, faces, asked.placement)
    points, triangle = points_on(vertices, faces)
    station = np.zeros(len(points), np.int32)
    mesh = (vertices, faces, triangle)
    return _Read(points, station, steps_of_mesh(vertices, faces), mesh=mesh)


def _read_ply(path: Path) -> tuple[Array, NDArray]:
    read = {name.lower(): values for name, values in read_vertices(path).items()}
    if not {"x", "y", "z"} <= read.keys():
        raise _unreadable(
            "cloud.no_coordinates",
            f"its vertices have {', '.join(read) or 'nothing'}, and not x, y and z",
            path,
        )
    points = np.empty((len(read["x"]), 3))
    for column, axis in enumerate("xyz"):
        points[:, column] = read[axis]
    station = next(
        (read[key] for key in ("station", "point_source_id") if key in read), np.zeros(len(points))
    )
    return points, station.astype(np.int32)


def _counted(station: NDArray) -> NDArray[np.int32]:
    """Number the stations from 0, in the order of the file's own numbers."""
    if not len(station) or not station.any():
        return station.astype(np.int32)
    if station.min() >= 0 and station.max() < 1 << 16:
        used = np.bincount(station) > 0
        return (np.cumsum(used) - 1).astype(np.int32)[station]
    return np.unique(station, return_inverse=True)[1].astype(np.int32)
