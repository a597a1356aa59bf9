"""Columns of acceleration: alone, with the time, or of several components, under any names.

Units come from the names of the columns, the text above them or the metadata table, the time step of columns without
times from that text or the table.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from toppling.models.errors import InputError
from toppling.models.files.documents import shown
from toppling.models.files.given import LONGEST_NAME
from toppling.models.files.table import Table
from toppling.models.motions.formats.component import Component, bearing, code_direction, label_of
from toppling.models.motions.formats.record_text import (
    HEADER_LINES,
    STEP_OFF,
    Counted,
    RecordText,
    check_stated,
    first_found,
    parted,
    round_step,
    stated_step_s,
    stated_unit,
)
from toppling.models.motions.formats.units import UNITS_S, counted_unit, known_names, unit_of
from toppling.models.motions.place import place_above

NAME = "plain columns"
COMMENT = ("#", "%", "!", "//", ";")
_REMARK = COMMENT[:-1]
"""First characters of a remark among samples: a semicolon may stand before an empty cell there."""
_NUMBER = re.compile(r"^[-+]?((\d+(\.\d*)?|\.\d+)([EeDd][-+]?\d+)?|nan|inf)$", re.IGNORECASE)
"""NaN too: a file that begins with one is of this format, and damaged at that line."""
_COMMA_NUMBER = re.compile(r"[-+]?(?:\d+(?:,\d*)?|,\d+)(?:[EeDd][-+]?\d+)?")
_POINT_NUMBER = re.compile(r"[-+]?\d*\.\d+")
_WORD = re.compile(r"[^\s(\[]+\s*+(?:[(\[][^)\]]{0,200}[)\]])?")
_TEXT = re.compile(r"\s*[A-Za-z#%!/]")
"""Beginning of a line of text below the samples."""
_OTHERS = ("TIMESERIES", "WID2", "WID1")
"""First words of SLIST, TSPAIR and GSE, which are not read and whose samples look like columns."""
_INTEGRAL_CORRELATION = 0.9
"""Correlation of a column with the slope of the next from which that is its integral."""
_USUAL = "acceleration alone, time and acceleration, or time and three components"
_WIDTHS = (1, 2, 4)
"""Numbers of columns that are understood without names."""
_MOST_COLUMNS = 12
"""Maximum number of columns of a record."""
_MOST_FOOTER = 20
"""Maximum number of lines of text below the samples, which are left out."""
_PROBED = 20
"""Number of rows by which separator and decimal sign are recognised."""

_BRACKETS = re.compile(r"[(\[]([^)\]]*)[)\]]")
_ENDING = re.compile(
    r"(.*?[^\W_])_((?:[cm]?m_s\^?2)|gal|g|ms|us|ns|s|sec|seconds|milliseconds)$", re.IGNORECASE
)
"""A unit at the end of a name, as this program's own columns have it: time_s, ns_m_s2."""
_QUOTIENT = re.compile(r"(.+?)\s+/\s+(.+)")
"""A quantity over its unit: a_E / m s^-2."""
_BEFORE_UNIT = re.compile(r"(\S+(?: \S+)??)\s+(?:in\s+)?(\S*/\S+)")
"""A quantity before its unit, without brackets: NS cm/s/s."""
_TIME = re.compile(
    r"(?:t|(?:(?:date|unix|epoch|elapsed|utc|gps)[ _-]?)?time(?:s|stamp)?|epoch|zeit|tiempo|temps|tempo|zaman|"
    r"时间|時間|時刻|s|m?secs?|(?:milli)?seconds?)(?![a-z])",
    re.IGNORECASE,
)
_COUNTERS = {
    "", "no", "nr", "n", "i", "id", "idx", "index", "row", "sample", "samples", "point", "points", "#", "count"
}  # fmt: skip
_DATES = ("date", "datum", "fecha", "data")
_ACCELERATION = re.compile(
    r"a(?:cc(?:el(?:eration|erations)?)?)?|aceleraci[oó]n|beschleunigung|acc[eé]l[eé]ration|amplitude|samples?|data|values?",
    re.IGNORECASE,
)
_DERIVED = re.compile(
    r"v(?:el(?:ocity)?)?|d(?:isp(?:lacement)?)?|velocidad|desplazamiento|"
    r"(?:gyr|mag)\w*|temp(?:erature)?|battery|vector(?: sum)?|srss|(?:absolute|abs|total|resultant)(?:[ _]acc\w*)?",
    re.IGNORECASE,
)
"""Names of quantities derived from accelerations, and of other sensors."""
_INTEGRATED, _ACCELERATED = (
    re.compile(words, re.IGNORECASE) for words in (r".*\b(?:velocity|displacement)\b.*", "acc|acel")
)
"""Text above the samples that names velocity, and acceleration."""
_CHANGED = re.compile(
    r".*\b(?:scal(?:e|ing)[ _-]*factor|multipl(?:y|ier|ied)|polarity|reversed)\b.*", re.IGNORECASE
)
"""Text above the samples that names a factor or a sign, which the samples may have or not."""
_OTHER_UNIT = re.compile(r"(?:rad|deg|°)/s|dps|°?[cf]|[hk]?pa|[uµμ]t|m?v|volts?|%", re.IGNORECASE)

