"""Plain columns of time and acceleration: what they are comes from the metadata table."""

import re
from pathlib import Path

import numpy as np

from models.motions.formats.component import Component, numbers_in, positive, refuse

NAME = "plain columns"
COMMENT = ("#", "%", "!", "//", ";")
_NUMBER = re.compile(r"^[-+]?(\d+\.?\d*|\.\d+)([EeDd][-+]?\d+)?$")
STEP_TOLERANCE = 0.01
"""Largest departure of one time difference from their median, as a share of it."""


def recognises(head: str) -> bool:
    """Whether the first lines that are no comments hold two numbers each."""
    body = [line for line in head.splitlines()[:-1] if line.strip() and not line.lstrip().startswith(COMMENT)]
    rows = [_split(line) for line in body[:20]]
    return len(rows) >= 3 and all(len(row) == 2 and all(map(_NUMBER.match, row)) for row in rows[1:])


def read(path: Path, text: str) -> list[Component]:
    """Read seconds and acceleration in a unit that the metadata table must name."""
    lines = text.splitlines()
    first = next(i for i, line in enumerate(lines) if line.strip() and not line.lstrip().startswith(COMMENT))
    if not all(map(_NUMBER.match, _split(lines[first]))):
        first += 1  # names of the columns
    rows = [line.replace(",", " ") for line in lines[first:]]
    for offset, row in enumerate(rows):
        if row.strip() and len(row.split()) != 2:
            refuse(
                f"{len(row.split())} numbers where the lines before have 2",
                path,
                first + 1 + offset,
                expected="seconds and acceleration on every line",
                remedy="the file is damaged or truncated here: fetch it again",
            )
    values = numbers_in(rows, path, first + 1).reshape(-1, 2)
    if len(values) < 2:
        refuse("fewer than two samples", path, first + 1, expected="a record", remedy="fetch the file again")
    steps = np.diff(values[:, 0])
    step = positive(float(np.median(steps)), "time step", path, first + 1)
    wrong = np.flatnonzero(np.abs(steps - step) > max(STEP_TOLERANCE * step, _print_error(rows[0])))
    if len(wrong):
        refuse(
            f"the time goes on by {steps[wrong[0]]:g} s where the step is {step:g} s: a gap or two steps",
            path,
            first + 2 + int(wrong[0]),
            expected="equal time steps",
            remedy="fill or cut the gap, or resample the record to one step first",
        )
    mean_step = float((values[-1, 0] - values[0, 0]) / (len(values) - 1))
    return [
        Component(
            acceleration_m_s2=values[:, 1],
            time_step_s=round(mean_step, 9),
            direction=None,
            path=path,
            line=first + 1,
            file_format=NAME,
            unit_known=False,
        )
    ]


def _print_error(row: str) -> float:
    """Twice the half of the last printed digit of a time: what rounding alone makes of a difference."""
    time = row.split()[0] if row.split() else ""
    digits = len(time.partition(".")[2])
    return 1.01 * 10.0**-digits if digits else 0.0


def _split(line: str) -> list[str]:
    return line.replace(",", " ").split()
