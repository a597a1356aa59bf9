"""Units of length: their names as files and people write them, and which of them would explain a rock's size."""

import re
from collections.abc import Iterable

from toppling.models.errors import InputError, refusals

_US_FOOT_M = 1200.0 / 3937.0
METRES = {
    "m": 1.0,
    "mm": 1e-3,
    "cm": 1e-2,
    "dm": 0.1,
    "km": 1e3,
    "ft": 0.3048,
    "us-ft": _US_FOOT_M,
    "in": 0.0254,
    "yd": 0.9144,
}
"""Metres of one of each unit; its names are those of `--units`."""
_SPOKEN = {
    "m": r"m|met(?:re|er)s?",
    "mm": r"mm|milli ?met(?:re|er)s?",
    "cm": r"cm|centi ?met(?:re|er)s?",
    "dm": r"dm|deci ?met(?:re|er)s?",
    "km": r"km|kilo ?met(?:re|er)s?",
    "us-ft": r"(?:us|u ?s) ?(?:survey )?(?:ft|feet|foot)|us ?ft|ft ?us|survey (?:ft|feet|foot)|"
    r"(?:ft|feet|foot) ?us(?: survey)?",
    "ft": r"i?ft|feet|foot|(?:international|intl) (?:feet|foot|ft)",
    "in": r"in|inch(?:es)?",
    "yd": r"yd|yards?",
}
_DEGREES = re.compile(r"(?:decimal )?(?:deg|degrees?|°)\b|lat\w*[ /,]+lon\w*")
_ANY = re.compile(
    "|".join(f"(?P<{unit.replace('-', '_')}>(?:{words}))\\b" for unit, words in _SPOKEN.items())
)
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
NAMES = {"ft": "feet", "us-ft": "US survey feet", "in": "inches", "mm": "millimetres", "cm": "centimetres"} | {
    "yd": "yards", "dm": "decimetres", "km": "kilometres", "m": "metres",
}  # fmt: skip


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
    readings = []
    for unit in ("mm", "ft", "cm", "in"):
        height = height_m * METRES[unit]
        if _ROCK_M[0] * 5.0 <= height <= _ROCK_M[1]:
            readings.append(f"{NAMES[unit]} ({height:.3g} m)")
    return ", ".join(readings)


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
        raise InputError(
            f"{unit!r} is no unit of length",
            where="units",
            expected=f"one of {', '.join(METRES)}",
            remedy="leave it out for metres",
        )
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