_EPOCHS = {1e17: 1e-9, 1e14: 1e-6, 1e11: 1e-3}
"""Present-day times since 1970 from which on they are in units of so many seconds."""
_CLOCK = re.compile(
    r"(?:\b\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}[T ,;\t]\s*)?(?<!\d)(\d{1,2}):(\d\d):(\d\d)(\.\d+)?"
    r"(?:Z|[-+]\d\d:\d\d| ?([AP])M)?\b",
    re.ASCII | re.IGNORECASE,
)
"""A time of day, of 24 hours or of twice twelve, and the date before it."""
_DAY_S = 24 * UNITS_S["h"]
_REGULAR_FRACTION = 0.95
"""Fraction of equal differences from which rounding explains no other."""


@dataclass(frozen=True)
class _Column:
    """Name and unit of a column: the unit stands in brackets behind the name, or at its end."""

    name: str
    unit: str

    @property
    def counts_rows(self) -> bool:
        return self.name.lower() in _COUNTERS and not self.unit

    @property
    def is_time(self) -> bool:
        return _TIME.match(self.name) is not None


@dataclass(frozen=True)
class _Roles:
    """Roles of the columns, by their places from 0."""

    time: int | None
    components: dict[int, str]  # place and label, '' for an acceleration without a direction
    left_out: tuple[str, ...] = ()  # names of columns of velocity or displacement


@dataclass(frozen=True)
class _Layout:
    """Place and number of the columns, how their cells are separated, and their names."""

    first: int  # line of the first row, from 0
    width: int
    table: Table  # of some rows
    names_at: int | None = None
    columns: tuple[_Column, ...] = ()

    def cells(self, line: str) -> list[str]:
        """Numbers, or words, of a line, with decimal points."""
        return _cells(self.table, line)

    @property
    def roles(self) -> _Roles | None:
        """Roles of the columns by their names, or by their number where no name is understood."""
        if len(self.columns) == self.width and (roles := _roles_of(self.columns)):
            return roles
        if self.width <= 2:
            return _Roles(None if self.width == 1 else 0, {self.width - 1: ""})
        return _Roles(0, {1: "h1", 2: "h2", 3: "v"}) if self.width == 4 and not self.columns else None


def recognises(head: str) -> bool:
    """Whether rows of numbers follow that have names, or are as many columns as need none."""
    lines = head.splitlines()
    layout = None if head.lstrip().startswith(_OTHERS) else _layout(lines[:-1])
    if layout is None:
        return False
    understood = layout.roles is not None
    if understood or layout.width in _WIDTHS or layout.width == 3:
        above = [line for line in lines[: layout.first] if _is_body(line)]
        return understood or layout.names_at is None or len(above) <= 2  # no other program's header
    first = layout.columns[0] if len(layout.columns) == layout.width else None
    if first and (first.is_time or first.counts_rows):
        return True  # which `read` refuses by the names
    row = lines[layout.first]
    # Which `read` refuses too, as decimal commas between commas.
    return layout.width == 2 * _WIDTHS[-1] and layout.names_at is None and "." not in row and "," in row


def _is_body(line: str) -> bool:
    return bool(line.strip()) and not line.lstrip().startswith(COMMENT)


def _cells(table: Table, line: str) -> list[str]:
    return " ".join(table.cells(line.rstrip(" ;,\t"))).split()


