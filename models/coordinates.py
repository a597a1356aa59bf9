"""Longitudes and latitudes as people write them: with compass letters, signs of degrees, minutes, decimal commas."""

import re

_PARTS = re.compile(
    r"(?P<before>[NSEW]?)\s*(?P<sign>[-+\u2212]?)\s*(?P<degrees>\d{1,3}(?:[.,]\d+)?)\s*(?:°|º|deg\.?|d)?"
    r"(?:[\s:]*(?<![\d.,])(?P<minutes>\d{1,2}(?:[.,]\d+)?)\s*(?:['\u2032\u2019m])?)?"
    r"(?:[\s:]*(?<![\d.,])(?P<seconds>\d{1,2}(?:[.,]\d+)?)\s*(?:[\"\u2033\u201ds]|'')?)?\s*(?P<after>[NSEW]?)",
    re.IGNORECASE,
)
_LETTERS = {"longitude": "EW", "latitude": "NS"}
_LONGEST = 40


def degrees_of(text: str, axis: str) -> float | None:
    """Degrees east or north that a text states; None if it states none, or those of the other axis.

    text: A number (`-118.92`, `-118,92`), one with a compass letter (`118.92W`, `N 34.08`), or with minutes and seconds
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
