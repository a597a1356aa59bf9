"""Clouds as text: separators, decimal signs, encodings, headers that name the columns, and PTX."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from io import TextIOWrapper
from itertools import islice
from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

from toppling.models.arrays import Array
from toppling.models.errors import InputError, refusals
from toppling.models.files.given import check_lines, open_given
from toppling.models.files.table import Table, is_number
from toppling.models.lengths import in_degrees
from toppling.models.scan.plausible import coordinate_steps, is_geocentric

_AXES = {
    "x": ("x", "easting", "east", "e"),
    "y": ("y", "northing", "north", "n"),
    "z": ("z", "elevation", "elev", "height", "up", "altitude", "alt", "h"),
}
"""Names in headers for east, north and up, in lower case."""
_AXIS_OF = {word: axis for axis, words in _AXES.items() for word in words}
_KINDS = frozenset({"point", "coord", "coordinate", "local", "utm"})
"""Words beside an axis that tell one set of coordinates from another: POINT_X, X_local."""
_METRES = frozenset({"m", "metre", "metres", "meter", "meters"})
_OTHER_LENGTH = re.compile(
    r"(us|i)?s?(ft|foot|feet)(us)?|in|inch(es)?|yd|yards?|[mcdk]m|(milli|centi|deci|kilo)met(er|re)s?"
)
"""Words for units of length that are not metres."""
_OTHER_COLUMNS = frozenset(
    {"id", "point", "station", "time", "intensity", "reflectance", "red", "green", "blue", "r", "g", "b"}
    | {"nx", "ny", "nz", "latitude", "longitude", "lat", "lon", "range", "azimuth", "zenith", "theta", "phi"}
)
"""Names in headers of columns that are no coordinates of a survey."""

Columns = tuple[int, int, int]
"""Numbers of the columns of x, y and z."""


def named_columns(lines: Sequence[str], columns: int, where: str, unit_given: bool = False) -> Columns | None:
    """Columns of x, y, z by the lines before the first point, None if these are remarks or there are none.

    columns: how many numbers the first point's line has.
    where: the file, for errors.
    unit_given: the user says which unit the numbers are in, so that the header may state another than metres.
    Raises InputError if a header does not tell which columns are x, y and z, or says that they are not in metres.
    """
    titles = []
    for line in filter(str.strip, lines):
        units = [name.strip("()") for name in _names(line, columns)]
        lengths = [unit for unit in units if _is_length(unit)]
        if len(units) != columns or len(lengths) < 3 or not all(map(_is_length_or_none, units)):
            titles.append(line)
        elif not (unit_given or _METRES.issuperset(lengths)):
            raise _other_unit(lengths, where)
    for line in reversed(titles):
        names = _names(line, columns)
        found = _axes(names)
        if found is not None and (len(names) == columns or found == (0, 1, 2)):
            if not unit_given:
                _check_metres([names[column] for column in found], where)
            return found
        # Remarks may stand between a header and the points, so of such lines only the last must be understood.
        is_remark = line.lstrip().startswith(("#", "//"))
        if (line is titles[-1] or not is_remark) and _names_columns(names, columns):
            raise _not_understood(names, columns, where)
    return None


def _coordinate(name: str) -> tuple[str, tuple[bool, int, int]] | None:
    """Axis by a column's name such as x, POINT_X, x_ft or X [m]; None if it is no coordinate's.

    And its rank among others of the axis: whether it is in another unit than metres, how many words tell it from
    others, as POINT does, and how usual the axis' own word is.
    """
    bare, _, bracket = name.partition("(")
    words, inside = set(re.findall(r"[^\s_-]+", bare)), set(re.findall(r"\w+", bracket))
    axes = words & _AXIS_OF.keys()
    if not axes or len({_AXIS_OF[word] for word in axes | (inside & _AXIS_OF.keys())}) > 1:
        return None  # X (northing) contradicts itself
    units = words - axes - _KINDS - _METRES - ({"in"} if words & _METRES else set())  # x in m
    if not all(map(_OTHER_LENGTH.fullmatch, units)):
        return None
    powers = not inside.isdisjoint({"10", "100", "1000"})  # 10^-3 m
    other = bool(units) or powers or (not inside & _METRES and any(map(_OTHER_LENGTH.fullmatch, inside)))
    word = min(axes)
    return _AXIS_OF[word], (other, len(words & _KINDS), _AXES[_AXIS_OF[word]].index(word))


def _axes(names: Sequence[str]) -> Columns | None:
    """Columns of x, y, z by their names, of each axis the first by rank; None where nobody can tell."""
    found = []
    for axis in _AXES:
        every = [(read, column) for column, name in enumerate(names) if (read := _coordinate(name))]
        ranked = sorted((read[1], column) for read, column in every if read[0] == axis)
        if not ranked or (len(ranked) > 1 and ranked[0][0] == ranked[1][0]):
            return None
        found.append(ranked[0][1])
    return found[0], found[1], found[2]


def _names(line: str, columns: int) -> list[str]:
    """Names in a header, parted in the way that gives as many as there are columns, if there is one."""
    title = re.sub(r"[\"']", "", line).strip().lstrip("#/ ").lower()
    # Neither blanks nor open brackets are looked through twice: a line may be long.
    # What stands in a bracket becomes one word, so that it stays with its name: x (us ft) is x(us-ft).
    title = re.sub(
        r"(?<!\s)\s*[(\[]([^()\[\]]*)[)\]]",
        lambda bracket: "(" + "-".join(re.findall(r"\w+", bracket[1])) + ")",
        title,
    )
    for separator in (",", ";", "\t", None):
        names = [name.strip() for name in title.split(separator)]
        if len(names) == columns:
            return names
    return [name for name in re.split(r"[,;\s]+", title) if name]


def _names_columns(names: Sequence[str], columns: int) -> bool:
    """Whether a line is a header, though one that names no place, and no remark."""
    known = {name for name in names if name.partition("(")[0] in _OTHER_COLUMNS or _coordinate(name)}
    return len(names) == columns or len(known) >= 2


def _check_metres(names: Sequence[str], where: str) -> None:
    stated = [name for name in names if (read := _coordinate(name)) and read[1][0]]
    if stated:
        raise _other_unit(stated, where)


def _is_length_or_none(word: str) -> bool:
    """Whether a cell of a line of units is one of length, or says that a column has none."""
    return _is_length(word) or not re.search("[a-z]", word)


def _is_length(word: str) -> bool:
    return word in _METRES or _OTHER_LENGTH.fullmatch(word) is not None


def _other_unit(stated: Sequence[str], where: str) -> InputError:
    return InputError(
        "coordinates.unit_not_metres",
        f"the header states another unit than metres: {', '.join(stated)}",
        where=where,
        expected="coordinates in metres",
        remedy="say which unit all three are in by --units, or convert the coordinates to metres, and name their "
        "columns x, y and z",
    )


def _not_understood(names: Sequence[str], columns: int, where: str) -> InputError:
    note = f"the header names its columns {', '.join(names)}"
    if {"lat", "lon"} <= {name[:3] for name in names}:
        return in_degrees(note, where)
    return InputError(
        "cloud.columns_unknown",
        note,
        where=where,
        expected="; ".join(f"{axis}: {' or '.join(words)}" for axis, words in _AXES.items())
        + f"; and as many names as columns ({columns})",
        remedy="name the columns of easting, northing and height x, y and z, in metres; if the line is a remark, "
        "delete it",
    )


_EASTINGS_M = (1e5, 1e6)
"""Range of all eastings of UTM; northings lie beyond it nearly everywhere."""
_NORTHINGS_BELOW_M = 1e7
_HEAD_LINES, _LOOKED_AT, _MOST_COLUMNS = 20, 2000, 24
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
    numeric = [_FORTRAN.sub(r"\1E\2", line) for line in rows if line.strip(_BETWEEN_CELLS)]
    try:
        return load(numeric)
    except ValueError as error:
        width = max(len(re.split(r"[\s;,]+", line.strip())) for line in numeric[:_HEAD_LINES])
        for number, line in enumerate(numeric, 1):
            words = re.split(r"[\s;,]+", line.split("#")[0].split("//")[0].strip())
            if words != [""] and (len(words) < min(width, 3) or not all(map(_is_number, words[:3]))):
                what = f"its {number}th line of points is {line.strip()[:60]!r}"
                raise _not_whole(
                    "cloud.row_unreadable", what + (": truncated" if number == len(numeric) else ""), path
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
        stripped = line.rstrip().rstrip(_ENDS + "\r\n ")
        if stripped and (ended or any(sign in stripped for sign in _ENDS)):
            raise InputError(
                "file.holds_zeros",
                f"zeros or an end-of-file character stand before line {number} of the points",
                where=str(path),
                expected="text to the end",
                remedy="copy or export the file again: a part of it was not written",
            )
        ended = ended or (number if len(stripped) < len(line.rstrip()) else 0)
        yield stripped


def _no_count(line: str) -> bool:
    """Whether a line is none of the counts of points that stand before each scan in a PTS file."""
    return not line.strip().isdigit()


def _is_number(word: str) -> bool:
    try:
        float(_FORTRAN.sub(r"\1E\2", word))
    except ValueError:
        return False
    return "_" not in word


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


NOWHERE = "lie at 0, 0, 0 of their scanner, where no beam came back,"
"""Reason for which points are left out, as notes state it."""

Pose = tuple[Array | None, Array | None]
"""Rotation (3, 3) and shift (3,) of points, as rows, from the scanner's frame; None where there is none."""


