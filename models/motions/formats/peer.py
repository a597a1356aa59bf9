"""PEER NGA acceleration files (AT2): four header lines, then samples in g."""

import re
from collections.abc import Sequence
from pathlib import Path

from toppling.models.files.table import is_numeral
from toppling.models.motions.formats.component import Component, bearing
from toppling.models.motions.formats.record_text import RecordText
from toppling.models.motions.formats.units import UNITS_S, acceleration_m_s2

NAME = "PEER AT2"
_COUNT = re.compile(r"NPTS\s*+(?:[=:]\s*+)?(\d+)", re.IGNORECASE)
_STEP = re.compile(
    r"DT\s*+(?:[=:]\s*+)?([-+]?(?:[0-9]++(?:[.,][0-9]+)?|[.,][0-9]+)(?:[EeDd][-+]?[0-9]+)?)\s*([a-z]*)",
    re.IGNORECASE,
)
_BARE = re.compile(r"^\s*(\d+)(?:\s*,\s*|\s+)(\d*\.\d+(?:[EeDd][-+]?\d+)?)\s*$")
_SERIES = re.compile(r"\b(?:ACCELERATION|VELOCITY|DISPLACEMENT)\b.*\bUNITS?\b", re.IGNORECASE)
_HEADER_LINES = 8
"""Number of lines that are searched for the title of the series; four are usual."""
_UNIT = re.compile(r"\bUNITS?(?:\s+OF\b|\s*[:=])\s*(\S+)", re.IGNORECASE)
_DATE = re.compile(r"(?<!\d)\d+[/.-]\d+[/.-]\d+")
_AGENCY = re.compile(r"(?<!\s)\s*\([^()]*\)\s*$")
_OLD = re.compile(r"^\s*(\d+)\s+([0-9.EeDd+-]+)\s+NPTS\s*,\s*DT", re.IGNORECASE)


def recognises(head: str) -> bool:
    """Whether this is how an AT2 file begins: PEER in the first line, or its series' title above NPTS and DT."""
    lines = head.strip("\n").splitlines()
    if len(lines) >= 4 and "PEER" in lines[0].upper() and "STRONG MOTION" in lines[0].upper():
        return True
    at = _series_line(lines)
    return at is not None and any(map(_numbers_of, lines[at + 1 : at + 3]))


def read(file: RecordText) -> list[Component]:
    """Read one component; both header styles (`NPTS= 5437, DT= .0050 SEC` and `5437 0.0050 NPTS, DT`)."""
    lines = file.lines
    top = next(place for place, line in enumerate(lines) if line.strip())
    at = _series_line(lines)
    at = top + 2 if at is None else at
    named = _UNIT.search(lines[at])
    unit = acceleration_m_s2(named[1]) if named else None
    if "ACCELERATION" not in lines[at].upper() or unit is None:
        what = f"the title of the series is {lines[at].strip()[:60]!r}"
        expected = "'ACCELERATION TIME SERIES IN UNITS OF G'"
        file.refuse("record.not_acceleration", at, what, expected,
            "give the acceleration file (.AT2), not velocity or displacement")  # fmt: skip
    numbers = next((n for n in range(at + 1, min(at + 3, len(lines))) if _numbers_of(lines[n])), at + 1)
    count, step = _count_and_step(file, numbers)
    first = numbers + 1
    found = file.counted(numbers, count, first)
    event, station, label = _title(lines[top + 1] if at > top + 1 else lines[top])
    return [
        file.channel(
            first,
            found,
            unit,
            step,
            direction=bearing(label),
            file_format=NAME,
            corrected=True,
            stated_unit_m_s2=unit,
            event=event,
            station=station,
            label=label,
            series=_series(file.path),
        )
    ]


def _series_line(lines: Sequence[str]) -> int | None:
    """Place of the line that names quantity and unit, which filters or blank lines may have moved."""
    return next((n for n, line in enumerate(lines[:_HEADER_LINES]) if _SERIES.search(line)), None)


def _numbers_of(line: str) -> tuple[str, str, str] | None:
    """Number of samples, time step and its unit as a line has them, empty where missing; None if it has neither."""
    if both := _OLD.match(line) or _BARE.match(line):
        return both[1], both[2], ""
    count, step = _COUNT.search(line), _STEP.search(line)
    if not (count or step):
        return None
    return count[1] if count else "", step[1] if step else "", step[2] if step else ""


def _count_and_step(file: RecordText, at: int) -> tuple[int, float]:
    count, step, unit = _numbers_of(file.lines[at]) or ("", "", "")
    number = step.upper().replace("D", "E").replace(",", ".")
    if not count or not is_numeral(number):
        what = f"{file.lines[at].strip()[:60]!r} has no readable count and time step"
        remedy = "write NPTS and DT into this line, or fetch the file again"
        file.refuse("record.header_unreadable", at, what, "a line such as 'NPTS=  5437, DT= .0050 SEC'",
            remedy)  # fmt: skip
    return int(count), file.positive(at, float(number) * UNITS_S.get(unit.lower(), 1.0), "time step")


def _title(line: str) -> tuple[str, str, str]:
    """Event, station and component of either style of title; the date separates event and station.

    'Kocaeli Turkey, 8/17/1999, Duzce, 180': event and station may have commas. Older: 'KOCAELI 08/17/99, DUZCE, 180
    (ERD STATION 12)', where the date stays with the event, which has no number to tell it from its aftershocks.
    """
    parts = [part.strip() for part in _AGENCY.sub("", line).split(",")]
    dates = [i for i, part in enumerate(parts) if _DATE.search(part)]
    at = next((i for i in dates if _DATE.fullmatch(parts[i])), dates[0] if dates else 0)
    event = parts[:at] if _DATE.fullmatch(parts[at]) else parts[: at + 1]
    behind = parts[at + 1 :]
    return ", ".join(event), ", ".join(behind[:-1]), behind[-1] if behind else ""


def _series(path: Path) -> str:
    """Record sequence number in the file's name, which distinguishes two records of one station."""
    match = re.match(r"(RSN\d+)_", path.name, re.IGNORECASE)
    return match[1].upper() if match else ""
