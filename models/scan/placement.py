"""How coordinates become metres with z up: what a file says of them, an upward axis, a length, or control points."""

from __future__ import annotations

import re
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import fdtrc

from toppling.models.arrays import Array
from toppling.models.errors import InputError, refusals
from toppling.models.files.table import Table, places_in
from toppling.models.frames import rotation_between
from toppling.models.lengths import in_degrees

COLLINEAR = 0.02
"""Points whose spread across is less than this share of that along lie on one line, and define no attitude."""
_LARGEST_FRACTION = 0.02
"""Residuals above this share of the points' extent are mistakes and no scatter."""
_SIGNIFICANT = 1e-4
"""Chance that scatter alone makes one of the points stand out as a mistake."""

_unusable = refusals(
    expected="three or more lines of six numbers: x,y,z in the model, then x,y,z as surveyed; a name may stand before",
    remedy="give one line for each control point; a line of column names may come first",
)

_SURVEYED = {
    "e",
    "east",
    "easting",
    "n",
    "north",
    "northing",
    "h",
    "height",
    "elevation",
    "elev",
    "alt",
    "up",
}
"""Words for surveyed coordinates."""
_OTHER_UNITS = {"ft", "feet", "foot", "usft", "mm", "cm", "km", "yd"}


@dataclass(frozen=True, eq=False)
class Fit:
    """Similarity from model to survey: surveyed = scale turn model + shift."""

    # Metres of a unit, and its standard deviation over it by the scatter of the points; NaN for exact points.
    scale: float
    scale_share_std: float
    turn: Array  # (3, 3)
    shift_m: Array  # (3,)
    residuals_m: Array  # (n,): distance of each point from where it was surveyed
    names: tuple[str, ...]

    @property
    def sentence(self) -> str:
        """Say it."""
        offs = ", ".join(f"{name} {off:.2g}" for name, off in zip(self.names, self.residuals_m, strict=True))
        return (
            f"{len(self.names)} control points, {self.scale:.6g} m a unit (± {self.scale_share_std:.1%}, so the volume "
            f"± {3.0 * self.scale_share_std:.1%}), residuals in m: {offs}"
        )


def similarity(model: Array, surveyed: Array, mirrored: bool = False) -> tuple[float, Array, Array]:
    """Scale, rotation and shift from (n, 3) to (n, 3) with the least squared residuals (Umeyama 1991).

    `mirrored`: a rotation with a reflection, which no model needs but an exchange of axes makes.
    """
    middle, centre = model.mean(axis=0), surveyed.mean(axis=0)
    own, other = model - middle, surveyed - centre
    left, stretch, right = np.linalg.svd(other.T @ own)
    handed = np.linalg.det(left) * np.linalg.det(right) * (-1.0 if mirrored else 1.0)
    sign = np.array([1.0, 1.0, np.sign(handed)])
    turn = (left * sign) @ right
    scale = float((stretch * sign).sum() / (own**2).sum())
    return scale, turn, centre - scale * turn @ middle


def fit_control_points(given: str | Path | Sequence[str], metres_per_unit: object = (1.0, 1.0)) -> Fit:
    """Fit control points.

    given: a file, or its lines.
    metres_per_unit: of surveyed coordinates, across and upward.
    Raises InputError if the file cannot be read, its points lie on one line, or one of them or all do not fit.
    """
    path = str(given) if isinstance(given, str | Path) else "--gcp"
    across, up = np.asarray(metres_per_unit, float)
    names, rows = _rows(control_point_lines(given), path, bool(across == up == 1.0))
    model, surveyed = rows[:, :3], rows[:, 3:] * (across, across, up)
    for side, places in (("model", model), ("survey", surveyed)):
        spread = np.linalg.svd(places - places.mean(axis=0), compute_uv=False)
        if spread[1] <= COLLINEAR * spread[0]:
            raise _unusable(
                "placement.points_on_a_line",
                f"the points lie on one line in the {side}, about which the model could turn",
                path,
            )
    scale, turn, shift = similarity(model, surveyed)
    residuals = np.linalg.norm(scale * model @ turn.T + shift - surveyed, axis=1)
    _check_fit(model, surveyed, residuals, names, path)
    free = 3 * len(rows) - 7
    spread_m = np.sqrt(((surveyed - surveyed.mean(axis=0)) ** 2).sum())
    return Fit(scale, float(np.sqrt((residuals**2).sum() / free) / spread_m), turn, shift, residuals, names)


