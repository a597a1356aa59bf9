"""Text in tables: what is a number, what a spreadsheet would take for a formula, and how one saves a table again."""

import csv
import io
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from toppling.models.files.folder import new_file

_FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""With which a cell begins that a spreadsheet calculates, or that hides one that does."""


def separator_of(header: str) -> str:
    """What stands between the cells of a table: comma, semicolon or tab, whichever its header has most of."""
    return max(",;\t", key=header.count)


def is_numeral(text: str) -> bool:
    """Whether a text is a number as Python writes it.

    Examples
    --------
    >>> [is_numeral(text) for text in ("-1.5e3", "", "1.5 m")]
    [True, False, False]
    """
    try:
        float(text)
    except ValueError:
        return False
    return True


def plain(value: Any) -> Any:
    """A cell's value; text that a spreadsheet would calculate gets an apostrophe, numbers stay.

    Examples
    --------
    >>> [plain(cell) for cell in ("=HYPERLINK(A1)", "-1.5", "St. Gallen", -2)]
    ["'=HYPERLINK(A1)", '-1.5', 'St. Gallen', -2]
    """
    if not isinstance(value, str) or not value.startswith(_FORMULA) or is_numeral(value):
        return value
    return f"'{value}"


def plain_frame(frame: Any) -> Any:
    """A pandas frame with plain cells, names of its columns and of its rows included."""
    cells = frame.copy()
    for index, kind in enumerate(frame.dtypes):
        if kind.kind == "O":  # of texts and categories too; numbers, times and truths have kinds of their own
            column = frame.iloc[:, index]
            texts = [plain(value) for value in column]  # whole numbers stay
            cells.isetitem(index, type(column)(texts, column.index, dtype=object))
    return cells.rename(columns=plain, index=plain)


def write_csv(frame: Any, target: Path, *, digits: int | None = 6, index: bool = False) -> Path:
    """Write a pandas frame with plain cells; the file appears complete or not at all."""
    with new_file(target) as hidden:
        plain_frame(frame).to_csv(hidden, index=index, float_format=digits and f"%.{digits}g")
    return target


# What follows reads tables that a spreadsheet saved again.
_COMMA_NUMBER = re.compile(r"[-+]?\d+(,\d+)+(\.\d+)?(e[-+]?\d+)?", re.IGNORECASE)
_THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2}(,\d{3})+(\.\d*)?")
_DOTTED = re.compile(r"[-+]?(?!0)\d{1,3}(\.\d{3})+(,\d+)?")
_BETWEEN = re.compile(r"(?<=\d),(?=\d)")
_MINUS = re.compile(r"[\u2212\u2013](?=[\d.])")


def plain_table(lines: Sequence[str]) -> list[str]:
    """Lines of a table with commas between cells and decimal points, whatever program saved it; others as they are.

    Commas between digits are decimal, unless each of them may part thousands; beside decimal commas dots part
    thousands.

    Examples
    --------
    >>> plain_table(["PGA (g);annual_rate", "0,1;1,5E-03"])
    ['PGA (g),annual_rate', '0.1,1.5E-03']
    >>> plain_table(["PGA (g),return_period", '0.1,"2,475"'])
    ['PGA (g),return_period', '0.1,2475']
    """
    lines = [_MINUS.sub("-", line) for line in lines]
    sign = _sign(lines)
    if sign == "," and not any('"' in line for line in lines):
        return lines
    bare = [_unquoted(line, sign) for line in lines]
    table = [_cells(line, sign) for line in bare]
    commas = [cell.strip() for row in table for cell in row if _COMMA_NUMBER.fullmatch(cell.strip())]
    if sign == "," and not commas:
        return bare
    decimal = not all(map(_THOUSANDS.fullmatch, commas))
    dotted = [cell for row in table for cell in row if re.fullmatch(r"[-+]?\d+\.[\d.]+(,\d+)?", cell.strip())]
    parted = decimal and all(_DOTTED.fullmatch(cell.strip()) for cell in dotted)

    def cell_of(text: str) -> str:
        if parted and _DOTTED.fullmatch(text.strip()):
            return text.replace(".", "").replace(",", ".")
        return _BETWEEN.sub("." if decimal else "", text)

    return [_joined(row if row[:1] == ["#"] else [cell_of(cell) for cell in row]) for row in table]


def _sign(lines: Sequence[str]) -> str:
    """Sign that most lines have, comments left out; where decimal commas stand beside another sign, that one."""
    table = [line for line in lines if not line.lstrip('" ').startswith(("#", "%", "//"))]
    return max("\t;,", key=lambda sign: sum(sign in line for line in table))


def _cells(line: str, sign: str) -> list[str]:
    try:
        return next(csv.reader([line], delimiter=sign), [])
    except csv.Error:  # which the reader of the table tells of
        return [line]


def _unquoted(line: str, sign: str) -> str:
    """A comment without the quotes around all of it; another line as it is."""
    text = line.rstrip(sign + " ")
    return text[1:-1].replace('""', '"') if text.startswith('"#') and text.endswith('"') else line


def _joined(cells: Sequence[str]) -> str:
    out = io.StringIO()
    csv.writer(out, lineterminator="").writerow(cells)
    return out.getvalue()
