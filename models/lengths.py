"""Units of length: their names as files and people write them, and which of them would explain a rock's size."""

import re
from collections.abc import Iterable

from toppling.models.errors import InputError

US_FOOT_M = 1200.0 / 3937.0
_UNITS = {
    "m": (1.0, "metres"),
    "mm": (1e-3, "millimetres"),
    "cm": (1e-2, "centimetres"),
    "ft": (0.3048, "feet"),
    "us-ft": (US_FOOT_M, "US survey feet"),
    "in": (0.0254, "inches"),
}
"""Of each unit: metres of one, and its name."""
METRES = {unit: metres for unit, (metres, _) in _UNITS.items()}
"""Metres of one of each unit; its names are those of `--units`."""
NAMES = {unit: name for unit, (_, name) in _UNITS.items()}
_OTHER = (
    r"(?:milli|centi|deci|kilo) ?met(?:re|er)s?|[mcdk]m|(?:us[ -]?|survey )?(?:feet|foot|ft)(?:[ -]?us)?|inch(?:es)?|"
    r"yards?|yd|deg(?:rees?)?"
)
_STATED = re.compile(
    r"\W*(?:(?:linear|length|coordinate|vertical|model) )?units?\s*[:=]\s*[\"']?(?!m\b|met(?:re|er)s?\b)\w|"
    rf".*\b(?:units? (?:[^,;.]{{0,30}} )?|in )(?:{_OTHER})\b|.*\bsurvey (?:feet|foot)\b",
    re.IGNORECASE,
)
"""A remark in a file that says what its coordinates are in, other than metres."""
_SYSTEM = re.compile(
    r"\bEPSG\s*:+\s*\d{4,6}|\b(?:PROJ|GEOG|COMP|GEOC|LOCAL_|BOUND|ENG)[A-Z_]*C[RS]S?\s*[\[(]"
)
_LONGEST = 200
"""Characters of a remark that are looked at."""
_ROCK_M = (0.1, 30.0)
"""Heights of the precarious rocks that are known; others are told which unit would make them one."""
_LARGEST_M3 = 5000.0
"""Twice the volume of the largest balanced rocks."""
_CUBES_OF_HEIGHT = (0.01, 3.0)
"""Volumes of rocks on a cube of their height: thinner ones are no rocks, flatter ones not precarious."""


def other_unit_in(remarks: Iterable[str]) -> str:
    """The first remark that states another unit than metres; empty where none does.

    Examples
    --------
    >>> other_unit_in(["made in Germany", "Units: US Survey Feet"]), other_unit_in(["units: metres"])
    ('Units: US Survey Feet', '')
    """
    return next((remark.strip()[:80] for remark in remarks if _STATED.match(remark[:_LONGEST])), "")


def check_remarks(remarks: Iterable[str], where: str) -> None:
    """Refuse a file whose remarks state another unit than metres, or a coordinate system: remarks are not converted.

    Raises InputError with the option that says the unit.
    """
    told = list(remarks)
    unit = other_unit_in(told)
    system = next((remark.strip()[:80] for remark in told if _SYSTEM.search(remark[:_LONGEST])), "")
    if unit or system:
        raise InputError(
            "coordinates.unit_not_metres",
            f"a remark states {'another unit than metres' if unit else 'a coordinate system'}: {unit or system!r}",
            where=where,
            expected="coordinates in metres",
            remedy="say which unit they are in by --units (in Python units), or the system by --crs EPSG:2229",
        )


def explaining_units(height_m: float) -> str:
    """Units in which a height would be a rock's, with what it would be; empty if there are none.

    Examples
    --------
    >>> explaining_units(46.1)
    'feet (14.1 m), inches (1.17 m)'
    """
    heights = {unit: height_m * METRES[unit] for unit in ("mm", "ft", "cm", "in")}
    readings = {unit: m for unit, m in heights.items() if _ROCK_M[0] * 5.0 <= m <= _ROCK_M[1]}
    return ", ".join(f"{NAMES[unit]} ({m:.3g} m)" for unit, m in readings.items())


def metres_in(unit: str) -> float:
    """Metres of one of a unit, by its key in `METRES` or its name, as trimesh has it.

    Raises InputError if it names none.

    Examples
    --------
    >>> metres_in("mm"), metres_in("centimeters")
    (0.001, 0.01)
    """
    word = str(unit).strip().lower().replace("meter", "metre")
    word = {"foot": "feet", "inch": "inches"}.get(word, word)
    for key, (metres, name) in _UNITS.items():
        if word in (key, name.lower(), name.lower().removesuffix("s")):
            return metres
    what, expected = f"{unit!r} is no unit of length", f"one of {', '.join(METRES)}"
    raise InputError(
        "units.unknown", what, where="units", expected=expected, remedy="leave it out for metres"
    )


def too_large(height_m: float, volume_m3: float, option: str = "--units") -> str:
    """What to say of a rock larger than any precarious one that is known; empty for others.

    option: by which the user says the unit.
    """
    told = []
    if height_m > _ROCK_M[1]:
        told.append(f"{height_m:.3g} m high, and no precarious rock is known above {_ROCK_M[1]:.0f} m")
    if volume_m3 > _LARGEST_M3:
        told.append(f"of {volume_m3:.3g} m³, and no precarious rock is known above {_LARGEST_M3:,.0f} m³")
    if not told:
        return ""
    readings = explaining_units(height_m)
    would = f"; if the coordinates are in {readings}, say so by {option}" if readings else ""
    return f"the rock is {', and it is '.join(told)}{would}"


def size_note(height_m: float, volume_m3: float = 0.0) -> str:
    """What to say of a height or a volume that no known precarious rock has; empty for others.

    Examples
    --------
    >>> size_note(14.05, 583.0)
    ''
    """
    told = [too_large(height_m, volume_m3)]
    cubes = volume_m3 / height_m**3
    if volume_m3 and not _CUBES_OF_HEIGHT[0] <= cubes <= _CUBES_OF_HEIGHT[1]:
        shape = "thinner" if cubes < _CUBES_OF_HEIGHT[0] else "flatter"
        told.append(
            f"the rock is {shape} than any precarious rock: are heights in the unit of the other coordinates?"
        )
    return "; ".join(filter(None, told))


def in_degrees(what: str, where: str) -> InputError:
    """Say that horizontal coordinates are angles."""
    return InputError(
        "coordinates.in_degrees",
        f"coordinates are in degrees ({what})",
        where=where,
        expected="projected or local coordinates: lengths in three directions, z up",
        remedy="project the cloud first, such as to the UTM zone of the site, and export again",
    )