def _squares(model: Array, surveyed: Array, mirrored: bool = False) -> float:
    scale, turn, shift = similarity(model, surveyed, mirrored)
    return float(((scale * model @ turn.T + shift - surveyed) ** 2).sum())


def _check_fit(model: Array, surveyed: Array, off: Array, names: tuple[str, ...], path: str) -> None:
    """Refuse points that no similarity carries into each other, naming the one without which the others fit."""
    count, size = len(model), float(np.ptp(surveyed, axis=0).max())
    large = off.max() > _LARGEST_FRACTION * size
    expected = "control points that one scale, one rotation and one shift carry onto the survey"
    if large and _squares(model, surveyed, mirrored=True) < 0.01 * (off**2).sum():
        raise InputError(
            "placement.mirrored",
            "the points fit when mirrored",
            where=path,
            expected=expected,
            remedy="exchange two of the columns of one side: one of the two systems is left-handed (north before east, "
            "or heights downward)",
        )
    if count > 3:
        others = [_squares(model[keep], surveyed[keep]) for keep in ~np.eye(count, dtype=bool)]
        worst, rest = int(np.argmin(others)), min(others)
        free = 3 * (count - 1) - 7
        tiny = (1e-9 * size) ** 2
        by_chance = count * fdtrc(3, free, ((off**2).sum() - rest) / 3.0 * free / max(rest, tiny))
        alone = rest / (count - 1) < (0.5 * _LARGEST_FRACTION * size) ** 2
        if (off**2).sum() > count * tiny and alone and (by_chance < _SIGNIFICANT or large):
            raise InputError(
                "placement.points_off",
                f"point {names[worst]} does not fit: with it the points are off by up to {off.max():.3g} m, without it "
                f"by {np.sqrt(rest / (count - 1)):.2g} m",
                where=path,
                expected=expected,
                remedy=f"correct point {names[worst]} or leave it out: it may be another mark's, mistyped or in "
                "another order",
            )
    if large:
        raise InputError(
            "placement.points_off",
            f"the points do not fit: off by up to {off.max():.3g} m, where they span {size:.3g} m; "
            f"{names[int(off.argmax())]} is off most",
            where=path,
            expected=expected,
            remedy="check the order of points and columns, and that each point is the same mark on both sides; a "
            "fourth point would show which one is wrong",
        )


def control_point_lines(given: str | Path | Sequence[str]) -> list[str]:
    """Lines of a file of control points, or the same lines.

    Raises
    ------
    InputError
        If the file cannot be read.
    """
    if not isinstance(given, str | Path):
        return list(given)
    return list(Table.read(Path(given), _unusable).lines)


def _rows(lines: Sequence[str], path: str, in_metres: bool) -> tuple[tuple[str, ...], Array]:
    """Names of the points, and their six coordinates (n, 6)."""
    table = Table.of(lines, Path(path), coordinates=True)
    header, places = places_in(table, slice(-6, None), (6, 7), _unusable)
    if len(places) < 3:
        raise _unusable("placement.too_few_points", f"holds {len(places)} points", path)
    _check_header(header, path, in_metres)
    names = (
        cells[0] if len(cells) == 7 else f"{count} (line {number})"
        for count, (number, cells, _) in enumerate(places, 1)
    )
    return tuple(names), np.array([numbers for _, _, numbers in places])


def _check_header(header: str, path: str, in_metres: bool) -> None:
    """Refuse names of columns that say that the survey stands first, or is in another unit than it is read in."""
    cells = re.split(r"[,;\t]", header.lower()) if re.search(r"[,;\t]", header) else header.lower().split()
    words = [set(re.findall("[a-z]+", cell)) for cell in cells[-6:]]
    if len(words) < 6:
        return
    surveyed = [all(value & _SURVEYED for value in part) for part in (words[:3], words[3:])]
    if surveyed == [True, False]:
        raise _unusable(
            "placement.sides_exchanged", "names the surveyed coordinates before the model's", path
        )
    other = [cell.strip() for cell, value in zip(cells[-3:], words[3:], strict=True) if value & _OTHER_UNITS]
    if in_metres and other:
        raise _unusable(
            "coordinates.unit_not_metres",
            f"states the survey under {', '.join(other)}, and it is read in metres",
            path,
        )


AXES = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1), "-x": (-1, 0, 0), "-y": (0, -1, 0), "-z": (0, 0, -1)}
Length = tuple[Sequence[float], Sequence[float], float]


