"""Parsing of directions and coordinates: bearings, quadrants, compass points; longitudes and latitudes."""

import math
import re

from toppling.models.errors import InputError

WINDS = ("N", "NNE", "NE", "ENE", "E", "ESE", "SE", "SSE", "S", "SSW", "SW", "WSW", "W", "WNW", "NW", "NNW")
_QUADRANT = re.compile(r"([NS])\s*(\d+(?:\.\d*)?)\s*°?\s*([EW])", re.IGNORECASE)


def azimuth_of(text: str | float) -> float:
    """Parse a direction to an azimuth, degrees counter-clockwise from east.

    text: an azimuth (`50`), a compass bearing (`compass:40`), a quadrant bearing (`N40E`) or a compass point (`NNE`).
    Raises InputError if it is none of these.

    Examples
    --------
    >>> azimuth_of("50"), azimuth_of("compass:40"), azimuth_of("N40E"), azimuth_of("S30W"), azimuth_of("NW")
    (50.0, 50.0, 50.0, 240.0, 135.0)
    """
    stated = str(text).strip()
    bearing: float | None = None
    try:
        if stated.lower().startswith("compass:"):
            bearing = float(stated[8:])
            if not 0.0 <= bearing <= 360.0:
                raise ValueError
        elif (quadrant := _QUADRANT.fullmatch(stated)) is not None:
            away = float(quadrant[2])
            if away > 90.0:
                raise ValueError
            north, east = quadrant[1].upper() == "N", quadrant[3].upper() == "E"
            bearing = (away if north else 180.0 - away) if east else (-away if north else 180.0 + away)
        elif stated.upper() in WINDS:
            bearing = 22.5 * WINDS.index(stated.upper())
        if bearing is not None:
            return (90.0 - bearing) % 360.0
        if not math.isfinite(azimuth := float(stated)):
            raise ValueError
    except ValueError:
        raise InputError(
            "azimuth.unreadable",
            f"'{text}' is no direction",
            where="azimuth",
            expected="degrees counter-clockwise from east (50), a compass bearing (compass:40, N40E) or a wind (NNE)",
            remedy="write a bearing of 40 degrees as compass:40 or N40E; a bare number is counted from east",
        ) from None
    return azimuth


def quadrant_of(azimuth_deg: float) -> str:
    """An azimuth, degrees counter-clockwise from east, as a quadrant bearing to the degree, or as one of four winds.

    Examples
    --------
    >>> [quadrant_of(azimuth) for azimuth in (50.0, 240.0, 135.0, 90.0, -0.2)]
    ['N40E', 'S30W', 'N45W', 'N', 'E']
    """
    bearing = round(90.0 - azimuth_deg) % 360
    if bearing % 90 == 0:
        return WINDS[bearing // 90 * 4]
    away = bearing if bearing < 90 else abs(180 - bearing) if bearing < 270 else 360 - bearing
    return f"{'S' if 90 < bearing < 270 else 'N'}{away}{'E' if bearing < 180 else 'W'}"


_PARTS = re.compile(
    r"(?P<before>[NSEW]?)\s*(?P<sign>[-+\u2212]?)\s*(?P<degrees>\d{1,3}(?:[.,]\d+)?)\s*(?:°|º|deg\.?|d)?"
    r"(?:[\s:]*(?<![\d.,])(?P<minutes>\d{1,2}(?:[.,]\d+)?)\s*(?:['\u2032\u2019m])?)?"
    r"(?:[\s:]*(?<![\d.,])(?P<seconds>\d{1,2}(?:[.,]\d+)?)\s*(?:[\"\u2033\u201ds]|'')?)?\s*(?P<after>[NSEW]?)",
    re.IGNORECASE,
)
_LETTERS = {"longitude": "EW", "latitude": "NS"}
_LONGEST = 40
"""Maximum number of characters of a coordinate that are parsed."""


def degrees_of(text: str, axis: str) -> float | None:
    """Parse degrees east or north; None if the text is invalid, or of the other axis.

    text: a number (`-118.92`, `-118,92`), one with a compass letter (`118.92W`, `N 34.08`), or with minutes and seconds
    (`118°55'12"W`, `118 55 12 W`).
    axis: `longitude` or `latitude`.

    Examples
    --------
    >>> [degrees_of(text, "longitude") for text in ("-118.92", "118.92 W", "118°55'12\\"W", "34.08N", "11855")]
    [-118.92, -118.92, -118.92, None, None]
    """
    match = _PARTS.fullmatch(text.strip()[:_LONGEST])
    if match is None:
        return None
    letter = (match["before"] or match["after"]).upper()
    if (match["before"] and match["after"]) or (letter and (letter not in _LETTERS[axis] or match["sign"])):
        return None
    if match["minutes"] and re.search("[.,]", match["degrees"]):
        return None
    degrees, minutes, seconds = (
        float((match[part] or "0").replace(",", ".")) for part in ("degrees", "minutes", "seconds")
    )
    if minutes >= 60 or seconds >= 60:
        return None
    size = round(degrees + minutes / 60 + seconds / 3600, 9)
    return -size if letter in ("W", "S") or match["sign"] in ("-", "\u2212") else size
