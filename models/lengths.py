"""Units of length: their names as files and people write them, and which of them would explain a rock's size."""

import re
from collections.abc import Iterable

from toppling.models.errors import InputError, refusals

_US_FOOT_M = 1200.0 / 3937.0
_UNITS = {
    "m": (1.0, "metres", r"m|met(?:re|er)s?"),
    "mm": (1e-3, "millimetres", r"mm|milli ?met(?:re|er)s?"),
    "cm": (1e-2, "centimetres", r"cm|centi ?met(?:re|er)s?"),
    "dm": (0.1, "decimetres", r"dm|deci ?met(?:re|er)s?"),
    "km": (1e3, "kilometres", r"km|kilo ?met(?:re|er)s?"),
    "ft": (0.3048, "feet", r"i?ft|feet|foot|(?:international|intl) (?:feet|foot|ft)"),
    "us-ft": (
        _US_FOOT_M,
        "US survey feet",
        r"(?:us|u ?s) ?(?:survey )?(?:ft|feet|foot)|us ?ft|ft ?us|survey (?:ft|feet|foot)|"
        r"(?:ft|feet|foot) ?us(?: survey)?",
    ),
    "in": (0.0254, "inches", r"in|inch(?:es)?"),
    "yd": (0.9144, "yards", r"yd|yards?"),
}
"""Of each unit: metres of one, its name, and how people and files write it."""
METRES = {unit: metres for unit, (metres, _, _) in _UNITS.items()}
"""Metres of one of each unit; its names are those of `--units`."""
NAMES = {unit: name for unit, (_, name, _) in _UNITS.items()}
_DEGREES = re.compile(r"(?:decimal )?(?:deg|degrees?|°)\b|lat\w*[ /,]+lon\w*")
_ANY = re.compile(
    "|".join(
        f"(?P<{unit.replace('-', '_')}>(?:{_UNITS[unit][2]}))\\b" for unit in sorted(_UNITS, reverse=True)
    )
)
"""US survey feet before feet, with which some of their names begin."""
_SAID = re.compile(
    r"\b(?:units?(?: of (?:length|measure(?:ment)?))?|(?:linear|length|coordinate|vertical|horizontal)s? ?units?)\b"
    r" ?(?:[:=]|\bare\b|\bis\b|\bin\b)? ?(?:in )?(?:the )?(?P<word>[^,;]{1,40})"
    r"|\b(?:coordinates?|points?|vertices|x y z|xyz|values?|lengths?|distances?|dimensions?|heights?|data|model|mesh|"
    r"cloud|scan(?:ned)?|scaled?|measured|given|expressed|exported|saved|stored)\b"
    r"(?: are| is| given| stored| measured| expressed| exported)* in (?P<in>[^,;]{1,40})"
    r"|(?P<foot>\b(?:us survey|survey|us|international) (?:feet|foot)\b|\bft ?us\b|\bus ?ft\b)"
)
_OUTRIGHT = re.compile(
    r"\W*(?:linear|length|coordinate|model)?s? ?units?\s*[:=]\s*[\"']?(?P<word>[a-z][\w./ -]{0,30})"
)
_NO_LENGTHS = ("db", "none", "unknown", "count", "dn", "raw", "percent", "rgb", "unitless", "intensity")
"""Words after "units" that are about something else than coordinates, or say nothing."""
_ROCK_M = (0.1, 30.0)
"""Heights of the precarious rocks that are known; others are told which unit would make them one."""
_LARGEST_M3 = 5000.0
"""Twice the volume of the largest balanced rocks."""
_CUBES_OF_HEIGHT = (0.01, 3.0)
"""Volumes of rocks on a cube of their height: thinner ones are no rocks, flatter ones not precarious."""

_unclear = refusals(
    expected=f"one of {', '.join(METRES)}",
    remedy="say in which unit the coordinates are by --units, which wins over what the file says",
)


def _unit_called(word: str) -> str | None:
    """The unit that a word names, as in `METRES`; None if it names none.

    Examples
    --------
    >>> _unit_called("US Survey Feet"), _unit_called("Millimeters"), _unit_called("cubits")
    ('us-ft', 'mm', None)
    """
    found = _ANY.match(re.sub(r"[\s._()\"'-]+", " ", word.lower()).strip())
    return found.lastgroup.replace("_", "-") if found is not None and found.lastgroup else None


def unit_of_remarks(remarks: Iterable[str], where: str) -> str | None:
    """The unit that remarks in a file state, None if they state none.

    remarks: such as "units: US survey feet", "coordinates in mm".
    where: the file, for errors.
    Raises InputError if they state degrees, a unit that nobody knows, two, or one of heights alone.

    Examples
    --------
    >>> unit_of_remarks(["made by a scanner", "Units: US Survey Feet"], "cloud.ply")
    'us-ft'
    """
    found, of_heights_alone = set(), True
    for remark in remarks:
        plain = re.sub(r"[\s._()\"'\[\]-]+", " ", remark.lower())
        for said in _SAID.finditer(plain):
            word = (said["word"] or said["in"] or said["foot"]).strip(" :=")
            if _DEGREES.match(word) and said["in"]:
                raise in_degrees(remark.strip()[:80], where)
            if (unit := _unit_called(word)) is not None:
                found.add(unit)
                of_heights_alone &= said[0].startswith("vertical")
        outright = _OUTRIGHT.match(remark.lower().strip())
        if outright is not None and not _unit_called(outright["word"]):
            if _DEGREES.match(outright["word"]):
                raise in_degrees(remark.strip()[:80], where)
            if not outright["word"].startswith(_NO_LENGTHS):
                raise _unclear(f"it states a unit that is not known: {remark.strip()[:80]!r}", where)
    if found and of_heights_alone:
        raise _unclear("it states the unit of heights alone", where)
    if len(found) > 1:
        raise _unclear(f"it states two units: {', '.join(NAMES[unit] for unit in sorted(found))}", where)
    return next(iter(found), None)


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
    """Metres of one of a unit, by any name of it.

    Raises InputError if it names none.

    Examples
    --------
    >>> metres_in("mm"), metres_in("centimetres")
    (0.001, 0.01)
    """
    known = _unit_called(str(unit))
    if known is None:
        what, expected = f"{unit!r} is no unit of length", f"one of {', '.join(METRES)}"
        raise InputError(what, where="units", expected=expected, remedy="leave it out for metres")
    return METRES[known]


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
        f"coordinates are in degrees ({what})",
        where=where,
        expected="projected or local coordinates: lengths in three directions, z up",
        remedy="project the cloud first, such as to the UTM zone of the site, and export again",
    )