def _layout(lines: Sequence[str]) -> _Layout | None:
    """Layout of a file by its first lines; None where no rows of numbers follow on each other."""
    plain = [_plain(line) for line in lines]
    numeric = [line for line in plain if re.match(r"\s*[-+.,\d]", line)]
    table = _probe(numeric[len(numeric) // 2 :][:_PROBED])
    widths = {}
    for n, line in enumerate(plain):
        if _is_body(lines[n]):
            row = _cells(table, line)
            widths[n] = len(row) if all(map(_NUMBER.match, row)) else 0
    places = list(widths)
    for at, (place, following) in enumerate(pairwise(places)):
        if 0 < widths[place] <= _MOST_COLUMNS and widths[place] == widths[following]:
            return _named(lines, _Layout(place, widths[place], table), places[:at])
    return None


def _probe(rows: Sequence[str]) -> Table:
    """Separator and decimal sign of rows of numbers.

    One comma a row separates two columns where what is before it rises as times do, and is decimal in one column
    otherwise.
    """
    table = Table.of(rows, coordinates=True)
    if (table.decimal, table.thousands) == (".", None):  # a column of times may have points beside commas
        table = Table.of([_POINT_NUMBER.sub("0", row) for row in rows], coordinates=True)
    if table.decimal == ",":
        table = replace(table, thousands=None)
    numbers = [number for row in rows if (number := row.strip(" ;,\t"))]
    if any("," in number for number in numbers) and all(map(_COMMA_NUMBER.fullmatch, numbers)):
        before = [int(number.partition(",")[0] or 0) for number in numbers]
        if any(b <= a for a, b in pairwise(before)):
            return replace(table, sign=None, decimal=",")
    return table


def _named(lines: Sequence[str], layout: _Layout, above: list[int]) -> _Layout:
    """Layout with the names in the line above the rows, or in the last comment, and with units between them."""
    candidates = above[-2:] or [n for n in range(layout.first) if lines[n].strip()][-2:]
    if not candidates:
        return layout
    names_at = candidates[-1]
    units: list[str] = []
    for names, other in ((0, 1), (1, 0)) if len(candidates) == 2 else ():
        parts = _parts(lines[candidates[other]])
        bare = [part.strip("()[]- \"'") for part in parts]
        if not units and len(parts) == layout.width and all(map(_is_unit, bare)) and any(bare):
            units, names_at = bare, candidates[names]
    columns = [_column_of(part) for part in _parts(lines[names_at])]
    if len(columns) == layout.width + 1 and columns[0].name.lower() in _DATES and columns[1].is_time:
        columns = columns[1:]  # a date and a time of day are one
    if len(columns) != layout.width and (
        all(_NUMBER.match(cell.name) for cell in columns) or lines[names_at].lstrip().startswith(COMMENT)
    ):
        columns = []
    if units and len(columns) == len(units):
        columns = [replace(cell, unit=unit or cell.unit) for cell, unit in zip(columns, units, strict=True)]
    return replace(layout, names_at=names_at, columns=tuple(columns))


def _parts(line: str) -> list[str]:
    """Cells of a line of names or units."""
    text = line.strip().lstrip("".join(COMMENT)).strip(" ")
    table = Table.of([text])
    if table.sign is None:
        return _WORD.findall(text)
    parts = table.cells(text)
    return parts[:-1] if len(parts) > 1 and not parts[-1] else parts


def _is_unit(word: str) -> bool:
    return not word or word.lower() in UNITS_S or unit_of(word) is not None


def _column_of(part: str) -> _Column:
    """Name and unit of a cell of a header."""
    part = part[:LONGEST_NAME]
    match = _BRACKETS.search(part)
    name, unit = _BRACKETS.sub("", part).strip(" \"'_:."), match[1].strip() if match else ""
    if unit:
        return _Column(name, unit)
    if (found := _QUOTIENT.fullmatch(name)) and _is_unit(found[2].strip("()[]- ")):
        return _Column(found[1], found[2])
    if (found := _BEFORE_UNIT.fullmatch(name)) and unit_of(found[2]):
        return _Column(found[1], found[2])
    # Acc_NS is no acceleration in nanoseconds.
    if (found := _ENDING.fullmatch(name)) and (found[2].lower() not in UNITS_S or _TIME.match(found[1])):
        return _Column(found[1], found[2].replace("_", "/"))
    if unit_of(name) and not bearing(name) and label_of(name) == "" and not _TIME.match(name):
        return _Column("acceleration", name)
    return _Column(name, unit)


def _roles_of(columns: Sequence[_Column]) -> _Roles | None:
    """Roles of columns by their names; None where one is not understood, as it might be a component.

    Rows may be counted in the first column; the others are the time and components in any order, or acceleration
    alone, with velocity and displacement behind it. The time stands first, or has a name that is no component's.
    """
    first = int(columns[0].counts_rows and len(columns) > 1)
    times = [n for n in range(first, len(columns)) if columns[n].is_time]
    times = [n for n in times if n == first or not label_of(columns[n].name)]
    time = times[0] if times and len(columns) > first + 1 else None
    labels: dict[int, str] = {}
    others: dict[int, str] = {}
    for place in (n for n in range(first, len(columns)) if n != time):
        name, unit = columns[place].name, columns[place].unit
        known, label = unit_of(unit) if unit else None, label_of(name)
        other = known.quantity != "acceleration" if known else _OTHER_UNIT.fullmatch(unit) is not None
        if other or (not label and _DERIVED.fullmatch(name)):
            others[place] = label
        elif label or _ACCELERATION.fullmatch(name):
            labels[place] = label
        else:
            return None
    if not labels and all(others.values()):
        labels, others = others, {}  # of velocity alone, which is refused by its unit
    alone = list(labels.values()) == [""]
    if not labels or (not alone and ("" in labels.values() or len(set(labels.values())) < len(labels))):
        return None
    return _Roles(time, labels, tuple(columns[place].name for place in others))


def read(file: RecordText) -> list[Component]:
    """Read the columns; the unit of their samples is that in their names, else the metadata table must name it."""
    layout = _layout(file.lines[:HEADER_LINES])
    if layout is None:
        file.refuse("record.no_rows", 0, "no rows of numbers follow on each other", "columns of numbers")
    rows, warnings = _rows(file, layout)
    above = file.lines[: layout.first]
    values, roles = _values(file, layout, rows)
    if roles.left_out:
        warnings = (*warnings, f"{file.path.name}: columns left out: {', '.join(roles.left_out)}")
    step, start_s = _times(file, layout, roles, values, rows)
    text = [line for n, line in enumerate(above) if n != layout.names_at or not layout.columns]
    integrated = None if first_found(_ACCELERATED, above) else first_found(_INTEGRATED, text)
    for statement in filter(None, (integrated, first_found(_CHANGED, text))):
        what = f"{file.path.name}: {shown(statement[0].strip())} stands above samples read as acceleration as they are"
        warnings = (*warnings, what)
    check_stated(text, step, (len(values), len(roles.components)), file.path)
    unit, place = stated_unit(text), place_above(above)
    named = layout.columns if len(layout.columns) == layout.width else (_Column("", ""),) * layout.width
    found = (
        _component(file, layout.first, Counted(values[:, n], warnings=warnings), step, label, named[n], unit)
        for n, label in roles.components.items()
    )
    return [replace(part, place=place, start_s=start_s) for part in found]


def _rows(file: RecordText, layout: _Layout) -> tuple[list[str], tuple[str, ...]]:
    """Rows below the names, their numbers separated by blanks, and warnings of the text that is left out."""
    lines, first, end = file.lines, layout.first, len(file.lines)
    while not lines[end - 1].strip():  # the first row has numbers
        end -= 1
    last = end
    while _TEXT.match(lines[last - 1]):
        if all(map(_NUMBER.match, layout.cells(lines[last - 1]))):
            break
        last -= 1
    warnings: tuple[str, ...] = ()
    if 0 < end - last <= _MOST_FOOTER:
        text = f"{file.path.name}: text below the samples is left out: {shown(lines[last].strip())}"
        end, warnings = last, (text,)
    remarks = [line.strip() for line in lines[first:end] if line.lstrip().startswith(_REMARK)]
    if remarks:
        remark = f"{file.path.name}: a remark among the samples is left out: {shown(remarks[0])}"
        warnings = (*warnings, remark)
    rows = []
    for line in lines[first:end]:
        cells = [] if line.lstrip().startswith(_REMARK) else layout.cells(_plain(line))
        rows.append(" ".join(cells) if len(cells) == layout.width else parted(" ".join(cells)))
    return rows, warnings


def _values(file: RecordText, layout: _Layout, rows: list[str]) -> tuple[NDArray[np.float64], _Roles]:
    """Numbers (n, width) of the rows, and the roles of their columns."""
    first, width, roles = layout.first, layout.width, layout.roles
    for offset, row in enumerate(rows):
        if row and len(row.split()) != width:
            what = f"{len(row.split())} numbers where the lines before have {width}"
            remedy = "fill an empty cell, or fetch the file again if it is damaged or truncated here"
            file.refuse(
                "record.row_wrong_length", first + offset, what, "the same columns on every line", remedy
            )
    _refuse_two_commas(file, layout, rows)
    values = RecordText(file.path, rows, first).numbers(0).reshape(-1, width)
    if roles is None:
        _refuse_columns(file, layout)
    if roles.components == {1: "h1", 2: "h2", 3: "v"}:
        _refuse_integrals(file, first, values)
    return values, roles


def _times(
    file: RecordText, layout: _Layout, roles: _Roles, values: NDArray[np.float64], rows: Sequence[str]
) -> tuple[float, float | None]:
    """Time step and first time by the column of times, else the step by the text above; NaN where neither states it."""
    if roles.time is None:
        above = stated_step_s(file.lines[: layout.first])
        return math.nan if above is None else above, None
    unit = layout.columns[roles.time].unit.lower() if layout.columns else ""
    unit = unit.replace("µ", "u").replace("μ", "u")
    time, first = values[:, roles.time], file.lines[layout.first]
    if _plain(first) != first.replace('"', ""):  # a time of day, which may go on into the next day
        time = time + _DAY_S * np.concatenate([[0], np.cumsum(np.diff(time) < -_DAY_S / 2)])
        unit = "s"
    elif unit not in UNITS_S:
        expected, remedy = f"one of {', '.join(filter(None, UNITS_S))}", "correct the unit, or give seconds"
        file.refuse(
            "record.time_unit_unknown", layout.names_at or 0, f"the time is in {unit!r}", expected, remedy
        )
    since_1970 = next((factor for least, factor in _EPOCHS.items() if time[0] >= least), 1.0)
    unit_s = UNITS_S[unit] if unit else since_1970
    printed = [row.split()[roles.time] for row in rows if row]
    return _time_step(file, layout.first, time, printed) * unit_s, float(time[0]) * unit_s


def _refuse_columns(file: RecordText, layout: _Layout) -> NoReturn:
    """Refuse names that are not understood, or are missing: in another order the columns are other components."""
    width = layout.width
    if not layout.columns:
        what, remedy = f"{width} columns without names", "name them, such as 'Time (s),NS (cm/s2),EW (cm/s2)'"
        file.refuse("record.columns_unnamed", layout.first, what, _USUAL, remedy)
    other = "delete this line if they are the time, h1, h2 and v" if width == 4 else "leave other columns out"
    same = width == len(layout.columns)
    what = f"the names of {width} columns are" if same else f"rows of {width} numbers stand below"
    what += " " + ", ".join(repr(column.name) for column in layout.columns)
    expected = "the time first, then components by direction (NS, E, 090, UP, HNZ ...) or as h1, h2, v"
    file.refuse(
        "record.columns_unknown", layout.names_at or 0, what, expected, f"write {expected}; or {other}"
    )


def _refuse_integrals(file: RecordText, first: int, values: NDArray[np.float64]) -> None:
    """Refuse columns that are integrals of the one before: velocity and displacement behind acceleration."""
    slopes = np.diff(values, axis=0)[:, 1:]
    means = 0.5 * (values[1:] + values[:-1])[:, 1:]
    for place in (1, 2):
        pair = np.stack([means[:, place - 1], slopes[:, place]])
        if pair.std(axis=1).min() == 0 or np.asarray(np.corrcoef(pair))[0, 1] < _INTEGRAL_CORRELATION:
            return
    what = "its last two columns are integrals of the second: velocity and displacement"
    remedy = "leave the columns of velocity and displacement out, and give one file a component"
    file.refuse("record.columns_are_integrals", first, what, _USUAL, remedy)


def _refuse_two_commas(file: RecordText, layout: _Layout, rows: list[str]) -> None:
    """Refuse commas that may be separators and decimal signs: no time rises, or there are twice as many numbers."""
    example, width = file.lines[layout.first], layout.width
    firsts = [row.split()[0] for row in rows[:_PROBED] if row]
    if "," not in example or "." in example or not all(map(str.isdigit, firsts)):
        return
    if width in _WIDTHS and (width == 1 or all(int(b) > int(a) for a, b in pairwise(firsts))):
        return
    what = f"{shown(example.strip())} has commas, which may stand between its numbers or within them"
    expected = "a decimal point, or semicolons, tabs or blanks between numbers with decimal commas"
    remedy = "export the file with a decimal point"
    file.refuse("record.commas_ambiguous", layout.first, what, expected, remedy)


def _component(
    file: RecordText,
    first: int,
    found: Counted,
    step: float,
    label: str,
    column: _Column,
    above: float | None,
) -> Component:
    """Component of a column; its unit is the column's, else that of the text above."""
    unit, no_unit = counted_unit(column.unit), None
    in_unit = f"the column {column.name!r} is in {column.unit!r}"
    if unit is not None and unit.quantity != "acceleration":
        what, remedy = f"{in_unit}, a unit of {unit.quantity}", "differentiate it to acceleration first"
        file.refuse("record.not_acceleration", first, what, "acceleration", remedy)
    if unit is not None and above is not None and not math.isclose(unit.factor, above):
        what, remedy = f"{in_unit}, and the text above names another unit", "correct the text, or the names"
        file.refuse("record.unit_contradicted", first, what, "one unit of acceleration", remedy)
    if unit is None and column.unit:
        no_unit = InputError(
            "record.unit_unknown",
            f"{column.unit!r} in the names of the columns does not say in which unit the samples are",
            where=file.where(first),
            expected=f"one of {known_names()}",
            remedy="correct it, or give a metadata table with the column 'unit' (--metadata)",
        )
    factor = unit.factor if unit else None if column.unit else above
    return file.channel(
        first,
        found,
        factor or 1.0,
        step,
        direction=code_direction(label),
        file_format=NAME,
        unit_known=factor is not None,
        stated_unit_m_s2=factor,
        label=label,
        no_unit=no_unit,
    )


def _plain(line: str) -> str:
    """Line without quotes, and with the first date and time of day in seconds of the day, with its decimals."""
    line = line.replace('"', "")
    match = _CLOCK.search(line) if ":" in line else None
    if match is None:
        return line
    hours = int(match[1])
    if match[5]:
        hours = hours % 12 + 12 * (match[5] in "Pp")
    seconds = 3600 * hours + 60 * int(match[2]) + int(match[3])
    return f"{line[: match.start()]}{seconds}{match[4] or ''}{line[match.end() :]}"


def _time_step(file: RecordText, first: int, time: NDArray[np.float64], printed: list[str]) -> float:
    """Step of equally spaced times: their span by their number, as round as the last printed digit allows.

    first: line of the first of them.
    Where nearly all differences are one number of whole digits, rounding explains no other.
    """
    if time[-1] < time[0]:
        what, remedy = f"the time goes back from {time[0]:g} to {time[-1]:g}", "sort the rows by their times"
        file.refuse("record.time_falls", first, what, "times that rise", remedy)
    steps = np.diff(time)
    mean = file.positive(first, float((time[-1] - time[0]) / len(steps)), "time step")
    usual, digit = float(np.median(steps)), _print_error(printed)
    regular = usual > 0 and float((np.abs(steps - usual) < 0.1 * digit).mean()) >= _REGULAR_FRACTION
    step = usual if regular or usual > digit else mean
    tolerance = max(STEP_OFF * step, digit / 2 if regular else digit)
    wrong = np.flatnonzero(np.abs(steps - step) > tolerance)
    if len(wrong):
        what = f"the time advances by {steps[wrong[0]]:g} s where the step is {step:g} s: a gap or two steps"
        remedy = "fill or cut the gap, or resample the record to one step first"
        file.refuse("record.step_uneven", first + 1 + int(wrong[0]), what, "equal time steps", remedy)
    return round_step(mean, digit / len(steps))


def _print_error(numbers: list[str]) -> float:
    """Maximum error of a difference of printed times: one unit of their last digit.

    Where zeros at the end are left away ('0.0', '0.005') the longest shows the digit; with an exponent it is each
    number's own.
    """
    digits, largest = 0, 0
    for number in numbers:
        mantissa, _, exponent = number.upper().replace("D", "E").partition("E")
        digits = max(digits, len(mantissa.partition(".")[2]))
        largest = max(largest, int(exponent or 0))
    return 1.01 * 10.0 ** (largest - digits) if digits else 0.0
