"""Directions as people say them: azimuths, compass bearings, quadrants and winds."""

import math
import re

from toppling.models.errors import InputError

WINDS = ("N", "NNE", "NE", "ENE", "E", "ESE", "SE", "SSE", "S", "SSW", "SW", "WSW", "W", "WNW", "NW", "NNW")
_QUADRANT = re.compile(r"([NS])\s*(\d+(?:\.\d*)?)\s*°?\s*([EW])", re.IGNORECASE)


def azimuth_of(text: str) -> float:
    """Azimuth, degrees counter-clockwise from east, of a direction as a person writes it.

    text: An azimuth (`50`), a compass bearing (`compass:40`), a quadrant bearing (`N40E`) or a wind (`NNE`).
    Raises InputError if it is none of these.

    Examples
    --------
    >>> azimuth_of("50"), azimuth_of("compass:40"), azimuth_of("N40E"), azimuth_of("S30W"), azimuth_of("NW")
    (50.0, 50.0, 50.0, 240.0, 135.0)
    """
    said = text.strip()
    bearing: float | None = None
    try:
        if said.lower().startswith("compass:"):
            bearing = float(said[8:])
            if not 0.0 <= bearing <= 360.0:
                raise ValueError
        elif (quadrant := _QUADRANT.fullmatch(said)) is not None:
            away = float(quadrant[2])
            if away > 90.0:
                raise ValueError
            north, east = quadrant[1].upper() == "N", quadrant[3].upper() == "E"
            bearing = (away if north else 180.0 - away) if east else (-away if north else 180.0 + away)
        elif said.upper() in WINDS:
            bearing = 22.5 * WINDS.index(said.upper())
        if bearing is not None:
            return (90.0 - bearing) % 360.0
        if not math.isfinite(azimuth := float(said)):
            raise ValueError
    except ValueError:
        raise InputError(
            f"'{text}' is no direction",
            where="azimuth",
            expected="degrees counter-clockwise from east (50), a compass bearing (compass:40, N40E) or a wind (NNE)",
            remedy="write a bearing of 40 degrees as compass:40 or N40E; a bare number is counted from east",
        ) from None
    return azimuth