@dataclass(frozen=True, eq=False)
class Placement:
    """A similarity from a model's coordinates to metres, z up."""

    scale: float = 1.0
    turn: Array = field(default_factory=lambda: np.eye(3))  # (3, 3): rotation
    shift_m: Array = field(default_factory=lambda: np.zeros(3))  # (3,)
    by: str = ""  # who says so; empty if nothing is changed
    # Whether the user said which way is up, and how long a unit is.
    says_up: bool = False
    says_scale: bool = False

    def apply(self, points: Array) -> Array:
        """Metres (n, 3) of places in the model."""
        return self.scale * (points @ self.turn.T) + self.shift_m

    def undo(self, points_m: Array) -> Array:
        """Places of the model (n, 3) that lie there in metres."""
        return ((points_m - self.shift_m) / self.scale) @ self.turn


def placement_of(
    up: str | Sequence[float] | None = None,
    length: Length | None = None,
    gcp: str | Path | Sequence[str] | None = None,
    metres_per_unit: Sequence[float] = (1.0, 1.0),
) -> Placement:
    """Placement by what the user says.

    Parameters
    ----------
    up : str or (3,) floats, optional
        Axis of the model that points upward: one of `AXES`, or a vector.
    length : (p, q, metres), optional
        Two places of the model and the distance between them.
    gcp : path or lines, optional
        Control points, which say scale and attitude too.
    metres_per_unit : (float, float)
        Of surveyed coordinates, across and upward.

    Raises
    ------
    InputError
        If what is said contradicts itself, the length is none, or the points cannot be used.
    """
    if gcp is not None:
        if up or length:
            raise InputError(
                "placement.given_twice",
                f"--gcp is given with {'--up' if up else '--length'}",
                where="--gcp",
                expected="control points alone: they say scale and attitude",
                remedy="leave out the other option",
            )
        fit = fit_control_points(gcp, metres_per_unit)
        return Placement(
            fit.scale, fit.turn, fit.shift_m, f"--gcp: {fit.sentence}", says_up=True, says_scale=True
        )
    turn, note = (upward(up), f"--up {_words(up)}") if up else (np.eye(3), "")
    if length is None:
        return Placement(turn=turn, by=note, says_up=bool(up))
    start, end, metres = np.asarray(length[0], float), np.asarray(length[1], float), float(length[2])
    apart = float(np.linalg.norm(end - start))
    if not (0.0 < apart < np.inf and 0.0 < metres < np.inf):
        raise InputError(
            "placement.length_unusable",
            f"two places {apart:g} apart are said to be {metres:g} m apart",
            where="--length",
            expected="two different places X,Y,Z of the model and a length in metres above 0",
            remedy="pick two marks whose distance was measured",
        )
    by = f"--length: {apart:.6g} units are {metres:g} m" + (f"; {note}" if note else "")
    return Placement(metres / apart, turn, by=by, says_up=bool(up), says_scale=True)


def upward(axis: str | Sequence[float]) -> Array:
    """Rotation (3, 3) that carries an axis of a model upward; -z by half a turn about x.

    Raises
    ------
    InputError
        If it is no axis and no vector.

    Examples
    --------
    >>> (upward("y") @ [0.0, 1.0, 0.0]).round(12).tolist(), (upward([0, 0, -2]) @ [1.0, 0.0, -1.0]).tolist()
    ([0.0, 0.0, 1.0], [1.0, 0.0, 1.0])
    """
    try:
        words = axis.replace(",", " ").split() if isinstance(axis, str) else axis
        vector = np.array(AXES.get(str(axis).strip().lower(), words), float)
    except ValueError:
        vector = np.zeros(0)
    if vector.shape != (3,) or not np.isfinite(vector).all() or not vector.any():
        raise InputError(
            "placement.up_unreadable",
            f"'{_words(axis)}' is no direction",
            where="--up",
            expected=f"one of {', '.join(AXES)}, or three numbers X,Y,Z that point upward in the model",
            remedy="write it like --up y, or --up 0,0.98,0.17",
        )
    vector /= np.linalg.norm(vector)
    if vector[2] < -1.0 + 1e-12:
        return np.diag([1.0, -1.0, -1.0])
    return rotation_between(vector, (0.0, 0.0, 1.0))


def _words(up: str | Sequence[float] | None) -> str:
    return up if isinstance(up, str) else ",".join(f"{value:g}" for value in up or ())


