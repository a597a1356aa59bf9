"""Plain columns: acceleration alone, time and acceleration, or time and three components.

Units come from the names of the columns or the metadata table, the time step of a single column from the table.
"""

import math
import re
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from toppling.models.errors import InputError
from toppling.models.motions.formats.component import Component, bearing, code_direction, positive, refuse
from toppling.models.motions.formats.numbers import numbers_in
from toppling.models.motions.formats.units import known_names, unit_of

NAME = "plain columns"
_COMMENT = ("#", "%", "!", "//", ";")
_NUMBER = re.compile(r"^[-+]?((\d+\.?\d*|\.\d+)([EeDd][-+]?\d+)?|nan|inf)$", re.IGNORECASE)
"""NaN too: a file that begins with one is of this format, and damaged at that line."""
_EXPONENT = re.compile(r"(?<=[\d.])[Dd](?=[-+\d])")
"""Fortran's double precision, which is no number elsewhere."""
_COMMA_NUMBER = re.compile(r"[-+]?(?:\d+,?\d*|,\d+)(?:[EeDd][-+]?\d+)?$")
SEPARATORS = ";\t,"
"""What stands between numbers, beside blanks; of names the first of these that a line has."""
_AS_BLANKS = str.maketrans(dict.fromkeys(SEPARATORS, " "))
_NOT_COMMA = SEPARATORS.replace(",", "")
_BETWEEN = re.compile(rf",(?=[\s{_NOT_COMMA}]|$)")
"""A comma with a blank behind it, which stands between two numbers whatever other commas do."""
_WORD = re.compile(r"[^\s(\[]+\s*(?:[(\[][^)\]]*[)\]])?")
_BRACKETS = re.compile(r"[(\[]([^)\]]*)[)\]]")
_TIME = re.compile(r"(?:t|times?|s|secs?|seconds?)(?![a-z])", re.IGNORECASE)
_QUANTITY = re.compile(r"^A(?:CC(?:EL(?:ERATION)?)?)?[\s._-]+")
_CHANNEL_CODE = re.compile(r"[A-Z][GHLN][ENZ123]")
"""SEED's: of a band, an accelerometer or seismometer, and a direction or number."""
_HORIZONTALS = {"H1", "H2", "L", "T", "X", "Y"}
"""Names of horizontals that say nothing of their bearing."""
_TIME_WORDS = {"s", "sec", "seconds", "ms", "msec"}
_TIME_UNITS_S = {"ms": 0.001, "msec": 0.001}
"""Units of a column of times that is not in seconds."""
_STEP_TOLERANCE = 0.01
"""Largest departure of one time difference from their median, as a share of it."""
_REGULAR_SHARE = 0.95
_COARSE, _COARSE_RANGE, _COARSE_WINDOW = 0.1, 1.3, 50
"""Times whose last digit is more than this share of the step leave their line by this many digits where rows are lost;
the place is found by the means of so many times on both sides."""
_DERIVED = 0.9
"""Correlation of a column with the slope of the next, from which this is its integral."""
_WIDTHS = (1, 2, 4)


def recognises(head: str) -> bool:
    """Whether the first lines that are no comments hold one, two or four numbers each, below their names."""
    body = [line for line in head.splitlines()[:-1] if _is_body(line)]
    comma = _is_decimal_comma(body[2:20])
    rows = [_split(line, comma) for line in body[:20]]
    if len(rows) < 4:
        return len(rows) == 3 and _are_numbers(rows[1:])
    return _are_numbers(rows[1:]) or (_are_numbers(rows[2:]) and _units_below(body[0], body[1]) is not None)


def _are_numbers(rows: list[list[str]]) -> bool:
    """Whether rows hold as many numbers each as this format has columns, or twice as many without a point."""
    if len(rows[0]) not in _WIDTHS and not (len(rows[0]) == 2 * _WIDTHS[-1] and "." not in "".join(rows[0])):
        return False
    return all(len(row) == len(rows[0]) and all(map(_NUMBER.match, row)) for row in rows)


