"""Columns of text: an intensity measure, and its annual rate, or its probability over a stated time."""

import csv
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from math import isclose
from operator import mul
from pathlib import Path

import numpy as np

from toppling.models.files.csv_text import is_numeral
from toppling.models.motions.formats.units import unit_of
from toppling.results.hazard.curves import HazardCurve, curve_of
from toppling.results.hazard.measure_names import LONGEST_NAME, measure_of, measure_with_unit, quantity_of
from toppling.results.hazard.readers.stated import (
    HazardFile,
    Hints,
    Statement,
    number,
    refuse,
    rows_of,
    years_of_values,
)

_RATE = re.compile(
    r"(?:mean )?annual (?:exceedance )?(?:rate|frequency)(?: of exceedance)?|(?:mean )?m?afe|m?are|"
    r"(?:mean )?(?:exceedance )?(?:rate|frequency|hazard|lambda|λ)(?: of exceedance)? per (?P<unit>year|kyr)|"
    r"exceedances per (?P<each>year|kyr)"
)
_ANNUAL = re.compile(r"annual (?:exceedance )?probability(?: of exceedance)?|annual poe|aep|apo?e")
_PROBABILITY = re.compile(
    r"(?:poe|probability(?: of (?P<non>non ?)?exceedance)?)[^0-9]*(?P<years>\d+(?:\.\d+)?)?[^0-9]*"
)
_PERCENT = re.compile(r"[ _]*[(\[] ?(?:%|percent) ?[)\]]|(?<![\d ]) ?%|\bpercent\b|(?<=\))%")
"""Of a column's values; a percentage behind a number is that of a hazard level."""
_RETURN = re.compile(r"(?:mean )?(?:return period|recurrence interval|recurrence)(?: years?)?|mrp|mri|rp|tr")
_TIMES = re.compile(r"[ /(\[]*(?:\b1/|\bper |/ ?)(?P<time>yr|years?|a|kyr|ka|1000 (?:yr|years?))[)\]]*$")
_YEARS = re.compile(r"[(\[](?P<time>yrs?|years?|a|kyr|ka)[)\]]$")
_LOGARITHM = re.compile(
    r"(?P<log>ln|log[ _]?10)[ _]*(?:\((?P<inside>[^()]+(?:\([^()]*\))?[^()]*)\)|(?P<bare>[^( ][^(\[]*))(?P<rest>.*)",
    re.IGNORECASE,
)
"""Of the name of a column; `log` alone does not say to which base."""
COMMENTS = ("#", "%", "//")
_MOST_NAMES = 50
"""Of a header, that are looked at for a measure."""
_STATED_UNIT = re.compile(
    r"(?:\bin |\bunits?\b ?(?:is |are |of |in |[:=])? ?|[(\[=])\s*([a-z%][a-z0-9%/^*²-]*(?: s\^?-2)?)"
)
_STATED_YEARS = re.compile(
    r"(?:investigation[_ ]time\D{0,5}|\bin )(\d+(?:\.\d+)?)(?= ?-?(?:yr|years?|$|[,;]))"
)
_MOST_G, _LEAST_CM_S = 10.0, 5.0
"""Levels of a whole curve: beyond in g, or below in cm/s, they are in another unit than its name implies."""
_RETURN_YEARS = 475.0
_MOST_G_ONCE = {"pga": 2.0, "sa": 5.0}
"""No published hazard is as strong once in so many years."""


def matches(file: HazardFile) -> bool:
    """Whether a file of a folder begins with a header that names a measure and what its values are."""
    at = _header_line(file.table)
    if at is None:
        return False
    header = _names(_uncommented(file.table[at]))
    measures = [name for name in header if measure_with_unit(name)]
    return len(measures) == 1 and (len(header) == 2 or any(map(says_value, header)))


