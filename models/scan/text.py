"""Clouds as text: which sign parts the numbers, which one is decimal, in which encoding, and how the lines end."""

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from toppling.models.arrays import Array
from toppling.models.errors import InputError, refusals
from toppling.models.files.given import check_lines, open_given
from toppling.models.files.table import Table, is_number
from toppling.models.scan.header import named_columns
from toppling.models.scan.plausible import is_geocentric

_EASTINGS_M = (1e5, 1e6)
"""Within these lie all eastings of UTM; northings lie beyond nearly everywhere."""
_NORTHINGS_BELOW_M = 1e7
_HEAD_LINES, _LOOKED_AT, _MOST_COLUMNS = 20, 2000, 24
_NUMBERED = 100
"""So many whole numbers that rise from point to point, or others by even steps, are no coordinates."""
_EVEN = 1e-3
_ENDS = "\x1a\0"
"""DOS' end-of-file character, and what a program leaves of a block that it did not fill."""
_BETWEEN_CELLS = ",;\t\r\n "
_WHOLE = re.compile(r"[+-]?\d+")


_FORTRAN = re.compile(r"(\d\.?)[dD]([+-]?\d)")
_not_whole = refusals(
    expected="the same columns of numbers in every line of points",
    remedy="export the cloud again, or cut the damaged lines",
)
_out_of_order = refusals(
    expected="x (east), y (north), z in this order, or a header line that names them",
    remedy="put a line with the columns' names before the first point: id,x,y,z or id,y,x,z where points are "
    "numbered, else y,x,z, or x,y,z if they are in order",
)
_ambiguous = refusals(
    expected="numbers with decimal points, or with decimal commas and parted by semicolons, tabs or blanks",
    remedy="export again with decimal points, or with semicolons between the columns",
)


@dataclass(frozen=True)
class _Layout:
    """How numbers stand in a text, as a table has them."""

    table: Table
    quoted: bool

    def fields(self, line: str) -> list[str]:
        """Numbers of a line, with decimal points."""
        return self.table.cells(line.strip().strip(_ENDS))

    @property
    def is_plain(self) -> bool:
        """Whether NumPy reads such lines as they are."""
        return not self.quoted and (self.table.decimal, self.table.thousands) == (".", None)


def read_text(path: Path, unit_given: bool = False) -> tuple[Array, tuple[str, ...], str]:
    """Read x, y, z of a text file: the columns that a header names, else the first three.

    unit_given: the user says which unit the numbers are in, so that a header may name another than metres.
    Returns points (n, 3) in the file's unit, the remarks before the first of them, and what is to be told.
    Raises InputError if it cannot be told where the numbers part, or which columns are meant.
    """
    encoding = _encoding_of(path)
    with path.open(encoding=encoding, errors="replace") as lines:
        head = [line for _, line in zip(range(_HEAD_LINES), lines, strict=False)]
    skip = next((i for i, line in enumerate(head) if _begins_with_numbers(line)), None)
    if skip is None:
        return np.empty((0, 3)), (), ""
    with path.open(encoding=encoding, errors="replace") as lines:
        layout = _settled([*islice(lines, skip, skip + _LOOKED_AT)], path)
    titles = list(filter(_no_count, head[:skip]))
    width = len(layout.fields(head[skip]))
    named = named_columns(titles, width, str(path), unit_given)
    if named is None and width > _MOST_COLUMNS:
        raise InputError(
            "cloud.grid_of_heights",
            f"rows of {width} numbers without names, as of a grid of heights",
            where=str(path),
            expected="a point in each line: x (east), y (north), z",
            remedy="export the nodes of the grid as points",
        )
    lines_from = partial(_rows, path, encoding, skip, layout)
    load = partial(
        np.loadtxt,
        delimiter=layout.table.sign if layout.is_plain else ";",
        usecols=named or (0, 1, 2),
        ndmin=2,
        comments=("#", "//"),
    )
    counts: list[int] = []
    try:
        points = load(lines_from(counts))
    except ValueError:
        counts.clear()
        points = _loaded_again(load, lines_from(counts), path)
    if named is None:
        _check_not_numbered(points, path)
        _check_easting_first(points, path, unit_given)
    note = (
        "" if sum(counts) in (0, len(points)) else f"{len(points)} points where the file counts {sum(counts)}"
    )
    return points, tuple(line.strip().lstrip("#/ ") for line in titles), note


def _rows(path: Path, encoding: str, skip: int, layout: _Layout, counts: list[int]) -> Iterator[str]:
    """Lines of points as NumPy reads them; the counts that stand before each scan of a PTS file go into `counts`."""
    with path.open(encoding=encoding, errors="replace") as lines:
        counted = path.suffix.lower() == ".pts"  # filtering costs time, so for these files alone
        rows: Iterator[str] = (
            _points_alone(lines, skip, counts) if counted else islice(iter(lines), skip, None)
        )
        if _ends_oddly(path):
            rows = _without_ends(rows, path)
        if not layout.is_plain:
            rows = (";".join(layout.fields(line)) for line in rows)
        yield from rows


def _points_alone(lines: Iterable[str], skip: int, counts: list[int]) -> Iterator[str]:
    for number, line in enumerate(lines):
        if not _no_count(line):
            counts.append(int(line.strip()[:18]))
        elif number >= skip:
            yield line


