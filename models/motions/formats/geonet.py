"""GeoNet V1A and V2A (New Zealand): 16 lines of text, 10 of numbers, then samples in mm/s2, ten to a line."""

import re

from toppling.models.motions.formats.component import Component, bearing
from toppling.models.motions.formats.record_text import Counted, RecordText, first_found, stated_peak_m_s2
from toppling.models.motions.formats.units import counted_unit, known_names
from toppling.models.motions.place import place_in_name

NAME = "GeoNet V1A/V2A"
_TEXT_LINES = 16
_REAL_LINES = 6
"""Number of lines of reals between the integers and the samples."""
_ACROSS = 10
"""Number of samples in a line."""
_COUNTS_AT = 33
"""Positions, from 0, of the integers that count the samples of acceleration, velocity and displacement."""
_COMPONENT = re.compile(r"^\s*Component\s+([NS]\s*\d+\s*[EW]|\S+)", re.IGNORECASE)
_DURATION = re.compile(r"^Number of points\s+\d+\s+Duration\s+(\d+\.?\d*)\s*s", re.IGNORECASE)
_FIRST = re.compile(r"^\s*(Uncorrected|Corrected) accelerogram \d{8}_\d{6}", re.IGNORECASE)


def recognises(head: str) -> bool:
    """Whether the first line names an accelerogram by date and time."""
    return bool(_FIRST.match(head))


def read(file: RecordText) -> list[Component]:
    """Read the acceleration of every component."""
    channels = []
    start = 0
    while any(line.strip() for line in file.lines[start:]):
        component, start = _channel(file, start)
        channels.append(component)
    return channels


def _channel(file: RecordText, start: int) -> tuple[Component, int]:
    kind = _FIRST.match(file.lines[start])
    title = file.lines[start : start + _TEXT_LINES]
    if not kind or len(title) < _TEXT_LINES:
        file.refuse("record.header_missing", start,
            f"{file.lines[start].strip()[:60]!r} where a component should begin",
            "'Corrected accelerogram' or 'Uncorrected accelerogram' and its header",
            "the file is damaged or truncated before: fetch it again")  # fmt: skip
    at = start + _TEXT_LINES
    integers, reals_at = file.block(at, at, 40, "10I8")
    counts = [int(n) for n in integers[_COUNTS_AT : _COUNTS_AT + 3]]
    if min(counts) < 0:  # the next component would be looked for before this one
        what = f"the header counts {', '.join(map(str, counts))} samples"
        file.refuse("record.count_unusable", at, what, "counts of acceleration, velocity and displacement")
    at = reals_at + _REAL_LINES
    values, stop = file.block(start + 9, at, counts[0], f"{_ACROSS}F8.1")
    step = re.search(r"(?:at intervals of|data at)\s+([\d.]+)\s*s", "\n".join(title))
    stated = re.search(r"readings in units of\s+([\d.]+\s+\S+)", "\n".join(title))
    unit = counted_unit(stated[1] if stated else "mm/s/s")
    component = first_found(_COMPONENT, title)
    moment = re.search(r"\bMw?\s+(\d\.\d+)", title[8])
    distance = re.search(r"Dist\s+([\d.]+)\s*km", title[8])
    if not step or not component:
        what = "no time step or component in the header"
        expected = "'... at 0.020 sec intervals' and 'Component N28W'"
        file.refuse("record.header_missing", start + 10, what, expected)
    step_s = file.positive(start + 10, float(step[1]), "time step")
    lasts = first_found(_DURATION, title)
    file.check_duration(start + 9, float(lasts[1]) if lasts else None, counts[0], step_s)
    if unit is None or unit.quantity != "acceleration":
        file.refuse("record.unit_unknown", start + 10, f"readings in units of {stated and stated[1]!r}",
            f"one of {known_names()}")  # fmt: skip
    return file.channel(
        at,
        Counted(values),
        unit.factor,
        step_s,
        direction=bearing(component[1]),
        file_format=f"GeoNet {'V2A' if kind[1].lower() == 'corrected' else 'V1A'}",
        corrected=kind[1].lower() == "corrected",
        event=title[7].strip(),
        station=title[1].split()[1] if len(title[1].split()) > 1 else "",
        label=component[1],
        place=place_in_name(title[2].strip()),
        magnitude=float(moment[1]) if moment else None,
        distance_km=float(distance[1]) if distance else None,
        stated_peak_m_s2=stated_peak_m_s2(title),
    ), stop + sum(-(-count // _ACROSS) for count in counts[1:])