def read(file: HazardFile, hints: Hints) -> list[Statement]:
    """Read a table with a header: a column of a measure's levels, and one of their rates or probabilities.

    Raises InputError if the header does not name a measure, or not what the values are.
    """
    path, lines = file.path, file.table
    at = _header_line(lines)
    if at is None:
        refuse(path, "holds no table")
    before = " ".join(lines[:at]).lower()
    body = [
        _uncommented(lines[at]),
        *("" if line.lstrip().startswith(COMMENTS) else line for line in lines[at + 1 :]),
    ]
    (_, header), *rows = list(rows_of(path, [",".join(cells) for cells in cells_of(body)], at + 1)) or [
        (0, [])
    ]
    header, rows = _raised(path, *upright(*_with_units(header, rows)))
    levels, values = _columns(path, lines[at], header)
    column, factor = measure_with_unit(header[levels]) or ("", 0.0)
    years, rate_of = values_of(path, header[values], hints, before)
    x, y = [], []
    for line, row in rows:
        if len(row) != len(header):
            refuse(path, f"line {line} has {len(row)} columns, the header {len(header)}")
        x.append(number(path, line, row[levels]) * factor)
        y.append(rate_of(number(path, line, row[values])))
    curve = curve_of(path.stem, column, x, y, years, source=str(path))
    bare = measure_of(header[levels])
    return [Statement(with_usual_unit(path, header[levels], curve, before) if bare else curve)]


def _header_line(lines: Sequence[str]) -> int | None:
    """Place of the line that names a measure, below a title perhaps or in a comment, else of the first of a table."""
    comment = [line.lstrip().startswith(COMMENTS) for line in lines]
    table = [place for place, line in enumerate(lines) if line.strip() and not comment[place]]
    first_row = next((n for n in table if is_numeral(re.split(r"[\s,;]+", lines[n].strip())[0])), len(lines))
    bare = map(_uncommented, lines[: first_row + 1])
    names = {place: _names(line) for place, line in enumerate(bare) if line}
    named = [
        n for n, each in names.items() if len(each) > 1 and any(map(measure_with_unit, each[:_MOST_NAMES]))
    ]
    for among in ([n for n in named if not comment[n]], [n for n in named if comment[n]]):
        said = [n for n in among if any(map(says_value, names[n]))]  # a title may name a measure too
        if among:
            return (said or among)[-1]
    return next(iter(table), None)


def _uncommented(line: str) -> str:
    """Line without the signs of a comment at its beginning."""
    return line.lstrip("".join(COMMENTS) + " ")


def _names(line: str) -> list[str]:
    """Names of a header's columns."""
    try:
        cells = next(csv.reader([",".join(cells_of([line])[0])]), [])
    except csv.Error:  # which `rows_of` tells of
        return []
    return [_bare(name.strip(' "'))[0] for name in cells]


def _bare(name: str) -> tuple[str, float]:
    """What a column's name says it is the logarithm of, and to which base; the name and 0 if it says none."""
    found = _LOGARITHM.fullmatch(name[:LONGEST_NAME])
    if found is None:
        return name, 0.0
    inner = (found["inside"] or found["bare"]) + found["rest"]
    return inner, math.e if found["log"].lower() == "ln" else 10.0


def _raised(
    path: Path, header: list[str], rows: list[tuple[int, list[str]]]
) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """Table with the values of columns of logarithms, under the names of what these are of."""
    bare = [_bare(name) for name in header]
    if not any(base for _, base in bare):
        return header, rows
    raised = [
        (
            line,
            [
                repr(base ** number(path, line, cell)) if base else cell
                for cell, (_, base) in zip(row, bare, strict=False)
            ],
        )
        for line, row in rows
    ]
    return [name for name, _ in bare], raised