def _loaded_again(load: Callable[[Iterable[str]], NDArray], rows: Iterator[str], path: Path) -> Array:
    """Points of a text with numbers of Fortran, or with lines of empty cells.

    Raises InputError: at the first line that cannot be read.
    """
    kept = [_FORTRAN.sub(r"\1E\2", line) for line in rows if line.strip(_BETWEEN_CELLS)]
    try:
        return load(kept)
    except ValueError as error:
        width = max(len(re.split(r"[\s;,]+", line.strip())) for line in kept[:_HEAD_LINES])
        for number, line in enumerate(kept, 1):
            words = re.split(r"[\s;,]+", line.split("#")[0].split("//")[0].strip())
            if words != [""] and (len(words) < min(width, 3) or not all(map(_is_number, words[:3]))):
                what = f"its {number}th line of points is {line.strip()[:60]!r}"
                raise _not_whole(
                    "cloud.row_unreadable", what + (": truncated" if number == len(kept) else ""), path
                ) from None
        raise _not_whole("cloud.row_unreadable", str(error)[:200], path) from None


def _encoding_of(path: Path) -> str:
    """Encoding of a text file by its first bytes: UTF-8 where it is, else that of western Windows."""
    with open_given(path, _not_whole) as file:
        check_lines(file, path, _not_whole)
        head = file.read(65_536)
    try:
        head[:-4].decode("utf-8")
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8-sig"


def _begins_with_numbers(line: str) -> bool:
    """Whether a line begins with three numbers, whatever parts them and their decimals."""
    cells = Table.of([line.strip(_ENDS)], Path()).names[:3]
    return len(cells) == 3 and all(is_number(cell) or _is_number(cell) for cell in cells)


def _settled(lines: list[str], path: Path) -> _Layout:
    """The layout that the first lines show.

    Raises InputError if commas part the numbers and are decimal too, or may be either.
    """
    points = [line.strip(_ENDS) for line in lines if _no_count(line)]
    table = Table.of(points, path, coordinates=True)
    rows = [row for _, row in table.rows]
    if unclear := [cell for row in rows for cell in row[:3] if "," in cell and is_number(cell)]:
        raise _ambiguous("cloud.numbers_ambiguous", f"numbers such as {unclear[0]}", str(path))
    quoted = any('"' in line for line in lines)
    even = [row for row in rows if len(row) >= 6 and len(row) % 2 == 0]
    whole = table.sign == "," and not quoted and all(all(map(_WHOLE.fullmatch, row)) for row in even)
    if whole and any(len(word) > 1 and word.startswith("0") for row in even for word in row[1::2]):
        what = "commas part the numbers and stand before decimals, too"
        raise _ambiguous("cloud.numbers_ambiguous", what, str(path))
    return _Layout(table, quoted)


def _ends_oddly(path: Path) -> bool:
    """Whether signs that are no text stand anywhere in a file."""
    with open_given(path, _not_whole) as file:
        return any(
            sign.encode() in chunk for chunk in iter(partial(file.read, 1 << 20), b"") for sign in _ENDS
        )


def _without_ends(lines: Iterator[str], path: Path) -> Iterator[str]:
    """Lines without end-of-file characters and zeros at the end.

    Raises InputError if they stand amidst the points.
    """
    ended = 0
    for number, line in enumerate(lines, 1):
        kept = line.rstrip().rstrip(_ENDS + "\r\n ")
        if kept and (ended or any(sign in kept for sign in _ENDS)):
            raise InputError(
                "file.holds_zeros",
                f"zeros or an end-of-file character stand before line {number} of the points",
                where=str(path),
                expected="text to the end",
                remedy="copy or export the file again: a part of it was not written",
            )
        ended = ended or (number if len(kept) < len(line.rstrip()) else 0)
        yield kept


def _no_count(line: str) -> bool:
    """Whether a line is none of the counts of points that stand before each scan in a PTS file."""
    return not line.strip().isdigit()


def _is_number(word: str) -> bool:
    try:
        float(_FORTRAN.sub(r"\1E\2", word))
    except ValueError:
        return False
    return "_" not in word


def _check_not_numbered(points: Array, path: Path) -> None:
    """Refuse points that are numbered or timed in front: number, x, y would be taken for x, y, z."""
    number = points[:, 0]
    rise = np.diff(number)
    if len(points) < _NUMBERED or not (rise > 0.0).all():
        return
    if (number % 1.0).any() and np.ptp(rise) > _EVEN * rise.min():
        return
    raise _out_of_order(
        "cloud.points_numbered",
        f"the first column, {', '.join(f'{each:g}' for each in number[:3])} ..., numbers or times the points",
        path,
    )


def _check_easting_first(points: Array, path: Path, unit_given: bool) -> None:
    """Refuse what looks like northing before easting, or, in metres, like an easting where the height should be."""
    if not np.isfinite(points).any(axis=0).all() or is_geocentric(points):
        return
    x, y, z = np.abs(np.nanmedian(points, axis=0))
    if _EASTINGS_M[0] < z < _NORTHINGS_BELOW_M and not unit_given:
        raise _out_of_order(
            "cloud.columns_out_of_order", f"the third column, about {z:.0f}, is no height", path
        )
    if _EASTINGS_M[1] < x < _NORTHINGS_BELOW_M and _EASTINGS_M[0] < y < _EASTINGS_M[1]:
        raise _out_of_order(
            "cloud.columns_out_of_order",
            f"the first column, about {x:.0f}, looks like a northing and the second, about {y:.0f}, like an easting",
            path,
        )
