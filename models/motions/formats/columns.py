"""Plain columns: acceleration alone, time and acceleration, or components with the time or without.

Units come from the names of the columns, the text above them or the metadata table, the time step of columns without
times from that text or the table.
"""

import csv
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from toppling.models.errors import InputError
from toppling.models.motions.formats.column_cells import (
    COMMENT,
    SEPARATORS,
    UNITS_S,
    cells_of,
    is_body,
    is_decimal_comma,
    past_midnight,
    plain_line,
    separated,
    time_step,
    unit_of_times_s,
    unquoted,
)
from toppling.models.motions.formats.column_names import (
    Column,
    Roles,
    column_of,
    counts_rows,
    is_unit,
    names_time,
    refuse_names,
    roles_of,
    without_date,
)
from toppling.models.motions.formats.component import Component, code_direction
from toppling.models.motions.formats.header_text import (
    check_stated,
    stated_counts,
    stated_direction,
    stated_orientations,
    stated_peak_m_s2,
    stated_step_s,
    stated_unit,
    unit_of_peaks,
)
from toppling.models.motions.formats.record_text import Counted, RecordText, parted
from toppling.models.motions.formats.units import counted_unit, known_names
from toppling.models.motions.place import place_above

NAME = "plain columns"
_NUMBER = re.compile(r"^[-+]?((\d+(\.\d*)?|\.\d+)([EeDd][-+]?\d+)?|nan|inf)$", re.IGNORECASE)
"""NaN too: a file that begins with one is of this format, and damaged at that line."""
_WORD = re.compile(r"[^\s(\[]+\s*+(?:[(\[][^)\]]{0,200}[)\]])?")
_TEXT = re.compile(r"\s*[A-Za-z#%!/]")
"""How a line of text begins, below the samples."""
_OTHERS = ("TIMESERIES", "WID2", "WID1")
"""First words of SLIST, TSPAIR and GSE, which are not read and whose samples look like columns."""
_REMARK = tuple(sign for sign in COMMENT if sign not in SEPARATORS)
"""How a remark begins among samples: there a semicolon may stand before an empty cell."""
_DERIVED = 0.9
"""Correlation of a column with the slope of the next, from which this is its integral."""
_USUAL = "acceleration alone, time and acceleration, or time and three components"
_WIDTHS = (1, 2, 4)
"""Numbers of columns that are understood without names."""
_MOST_COLUMNS, _MOST_ABOVE, _MOST_FOOTER, _SHOWN = 12, 500, 20, 60
_LEAST_ROWS = 2
"""So many rows of one width show where the columns begin."""


@dataclass(frozen=True)
class _Layout:
    """Where columns begin, what stands between their numbers, and what their names say."""

    first: int  # line of the first row, from 0
    width: int
    decimal_comma: bool
    names_at: int | None = None
    columns: tuple[Column, ...] = ()


def recognises(head: str) -> bool:
    """Whether rows of numbers follow that have names, or are as many columns as need none."""
    if head.lstrip().startswith(_OTHERS):
        return False
    layout = _layout(head.splitlines()[:-1])
    if layout is None:
        return False
    understood = _roles(layout) is not None
    if understood or layout.width in _WIDTHS or layout.width == 3:
        return understood or layout.names_at is None or _is_header(head, layout)
    first = layout.columns[0] if len(layout.columns) == layout.width else None
    if first and (names_time(first) or counts_rows(first)):
        return True  # which `read` refuses by the names
    if layout.width == 2 * _WIDTHS[-1] and _whole_numbers(head, layout):
        return True
    return _is_wrapped(head.splitlines(), layout)


def _is_wrapped(lines: Sequence[str], layout: _Layout) -> bool:
    """Whether rows are one component's samples, so many a line: the text above states their number and time step."""
    above = lines[: layout.first]
    return (
        layout.width > _WIDTHS[-1] and len(stated_counts(above)) == 1 and stated_step_s(above, 0) is not None
    )