def _with_units(
    header: list[str], rows: list[tuple[int, list[str]]]
) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """Header with the units of a line below the names, and the rows below that."""
    if not rows or len(rows[0][1]) != len(header) or any(map(is_numeral, rows[0][1])) or not any(rows[0][1]):
        return header, rows
    units = [cell.strip("()[] ") for cell in rows[0][1]]
    joined = [
        f"{name} ({unit})" if unit.strip("-") else name for name, unit in zip(header, units, strict=True)
    ]
    if not any(map(measure_with_unit, joined)):
        return header, rows
    return joined, rows[1:]


def upright(
    header: list[str], rows: list[tuple[int, list[str]]]
) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """Table whose names stand above its columns, of one whose names stand before its rows."""
    if (
        len(header) < 3
        or not all(map(is_numeral, header[1:]))
        or any(len(row) != len(header) for _, row in rows)
    ):
        return header, rows
    names, *columns = zip(header, *(row for _, row in rows), strict=True)
    return list(names), [(rows[0][0] if rows else 1, list(column)) for column in columns]


def with_usual_unit(path: Path, name: str, curve: HazardCurve, before: str) -> HazardCurve:
    """Curve whose levels stand under a bare name, with what that was taken to mean.

    before: the lines above, in lower case.
    Raises InputError if their unit is another by the lines above, by their size, or by the hazard that they would be:
    with the one that may be meant.
    """
    quantity = quantity_of(curve.measure)
    if quantity != "acceleration" and curve.measure != "pgv_m_s":
        return curve
    factor = (measure_of(name) or ("", 1.0))[1]
    found = {text: unit_of(text) for text in _STATED_UNIT.findall(before)}
    stated = {text: unit for text, unit in found.items() if unit and unit.quantity == quantity}
    other = [text for text, unit in stated.items() if not isclose(unit.factor, factor)]
    own, most = ("g", _MOST_G) if quantity == "acceleration" else ("cm/s", math.inf)
    most_once = _MOST_G_ONCE["pga" if curve.measure == "pga_m_s2" else "sa"] if own == "g" else math.inf
    largest = max(curve.levels, default=0.0) / factor
    once = _once_in(_RETURN_YEARS, curve) / factor
    why = ""
    if other:
        why = f"the lines above say {other[0]!r}"
    elif largest > most or (own == "cm/s" and 0 < largest < _LEAST_CM_S):
        why = f"its levels reach {largest:g}"
    elif once > most_once:
        why = f"{once:.3g} would be exceeded once in {_RETURN_YEARS:g} years"
    if why:
        meant = other[0] if other else "cm/s2" if largest > most else "m/s2" if own == "g" else "m/s"
        refuse(
            path,
            f"the column {name!r} names no unit, which is {own} then, and {why}",
            f"name the unit in the column, such as {name} ({meant})",
        )
    if stated:
        return curve
    size = f": {once:.3g} {own} once in {_RETURN_YEARS:g} years" if math.isfinite(once) else ""
    return replace(curve, assumed=f"{path.name} names no unit of {name}, which is taken to be {own}{size}.")


def _once_in(years: float, curve: HazardCurve) -> float:
    """Level that is exceeded once in some years, in SI; not a number where the curve does not reach that rate."""
    rate = curve.annual_rate
    if not len(rate) or not rate[-1] <= 1.0 / years <= rate[0]:
        return math.nan
    return float(np.exp(np.interp(math.log(years), -np.log(rate), np.log(curve.intensity))))


