"""Columns of text: an intensity measure, and its annual rate, or its probability over a stated time."""

import csv
import math
import re
from collections.abc import Sequence
from dataclasses import replace
from math import isclose
from typing import NoReturn

import numpy as np

from toppling.models.files.csv_text import is_numeral
from toppling.models.motions.formats.units import unit_of
from toppling.results.hazard.curves import HazardCurve, intensity_at
from toppling.results.hazard.measure_names import LONGEST_NAME, measure_of, measure_with_unit, quantity_of
from toppling.results.hazard.readers.stated import HazardFile, Statement
from toppling.results.hazard.readers.value_columns import is_probability, is_share, says_value, values_of

_LOGARITHM = re.compile(
    r"(?P<log>ln|log[ _]?10)[ _]*(?:\((?P<inside>[^()]+(?:\([^()]*\))?[^()]*)\)|(?P<bare>[^( ][^(\[]*))(?P<rest>.*)",
    re.IGNORECASE,
)
"""Of the name of a column; `log` alone does not say to which base."""
_COMMENTS = ("#", "%", "//")
_WITH_UNIT = re.compile(
    r"([-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[ed][-+]?\d+)?) ?([^\d\s.,;+-][^\d]{0,9}\d?|1/[a-z]+)", re.IGNORECASE
)
"""A cell that states the unit of its number."""
_GAP = re.compile(r" {2,}")
_MOST_NAMES = 50
"""Of a header, that are looked at for a measure."""
_STATED_UNIT = re.compile(
    r"(?:\bin |\bunits?\b ?(?:is |are |of |in |[:=])? ?|[(\[=])\s*([a-z%][a-z0-9%/^*²-]*(?: s\^?-2)?)"
)
_WORD = re.compile(r"[^\W\d_]{2}")
_MOST_G, _LEAST_CM_S = 10.0, 5.0
"""Levels of a whole curve: beyond in g, or below in cm/s, they are in another unit than its name implies."""
_RARE, _ROUNDED = 0.02, 0.05
"""Rates up to the first are compared between columns, and may differ by this share."""
_RETURN_YEARS = 475.0
_MOST_G_ONCE = {"pga": 2.0, "sa": 5.0}
"""No published hazard is as strong once in so many years."""


def matches(file: HazardFile) -> bool:
    """Whether a file of a folder begins with a header that names a measure and what its values are."""
    at = _header_line(file.table)
    if at is None:
        return False
    header = _names(uncommented(file.table[at]))
    measures = [name for name in header if measure_with_unit(name)]
    return len(measures) == 1 and (len(header) == 2 or any(map(says_value, header)))


def read(file: HazardFile) -> list[Statement]:
    """Read a table with a header: a column of a measure's levels, and one of their rates or probabilities.

    Raises InputError if the header does not name a measure, or not what the values are.
    """
    lines = file.table
    at = _header_line(lines)
    if at is None:
        file.refuse("holds no table")
    before = " ".join(lines[:at]).lower()
    header, rows = _raised(file, *upright(*_with_units(*rows_from(file, at))))
    while rows and _is_footnote(rows[-1][1], len(header)):
        rows.pop()
    rows = file.wanted_rows(rows, header, None)
    curve, *again = (_curve(file, header, rows, pair, before) for pair in _columns(file, lines[at], header))
    if not all(_same(curve, other) for other in again):
        _refuse_columns(file, header)
    return [Statement(curve)]


def _is_footnote(row: Sequence[str], columns: int) -> bool:
    """Whether the last row of a table is text below it: one cell of words, or words in other numbers of cells."""
    words = _WORD.search(row[0]) and not is_numeral(row[0])  # "O.4" is a damaged number
    return bool(words) and (len(list(filter(None, row))) == 1 or len(row) != columns)


