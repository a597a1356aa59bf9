"""PTX: text of one scan after the other, each a grid of beams in its scanner's own frame below the pose of that."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from io import TextIOWrapper
from itertools import islice
from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

from toppling.models.arrays import Array
from toppling.models.errors import refusals
from toppling.models.files.given import check_lines, open_given
from toppling.models.scan.plausible import coordinate_steps

NOWHERE = "lie at 0, 0, 0 of their scanner, where no beam came back,"
"""What points that are left out are."""

Pose = tuple[Array | None, Array | None]
"""What turns (3, 3) and shifts (3,) points, as rows, from the scanner's frame; None where nothing does."""


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
    number = np.repeat(np.arange(len(steps) - 1, dtype=np.int32), [len(each) for each in placed[1:]])
    return np.concatenate(placed), number, np.max(steps, axis=0), nowhere


_LEAST_BYTES = 7
"""Line of a beam without a return."""
_UNIT_ROTATION = 1e-3
"""How far from a rotation the part of a pose may be that turns: writers round."""

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
    rigid = np.abs(turn @ turn.T - np.eye(3)).max() < _UNIT_ROTATION and np.linalg.det(turn) > 0.0
    if not (rigid and np.allclose(pose[:, 3], (0.0, 0.0, 0.0, 1.0), atol=_UNIT_ROTATION)):
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