_SYSTEMS = (
    "PROJCS|GEOGCS|COMPD_CS|GEOCCS|LOCAL_CS|VERT_CS|PROJCRS|GEOGCRS|GEODCRS|COMPOUNDCRS|ENGCRS|ENGINEERINGCRS|BOUNDCRS|"
    "PROJECTEDCRS|GEOGRAPHICCRS|GEODETICCRS"
)
_WKT = re.compile(rf"\b(?:{_SYSTEMS})\s*[\[(].*", re.DOTALL)
_CODE = re.compile(r"\bEPSG\s*:+\s*(\d{4,6})\b", re.IGNORECASE)
_LINEAR_UNIT, _LINEAR_SIZE, _VERTICAL_CODE, _VERTICAL_UNIT = 3076, 3077, 4096, 4099
_GEOCENTRIC_MODEL = 3
_USER_DEFINED = 32767

Reference = dict[str, Any]
"""Coordinate system in JSON: `name`, `epsg` (or None), `metres_per_unit` [horizontal, vertical], `unit`, `note`."""


def of_wkt(wkt: str, where: str) -> Reference:
    """Coordinate system by its WKT, of either version.

    Raises InputError if it is geographic or geocentric, has no axis of a known length, or is not understood.
    """
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    try:
        return _of_crs(CRS.from_wkt(wkt.rstrip("\0 \r\n")), where)
    except CRSError as error:
        raise _not_understood(f"{wkt[:60]}...: {str(error).splitlines()[0][:120]}", where) from None


def _of_code(code: int, where: str) -> Reference:
    """Coordinate system by its EPSG code.

    Raises InputError as of `of_wkt`.
    """
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    try:
        return _of_crs(CRS.from_epsg(code), where)
    except CRSError:
        raise _not_understood(f"EPSG:{code}", where) from None


def of_user(text: str) -> Reference:
    """Coordinate system as a user names it: EPSG:32611, its number alone, WKT, or a PROJ string.

    Raises
    ------
    InputError
        As of `of_wkt`.

    Examples
    --------
    >>> system = of_user("EPSG:32611")
    >>> system["name"], system["metres_per_unit"]
    ('WGS 84 / UTM zone 11N', [1.0, 1.0])
    """
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    try:
        return _of_crs(CRS.from_user_input(int(text) if text.strip().isdigit() else text), "--crs")
    except CRSError as error:
        raise InputError(
            "coordinates.crs_unknown",
            f"'{text[:60]}' names no coordinate system ({str(error).splitlines()[0][:120]})",
            where="--crs",
            expected="a projected coordinate system: EPSG:32611, or its WKT",
            remedy="look up the code of the survey's coordinate system, such as that of its UTM zone",
        ) from None


def of_geo_keys(keys: bytes, doubles: bytes, where: str) -> Reference | None:
    """Coordinate system by GeoTIFF's keys; None if they say nothing of lengths.

    Raises InputError as of `of_wkt`.
    """
    from laspy.vlrs import geotiff

    values, projected = _keys(keys, doubles), geotiff.ProjectedCSTypeGeoKey.id
    usual = geotiff.ModelTypeProjected if projected in values else None
    model = values.get(geotiff.GTModelTypeGeoKey.id, usual)
    if model == geotiff.ModelTypeGeographic or (model is None and geotiff.GeographicTypeGeoKey.id in values):
        raise in_degrees("GeoTIFF's keys state a geographic system", where)
    if model == _GEOCENTRIC_MODEL:
        raise _geocentric(where)
    code = values.get(projected, _USER_DEFINED)
    plane = _of_code(int(code), where) if 0 < code < _USER_DEFINED else None
    across = _unit(values, _LINEAR_UNIT, values.get(_LINEAR_SIZE), where)
    up = _unit(values, _VERTICAL_UNIT, None, where)
    if across is None and plane is None and up is None:
        return None
    stated = across or (plane["metres_per_unit"][0] if plane else None)
    if stated is None:
        raise _not_understood(f"keys that state the unit of heights alone ({up} m)", where)
    if up is None and 0 < values.get(_VERTICAL_CODE, 0) < _USER_DEFINED:
        up = _vertical(int(values[_VERTICAL_CODE]))
    return _reference(
        plane["name"] if plane else "GeoTIFF keys", plane["epsg"] if plane else None, stated, up
    )


def of_words(text: str, where: str) -> Reference | None:
    """Coordinate system that a text names, as WKT or by an EPSG code; None if it names none."""
    if wkt := _WKT.search(text):
        return of_wkt(_balanced(wkt[0]), where)
    if code := _CODE.search(text):
        return _of_code(int(code[1]), where)
    return None


def _balanced(text: str) -> str:
    """Text up to where its first bracket closes."""
    depth, quoted = 0, False
    for at, letter in enumerate(text):
        quoted ^= letter == '"'
        if not quoted:
            depth += (letter in "[(") - (letter in ")]")
            if depth == 0 and letter in ")]":
                return text[: at + 1]
    return text