def read(path: Path, text: str) -> list[Component]:
    """Read the columns; the unit of their samples is that in their names, else the metadata table must name it."""
    lines = text.splitlines()
    at, first = _header(lines)
    comma = _is_decimal_comma(lines[first : first + 20])
    rows = [_EXPONENT.sub("E", _separated(line, comma)) for line in lines[first:]]
    width = len(rows[0].split()) if rows else 0
    for offset, row in enumerate(rows):
        if row.strip() and len(row.split()) != width:
            refuse(
                f"{len(row.split())} numbers where the lines before have {width}",
                path,
                first + 1 + offset,
                expected="the same columns on every line",
                remedy="the file is damaged or truncated here: fetch it again",
            )
    _refuse_two_commas(lines[first], width, rows, path, first + 1)
    values = numbers_in(rows, path, first + 1).reshape(-1, max(width, 1))
    if len(values) < 2 or width not in _WIDTHS:
        refuse(
            f"{len(values)} rows of {width} numbers",
            path,
            first + 1,
            expected="acceleration alone, time and acceleration, or time and three components",
        )
    if width == 4:
        _refuse_derived(values, path, first + 1)
    columns = _columns(lines[at], width) if at is not None else []
    if at is not None and first > at + 1:
        columns = _units_below(lines[at], lines[first - 1]) or columns
    labels = _labels(columns, width, path, (at or 0) + 1)
    named = columns if len(columns) == width else [_Column("", "")] * width
    step = math.nan
    if width > 1:
        times = [row.split()[0] for row in rows if row.strip()]
        step = _time_step(values[:, 0], times, path, first + 1) * _TIME_UNITS_S.get(
            named[0].unit.lower(), 1.0
        )
    return [
        _component(values[:, place], step, label, named[place], path, first + 1)
        for place, label in enumerate(labels, max(width - len(labels), 0))
    ]


def _refuse_derived(values: NDArray[np.float64], path: Path, line: int) -> None:
    """Refuse a column that is the integral of the one before it, as velocity and displacement beside acceleration."""
    slopes = np.diff(values, axis=0)[:, 1:]
    means = 0.5 * (values[1:] + values[:-1])[:, 1:]
    for column in (1, 2):
        pair = np.stack([means[:, column - 1], slopes[:, column]])
        if pair.std(axis=1).min() == 0 or np.asarray(np.corrcoef(pair))[0, 1] < _DERIVED:
            return
    refuse(
        "its last two columns are integrals of the second: velocity and displacement beside the acceleration",
        path,
        line,
        expected="acceleration alone, time and acceleration, or time and three components",
        remedy="leave the columns of velocity and displacement out, and give one file a component",
    )


def _component(
    values: NDArray[np.float64], step: float, label: str, column: "_Column", path: Path, line: int
) -> Component:
    unit, no_unit = unit_of(column.unit) if column.unit else None, None
    if unit is not None and unit.quantity != "acceleration":
        refuse(
            f"the column {column.name!r} is in {column.unit!r}, a unit of {unit.quantity}",
            path,
            line,
            expected="acceleration",
            remedy="differentiate it to acceleration first",
        )
    if unit is None and column.unit:
        no_unit = InputError(
            f"{column.unit!r} in the names of the columns does not say in which unit the samples are",
            where=f"{path}:{line}",
            expected=f"one of {known_names()}",
            remedy="correct it, or give a metadata table with the column 'unit' (--metadata)",
        )
    factor = unit.factor if unit else None
    return Component(
        acceleration_m_s2=values * (factor or 1.0),
        time_step_s=step,
        direction=code_direction(label),
        path=path,
        line=line,
        file_format=NAME,
        unit_known=factor is not None,
        stated_unit_m_s2=factor,
        label=label,
        no_unit=no_unit,
    )


@dataclass(frozen=True)
class _Column:
    """Name of a column, and what stands in brackets behind it."""

    name: str
    unit: str