def _curve(
    file: HazardFile,
    header: Sequence[str],
    rows: Sequence[tuple[int, list[str]]],
    pair: tuple[int, int],
    before: str,
) -> HazardCurve:
    levels, values = pair
    column, factor = measure_with_unit(header[levels]) or ("", 0.0)
    years, rate_of = values_of(file, header[values], before)
    endless = rate_of(math.inf) == 0.0  # a return period
    x = [file.number(line, row[levels]) * factor for line, row in rows]
    y = [rate_of(file.value(line, row[values], endless=endless)) for line, row in rows]
    curve = file.curve(column, x, y, years)
    bare = measure_of(header[levels])
    return with_usual_unit(file, header[levels], curve, before) if bare else curve


def _same(one: HazardCurve, other: HazardCurve) -> bool:
    """Whether two columns say one thing, as a rate and its return period do; frequent ones are left to rounding."""
    if one.measure != other.measure:
        return False
    rare = one.annual_rate <= _RARE
    rates = np.interp(np.log(one.intensity[rare]), np.log(other.intensity), np.log(other.annual_rate))
    return bool(np.allclose(rates, np.log(one.annual_rate[rare]), rtol=0.0, atol=_ROUNDED))


def _header_line(lines: Sequence[str]) -> int | None:
    """Place of the line that names a measure, below a title perhaps or in a comment, else of the first of a table."""
    comment = list(map(is_comment, lines))
    table = [place for place, line in enumerate(lines) if line.strip() and not comment[place]]
    first_row = next((n for n in table if is_numeral(re.split(r"[\s,;]+", lines[n].strip())[0])), len(lines))
    bare = map(uncommented, lines[: first_row + 1])
    names = {place: _names(line) for place, line in enumerate(bare) if line}
    named = [
        n for n, each in names.items() if len(each) > 1 and any(map(measure_with_unit, each[:_MOST_NAMES]))
    ]
    for among in ([n for n in named if not comment[n]], [n for n in named if comment[n]]):
        said = [n for n in among if any(map(says_value, names[n]))]  # a title may name a measure too
        if among:
            return (said or among)[-1]
    return next(iter(table), None)


def is_comment(line: str) -> bool:
    """Whether a line is a remark; `% in 50 years` is the name of a column."""
    return line.lstrip().startswith(_COMMENTS) and not is_share(line.lstrip())


def uncommented(line: str) -> str:
    """Line without the signs of a comment at its beginning."""
    return line.lstrip("".join(_COMMENTS) + " ") if is_comment(line) else line.lstrip()


def _names(line: str) -> list[str]:
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
    file: HazardFile, header: list[str], rows: list[tuple[int, list[str]]]
) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """Table with the values of columns of logarithms, under the names of what these are of."""
    bases = [base for _, base in map(_bare, header)]
    if not any(bases):
        return header, rows
    raised = []
    for line, row in rows:
        cells = zip(row, bases, strict=False)
        raised.append(
            (line, [repr(base ** file.number(line, cell)) if base else cell for cell, base in cells])
        )
    return [name for name, _ in map(_bare, header)], raised


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
    """Table with its names above its columns, of one with names before its rows, and units of cells in the names."""
    whole = all(len(row) == len(header) for _, row in rows)
    if whole and len(header) > 2 and all(map(is_numeral, header[1:])):
        names, *columns = zip(header, *(row for _, row in rows), strict=True)
        first = rows[0][0] if rows else 1
        header, rows = list(names), [(first, list(column)) for column in columns]
    for place, name in enumerate(header if whole else ()):
        found = [_WITH_UNIT.fullmatch(row[place]) for _, row in rows]
        units = {cell and cell[2].strip() for cell in found}
        if len(units) != 1 or None in units:
            continue
        (unit,) = units
        named = name if name.endswith((f"({unit})", f"[{unit}]")) else f"{name} ({unit})"
        if measure_with_unit(named) or says_value(named):
            header = [*header[:place], named, *header[place + 1 :]]
            numbers = [cell[1] for cell in found if cell]
            rows = [
                (line, [*row[:place], cell, *row[place + 1 :]])
                for (line, row), cell in zip(rows, numbers, strict=True)
            ]
    return header, rows