def _columns(path: Path, line: str, header: Sequence[str]) -> tuple[int, int]:
    """Numbers of the columns of levels and of values; others, where a header says what these two are, are left."""
    if len(header) < 2:
        refuse(path, f"has the columns {', '.join(header)[:200]}" if header else "is empty")
    if is_numeral(header[0]):
        refuse(path, f"states neither measure nor unit nor time: its first line is {line[:40]!r}",
               "put a header above them, such as PGA (g),annual_rate or pgv_m_s,probability_50_years")  # fmt: skip
    if any(name.lower() in ("event_id", "eid") for name in header):
        refuse(
            path,
            f"is of events, with the columns {line.strip()[:200]}",
            "a set of events has the columns annual_rate and measures with their units, such as PGA (g)",
        )
    measures = [index for index, name in enumerate(header) if measure_with_unit(name)]
    values = [index for index, name in enumerate(header) if says_value(name)]
    if len(header) == 2 and len(measures) == 1:
        return measures[0], 1 - measures[0]
    if not measures:
        first = next(
            name for index, name in enumerate(header) if index not in values or len(values) == len(header)
        )
        remedy = "name a measure with its unit, such as pga_m_s2, PGA or PGA (m/s2)"
        refuse(
            path,
            f"is over {first!r}" if len(header) == 2 else f"has the columns {', '.join(header)[:200]}",
            remedy,
        )
    if len(measures) != 1 or len(values) != 1:
        refuse(
            path,
            f"has the columns {', '.join(header)[:200]}",
            "give one measure and one column of its values",
        )
    return measures[0], values[0]


def cells_of(lines: Sequence[str]) -> list[list[str]]:
    """Cells of lines that commas or blanks part, told by the first."""
    if "," in lines[0]:
        return [[line] for line in lines]
    return [[part.strip() for part in line.strip().rpartition(" ")[::2]] for line in lines]


def _plain(name: str) -> str:
    """A column's name in lower case, with blanks, and its time, if any, as `per year` or `per kyr`."""
    plain = re.sub(r"[ _-]+", " ", _PERCENT.sub("", name.lower())).strip()
    if not (found := _TIMES.search(plain)):
        return _YEARS.sub("", plain).strip()
    time = " per kyr" if found["time"][0] in "k1" else " per year"
    bare = plain[: found.start()].strip()
    return bare if bare.startswith(("annual", "mean annual")) and time == " per year" else bare + time


def says_value(name: str) -> bool:
    """Whether a column's name says that it holds rates, probabilities or return periods."""
    if len(name) > LONGEST_NAME:
        return False
    plain = _plain(name)
    return any(kind.fullmatch(plain) for kind in (_RATE, _ANNUAL, _RETURN, _PROBABILITY))


def values_of(path: Path, name: str, hints: Hints, before: str) -> tuple[float, Callable[[float], float]]:
    """Time that a column's probabilities are over, 0 for rates; and what turns a cell into either.

    Raises InputError if neither its name, nor the lines before in lower case, nor the user says so.
    """
    plain = _plain(name) if len(name) <= LONGEST_NAME else ""
    stated: float | None = None
    scale = 0.01 if plain and _PERCENT.search(name.lower()) else 1.0
    convert: Callable[[float], float] = partial(mul, scale)
    if rate := _RATE.fullmatch(plain):
        stated = 0.0
        if "kyr" in (rate["unit"], rate["each"]):
            convert = partial(mul, scale / 1000.0)
    elif _RETURN.fullmatch(plain):
        kyr = (time := _YEARS.search(name.lower())) and time["time"].startswith("k")
        stated, convert = 0.0, partial(_rate_of_return, 1000.0 if kyr else 1.0)
    elif _ANNUAL.fullmatch(plain):
        stated = 1.0
    elif found := _PROBABILITY.fullmatch(plain):
        above = set(_STATED_YEARS.findall(before))
        text = found["years"] or (above.pop() if len(above) == 1 else None)
        stated = float(text) if text else None
        if found["non"]:
            convert = partial(_exceedance, scale)
        if not (hints.years if stated is None else stated):
            remedy = "call the column after it, such as probability_50_years, or give --values 50"
            refuse(path, f"states no time that its {name!r} is over", remedy)
    remedy = "call it annual_rate, or probability_50_years after its time, or give --values"
    return years_of_values(path, stated, hints, f"has the column {name!r}", remedy), convert


def _rate_of_return(unit_years: float, period: float) -> float:
    return 1.0 / (unit_years * period) if period > 0 else math.nan


def _exceedance(scale: float, non_exceedance: float) -> float:
    return 1.0 - scale * non_exceedance