def _is_header(head: str, layout: _Layout) -> bool:
    """Whether what stands above the rows is one line of names, with comments perhaps, and no other program's header."""
    above = [line for line in head.splitlines()[: layout.first] if is_body(line)]
    return len(above) <= 2


def _whole_numbers(head: str, layout: _Layout) -> bool:
    """Whether eight columns are four whose decimal commas stand between numbers too; `read` says so."""
    row = head.splitlines()[layout.first]
    return layout.names_at is None and "." not in row and "," in row


def _layout(lines: Sequence[str]) -> _Layout | None:
    """Layout of a file by its first lines; None where no rows of numbers follow on each other."""
    plain = [plain_line(line) for line in lines]
    numeric = [line for line in plain if re.match(r"\s*[-+.,\d]", line)]
    middle = len(numeric) // 2
    comma = is_decimal_comma(numeric[middle : middle + 20])
    rows = {n: cells_of(plain[n], comma) for n in range(len(lines)) if is_body(lines[n])}
    widths = {n: len(row) if all(map(_NUMBER.match, row)) else 0 for n, row in rows.items()}
    places = list(rows)
    for at, place in enumerate(places):
        run = [widths[n] for n in places[at : at + _LEAST_ROWS]]
        if 0 < run[0] <= _MOST_COLUMNS and len(run) == _LEAST_ROWS and len(set(run)) == 1:
            return _named(lines, _Layout(place, run[0], comma), places[:at])
    return None


def _named(lines: Sequence[str], layout: _Layout, above: list[int]) -> _Layout:
    """Layout with the names in the line above the rows, or in the last comment, and with units between them."""
    candidates = above[-2:] or [n for n in range(layout.first) if lines[n].strip()][-2:]
    if not candidates:
        return layout
    names_at = candidates[-1]
    units: list[str] = []
    for names, beside in ((0, 1), (1, 0)) if len(candidates) == 2 else ():
        if not units and (units := _units_in(lines[candidates[beside]], layout.width)):
            names_at = candidates[names]
    columns = _columns(lines[names_at], layout.width)
    if units and len(columns) == len(units):
        columns = [replace(each, unit=unit or each.unit) for each, unit in zip(columns, units, strict=True)]
    return replace(layout, names_at=names_at, columns=tuple(columns))


def _units_in(line: str, width: int) -> list[str]:
    """Units of a line of units, nothing if it is none."""
    parts = _parts(line)
    bare = [part.strip("()[]- \"'") for part in parts]
    return bare if len(parts) == width and all(map(is_unit, parts)) and any(bare) else []


def _parts(line: str) -> list[str]:
    text = line.strip().lstrip("".join(COMMENT)).strip(" ")
    between = next((separator for separator in SEPARATORS if separator in text), None)
    parts = (
        next(csv.reader([text], delimiter=between, skipinitialspace=True)) if between else _WORD.findall(text)
    )
    return parts[:-1] if between and len(parts) > 1 and not parts[-1].strip() else parts


def _columns(line: str, width: int) -> list[Column]:
    """Columns as a line names them; none if it is a comment or numbers, of another number of words, and no header."""
    found = [column_of(part) for part in _parts(line)]
    found = without_date(found) if len(found) == width + 1 else found
    numbers = all(_NUMBER.match(each.name) for each in found)
    return [] if len(found) != width and (numbers or line.lstrip().startswith(COMMENT)) else found


def _roles(layout: _Layout) -> Roles | None:
    """Roles of the columns by their names, or by their number where they have none that is understood."""
    columns = list(layout.columns)
    if len(columns) == layout.width and (roles := roles_of(columns)):
        return roles
    if layout.width <= 2:
        return Roles(None if layout.width == 1 else 0, {layout.width - 1: ""})
    return Roles(0, {1: "h1", 2: "h2", 3: "v"}) if layout.width == 4 and not columns else None


