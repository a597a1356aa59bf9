"""Tables in text: one rule for separators, one for decimal commas, one for remarks; and cells as written."""

import csv
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from toppling.models.errors import refusals
from toppling.models.files.folder import new_file
from toppling.models.files.given import Refuse, TextFile, bytes_given, text_of

_FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""Characters with which a cell begins that a spreadsheet calculates, or that hides one that does."""


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


def write_csv(frame: Any, target: Path, *, digits: int | None = 6) -> Path:
    """Write a pandas frame with plain cells; the file appears complete or not at all."""
    with new_file(target) as hidden:
        plain_frame(frame).to_csv(hidden, index=False, float_format=digits and f"%.{digits}g")
    return target


no_table = refusals(
    expected="a CSV table with a header line",
    remedy="look for a quote that is not closed, or save the table as CSV again",
)
_SIGNS, _REMARKS = ";\t,", ("#", "%", "//")
_REMARK = re.compile(r'\s*"?(?:[#%]|//)(?!\s*[,;\t]\s*\w[^=]*$)|sep=.$')
"""How a line begins that is no row, but where a column is called #; and Excel's note on its separator."""
_MINUS = re.compile(r"[\u2212\u2013](?=[\d.,])")
_NUMBER = re.compile(
    r"([-+]?(?:\d{1,3}(?:([.,])\d{3})+(?:(?!\2)[.,]\d+)?|\d*[.,]\d+|\d+\.?)(?:[ed][-+]?\d+)?)(\s*[a-z%/^²]*)",
    re.IGNORECASE,
)
"""A number of any country, perhaps with its unit."""
_COMMA_AND_BLANK = re.compile(r",\s+")
_THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2}(?:,\d{3})+(?:\.\d*)?")
_DECIMAL = re.compile(r"[-+]?(?:\d*|[1-9]\d{0,2}(?:\.\d{3})+),\d+(?:[ed][-+]?\d+)?", re.IGNORECASE)
_DOTTED = re.compile(r"[-+]?[1-9]\d{0,2}(?:\.\d{3})+(?:,\d*)?")


_NOWHERE = Path()
_Place = tuple[int, list[str], list[float]]
"""Number of a line, its cells, and its numbers."""


@dataclass(frozen=True)
class Table(TextFile):
    """Cells of a table, stripped, their numbers with decimal points; the first row has the names of the columns."""

    rows: Sequence[tuple[int, list[str]]] = ()
    """With the place of its line each, from 0."""
    sign: str | None = None
    """Separator of the cells: semicolon, tab or comma, the first that a line has; None for blanks, or one column.

    A comma with a blank where other commas are decimal."""
    decimal: str = "."
    """Decimal sign of the numbers in the file."""
    thousands: str | None = None
    """Separator of thousands in the file."""

    @classmethod
    def read(cls, path: Path, refuse: Refuse = no_table, **how: bool) -> Self:
        """Table of a file, in any encoding that :func:`~toppling.models.files.given.text_of` knows.

        Raises InputError if there is none, it is too large, or holds a zero: with the line.
        """
        content = bytes_given(path, refuse)
        text = text_of(content)
        if text is None or "\0" in text:
            line = content.partition(b"\0")[0].count(b"\n") + 1
            raise refuse("file.holds_zeros", "holds a zero byte", f"{path}:{line}")
        return cls.of(text.splitlines(), path, **how)

    @classmethod
    def of(cls, lines: Sequence[str], path: Path = _NOWHERE, *, coordinates: bool = False) -> Self:
        """Table of lines; blank rows and remarks are left out.

        coordinates: whether its numbers are these, in which nobody parts thousands of whole ones.

        Raises InputError if a row is no CSV.
        """
        plain = [_MINUS.sub("-", line) for line in lines] if any(map(_MINUS.search, lines)) else lines
        first = next(
            (n for n, line in enumerate(plain) if line.strip(" ,;\t") and not _REMARK.match(line)), len(plain)
        )
        plain = plain[first:] if first else plain
        sign = _sign(plain)
        reader = _reader(plain, sign or ",")
        # Rows are made one by one: of a small file with many of them each copy would take a hundred times its size.
        found = ((first + reader.line_num - 1, [cell.strip() for cell in row]) for row in reader)
        if sign is None:
            single_column = len(plain) > 1 and all(len(line.split()) < 2 for line in plain[1:])
            words = ((n, line.split()) for n, line in enumerate(plain, first))
            found = ((n, [" ".join(row)] if single_column else row) for n, row in words)
        try:
            rows = [
                (n, row) for n, row in found if any(row) and (n == first or not row[0].startswith(_REMARKS))
            ]
        except csv.Error as error:
            what = f"is no CSV ({error})"
            raise no_table("table.unreadable", what, f"{path}:{first + reader.line_num}") from None
        decimal, thousands = _signs_in_numbers(rows, sign, coordinates)
        if (decimal, thousands) != (".", None):
            rows = [(n, [_plain(cell, decimal, thousands) for cell in row]) for n, row in rows]
        return cls(path, lines, rows=rows, sign=sign, decimal=decimal, thousands=thousands)

    def cells(self, line: str) -> list[str]:
        """Cells of another line of the table."""
        row = line.split(self.sign)
        if self.sign and ('"' in line or self.sign == ", "):
            row = next(_reader([line], self.sign), [])
        return [_plain(cell.strip(), self.decimal, self.thousands) for cell in row]

    @property
    def names(self) -> list[str]:
        """Names of the columns."""
        return self.rows[0][1] if self.rows else []

    def whole_rows(self, refuse: Refuse) -> Sequence[tuple[int, list[str]]]:
        """Rows below the names of the columns; InputError at the first with another number of cells."""
        count = len(self.names)
        for at, row in self.rows[1:]:
            if len(row) != count:
                what = f"has {len(row)} columns, the header {count}"
                raise refuse("table.row_wrong_length", what, self.where(at))
        return self.rows[1:]


