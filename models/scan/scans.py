"""Scans of one file, each in its scanner's own frame, together in the survey's."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from toppling.models.scan.steps import coordinate_steps

NOWHERE = "lie at 0, 0, 0 of their scanner, where no beam came back,"
"""What points that are left out are."""

Pose = tuple[NDArray[np.float64] | None, NDArray[np.float64] | None]
"""What turns (3, 3) and shifts (3,) points, as rows, from the scanner's frame; None where nothing does."""


def in_survey(
    scans: Iterable[tuple[NDArray[np.float64], Pose]],
) -> tuple[NDArray[np.float64], NDArray[np.int32], NDArray[np.float64], int]:
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
