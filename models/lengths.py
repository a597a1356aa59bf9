"""Units of length: their names in files and options, and plausibility of a rock's size."""

import re
from collections.abc import Iterable

from toppling.models.errors import InputError
from toppling.models.files.given import LONGEST_NAME

US_FOOT_M = 1200.0 / 3937.0
"""US survey foot, m (exact definition)."""
_UNITS = {
    "m": (1.0, "metres"),
    "mm": (1e-3, "millimetres"),
    "cm": (1e-2, "centimetres"),
    "ft": (0.3048, "feet"),
    "us-ft": (US_FOOT_M, "US survey feet"),
    "in": (0.0254, "inches"),
}
"""Metres per unit, and name, of each unit."""
METRES = {unit: metres for unit, (metres, _) in _UNITS.items()}
"""Metres per unit, by the values of `--units`."""
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
"""Pattern of a remark in a file that states a unit of its coordinates other than metres."""
_SYSTEM = re.compile(
    r"\bEPSG\s*:+\s*\d{4,6}|\b(?:PROJ|GEOG|COMP|GEOC|LOCAL_|BOUND|ENG)[A-Z_]*C[RS]S?\s*[\[(]"
)
_ROCK_M = (0.1, 30.0)
"""Range of heights of known precarious rocks, m; outside it a more plausible unit is suggested."""
_LARGEST_M3 = 5000.0
"""Maximum plausible volume of a rock, m³: twice that of the largest balanced rocks."""


def other_unit_in(remarks: Iterable[str]) -> str:
    """First remark that states a unit other than metres; empty if there is none.

    Examples
    --------
    >>> other_unit_in(["made in Germany", "Units: US Survey Feet"]), other_unit_in(["units: metres"])
    ('Units: US Survey Feet', '')
    """
    return next((remark.strip()[:80] for remark in remarks if _STATED.match(remark[:LONGEST_NAME])), "")


def check_remarks(remarks: Iterable[str], where: str) -> None:
    """Raise InputError, with the option to use, if remarks state a unit other than metres or a coordinate system."""
    texts = list(remarks)
    unit = other_unit_in(texts)
    system = next((remark.strip()[:80] for remark in texts if _SYSTEM.search(remark[:LONGEST_NAME])), "")
    if unit or system:
        raise InputError(
            "coordinates.unit_not_metres",
            f"a remark states {'another unit than metres' if unit else 'a coordinate system'}: {unit or system!r}",
            where=where,
            expected="coordinates in metres",
            remedy="say which unit they are in by --units (in Python units), or the system by --crs EPSG:2229",
        )


def explaining_units(height_m: float) -> str:
    """List units in which a height would be plausible, with the height in metres; empty if there are none.

    Examples
    --------
    >>> explaining_units(46.1)
    'feet (14.1 m), inches (1.17 m)'
    """
    heights = {unit: height_m * METRES[unit] for unit in ("mm", "ft", "cm", "in")}
    readings = {unit: m for unit, m in heights.items() if _ROCK_M[0] * 5.0 <= m <= _ROCK_M[1]}
    return ", ".join(f"{NAMES[unit]} ({m:.3g} m)" for unit, m in readings.items())


def metres_in(unit: str) -> float:
    """Metres per unit, by its key in `METRES` or its name as in trimesh.

    Raises InputError for an unknown unit.

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
    """Warning of a rock larger than any known precarious one; empty for others.

    option: option that states the unit.
    """
    reasons = []
    if height_m > _ROCK_M[1]:
        reasons.append(f"{height_m:.3g} m high, and no precarious rock is known above {_ROCK_M[1]:.0f} m")
    if volume_m3 > _LARGEST_M3:
        reasons.append(f"of {volume_m3:.3g} m³, and no precarious rock is known above {_LARGEST_M3:,.0f} m³")
    if not reasons:
        return ""
    readings = explaining_units(height_m)
    would = f"; if the coordinates are in {readings}, say so by {option}" if readings else ""
    return f"the rock is {', and it is '.join(reasons)}{would}"


def in_degrees(what: str, where: str) -> InputError:
    """Error for horizontal coordinates in degrees."""
    return InputError(
        "coordinates.in_degrees",
        f"coordinates are in degrees ({what})",
        where=where,
        expected="projected or local coordinates: lengths in three directions, z up",
        remedy="project the cloud first, such as to the UTM zone of the site, and export again",
    )
