"""What a file says of its coordinates: the coordinate system, and the units of its two horizontal axes and of height.

WKT and codes are parsed by PROJ, in C++, so only in the guarded process.
"""

import re
import struct
from typing import Any

from toppling.models.errors import InputError
from toppling.models.lengths import in_degrees

_LONGEST_WKT = 20_000
_SYSTEMS = (
    "PROJCS|GEOGCS|COMPD_CS|GEOCCS|LOCAL_CS|VERT_CS|PROJCRS|GEOGCRS|GEODCRS|COMPOUNDCRS|ENGCRS|ENGINEERINGCRS|BOUNDCRS|"
    "PROJECTEDCRS|GEOGRAPHICCRS|GEODETICCRS"
)
_WKT = re.compile(rf"\b(?:{_SYSTEMS})\s*[\[(].*", re.DOTALL)
_CODE = re.compile(r"\bEPSG\s*:+\s*(\d{4,6})\b", re.IGNORECASE)
GEO_KEYS, GEO_DOUBLES = 34735, 34736
_MODEL, _GEOGRAPHIC_CODE, _PROJECTED_CODE = 1024, 2048, 3072
_LINEAR_UNIT, _LINEAR_SIZE, _VERTICAL_CODE, _VERTICAL_UNIT = 3076, 3077, 4096, 4099
_PROJECTED_MODEL, _GEOGRAPHIC_MODEL, _GEOCENTRIC_MODEL = 1, 2, 3
_USER_DEFINED = 32767

Reference = dict[str, Any]
"""What JSON can say of it: `name`, `epsg` (or None), `metres_per_unit` [horizontal, vertical], `unit`, `note`."""


def of_wkt(wkt: str, where: str) -> Reference:
    """Coordinate system by its WKT, of either version.

    Raises InputError if it is geographic or geocentric, has no axis of a known length, or is not understood.
    """
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    try:
        return _of_crs(CRS.from_wkt(wkt[:_LONGEST_WKT].rstrip("\0 \r\n")), where)
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
    values = _keys(keys, doubles)
    model = values.get(_MODEL, _PROJECTED_MODEL if _PROJECTED_CODE in values else None)
    if model == _GEOGRAPHIC_MODEL or (model is None and _GEOGRAPHIC_CODE in values):
        raise in_degrees(f"GeoTIFF key {_MODEL} is {_GEOGRAPHIC_MODEL}, geographic", where)
    if model == _GEOCENTRIC_MODEL:
        raise _geocentric(where)
    code = values.get(_PROJECTED_CODE, _USER_DEFINED)
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
    for at, letter in enumerate(text[:_LONGEST_WKT]):
        quoted ^= letter == '"'
        if not quoted:
            depth += (letter in "[(") - (letter in ")]")
            if depth == 0 and letter in ")]":
                return text[: at + 1]
    return text


def _of_crs(crs: Any, where: str) -> Reference:
    """What matters of PROJ's coordinate system."""
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
    """What a person calls the units."""
    from pyproj.database import get_units_map

    known: dict[float, str] = {}
    for unit in get_units_map(auth_name="EPSG", category="linear").values():
        known.setdefault(round(unit.conv_factor, 9), unit.name)
    one, other = (known.get(round(each, 9), f"{each:.9g} m") for each in (across, up))
    return one if one == other else f"{one}, heights in {other}"


def _keys(keys: bytes, doubles: bytes) -> dict[int, float]:
    """Numbers of GeoTIFF's keys."""
    words = struct.unpack(f"<{len(keys) // 2}H", keys[: len(keys) // 2 * 2])
    numbers = struct.unpack(f"<{len(doubles) // 8}d", doubles[: len(doubles) // 8 * 8])
    values: dict[int, float] = {}
    for at in range(4, min(len(words), 4 + 4 * (words[3] if len(words) > 3 else 0)) - 3, 4):
        key, place, count, value = words[at : at + 4]
        if place == 0:
            values[key] = value
        elif place == GEO_DOUBLES and count >= 1 and value < len(numbers):
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
