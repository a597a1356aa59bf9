"""Hazard curves of OpenSHA's applications: `Info:` in words, then two columns, in g (velocity cm/s).

The words hold the parameters of the calculation: `IMT = SA; SA Period = 1.0`, `Duration = 50.0`, the site.
"""

import re
from collections.abc import Sequence
from pathlib import Path

from toppling.models.files.csv_text import is_numeral
from toppling.results.hazard.curves import curve_of_probabilities, curve_of_rates
from toppling.results.hazard.measure_names import measure_of
from toppling.results.hazard.readers.stated import Hints, Statement, number, refuse, years_of_values

_IMT = re.compile(r"\bIMT = ([A-Za-z]\w*)")
_PERIOD = re.compile(r"\bSA Period = ([\d.]+)")
_DURATION = re.compile(r"\bDuration = ([\d.]+)")
_PLACE = {axis: re.compile(rf"\b{axis} = (-?[\d.]+)") for axis in ("Longitude", "Latitude")}
_RATES = re.compile(r"annuali[sz]ed rates?", re.IGNORECASE)


def matches(lines: Sequence[str]) -> bool:
    """Whether words above two columns name a calculation's intensity measure as OpenSHA does."""
    return _IMT.search("\n".join(_words(lines))) is not None


def _words(lines: Sequence[str]) -> list[str]:
    """Lines before the first point."""
    first = next((n for n, line in enumerate(lines) if _is_point(line)), len(lines))
    return list(lines[:first])


def _is_point(line: str) -> bool:
    cells = line.replace(",", " ").split()
    return len(cells) == 2 and all(map(is_numeral, cells))


def read(path: Path, lines: Sequence[str], hints: Hints) -> list[Statement]:
    """Read the curve of a file.

    Raises InputError if it holds none or several, or states neither rates nor a duration.
    """
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
    known = measure_of(imt)
    if known is None:
        refuse(path, f"is over {imt!r}, which is no measure known here")
    duration = _DURATION.search(about)
    stated = 0.0 if _RATES.search(about) else number(path, 1, duration[1]) if duration else None
    years = years_of_values(path, stated, hints)
    if years is None:
        refuse(path, "states no Duration that its probabilities are over", "give --values 50")
    place = [found[1] for found in (pattern.search(about) for pattern in _PLACE.values()) if found]
    site = {"site": tuple(number(path, 1, degrees) for degrees in place)} if len(place) == 2 else {}
    x, y = zip(
        *([number(path, n, cell) for cell in line.replace(",", " ").split()] for n, line in points),
        strict=True,
    )
    levels, origin = [level * known[1] for level in x], {"source": str(path), **site}
    if not years:
        return [Statement(curve_of_rates(path.stem, known[0], levels, y, **origin))]
    return [Statement(curve_of_probabilities(path.stem, known[0], levels, y, years, **origin))]