def in_survey(scans: Iterable[tuple[Array, Pose]]) -> tuple[Array, NDArray[np.int32], Array, int]:
    """Points of scans in the survey's frame.

    scans: points (n, 3) of each in its own frame, 0, 0, 0 where no beam came back, and its pose.
    Returns points (n, 3), the scan (n,) of each, the widest step (3,) in which they come in their own frames, and how
    many were left out as no beam came back.
    """
    placed, steps, nowhere = [np.empty((0, 3))], [np.zeros(3)], 0
    for points, (turn, shift) in scans:
        returned = points.any(axis=1)
        nowhere += int((~returned).sum())
        points = points if returned.all() else points[returned]
        steps.append(coordinate_steps(points))
        # Points that are not finite are left out later.
        with np.errstate(invalid="ignore", over="ignore"):
            points = points if turn is None else points @ turn
            placed.append(points if shift is None else points + shift)
    number = np.repeat(np.arange(len(steps) - 1, dtype=np.int32), [len(points) for points in placed[1:]])
    return np.concatenate(placed), number, np.max(steps, axis=0), nowhere


_LEAST_BYTES = 7
"""Line of a beam without a return."""
UNIT_ROTATION = 1e-3
"""Deviation of a pose's quaternion or matrix from that of a rotation: writers round to four digits."""