def read(file: RecordText) -> list[Component]:
    """Read the columns; the unit of their samples is that in their names, else the metadata table must name it."""
    lines = file.lines
    layout = _layout(lines[:_MOST_ABOVE])
    if layout is None:
        file.refuse("record.no_rows", 0, "no rows of numbers follow on each other", "columns of numbers")
    first, width = layout.first, layout.width
    end, warnings = _end(file, layout)
    remarks = [line.strip() for line in lines[first:end] if line.lstrip().startswith(_REMARK)]
    if remarks:
        remark = f"{file.path.name}: a remark among the samples is left out: {remarks[0][:_SHOWN]!r}"
        warnings = (*warnings, remark)
    rows = [
        "" if line.lstrip().startswith(_REMARK) else separated(plain_line(line), layout.decimal_comma)
        for line in lines[first:end]
    ]
    rows = [row if len(row.split()) == width else parted(row) for row in rows]
    wrapped = _is_wrapped(lines, layout)
    for offset, row in enumerate(() if wrapped else rows):
        if row.strip() and len(row.split()) != width:
            what = f"{len(row.split())} numbers where the lines before have {width}"
            remedy = "fill an empty cell, or fetch the file again if it is damaged or truncated here"
            file.refuse("record.row_wrong_length", first + offset, what, "the same columns on every line",
                remedy)  # fmt: skip
    _refuse_two_commas(file, layout, rows)
    values = RecordText(file.path, rows, first).numbers(0).reshape(-1, 1 if wrapped else width)
    roles = Roles(None, {0: ""}) if wrapped else _roles(layout)
    if roles is None:
        _refuse_columns(file, layout)
    if roles.components == {1: "h1", 2: "h2", 3: "v"}:
        _refuse_derived(file, first, values)
    step = _step(file, layout, roles, values, rows)
    if roles.left_out:
        warnings = (*warnings, f"{file.path.name}: columns left out: {', '.join(roles.left_out)}")
    named = layout.columns if len(layout.columns) == width and not wrapped else (Column("", ""),) * width
    names_at = layout.names_at if layout.columns and not wrapped else None
    told = [line for n, line in enumerate(lines[:first]) if n != names_at]
    check_stated(told, step, (len(values), len(roles.components)), file.path)
    above = stated_unit(told) or unit_of_peaks(told, float(np.abs(values[:, list(roles.components)]).max()))
    counted = {place: Counted(values[:, place], warnings=warnings) for place in roles.components}
    found = [
        replace(
            _component(file, first, counted[place], step, label, named[place], above),
            place=place_above(lines[:first]),
        )
        for place, label in roles.components.items()
    ]
    if list(roles.components.values()) == [""]:
        found = [replace(found[0], direction=stated_direction(told))]
    elif not named[-1].name and len(said := stated_orientations(told)) == len(found):
        found = [replace(each, direction=one) for each, one in zip(found, said, strict=True)]
    peak = stated_peak_m_s2(told)
    if peak:  # of whichever it is nearest to
        off = [abs(math.log(max(float(np.abs(each.acceleration_m_s2).max()), 1e-9) / peak)) for each in found]
        nearest = off.index(min(off))
        found[nearest] = replace(found[nearest], stated_peak_m_s2=peak)
    return found


def _end(file: RecordText, layout: _Layout) -> tuple[int, tuple[str, ...]]:
    """Place behind the last row, and what is told of text below it: sums, or that it is the end."""
    lines, end = file.lines, len(file.lines)
    while end > layout.first + _LEAST_ROWS and not lines[end - 1].strip():
        end -= 1
    last = end
    while last > layout.first + _LEAST_ROWS and _TEXT.match(lines[last - 1]):
        if all(map(_NUMBER.match, cells_of(lines[last - 1], layout.decimal_comma))):
            break
        last -= 1
    if not 0 < end - last <= _MOST_FOOTER:
        return end, ()
    told = f"{file.path.name}: text below the samples is left out: {lines[last].strip()[:_SHOWN]!r}"
    return last, (told,)