def with_usual_unit(file: HazardFile, name: str, curve: HazardCurve, before: str) -> HazardCurve:
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
    once = intensity_at(curve.intensity, curve.annual_rate, 1.0 / _RETURN_YEARS) / factor
    why = ""
    if other:
        why = f"the lines above say {other[0]!r}"
    elif largest > most or (own == "cm/s" and 0 < largest < _LEAST_CM_S):
        why = f"its levels reach {largest:g}"
    elif once > most_once:
        why = f"{once:.3g} would be exceeded once in {_RETURN_YEARS:g} years"
    if why:
        meant = other[0] if other else "cm/s2" if largest > most else "m/s2" if own == "g" else "m/s"
        file.refuse(
            f"names no unit of {name}, which is {own} then, and {why}",
            f"name the unit in the column of a table, such as {name} ({meant})",
        )
    if stated:
        return curve
    size = f": {once:.3g} {own} once in {_RETURN_YEARS:g} years" if math.isfinite(once) else ""
    assumed = f"{file.path.name} names no unit of {name}, which is taken to be {own}{size}."
    return replace(curve, assumed=assumed)


def _columns(file: HazardFile, line: str, header: Sequence[str]) -> list[tuple[int, int]]:
    """Numbers of the columns of levels and of values, all pairs of them, rates first; others are left."""
    if len(header) < 2:
        file.refuse(f"has the columns {', '.join(header)[:200]}" if header else "is empty")
    if is_numeral(header[0]):
        file.refuse(f"states neither measure nor unit nor time: its first line is {line[:40]!r}",
               "put a header above them, such as PGA (g),annual_rate or pgv_m_s,probability_50_years")  # fmt: skip
    if any(name.lower() in ("event_id", "eid") for name in header):
        file.refuse(
            f"is of events, with the columns {line.strip()[:200]}",
            "a set of events has the columns annual_rate and measures with their units, such as PGA (g)",
        )
    measures = [index for index, name in enumerate(header) if measure_with_unit(name)]
    values = [index for index, name in enumerate(header) if says_value(name)]
    if len(header) == 2 and len(measures) == 1:
        return [(measures[0], 1 - measures[0])]
    if not measures:
        first = next((name for index, name in enumerate(header) if index not in values), header[0])
        what = f"is over {first!r}" if len(header) == 2 else f"has the columns {', '.join(header)[:200]}"
        file.refuse(what, "name a measure with its unit, such as pga_m_s2, PGA or PGA (m/s2)")
    if not values:
        _refuse_columns(file, header)
    values.sort(key=lambda n: is_probability(header[n]))
    return [(level, value) for value in values for level in measures]


def _refuse_columns(file: HazardFile, header: Sequence[str]) -> NoReturn:
    file.refuse(
        f"has the columns {', '.join(header)[:200]}",
        "give one measure and one column of its values, or several that say the same",
    )


def rows_from(file: HazardFile, at: int) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """Header in a line of a table and the rows below with their lines, without remarks."""
    below = ("" if is_comment(line) else line.partition(" # ")[0] for line in file.table[at + 1 :])
    lines = [uncommented(file.table[at]), *below]
    (_, header), *rows = list(file.rows([",".join(cells) for cells in cells_of(lines)], at + 1)) or [(0, [])]
    return header, rows


def cells_of(lines: Sequence[str]) -> list[list[str]]:
    """Cells of lines that commas or blanks part, told by the first."""
    if "," in lines[0]:
        return [[line] for line in lines]
    cells = [[part.strip() for part in line.strip().rpartition(" ")[::2]] for line in lines]
    names = _GAP.split(lines[0].strip())  # which have blanks of their own where they stand far apart
    return [names, *cells[1:]] if len(names) == len(cells[0]) else cells