def _header(lines: list[str]) -> tuple[int | None, int]:
    """Places of the line that may name the columns, None without one, and of the first line of numbers."""
    first = next(i for i, line in enumerate(lines) if _is_body(line))
    comma = _is_decimal_comma(lines[first + 1 : first + 21])
    if not all(map(_NUMBER.match, _split(lines[first], comma))):
        below = next((i for i in range(first + 1, len(lines)) if _is_body(lines[i])), first)
        return first, below + (_units_below(lines[first], lines[below]) is not None)
    comments = [i for i in range(first) if lines[i].strip()]
    return (comments[-1] if comments else None), first


def _units_below(names: str, units: str) -> list["_Column"] | None:
    """Columns of a line of names and a line of units below it; None if the second line is none of units."""
    width = len(_columns(names, 0))
    below = _columns(units, 0)
    if len(below) != width or not width:
        return None
    words = [part.unit or part.name for part in below]
    if any(unit_of(word) is None and word.lower() not in _TIME_WORDS for word in words):
        return None
    return [_Column(column.name, word) for column, word in zip(_columns(names, width), words, strict=True)]


def _columns(line: str, width: int) -> list[_Column]:
    """Columns as a line names them; none if it is a comment of another number of words, which is no header."""
    text = line.strip().lstrip("".join(_COMMENT)).strip(f" {SEPARATORS}")
    between = next((separator for separator in SEPARATORS if separator in text), None)
    parts = text.split(between) if between else _WORD.findall(text)
    found = [_Column(_BRACKETS.sub("", part).strip(" \"'_:."), _unit(part)) for part in parts]
    return [] if len(found) != width and line.lstrip().startswith(_COMMENT) else found


def _unit(part: str) -> str:
    match = _BRACKETS.search(part)
    return match[1].strip() if match else ""


def _labels(columns: list[_Column], width: int, path: Path, line: int) -> list[str]:
    """Labels of the components: of three by their names, first, second and vertical where there are none.

    Names that are not understood are refused: in the order of a file without names, they would become other
    components than they are.
    """
    if width < 4:
        return [""]
    if not columns:
        return ["h1", "h2", "v"]
    labels = [_label(column.name) for column in columns[1:]]
    if len(columns) != width or not _TIME.match(columns[0].name) or "" in labels or len(set(labels)) < 3:
        refuse(
            f"the names of {width} columns are {', '.join(repr(column.name) for column in columns)}",
            path,
            line,
            expected="the time, then three components by direction (NS, E, 090, UP, HNZ ...) or as h1, h2, v",
            remedy="name them so, or delete this line if they are the time, h1, h2 and v",
        )
    return labels


def _label(name: str) -> str:
    """Label of a component's name, '' if it is none: a direction, a channel's code or number, or a horizontal."""
    bare = _QUANTITY.sub("", name.upper())
    if bearing(bare) is not None or bare in _HORIZONTALS or re.fullmatch("[1-9]", bare):
        return bare.lower()
    return bare[-1].lower() if _CHANNEL_CODE.fullmatch(bare) else ""


def _time_step(time: NDArray[np.float64], printed: list[str], path: Path, line: int) -> float:
    """Step of equally spaced times: their span by their number, as round as the last printed digit allows.

    Where nearly all differences are one number of whole digits, rounding explains no other.
    """
    steps = np.diff(time)
    mean = positive(float((time[-1] - time[0]) / len(steps)), "time step", path, line)
    usual, digit = float(np.median(steps)), _print_error(printed)
    regular = usual > 0 and float((np.abs(steps - usual) < 0.1 * digit).mean()) >= _REGULAR_SHARE
    step = usual if regular or usual > digit else mean
    wrong = np.flatnonzero(
        np.abs(steps - step) > max(_STEP_TOLERANCE * step, digit / 2 if regular else digit)
    )
    if not len(wrong) and digit > _COARSE * step:
        wrong = _jump_of_coarse_times(time, digit)
    if len(wrong):
        refuse(
            f"the time goes on by {steps[wrong[0]]:g} s where the step is {step:g} s: a gap or two steps",
            path,
            line + 1 + int(wrong[0]),
            expected="equal time steps",
            remedy="fill or cut the gap, or resample the record to one step first",
        )
    return _round_step(mean, digit / len(steps))