_damaged = refusals(
    expected="of each scan ten lines of header, columns, rows, position, axes and pose, and a line for each point",
    remedy="export the file again as PTX or E57",
)


def read_ptx(path: Path) -> tuple[Array, NDArray[np.int32], Array, dict[str, int]]:
    """Read every scan in the coordinates of the survey.

    Returns points (n, 3) in metres, station (n,), widest step (3,) of the coordinates, how many were left out by what
    they are. Raises InputError if a header is none, a pose does not turn rigidly, or points are missing.
    """
    points, station, step, nowhere = in_survey(_scans(path))
    return points, station, step, {NOWHERE: nowhere}


def _scans(path: Path) -> Iterator[tuple[Array, Pose]]:
    """Points (n, 3) of each scan in its own frame, and its pose."""
    with open_given(path, _damaged) as binary:
        check_lines(binary, path, _damaged)
        file = TextIOWrapper(binary, "latin-1")
        while first := next((line for line in file if line.strip()), ""):
            count, pose = _header(first, file, path)
            yield _points(file, count, path), pose


def _header(first: str, file: TextIO, path: Path) -> tuple[int, Pose]:
    """Number of points of a scan, and its pose."""
    try:
        columns, rows = int(first), int(next(file))
        for _ in range(4):  # position and axes, which the pose has too
            _numbers(next(file), 3)
        pose = np.array([_numbers(next(file), 4) for _ in range(4)])
    except (ValueError, StopIteration):
        raise _damaged(
            "cloud.header_unreadable",
            f"the header that begins with {first.strip()[:40]!r} is none of a scan",
            path,
        ) from None
    count = columns * rows
    if columns < 0 or rows < 0 or count > path.stat().st_size // _LEAST_BYTES:
        raise _damaged(
            "file.truncated", f"{columns} columns of {rows} points, more than the file can hold", path
        )
    turn = pose[:3, :3]
    rigid = np.abs(turn @ turn.T - np.eye(3)).max() < UNIT_ROTATION and np.linalg.det(turn) > 0.0
    if not (rigid and np.allclose(pose[:, 3], (0.0, 0.0, 0.0, 1.0), atol=UNIT_ROTATION)):
        raise _damaged(
            "cloud.pose_unusable",
            "a scan's pose does not turn and shift alone, the shift in its fourth row",
            path,
        )
    return count, (turn, pose[3, :3])


def _numbers(line: str, count: int) -> list[float]:
    numbers = [float(word) for word in line.split()]
    if len(numbers) != count or not np.isfinite(numbers).all():
        raise ValueError(line)
    return numbers


def _points(file: TextIO, count: int, path: Path) -> Array:
    """So many points (n, 3) in the scan's own frame."""
    if not count:
        return np.empty((0, 3))
    points = np.loadtxt(islice(file, count), usecols=(0, 1, 2), comments=None, ndmin=2)
    if len(points) != count:
        raise _damaged(
            "file.truncated", f"a scan has {len(points)} of the {count} points that its header counts", path
        )
    return points
