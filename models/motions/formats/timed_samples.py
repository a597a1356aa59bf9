"""Samples that are given with their times, from hand or table digitisers: equally spaced, or made so."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from toppling.models.motions.formats.component import check_time_step, refuse

_PRINTED_TIME_S = 0.001
_GAP_STEPS, _GAP_S = 5.0, 0.02
"""A time so many mean steps, and so long, after the one before is a gap: curves are digitised where they bend."""


def evenly(
    pairs: NDArray[np.float64], path: Path, line: int, pairs_a_line: int, uneven_step_s: float
) -> tuple[NDArray[np.float64], float, tuple[str, ...]]:
    """Acceleration at equal steps: as it is where times are equal but for printing, else interpolated.

    pairs: (n, 2), time in seconds, and acceleration in any unit.
    line: line of the first pair.
    uneven_step_s: step to which uneven samples are interpolated.
    Raises InputError if a time does not follow the one before, or only after a gap: with its line.
    """
    time, values = pairs.T
    if len(time) < 2:
        refuse("fewer than two samples", path, line, expected="a record")
    steps = np.diff(time)
    step = (time[-1] - time[0]) / len(steps)
    wrong = np.flatnonzero((steps < 0) | (steps > max(_GAP_STEPS * step, _GAP_S) + _PRINTED_TIME_S))
    if not step > 0 or len(wrong):
        where = int(wrong[0]) if len(wrong) else 0
        refuse(
            f"the time goes from {time[where]:g} to {time[where + 1]:g} s: a gap or a damaged line",
            path,
            line + where // pairs_a_line,
            expected=f"times about {step:.4g} s apart",
            remedy="cut the record at the gap, or fetch the file again",
        )
    check_time_step(step, path, line)  # before the record is interpolated
    nice = round(step, 3)
    nice = nice if nice and abs(nice * len(steps) - (time[-1] - time[0])) <= 1.5 * _PRINTED_TIME_S else step
    if np.abs(time - time[0] - nice * np.arange(len(time))).max() <= 1.5 * _PRINTED_TIME_S:
        return values, float(round(nice, 9)), ()
    even = np.arange(time[0], time[-1] + 1e-9, uneven_step_s)
    note = f"uneven times, mean step {step:.4g} s, interpolated to {uneven_step_s:g} s"
    return np.interp(even, time, values), uneven_step_s, (note,)
