"""Hazard curves of OpenSHA's applications, and of its plotter, which CyberShake uses; in g (velocity cm/s).

Applications write `Info:` in words, then two columns; the words hold the parameters of the calculation: `IMT = SA; SA
Period = 1.0`, `Duration = 50.0`, the site. Where these are left out, titles and labels of axes may name the measure and
its values. The plotter writes levels and probabilities in one year; site, run, period and component stand in the file's
name only: USC_ERF36_Run9306_SA_3sec_RotD50_2022_12_21.txt.
"""

import re
from collections.abc import Sequence
from typing import Any

from toppling.models.files.table import Table, is_numeral
from toppling.results.hazard.measure_names import imt_of, measure_of, measure_with_unit
from toppling.results.hazard.readers.assembly import HazardFile, Statement
from toppling.results.hazard.readers.text_columns import is_value_name, values_of

_IMT = re.compile(r"\bIMT = ([A-Za-z]\w*)")
_PERIOD = re.compile(r"\bSA Period = ([\d.]+)")
_COUNT = re.compile(r"^[^\w\n]*Num(?:ber of)? Points *[:=]|^[^\w\n]*DATASET #", re.IGNORECASE | re.MULTILINE)
_PHRASES = re.compile(r"[:;,=#\n\t]")
_DURATION = re.compile(r"\bDuration = ([\d.]+)")
_PLACE = {axis: re.compile(rf"\b{axis} = (-?[\d.]+)") for axis in ("Longitude", "Latitude")}
_RATES = re.compile(r"annuali[sz]ed rates?", re.IGNORECASE)
_PLOTTED = re.compile(
    r"(?P<site>.+?)_ERF\d+_Run(?P<run>\d+)_(?P<imt>SA_(?P<period>\d+(?:[.p]\d+)?)sec|PGA|PGV)"
    r"(?:_(?P<component>[A-Za-z]+\d*))?"
)
"""Name of a file of the plotter."""


def matches(file: HazardFile) -> bool:
    """Whether words above two columns name a calculation's intensity measure as OpenSHA does, or count its points.

    Or the plotter wrote the file.
    """
    if _is_plotted(file):
        return True
    words = "\n".join(_words(file.lines))
    return _IMT.search(words) is not None or _COUNT.search(words) is not None


def _words(lines: Sequence[str]) -> list[str]:
    """Lines before the first point."""
    first = next((n for n, line in enumerate(lines) if _is_point(line)), len(lines))
    return list(lines[:first])


def _is_point(line: str) -> bool:
    cells = line.replace(",", " ").split()
    return len(cells) == 2 and all(map(is_numeral, cells))


def _is_plotted(file: HazardFile) -> bool:
    return file.lines[0].replace(" ", "").startswith("#Curves:")


def read(file: HazardFile) -> list[Statement]:
    """Read the curve of a file; of the plotter's the first that CyberShake computed, as others are comparisons.

    Raises InputError if it holds none or several, states neither rates nor a duration, or nobody says what it is over.
    """
    if _is_plotted(file):
        return _plotted(file)
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


def _plotted(file: HazardFile) -> list[Statement]:
    named = _PLOTTED.match(file.path.name)
    imt = named["imt"] if named else imt_of(file.measure_elsewhere)[0] if file.measure_elsewhere else ""
    if named and named["period"]:
        imt = f"SA({named['period'].replace('p', '.')})"
    known = measure_of(imt)
    if known is None or (not named and known[0] == "pgv_m_s"):
        file.refuse("hazard.measure_missing",
            "states its measure in its name only, which is not as CyberShake gave it",
            "name it as it was, SITE_ERF36_RunN_SA_3sec_RotD50_DATE.txt, or give --measure")  # fmt: skip
    rows = _first_curve(file, file.lines)
    measure, unit = known
    curve = file.curve(
        measure, [x * unit for x, _ in rows], [p for _, p in rows], file.hints.years or 1.0,
        site_name=named["site"] if named else "", component=(named["component"] or "") if named else "",
    )  # fmt: skip
    return [Statement(curve, calculation=named["run"] if named else "")]


def _first_curve(file: HazardFile, lines: Sequence[str]) -> list[tuple[float, float]]:
    """Points below the first name that contains CyberShake, or below the first name."""
    heads = [index for index, line in enumerate(lines) if line.replace(" ", "").startswith("#Name:")]
    own = [index for index in heads if re.search(r"CS Run|CyberShake", lines[index])]
    start = (own or heads or [0])[0]
    stop = next((index for index in heads if index > start), len(lines))
    rows = Table.of([*[""] * (start + 1), *lines[start + 1 : stop]], file.path).rows
    if other := next((at for at, row in rows if len(row) != 2), None):
        file.refuse("hazard.row_unreadable", f"line {other + 1} is no level and probability")
    if not rows:
        file.refuse("hazard.no_curve", "holds no curve")
    return [(file.number(at + 1, level), file.number(at + 1, value)) for at, (level, value) in rows]
