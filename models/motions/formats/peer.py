"""PEER NGA acceleration files (AT2): four header lines, then samples in g."""

import re
from pathlib import Path

from toppling.models.motions.formats.component import Component, bearing, code_direction, positive, refuse
from toppling.models.motions.formats.numbers import counted, numbers_in
from toppling.models.motions.formats.units import acceleration_m_s2

NAME = "PEER AT2"
_COUNT = re.compile(r"NPTS\s*=?\s*(\d+)", re.IGNORECASE)
_STEP = re.compile(r"DT\s*=?\s*([-+0-9.Ee]+)", re.IGNORECASE)
_UNIT = re.compile(r"\bUNITS?(?:\s+OF\b|\s*[:=])\s*(\S+)", re.IGNORECASE)
_SEED = re.compile(r"[A-Z][GHLN]([ENZ123])(?:[._ ]?(?:\d\w|--))?")
"""NGA-East's labels: a channel's code, and its location behind it."""
_DATE = re.compile(r"\d+[/.-]\d+[/.-]\d+")
_AGENCY = re.compile(r"\s*\([^()]*\)\s*$")
_OLD = re.compile(r"^\s*(\d+)\s+([0-9.Ee+-]+)\s+NPTS\s*,\s*DT", re.IGNORECASE)


def recognises(head: str) -> bool:
    """Whether this is how an AT2 file begins."""
    lines = head.splitlines()
    return len(lines) >= 4 and "PEER" in lines[0].upper() and "STRONG MOTION" in lines[0].upper()


def read(path: Path, text: str) -> list[Component]:
    """Read one component; both header styles (`NPTS= 5437, DT= .0050 SEC` and `5437 0.0050 NPTS, DT`)."""
    lines = text.splitlines()
    named = _UNIT.search(lines[2])
    unit = acceleration_m_s2(named[1]) if named else None
    if "ACCELERATION" not in lines[2].upper() or unit is None:
        refuse(
            f"the third line says {lines[2].strip()[:60]!r}",
            path,
            3,
            expected="'ACCELERATION TIME SERIES IN UNITS OF G'",
            remedy="give the acceleration file (.AT2), not velocity or displacement",
        )
    count, step = _count_and_step(lines[3], path)
    found = counted(numbers_in(lines[4:], path, 5), count, lines[4:], path, 4)
    event, station, label = _title(lines[1])
    return [
        Component(
            acceleration_m_s2=found.values * unit,
            time_step_s=step,
            direction=_direction(label),
            path=path,
            line=5,
            file_format=NAME,
            corrected=True,
            event=event,
            station=station,
            label=label,
            series=_series(path),
            warnings=found.warnings,
            missing=found.missing,
        )
    ]


def _count_and_step(line: str, path: Path) -> tuple[int, float]:
    old = _OLD.match(line)
    count, step = (old[1], old[2]) if old else (_COUNT.search(line), _STEP.search(line))
    if count is None or step is None:
        refuse(
            f"no NPTS and DT in {line.strip()[:60]!r}",
            path,
            4,
            expected="a line such as 'NPTS=  5437, DT= .0050 SEC'",
        )
    try:
        number = int(count if isinstance(count, str) else count[1])
        seconds = float(step if isinstance(step, str) else step[1])
    except ValueError:
        refuse(
            f"{line.strip()[:60]!r} has no readable time step",
            path,
            4,
            expected="a line such as 'NPTS=  5437, DT= .0050 SEC'",
        )
    return number, positive(seconds, "time step", path, 4)


def _title(line: str) -> tuple[str, str, str]:
    """Event, station and component of either style of title; the date tells where event and station part.

    'Kocaeli Turkey, 8/17/1999, Duzce, 180': event and station may have commas. Older: 'KOCAELI 08/17/99, DUZCE, 180
    (ERD STATION 12)', where the date stays with the event, which has no number to tell it from its aftershocks.
    """
    parts = [part.strip() for part in _AGENCY.sub("", line).split(",")]
    dates = [i for i, part in enumerate(parts) if _DATE.search(part)]
    at = next((i for i in dates if _DATE.fullmatch(parts[i])), dates[0] if dates else 0)
    event = parts[:at] if _DATE.fullmatch(parts[at]) else parts[: at + 1]
    behind = parts[at + 1 :]
    return ", ".join(event), ", ".join(behind[:-1]), behind[-1] if behind else ""


def _direction(label: str) -> float | str | None:
    """Direction of a component's label, which is a bearing, a word or a channel's code."""
    code = _SEED.fullmatch(label.upper())
    return code_direction(code[1]) if code else bearing(label)


def _series(path: Path) -> str:
    """Record sequence number in the file's name, which tells apart two records of one station."""
    match = re.match(r"(RSN\d+)_", path.name, re.IGNORECASE)
    return match[1].upper() if match else ""