def _jump_of_coarse_times(time: NDArray[np.float64], digit: float) -> NDArray[np.int64]:
    """Place, if there is one, where times leave the line that they are on but for rounding to a digit."""
    number = np.arange(len(time))
    slope, start = np.polyfit(number, time, 1)
    off = time - start - slope * number
    if np.ptp(off) <= _COARSE_RANGE * digit:
        return np.empty(0, np.int64)
    sums = np.concatenate([[0.0], np.cumsum(off)])
    beside = min(_COARSE_WINDOW, len(time) // 2)
    middle = sums[beside:-beside]
    return np.array([np.argmax(sums[2 * beside :] + sums[: -2 * beside] - 2 * middle) + beside - 1])


def _round_step(step: float, error: float) -> float:
    """Roundest step within an error: of a few decimals, else of a whole number a second, else of nine decimals."""
    few = next(
        (round(step, digits) for digits in range(1, 5) if abs(round(step, digits) - step) <= error), 0.0
    )
    rate = round(1 / step) or 1
    if few > 0:
        return few
    return 1 / rate if abs(1 / rate - step) <= error else round(step, 9)


def _print_error(numbers: list[str]) -> float:
    """Twice the half of the last printed digit of times: what rounding alone makes of a difference.

    Where zeros at the end are left away ('0.0', '0.005') the longest shows the digit; with an exponent it is each
    number's own.
    """
    digits, largest = 0, 0
    for number in numbers:
        mantissa, _, exponent = number.upper().partition("E")
        digits = max(digits, len(mantissa.partition(".")[2]))
        largest = max(largest, int(exponent or 0))
    return 1.01 * 10.0 ** (largest - digits) if digits else 0.0


def _is_decimal_comma(lines: list[str]) -> bool:
    """Whether commas in lines of numbers are decimal points: where something else stands between the numbers.

    One comma a line may be either: it stands between two columns if what is before it goes on as times do.
    """
    bare = [_BETWEEN.sub(" ", line.strip(f" {SEPARATORS}")) for line in lines if _is_body(line)]
    rows = [re.split(rf"[\s{_NOT_COMMA}]+", line) for line in bare]
    numbers = [number for row in rows for number in row]
    if not any("," in number for number in numbers) or not all(map(_COMMA_NUMBER.match, numbers)):
        return False
    if all(len(row) > 1 for row in rows):
        return True
    before = [int(row[0].partition(",")[0] or 0) for row in rows]
    return any(b <= a for a, b in pairwise(before))


def _is_body(line: str) -> bool:
    return bool(line.strip()) and not line.lstrip().startswith(_COMMENT)


def _separated(line: str, decimal_comma: bool) -> str:
    """Line with a blank between its numbers, and their decimals behind a point."""
    if decimal_comma:
        line = _BETWEEN.sub(" ", line).replace(",", ".")
    return line.translate(_AS_BLANKS)


def _split(line: str, decimal_comma: bool) -> list[str]:
    return _separated(line, decimal_comma).split()


def _refuse_two_commas(example: str, width: int, rows: list[str], path: Path, line: int) -> None:
    """Refuse commas that part numbers and seem to be within them too: no time goes on, or there are twice as many."""
    firsts = [row.split()[0] for row in rows[:20] if row.strip()]
    if "," not in example or "." in example or not all(map(str.isdigit, firsts)):
        return
    if width in _WIDTHS and (width == 1 or all(int(b) > int(a) for a, b in pairwise(firsts))):
        return
    refuse(
        f"{example.strip()[:60]!r} has commas, which may stand between its numbers or within them",
        path,
        line,
        expected="a decimal point, or semicolons, tabs or blanks between numbers with decimal commas",
        remedy="export the file with a decimal point",
    )