def places_in(table: Table, part: slice, counts: Sequence[int], refuse: Refuse) -> tuple[str, list[_Place]]:
    """Places that a person lists: the line of names above them, empty if there is none, and each with its line from 1.

    part: cells of a row that are its numbers.
    counts: how many cells a row may have.
    Raises InputError: at the first row that is no place.
    """
    places: list[_Place] = []
    named_at = table.rows[0][0] - 1 if table.rows else -1
    for at, row in table.rows:
        cells = [cell for cell in row if cell]
        numbers = [float(cell) if is_numeral(cell) else math.nan for cell in cells[part]]
        if not places and not any(map(is_numeral, cells)):
            named_at = at
        elif len(cells) not in counts or not all(map(math.isfinite, numbers)):
            raise refuse("hint.place_unreadable", f"line {at + 1} is '{table.lines[at]}'", table.path)
        else:
            places.append((at + 1, cells, numbers))
    return table.lines[named_at] if named_at >= 0 else "", places


def _sign(lines: Sequence[str]) -> str | None:
    for line in lines:
        sign, words = next((sign for sign in _SIGNS if sign in line), None), line.split()
        if sign in (None, ",") and len(words) > 1 and all(map(is_number, words)):
            return None
        parts = _COMMA_AND_BLANK.split(line.strip())
        if sign == "," and len(parts) > 1 and "," in "".join(parts) and all(map(is_number, parts)):
            return ", "
        if sign:
            return sign
    return None


def _reader(lines: Sequence[str], sign: str) -> Any:
    """Reader of rows, which counts the lines."""
    if sign == ", ":
        lines, sign = [_COMMA_AND_BLANK.sub(";", line) for line in lines], ";"
    return csv.reader((f"{line}\n" for line in lines), delimiter=sign, skipinitialspace=True)


def is_number(cell: str) -> bool:
    """Whether a cell is a number of any country, perhaps with its unit."""
    return _NUMBER.fullmatch(cell) is not None


def _signs_in_numbers(
    rows: Sequence[tuple[int, list[str]]], sign: str | None, coordinates: bool
) -> tuple[str, str | None]:
    """Decimal sign, and what parts thousands; a point and nothing where the numbers do not decide it.

    Commas part thousands where each may, and numbers have decimal points or are parted by commas too; they are decimal
    where no number has a point, beside which dots may part thousands. Where all may be either nobody knows.
    """

    def numbers_with(of: str) -> list[str]:
        return [
            match[1] for _, row in rows for cell in row if of in cell and (match := _NUMBER.fullmatch(cell))
        ]

    if not (commas := numbers_with(",")):
        return ".", None
    points, thousands = numbers_with("."), all(map(_THOUSANDS.fullmatch, commas))
    whole = sign == "," and not coordinates
    if thousands and (points or whole or any(number.count(",") > 1 for number in commas)):
        return ".", ","
    decimal = all(map(_DECIMAL.fullmatch, commas)) and all(map(_DOTTED.fullmatch, points))
    return (",", ".") if decimal and (not thousands or coordinates) else (".", None)


def _plain(cell: str, decimal: str, thousands: str | None) -> str:
    if (decimal == "." and thousands is None) or not is_number(cell):
        return cell
    return cell.replace(thousands or "", "").replace(decimal, ".")


_PAIR = re.compile(r"\b(\w++)=('[^']*'|\"[^\"]*\"|\[[^\]]*\]|\([^)]*\)|[^,]*)")


def openquake_values(line: str) -> dict[str, str]:
    r"""Key-value pairs in the first line of OpenQuake's CSV files, since engine 3 in one quoted cell.

    Without quotes; lists keep their brackets.

    Examples
    --------
    >>> openquake_values('#,,"kind=\'mean\', investigation_time=50.0, weights=[0.4, 0.6]"')
    {'kind': 'mean', 'investigation_time': '50.0', 'weights': '[0.4, 0.6]'}
    """
    # Quotes inside a quoted CSV cell are doubled.
    text = line.lstrip("#,;\t ").strip()
    if text.startswith('"'):
        text = text[1:].removesuffix('"').replace('""', '"')
    return {key: value.strip().strip("'\"") for key, value in _PAIR.findall(text)}


def listed_numbers(text: str) -> list[float]:
    """Parse a list of numbers; empty if it is invalid.

    Examples
    --------
    >>> listed_numbers("[5.0, 6.0]")
    [5.0, 6.0]
    """
    try:
        return [float(word) for word in text.strip("[]() ").split(",") if word.strip()]
    except ValueError:
        return []