def _step(
    file: RecordText, layout: _Layout, roles: Roles, values: NDArray[np.float64], rows: Sequence[str]
) -> float:
    """Time step by the column of times, else by the text above; NaN where neither states it."""
    if roles.time is None:
        above = stated_step_s([line for line in file.lines[: layout.first] if line.strip()], len(values))
        return math.nan if above is None else above
    unit = (
        layout.columns[roles.time].unit.lower().replace("µ", "u").replace("μ", "u") if layout.columns else ""
    )
    clock = plain_line(file.lines[layout.first]) != unquoted(file.lines[layout.first])
    if not clock and unit not in UNITS_S:
        expected = f"one of {', '.join(filter(None, UNITS_S))}"
        remedy = "correct the unit, or give the time in seconds"
        file.refuse("record.time_unit_unknown", layout.names_at or 0, f"the time is in {unit!r}", expected,
            remedy)  # fmt: skip
    printed = [row.split()[roles.time] for row in rows if row.strip()]
    time = past_midnight(values[:, roles.time]) if clock else values[:, roles.time]
    return time_step(file, layout.first, time, printed) * (
        1.0 if clock else unit_of_times_s(unit, float(time[0]))
    )


def _refuse_columns(file: RecordText, layout: _Layout) -> NoReturn:
    if layout.columns:
        refuse_names(file, layout.names_at or 0, list(layout.columns), layout.width)
    remedy = "name them in a line above, such as 'Time (s),NS (cm/s2),EW (cm/s2)'"
    file.refuse("record.columns_unnamed", layout.first, f"{layout.width} columns without names", _USUAL,
        remedy)  # fmt: skip


def _refuse_derived(file: RecordText, first: int, values: NDArray[np.float64]) -> None:
    """Refuse a column that is the integral of the one before it, as velocity and displacement beside acceleration."""
    slopes = np.diff(values, axis=0)[:, 1:]
    means = 0.5 * (values[1:] + values[:-1])[:, 1:]
    for place in (1, 2):
        pair = np.stack([means[:, place - 1], slopes[:, place]])
        if pair.std(axis=1).min() == 0 or np.asarray(np.corrcoef(pair))[0, 1] < _DERIVED:
            return
    file.refuse("record.columns_are_integrals", first,
        "its last two columns are integrals of the second: velocity and displacement beside the acceleration",
        _USUAL,
        "leave the columns of velocity and displacement out, and give one file a component")  # fmt: skip


def _component(
    file: RecordText, first: int, found: Counted, step: float, label: str, column: Column, above: float | None
) -> Component:
    """One channel; its unit is its column's, else that of the text above."""
    unit, no_unit = counted_unit(column.unit), None
    if unit is not None and unit.quantity != "acceleration":
        what = f"the column {column.name!r} is in {column.unit!r}, a unit of {unit.quantity}"
        file.refuse("record.not_acceleration", first, what, "acceleration",
            "differentiate it to acceleration first")  # fmt: skip
    if unit is not None and above is not None and not math.isclose(unit.factor, above):
        what = f"the column {column.name!r} is in {column.unit!r}, and the text above names another unit"
        file.refuse("record.unit_contradicted", first, what, "one unit of acceleration",
            "correct the text, or the names of the columns")  # fmt: skip
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


def _refuse_two_commas(file: RecordText, layout: _Layout, rows: list[str]) -> None:
    """Refuse commas that part numbers and seem to be within them too: no time goes on, or there are twice as many."""
    example, width = file.lines[layout.first], layout.width
    firsts = [row.split()[0] for row in rows[:20] if row.strip()]
    if "," not in example or "." in example or not all(map(str.isdigit, firsts)):
        return
    if width in _WIDTHS and (width == 1 or all(int(b) > int(a) for a, b in pairwise(firsts))):
        return
    file.refuse("record.commas_ambiguous", layout.first,
        f"{example.strip()[:60]!r} has commas, which may stand between its numbers or within them",
        "a decimal point, or semicolons, tabs or blanks between numbers with decimal commas",
        "export the file with a decimal point")  # fmt: skip
