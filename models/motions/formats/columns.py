"""Plain columns: acceleration alone, time and acceleration, or time and three components.

Units, and the time step of a single column, come from the metadata table.
"""

import math
import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from models.motions.formats.component import UP, Component, code_direction, numbers_in, positive, refuse

NAME = "plain columns"
COMMENT = ("#", "%", "!", "//", ";")
_NUMBER = re.compile(r"^[-+]?((\d+\.?\d*|\.\d+)([EeDd][-+]?\d+)?|nan|inf)$", re.IGNORECASE)
"""NaN too: a file that begins with one is of this format, and damaged at that line."""
STEP_TOLERANCE = 0.01
"""Largest departure of one time difference from their median, as a share of it."""
WIDTHS = (1, 2, 4)


def recognises(head: str) -> bool:
    """Whether the first lines that are no comments hold one, two or four numbers each, below their names."""
    body = [line for line in head.splitlines()[:-1] if line.strip() and not line.lstrip().startswith(COMMENT)]
    rows = [_split(line) for line in body[:20]]
    if len(rows) < 3 or len(rows[1]) not in WIDTHS:
        return False
    return all(len(row) == len(rows[1]) and all(map(_NUMBER.match, row)) for row in rows[1:])


def read(path: Path, text: str) -> list[Component]:
    """Read the columns; their samples are in a unit that the metadata table must name."""
    lines = text.splitlines()
    first = next(i for i, line in enumerate(lines) if line.strip() and not line.lstrip().startswith(COMMENT))
    names: list[str] = []
    if not all(map(_NUMBER.match, _split(lines[first]))):
        names = _split(lines[first])
        first += 1
    rows = [line.replace(",", " ") for line in lines[first:]]
    width = len(rows[0].split()) if rows else 0
    for offset, row in enumerate(rows):
        if row.strip() and len(row.split()) != width:
            refuse(
                f"{len(row.split())} numbers where the lines before have {width}",
                path,
                first + 1 + offset,
                expected="the same columns on every line",
                remedy="the file is damaged or truncated here: fetch it again",
            )
    values = numbers_in(rows, path, first + 1).reshape(-1, max(width, 1))
    if len(values) < 2 or width not in WIDTHS:
        refuse("fewer than two samples", path, first + 1, expected="a record", remedy="fetch the file again")
    step = math.nan if width == 1 else _time_step(values[:, 0], rows[0], path, first + 1)
    labels = _labels(names, width)
    return [
        Component(
            acceleration_m_s2=values[:, max(width - len(labels), 0) + column],
            time_step_s=step,
            direction=UP if label == "v" else code_direction(label),
            path=path,
            line=first + 1,
            file_format=NAME,
            unit_known=False,
            label=label,
        )
        for column, label in enumerate(labels)
    ]


def _labels(names: list[str], width: int) -> list[str]:
    """Names of the components: by the line of names where it has three, else first, second and vertical."""
    if width < 4:
        return [""]
    return names[1:] if len(names) == width else ["h1", "h2", "v"]


def _time_step(time: NDArray[np.float64], first_row: str, path: Path, line: int) -> float:
    steps = np.diff(time)
    step = positive(float(np.median(steps)), "time step", path, line)
    wrong = np.flatnonzero(np.abs(steps - step) > max(STEP_TOLERANCE * step, _print_error(first_row)))
    if len(wrong):
        refuse(
            f"the time goes on by {steps[wrong[0]]:g} s where the step is {step:g} s: a gap or two steps",
            path,
            line + 1 + int(wrong[0]),
            expected="equal time steps",
            remedy="fill or cut the gap, or resample the record to one step first",
        )
    return round(float((time[-1] - time[0]) / len(steps)), 9)


def _print_error(row: str) -> float:
    """Twice the half of the last printed digit of a time: what rounding alone makes of a difference."""
    digits = len(row.split()[0].partition(".")[2]) if row.split() else 0
    return 1.01 * 10.0**-digits if digits else 0.0


def _split(line: str) -> list[str]:
    return line.replace(",", " ").split()
