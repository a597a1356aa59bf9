"""PTX: text of one scan after the other, each a grid of beams in its scanner's own frame below the pose of that."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

from toppling.models.errors import refusals
from toppling.models.scan.scans import NOWHERE, Pose, in_survey

_LEAST_BYTES = 7
"""Of a point's line: 0 0 0 0."""
_UNIT_ROTATION = 1e-3
"""How far from a rotation the part of a pose may be that turns: writers round."""

_damaged = refusals(
    expected="of each scan ten lines of header, columns, rows, position, axes and pose, and a line for each point",
    remedy="export the file again as PTX or E57",
)


def read_ptx(
    path: Path,
) -> tuple[NDArray[np.float64], NDArray[np.int32], NDArray[np.float64], dict[str, int]]:
    """Read every scan in the coordinates of the survey.

    Returns
    -------
    points (n, 3) in metres, station (n,), widest step (3,) of the coordinates, how many were left out by what they are

    Raises
    ------
    InputError
        If a header is none, a pose does not turn rigidly, or points are missing.
    """
    points, station, step, nowhere = in_survey(_scans(path))
    return points, station, step, {NOWHERE: nowhere}


def _scans(path: Path) -> Iterator[tuple[NDArray[np.float64], Pose]]:
    """Points (n, 3) of each scan in its own frame, and its pose."""
    with path.open(encoding="latin-1") as file:
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
            f"the header that begins with {first.strip()[:40]!r} is none of a scan", path
        ) from None
    count = columns * rows
    if columns < 0 or rows < 0 or count > path.stat().st_size // _LEAST_BYTES:
        raise _damaged(f"{columns} columns of {rows} points, more than the file can hold", path)
    turn = pose[:3, :3]
    rigid = np.abs(turn @ turn.T - np.eye(3)).max() < _UNIT_ROTATION and np.linalg.det(turn) > 0.0
    if not (rigid and np.allclose(pose[:, 3], (0.0, 0.0, 0.0, 1.0), atol=_UNIT_ROTATION)):
        raise _damaged("a scan's pose does not turn and shift alone, the shift in its fourth row", path)
    return count, (turn, pose[3, :3])


def _numbers(line: str, count: int) -> list[float]:
    numbers = [float(word) for word in line.split()]
    if len(numbers) != count or not np.isfinite(numbers).all():
        raise ValueError(line)
    return numbers


def _points(file: TextIO, count: int, path: Path) -> NDArray[np.float64]:
    """So many points (n, 3) in the scan's own frame."""
    if not count:
        return np.empty((0, 3))
    points = np.loadtxt(islice(file, count), usecols=(0, 1, 2), comments=None, ndmin=2)
    if len(points) != count:
        raise _damaged(f"a scan has {len(points)} of the {count} points that its header counts", path)
    return points
