"""Hazard curves of OpenSHA's applications: `Info:` in words, then two columns, in g (velocity cm/s).

The words hold the parameters of the calculation: `IMT = SA; SA Period = 1.0`, `Duration = 50.0`, the site. Where these
are left out, titles and labels of axes may name the measure and its values.
"""

import re
from collections.abc import Sequence
from typing import Any

from toppling.models.files.table import is_numeral
from toppling.results.hazard.measure_names import imt_of, measure_with_unit
from toppling.results.hazard.readers.assembly import HazardFile, Statement
from toppling.results.hazard.readers.text_columns import is_value_name, values_of

_IMT = re.compile(r"\bIMT = ([A-Za-z]\w*)")
_PERIOD = re.compile(r"\bSA Period = ([\d.]+)")
_COUNT = re.compile(r"^[^\w\n]*Num(?:ber of)? Points *[:=]|^[^\w\n]*DATASET #", re.IGNORECASE | re.MULTILINE)
_PHRASES = re.compile(r"[:;,=#\n\t]")
_DURATION = re.compile(r"\bDuration = ([\d.]+)")
_PLACE = {axis: re.compile(rf"\b{axis} = (-?[\d.]+)") for axis in ("Longitude", "Latitude")}
_RATES = re.compile(r"annuali[sz]ed rates?", re.IGNORECASE)


def matches(file: HazardFile) -> bool:
    """Whether words above two columns name a calculation's intensity measure as OpenSHA does, or count its points."""
    words = "\n".join(_words(file.lines))
    return _IMT.search(words) is not None or _COUNT.search(words) is not None


def _words(lines: Sequence[str]) -> list[str]:
    """Lines before the first point."""
    first = next((n for n, line in enumerate(lines) if _is_point(line)), len(lines))
    return list(lines[:first])


def _is_point(line: str) -> bool:
    cells = line.replace(",", " ").split()
    return len(cells) == 2 and all(map(is_numeral, cells))


def read(file: HazardFile) -> list[Statement]:
    """Read the curve of a file.

    Raises InputError if it holds none or several, or states neither rates nor a duration.
    """
    lines = file.lines
    words = _words(lines)
    about = "\n".join(words)
    rest = lines[len(words) :]
    points = [(n, line) for n, line in enumerate(rest, len(words) + 1) if _is_point(line)]
    last = points[-1][0] - len(words) if points else 0
    if not points or any(line.strip() for line in rest[: last - 1] if not _is_point(line)):
        file.refuse("hazard.several_curves" if points else "hazard.no_curve",
            "holds several curves" if points else "holds no curve", "save one curve in a file")  # fmt: skip
    phrases = [phrase.strip() for phrase in _PHRASES.split(about) if phrase.strip()]
    measure, unit = _measure(file, about, phrases)
    duration = _DURATION.search(about)
    named = next(filter(is_value_name, phrases), "")
    rates = _RATES.search(about)
    if named and not (duration or rates):
        years, convert = values_of(file, named)
    else:
        stated = 0.0 if rates else file.number(1, duration[1]) if duration else None
        lacks = "states no Duration that its probabilities are over"
        years, convert = file.years_of_values(stated, lacks, "give --values 50"), float
    place = [found[1] for found in (pattern.search(about) for pattern in _PLACE.values()) if found]
    site: dict[str, Any] = (
        {"site": tuple(file.number(1, degrees) for degrees in place)} if len(place) == 2 else {}
    )
    x, y = zip(
        *([file.number(n, cell) for cell in line.replace(",", " ").split()] for n, line in points),
        strict=True,
    )
    levels, values = [level * unit for level in x], list(map(convert, y))
    return [Statement(file.curve(measure, levels, values, years, **site))]


def _measure(file: HazardFile, about: str, phrases: Sequence[str]) -> tuple[str, float]:
    """Column of the measure that words name, or the user, and its unit in SI."""
    period, named = _PERIOD.search(about), _IMT.search(about)
    if named:
        return file.measure_named(f"SA({period[1]})" if named[1] == "SA" and period else named[1])
    found = set(filter(None, map(measure_with_unit, phrases)))
    if measure := file.measure_elsewhere:
        found = {(measure, 1.0 / imt_of(measure)[1])}
    if len(found) != 1:
        file.refuse("hazard.measure_missing", f"names {len(found) or 'no'} measures above its points",
            "put IMT = PGA (or IMT = SA; SA Period = 1.0) above them, or give --measure")  # fmt: skip
    return found.pop()