def _of_crs(crs: Any, where: str) -> Reference:
    """Reference of a coordinate system of PROJ."""
    while crs.is_bound:
        crs = crs.source_crs
    parts = crs.sub_crs_list if crs.is_compound else [crs]
    plane = parts[0]
    while plane.is_bound:
        plane = plane.source_crs
    if plane.is_geographic:
        raise in_degrees(f"{crs.name}: geographic", where)
    if plane.is_geocentric:
        raise _geocentric(where)
    axes = [*plane.axis_info, *(axis for part in parts[1:] for axis in part.axis_info)]
    lengths = [axis.unit_conversion_factor for axis in axes]
    level = lengths[:2] if not plane.is_vertical else []
    if len(level) < 2 or min(lengths) <= 0.0 or any("degree" in axis.unit_name for axis in axes):
        raise _not_understood(f"{crs.name}, with no two horizontal axes of a length", where)
    if level[0] != level[1]:
        raise _not_understood(f"{crs.name}, with axes in two units", where)
    up = lengths[2] if len(lengths) > 2 else None
    return _reference(crs.name, crs.to_epsg() or plane.to_epsg(), level[0], up)


def _reference(name: str, epsg: int | None, across: float, up: float | None) -> Reference:
    """Metres of a unit across and upward; where nobody states that of heights, it is that of the plane."""
    surmised = up is None and across != 1.0
    up = across if up is None else up
    return {
        "name": name,
        "epsg": epsg,
        "metres_per_unit": [across, up],
        "unit": _unit_name(across, up),
        "note": "the unit of heights is not stated: taken as that of the plane" if surmised else "",
    }


def _unit_name(across: float, up: float) -> str:
    """Name of the units across and up."""
    from pyproj.database import get_units_map

    known: dict[float, str] = {}
    for unit in get_units_map(auth_name="EPSG", category="linear").values():
        known.setdefault(round(unit.conv_factor, 9), unit.name)
    first, other = (known.get(round(value, 9), f"{value:.9g} m") for value in (across, up))
    return first if first == other else f"{first}, heights in {other}"


def _keys(keys: bytes, doubles: bytes) -> dict[int, float]:
    """Numbers of GeoTIFF's keys."""
    from laspy.vlrs.known import GeoDoubleParamsVlr

    words = struct.unpack(f"<{len(keys) // 2}H", keys[: len(keys) // 2 * 2])
    numbers = struct.unpack(f"<{len(doubles) // 8}d", doubles[: len(doubles) // 8 * 8])
    values: dict[int, float] = {}
    for at in range(4, min(len(words), 4 + 4 * (words[3] if len(words) > 3 else 0)) - 3, 4):
        key, place, count, value = words[at : at + 4]
        if place == 0:
            values[key] = value
        elif (place,) == GeoDoubleParamsVlr.official_record_ids() and count >= 1 and value < len(numbers):
            values[key] = numbers[value]
    return values


def _unit(values: dict[int, float], key: int, size: float | None, where: str) -> float | None:
    """Metres of the unit that a key names by its code in EPSG, None if there is none."""
    from pyproj.database import get_units_map

    code = int(values.get(key, 0))
    if code in (0, _USER_DEFINED):
        if code and key == _LINEAR_UNIT and (size is None or not 1e-6 < size < 1e6):
            raise _not_understood("a unit of its own without its size", where)
        return size if code else None
    for unit in get_units_map(auth_name="EPSG", category="linear", allow_deprecated=True).values():
        if unit.code == str(code):
            return float(unit.conv_factor)
    raise _not_understood(f"GeoTIFF key {key} is {code}, no unit of length", where)


def _vertical(code: int) -> float | None:
    """Metres of the unit of a vertical coordinate system; None if it is not known."""
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    try:
        axes = CRS.from_epsg(code).axis_info
    except CRSError:
        return None
    return float(axes[-1].unit_conversion_factor) if axes else None


def _geocentric(where: str) -> InputError:
    return InputError(
        "coordinates.geocentric",
        "coordinates are geocentric: z does not point up",
        where=where,
        expected="projected or local coordinates, z up",
        remedy="project the cloud first, such as to the UTM zone of the site, and export again",
    )


def _not_understood(what: str, where: str) -> InputError:
    return InputError(
        "coordinates.crs_unknown",
        f"its coordinate system is not understood: {what}",
        where=where,
        expected="a projected or local coordinate system with units of length",
        remedy="say in which unit the coordinates are by --units, which wins over what the file says",
    )
