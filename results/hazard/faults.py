"""Fault traces around a rock, from GeoJSON, in kilometres east and north of it."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from toppling.models.arrays import Array
from toppling.models.errors import refusals
from toppling.models.files.documents import read_json
from toppling.results.hazard.places import EARTH_RADIUS_KM

_NAMES = ("name", "Name", "NAME", "fault_name", "FaultName", "sect_name", "SectionName", "id")
"""Properties that may contain a fault's name, by precedence."""

_MAGNITUDES = ("magnitude", "mag", "Mw", "mw", "max_mag", "mag_max", "maximum_magnitude")
"""Properties that may contain the magnitude of a fault's earthquake, by precedence."""

_STEP_DEG = 0.05
"""Maximum length of a segment drawn straight on the map, degrees of longitude or latitude."""


_fault_error = refusals(
    expected="GeoJSON with lines (LineString, MultiLineString) in longitude and latitude",
    remedy="export the traces as GeoJSON in WGS 84, each with a name and, if known, a magnitude",
)


@dataclass(frozen=True, eq=False)
class FaultTrace:
    """Trace of a fault."""

    name: str
    # tuple of (n, 2): points in km east and north of the rock (azimuthal equidistant: great-circle distances and
    # azimuths from the rock are true).
    lines: tuple[Array, ...]
    magnitude: float | None = None  # magnitude of its earthquake, where the file states one

    @property
    def distance_km(self) -> float:
        """Minimum distance of the trace from the rock."""
        return min(_least_distance(line) for line in self.lines)


def read_faults(path: Path, site: tuple[float, float]) -> list[FaultTrace]:
    """Read fault traces from GeoJSON: lines in longitude and latitude, with a name and perhaps a magnitude.

    site: (longitude, latitude) of the rock in degrees.
    Raises InputError if the file is absent, is not GeoJSON, contains no line, or has invalid coordinates.
    """
    features = list(_features(read_json(path, _fault_error)))
    traces = []
    for number, feature in enumerate(features):
        lines = [_projected(line, site, path, number) for line in _lines(feature.get("geometry"))]
        if lines:
            properties = feature.get("properties") or {}
            name = _first({**properties, "fid": feature.get("id")}, (*_NAMES, "fid"), f"fault {number + 1}")
            traces.append(FaultTrace(str(name), tuple(lines), _magnitude(properties, path)))
    if not traces:
        raise _fault_error("faults.no_line", f"holds no line among {len(features)} features", path)
    return traces


def _features(document: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
    if document.get("type") == "FeatureCollection" and isinstance(document.get("features"), list):
        yield from (feature for feature in document["features"] if isinstance(feature, dict))
    elif document.get("type") == "Feature":
        yield document
    elif "coordinates" in document or "geometries" in document:
        yield {"geometry": document}


def _lines(geometry: Any) -> Iterator[Sequence[Any]]:
    """Coordinates of a geometry's lines: traces, and the outlines of polygons."""
    if not isinstance(geometry, dict):
        return
    kind, coordinates = geometry.get("type"), geometry.get("coordinates")
    if kind == "GeometryCollection":
        for part in geometry.get("geometries") or ():
            yield from _lines(part)
    elif kind == "LineString":
        yield coordinates or ()
    elif kind in ("MultiLineString", "Polygon"):
        yield from coordinates or ()
    elif kind == "MultiPolygon":
        yield from (ring for polygon in coordinates or () for ring in polygon)


def _projected(line: Any, site: tuple[float, float], path: Path, number: int) -> Array:
    try:
        points = np.array([[float(point[0]), float(point[1])] for point in line])
    except (TypeError, ValueError, IndexError, KeyError):
        points = np.empty((0, 2))
    if not (len(points) >= 2 and np.isfinite(points).all() and (np.abs(points) <= (360.0, 90.0)).all()):
        raise _fault_error(
            "faults.line_unusable",
            f"feature {number + 1} is no line of longitudes and latitudes in degrees",
            path,
        )
    return azimuthal_km(_straight(points), site)


def _straight(points_deg: Array) -> Array:
    """Densify a line that is straight in longitude and latitude, as in GeoJSON, to `_STEP_DEG` for projection."""
    steps = np.maximum(np.ceil(np.abs(np.diff(points_deg, axis=0)).max(axis=1) / _STEP_DEG).astype(int), 1)
    places = np.concatenate([number + np.arange(count) / count for number, count in enumerate(steps)])
    places = np.append(places, len(points_deg) - 1.0)
    corners = np.arange(len(points_deg))
    return np.column_stack([np.interp(places, corners, points_deg[:, axis]) for axis in (0, 1)])


def azimuthal_km(points_deg: Array, site: tuple[float, float]) -> Array:
    """Project points (n, 2) of longitude and latitude to km east and north of a site: azimuthal equidistant.

    Snyder (1987, Map projections: a working manual, USGS Professional Paper 1395), equations 5-3, 22-4 and 22-5.
    """
    east, north = np.deg2rad(points_deg[:, 0] - site[0]), np.deg2rad(points_deg[:, 1])
    here = math.radians(site[1])
    cosine = math.sin(here) * np.sin(north) + math.cos(here) * np.cos(north) * np.cos(east)
    x = np.cos(north) * np.sin(east)
    y = math.cos(here) * np.sin(north) - math.sin(here) * np.cos(north) * np.cos(east)
    angle = np.arctan2(np.hypot(x, y), cosine)
    sine = np.sin(angle)
    scale = np.where(sine > 1e-12, angle / np.where(sine > 1e-12, sine, 1.0), 1.0)
    return EARTH_RADIUS_KM * scale[:, None] * np.column_stack([x, y])


def _least_distance(line: Array) -> float:
    """Distance of the origin from a polyline."""
    start, along = line[:-1], np.diff(line, axis=0)
    length = (along**2).sum(axis=1)
    share = np.clip(-(start * along).sum(axis=1) / np.where(length > 0, length, 1.0), 0.0, 1.0)
    return float(np.hypot(*(start + share[:, None] * along).T).min())


def _first(properties: Mapping[str, Any], names: Sequence[str], otherwise: Any = None) -> Any:
    return next((properties[name] for name in names if properties.get(name) not in (None, "")), otherwise)


def _magnitude(properties: Mapping[str, Any], path: Path) -> float | None:
    found = _first(properties, _MAGNITUDES)
    if found is None:
        return None
    try:
        magnitude = float(found)
    except (TypeError, ValueError):
        magnitude = math.nan
    if not 0 < magnitude < 11:
        raise _fault_error("faults.magnitude_unusable", f"states the magnitude {found!r}", path)
    return magnitude
