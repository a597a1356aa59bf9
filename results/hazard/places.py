"""Sites of hazard files, rocks and fault traces: their distances, and the choice of a site."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from toppling.models.arrays import Array
from toppling.models.errors import InputError, refusals
from toppling.models.files.documents import listed, read_json

SITE_REACH_KM = 30.0
"""Maximum distance of a hazard file's site from the requested location, km.

A grid of 0.3 degrees has a node within 24 km of every location, and published grids have 0.05 to 0.2 degrees. A site
farther away may lie on another side of a fault, with a different hazard.
"""
_SAME_SITE_KM = 0.2
"""Distance below which two locations are the same site, km: files print them with five decimals, some with two."""
EARTH_RADIUS_KM = 6371.0
"""Mean radius of the Earth, km."""
Place = tuple[float, float]
"""Longitude and latitude in degrees."""


def distance_km(longitude_deg: ArrayLike, latitude_deg: ArrayLike, site: tuple[float, float]) -> Array:
    """Great-circle distances from a site (longitude, latitude); longitudes are modulo 360 degrees."""
    east, north, here = (
        np.deg2rad(np.asarray(angle, float)) for angle in (longitude_deg, latitude_deg, site)
    )
    lengths = np.sin((north - here[1]) / 2) ** 2
    widths = np.cos(north) * np.cos(here[1]) * np.sin((east - here[0]) / 2) ** 2
    return 2.0 * EARTH_RADIUS_KM * np.arcsin(np.sqrt(np.minimum(lengths + widths, 1.0)))


def check_place(asked: Place) -> None:
    """Raise InputError if longitude and latitude are out of range."""
    if not (-180 <= asked[0] <= 360 and -90 <= asked[1] <= 90):
        raise InputError(
            "site.out_of_range",
            what=f"{asked[0]:g} {asked[1]:g} is no place on Earth",
            where="--site",
            expected="a longitude of -180 to 360 degrees, then a latitude of -90 to 90",
            remedy="give the longitude first: --site LONGITUDE LATITUDE",
        )


def of_name(names: Sequence[str], asked: str, where: str) -> list[int]:
    """Indices of the sites with a name, ignoring case; InputError if there are none."""
    found = [number for number, name in enumerate(names) if name.casefold() == asked.casefold()]
    if not found:
        known = listed([*dict.fromkeys(filter(None, names))]) or "none that has a name"
        raise InputError(
            "site.unknown",
            f"has no site called {asked!r}: it has {known}",
            where=where,
            expected="the name of one of its sites",
            remedy="give one of its names, or --site LONGITUDE LATITUDE",
        )
    return found


def nearest(sites: Sequence[Place], asked: Place, where: str) -> int:
    """Index of the site nearest to a location.

    Raises InputError if the coordinates are out of range, or the nearest site lies beyond `SITE_REACH_KM`.
    """
    check_place(asked)
    east, north = np.transpose(sites)
    away_km = distance_km(east, north, asked)
    number = int(away_km.argmin())
    if not away_km[number] <= SITE_REACH_KM:
        raise InputError(
            "site.too_far",
            what=f"the nearest site to {asked[0]:g} {asked[1]:g}, at longitude {sites[number][0]:g} and latitude "
            f"{sites[number][1]:g}, is {away_km[number]:.0f} km away",
            where=where,
            expected=f"a site within {SITE_REACH_KM:g} km",
            remedy="see that the longitude comes first, or compute the hazard at the rock",
        )
    return number


def same_place(first: Place | None, other: Place | None) -> bool:
    """Whether two locations may be the same: nearer than `_SAME_SITE_KM`, or one of them unknown."""
    return first is None or other is None or bool(distance_km(*first, other) <= _SAME_SITE_KM)


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
    elif "coordinates" in document:
        yield {"geometry": document}


def _lines(geometry: Any) -> Iterator[Sequence[Any]]:
    """Coordinates of a geometry's lines."""
    kind = geometry.get("type") if isinstance(geometry, dict) else None
    if kind == "LineString":
        yield geometry.get("coordinates") or ()
    elif kind == "MultiLineString":
        yield from geometry.get("coordinates") or ()


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
