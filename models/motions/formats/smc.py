"""USGS SMC: 11 lines of text, 48 integers, 50 reals, comments, samples in cm/s2, ten characters each."""

import re

import numpy as np
from numpy.typing import NDArray

from toppling.models.motions.formats.component import DOWN, UP, Component, bearing
from toppling.models.motions.formats.record_text import RecordText
from toppling.models.motions.place import FREE_FIELD, Place

NAME = "USGS SMC"
_TEXT_LINES = 11
_SAMPLE_WIDTH = 10
_NO_INTEGER = -32768
"""Integer that is not known."""
_NO_REAL = 1.6e38
"""Real that is not known: 1.7e38, as printed."""
_EXTREMES = (29, 31)
"""Positions, from 0, of the reals that state the largest and the least sample."""
_BUILDING = 1
_OTHER_STRUCTURES = {2: ("bridge", 26), 3: ("dam", 27)}
"""Types of structures, and where, from 0, the integers state the sensor's location, 0 in the free field."""
_KIND = re.compile(r"^\s*([12346])\s+(UNCORRECTED|CORRECTED|VELOCITY|DISPLACEMENT|RESPONSE)", re.IGNORECASE)
_EVENT = re.compile(r"^\s*(\d+)\s+(\d+)\s+(\d+)\s+(\d+)\s*(.*)$")


def recognises(head: str) -> bool:
    """Whether the first line numbers and names the kind of record."""
    return bool(_KIND.match(head)) and "\n*" in head[:200]


def read(file: RecordText) -> list[Component]:
    """Read one component."""
    lines = file.lines
    kind = _KIND.match(lines[0])
    if kind is None or "CORRECTED" not in kind[2].upper():
        what = f"the first line says {lines[0].strip()!r}"
        expected = "an uncorrected (1) or corrected (2) accelerogram"
        file.refuse("record.not_acceleration", 0, what, expected, "give the file of acceleration")
    numbers, reals_at = file.block(_TEXT_LINES, _TEXT_LINES, 48, "8I10")
    reals, comments_at = file.block(reals_at, reals_at, 50, "5E15.7")
    integers = numbers.astype(int)
    first = comments_at + max(int(integers[15]), 0)
    found = file.counted(_TEXT_LINES + 2, int(integers[16]), first, None, _SAMPLE_WIDTH)
    if not reals[1] < _NO_REAL:
        what = "no sampling rate in the header: its samples are pairs of time and acceleration"
        remedy = "give the corrected record, or columns of time and acceleration at equal steps"
        file.refuse("record.step_missing", reals_at, what, "samples at one rate", remedy)
    station = next((text for text in lines[:_TEXT_LINES] if text.lower().startswith("station")), "")
    match = re.match(r"station\s*=\s*(.*?)(?<!\s)\s*component=\s*(.*)$", station, re.IGNORECASE)
    label = match[2].strip() if match else ""
    return [
        file.channel(
            first,
            found,
            0.01,
            1 / file.positive(reals_at, float(reals[1]), "sampling rate"),
            direction=_direction(label, int(integers[12]), int(integers[13])),
            file_format=NAME,
            corrected=kind[1] == "2",
            event=_event(lines[3]),
            station=match[1] if match else "",
            label=label,
            magnitude=float(reals[5]) if 0 < reals[5] < 10 else None,
            place=_place(integers),
            distance_km=float(reals[16]) if 0 <= reals[16] < _NO_REAL else None,
            stated_peak_m_s2=0.01
            * max((abs(reals[n]) for n in _EXTREMES if abs(reals[n]) < _NO_REAL), default=0.0),
        )
    ]


def _place(integers: NDArray[np.int_]) -> Place:
    """Place by integer 19, the type of structure, and the sensor's location in it: 25, 27 or 28.

    The agency distinguishes structures from the free field only: a building's ground floor is in a building too.
    """
    kind = int(integers[18])
    if kind == _BUILDING:
        floor = int(integers[24])
        if floor <= 0:
            return Place(0.0, "in a building" if floor == _NO_INTEGER else "in the basement of a building")
        return Place(0.0, f"on floor {floor} of a building")
    name, at = _OTHER_STRUCTURES.get(kind, ("structure", None))
    free = kind in (0, _NO_INTEGER) or (at is not None and integers[at] == 0)
    return FREE_FIELD if free else Place(0.0, f"on a {name}")


def _event(line: str) -> str:
    """Name, and the origin's date and time: a name alone is that of the aftershocks too."""
    match = _EVENT.match(line)
    if match is None:
        return line.strip()
    year, month, day, clock, name = match.groups()
    return ", ".join(filter(None, (name.strip(), f"{year}-{month}-{day} {clock}")))


def _direction(label: str, from_vertical_deg: int, bearing_deg: int) -> float | str | None:
    """Bearing by the text, else by integers 13 (angle from the vertical) and 14 (clockwise from north)."""
    found = bearing(label)
    if found is not None:
        return found
    if from_vertical_deg in (0, 180):
        return UP if from_vertical_deg == 0 else DOWN
    return float(bearing_deg % 360) if bearing_deg != _NO_INTEGER else None
