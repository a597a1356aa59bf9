"""Numbers of a text format: blocks of lines, columns of a fixed width, and the count that a header gives of them."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from toppling.models.motions.formats.component import refuse

_SURPLUS_SHARE, _ROWS_OFF = 0.01, 2
"""Of its samples, and rows: so far is a count off by a program's mistake; beyond that something is missing."""
_JUMP_RATIO, _NEAR = 4.0, 200
"""A bend between two rows so many times as sharp as any within rows, of so many samples beside it, is a lost row."""
_FORTRAN = re.compile(r"(\d\.?)[dD]([-+]?\d)")
_GLUED = re.compile(r"(?<=\d)(?=[-+]\d*\.\d)")
"""Between two numbers of full Fortran columns: before a sign that is no exponent's, as that has no point behind it."""
_COMMA_NUMBER = re.compile(r"\s*[-+]?(?:\d+,\d*|,\d+|\d+)(?:[EeDd][-+]?\d+)?\s*$")


@dataclass(frozen=True, eq=False)
class Counted:
    """Samples, as many as counted or as there are; how many the header counts more; what is to be told of it."""

    values: NDArray[np.float64]
    missing: int = 0
    warnings: tuple[str, ...] = ()


def numbers_in(
    lines: list[str], path: Path, first_line: int, width: int | None = None
) -> NDArray[np.float64]:
    """Numbers of a block of lines, separated by blanks or in columns of a fixed width.

    first_line: number of the first of `lines` in the file, from 1.
    width: characters to a number; None for blanks.
    Raises InputError: at the first line with something that is not a finite number.

    Notes
    -----
    Decimal commas are read where no number has a point, and none a comma that could stand between two.
    """
    tokens = [token for line in lines for token in _tokens(line, width)]
    values = _floats(tokens)
    if values is None:
        values = _floats([_FORTRAN.sub(r"\1E\2", token) for token in tokens])
    if values is None and all(map(_COMMA_NUMBER.match, tokens)):
        values = _floats([_FORTRAN.sub(r"\1E\2", token.replace(",", ".")) for token in tokens])
    if values is None and width is None and any(map(_GLUED.search, tokens)):
        apart = [parted(line) for line in lines]
        return numbers_in(apart, path, first_line) if apart != lines else np.empty(0)
    if values is not None and np.isfinite(values).all():
        return values
    left = len(tokens)
    for offset, line in enumerate(lines):
        for token in _tokens(line, width):
            left -= 1
            if not _is_finite_number(token):
                broken_off = left == 0 and _floats([token]) is None
                refuse(
                    f"{token.strip()!r} is not a finite number{': the file is truncated' if broken_off else ''}",
                    path,
                    first_line + offset,
                    expected="one finite number after another",
                    remedy="fetch the file again, or cut the damaged part and correct its count",
                )
    return np.empty(0)


def parted(line: str) -> str:
    """Line with a blank between numbers that fill their columns."""
    return _GLUED.sub(" ", line)


def exactly(values: NDArray[np.float64], count: int, path: Path, line: int) -> NDArray[np.float64]:
    """Values, if they are as many as the header says.

    Raises InputError if there are fewer (a truncated file) or more.
    """
    if len(values) != count:
        _refuse_count(len(values), count, path, line)
    return values


def _refuse_count(found: float, count: int, path: Path, line: int) -> NoReturn:
    short = found < count
    refuse(
        f"{found:.10g} samples follow where the header counts {count}"
        + (": the file is truncated" if short else ""),
        path,
        line,
        expected=f"{count} samples",
        remedy="fetch the file again" if short else "correct the count in the header",
    )


def counted(
    values: NDArray[np.float64],
    count: int,
    body: Sequence[str],
    path: Path,
    line: int,
    width: int | None = None,
    channels: int = 1,
) -> Counted:
    """Values by the header's count, or by their rows where these are whole and the count is a little off.

    values: (n,), as `numbers_in` read them from `body`.
    count: as the header says.
    body: lines of the values.
    line: line of the count.
    width: characters to a number; None for blanks.
    channels: side by side in a row: the header counts rows.
    Raises InputError if more than two rows are missing, a row in the middle is not whole, or the values jump
    between two rows.
    """
    rows, count = count, count * channels
    surplus = len(values) - count
    if surplus == 0:
        return Counted(values)
    lengths = np.array([len(_tokens(text, width)) for text in body if text.strip()])
    ends = np.cumsum(lengths)
    few = _ROWS_OFF * int(lengths.max(initial=1))
    if surplus > 0:
        whole = surplus <= max(few, _SURPLUS_SHARE * count) and (count in ends or surplus < lengths[-1])
    else:
        whole = -surplus <= few and len(lengths) > 1 and bool((lengths[:-1] == lengths.max()).all())
    if count < 1 or not whole or _jumps(values[:count], ends):
        _refuse_count(len(values) / channels, rows, path, line)
    said = f"{path.name}: {len(values) / channels:.10g} samples where the header counts {rows}"
    if surplus > 0:
        return Counted(values[:count], 0, (f"{said}: the last {surplus / channels:g} left out",))
    return Counted(values, -surplus // channels, (f"{said}: read as they are, the rows are whole",))


def _jumps(values: NDArray[np.float64], ends: NDArray[np.int64]) -> bool:
    """Whether values bend far more sharply somewhere between two rows than near it within rows: a row is lost there."""
    if len(values) < 3:
        return False
    bend = np.abs(np.diff(values, 2))  # of the sample one further on
    between = np.zeros(len(values) + 1, bool)
    inner = ends[(ends > 0) & (ends < len(values))]
    if 5 * len(inner) > len(values):  # few numbers a row, or several channels: nothing lies within rows
        return False
    between[inner], between[inner - 1] = True, True
    between = between[1 : len(values) - 1]
    for place in np.argsort(np.where(between, bend, 0.0))[-20:]:
        beside = slice(max(place - _NEAR, 0), place + _NEAR)
        within = bend[beside][~between[beside]]
        if len(within) and bend[place] > _JUMP_RATIO * within.max():
            return True
    return False


def column_width(body: Sequence[str]) -> tuple[int, int] | None:
    """How many numbers a full line has, and in how many characters each, by where decimal points stand.

    None where they do not stand at equal distances.
    """
    longest = max((text.rstrip() for text in body[:5]), key=len, default="")
    points = [place for place, letter in enumerate(longest) if letter == "."]
    distances = {b - a for a, b in pairwise(points)}
    return (len(points), distances.pop()) if len(distances) == 1 else None


def _floats(tokens: list[str]) -> NDArray[np.float64] | None:
    try:
        return np.array(list(map(float, tokens)))
    except ValueError:
        return None


def _tokens(line: str, width: int | None) -> list[str]:
    if width is None:
        return line.split()
    body = line.rstrip()
    return [body[i : i + width] for i in range(0, len(body), width)]


def _is_finite_number(token: str) -> bool:
    try:
        return bool(np.isfinite(float(token)))
    except ValueError:
        return False
