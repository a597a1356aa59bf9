"""Hazard curves of OpenSHA's applications: `Info:` in words, then two columns, in g (velocity cm/s).

The words hold the parameters of the calculation: `IMT = SA; SA Period = 1.0`, `Duration = 50.0`, the site.
"""

import re
from collections.abc import Sequence

from toppling.models.files.csv_text import is_numeral
from toppling.results.hazard.curves import curve_of
from toppling.results.hazard.readers.stated import (
    HazardFile,
    Hints,
    Statement,
    measure_named,
    number,
    refuse,
    years_of_values,
)

_IMT = re.compile(r"\bIMT = ([A-Za-z]\w*)")
_PERIOD = re.compile(r"\bSA Period = ([\d.]+)")
_DURATION = re.compile(r"\bDuration = ([\d.]+)")
_PLACE = {axis: re.compile(rf"\b{axis} = (-?[\d.]+)") for axis in ("Longitude", "Latitude")}
_RATES = re.compile(r"annuali[sz]ed rates?", re.IGNORECASE)


def matches(file: HazardFile) -> bool:
    """Whether words above two columns name a calculation's intensity measure as OpenSHA does."""
    return _IMT.search("\n".join(_words(file.lines))) is not None


def _words(lines: Sequence[str]) -> list[str]:
    """Lines before the first point."""
    first = next((n for n, line in enumerate(lines) if _is_point(line)), len(lines))
    return list(lines[:first])


def _is_point(line: str) -> bool:
    cells = line.replace(",", " ").split()
    return len(cells) == 2 and all(map(is_numeral, cells))


def read(file: HazardFile, hints: Hints) -> list[Statement]:
    """Read the curve of a file.

    Raises InputError if it holds none or several, or states neither rates nor a duration.
    """
    path, lines = file.path, file.lines
    words = _words(lines)
    about = "\n".join(words)
    rest = lines[len(words) :]
    points = [(n, line) for n, line in enumerate(rest, len(words) + 1) if _is_point(line)]
    last = points[-1][0] - len(words) if points else 0
    if not points or any(line.strip() for line in rest[: last - 1] if not _is_point(line)):
        refuse(path, "holds several curves" if points else "holds no curve", "save one curve in a file")
    period = _PERIOD.search(about)
    named = _IMT.findall(about)[0]
    imt = f"SA({period[1]})" if named == "SA" and period else named
    measure, unit = measure_named(path, imt)
    duration = _DURATION.search(about)
    stated = 0.0 if _RATES.search(about) else number(path, 1, duration[1]) if duration else None
    lacks = "states no Duration that its probabilities are over"
    years = years_of_values(path, stated, hints, lacks, "give --values 50")
    place = [found[1] for found in (pattern.search(about) for pattern in _PLACE.values()) if found]
    site = {"site": tuple(number(path, 1, degrees) for degrees in place)} if len(place) == 2 else {}
    x, y = zip(
        *([number(path, n, cell) for cell in line.replace(",", " ").split()] for n, line in points),
        strict=True,
    )
    levels = [level * unit for level in x]
    return [Statement(curve_of(path.stem, measure, levels, y, years, source=str(path), **site))]
