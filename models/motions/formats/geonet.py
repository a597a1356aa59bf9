"""GeoNet V1A and V2A (New Zealand): 16 lines of text, 10 of numbers, then samples in mm/s2, ten to a line."""

import re
from pathlib import Path

from toppling.models.motions.formats.component import Component, bearing, positive, refuse
from toppling.models.motions.formats.header_text import stated_peak_m_s2
from toppling.models.motions.formats.numbers import exactly, numbers_in

NAME = "GeoNet V1A/V2A"
_TEXT_LINES, _NUMBER_LINES = 16, 10
_ACROSS, _WIDTH = 10, 8
_COUNTS_AT = 33
"""Where, from 0, the integers count the samples of acceleration, velocity and displacement."""
_FIRST = re.compile(r"^\s*(Uncorrected|Corrected) accelerogram \d{8}_\d{6}", re.IGNORECASE)


def recognises(head: str) -> bool:
    """Whether the first line names an accelerogram by date and time."""
    return bool(_FIRST.match(head))


def read(path: Path, text: str) -> list[Component]:
    """Read the acceleration of every component."""
    lines = text.splitlines()
    channels = []
    start = 0
    while start < len(lines) and any(line.strip() for line in lines[start:]):
        component, start = _channel(lines, start, path)
        channels.append(component)
    return channels


def _channel(lines: list[str], start: int, path: Path) -> tuple[Component, int]:
    kind = _FIRST.match(lines[start])
    title = lines[start : start + _TEXT_LINES]
    if not kind or len(title) < _TEXT_LINES:
        refuse(
            f"{lines[start].strip()[:60]!r} where a component should begin",
            path,
            start + 1,
            expected="'Corrected accelerogram' or 'Uncorrected accelerogram' and its header",
            remedy="the file is damaged or truncated before: fetch it again",
        )
    at = start + _TEXT_LINES
    integers = exactly(numbers_in(lines[at : at + 4], path, at + 1, _WIDTH), 40, path, at + 1).astype(int)
    counts = [int(n) for n in integers[_COUNTS_AT : _COUNTS_AT + 3]]
    if min(counts) < 0:  # the next component would be looked for before this one
        refuse(
            f"the header counts {', '.join(map(str, counts))} samples",
            path,
            at + 1,
            expected="counts of acceleration, velocity and displacement",
        )
    at += _NUMBER_LINES
    rows = [-(-count // _ACROSS) for count in counts]
    values = exactly(numbers_in(lines[at : at + rows[0]], path, at + 1, _WIDTH), counts[0], path, start + 10)
    step = re.search(r"(?:at intervals of|data at)\s+([\d.]+)\s*s", "\n".join(title))
    unit = re.search(r"readings in units of\s+([\d.]+)\s+mm/s/s", "\n".join(title))
    component = next((text.split()[1] for text in title if text.startswith("Component ")), "")
    moment = re.search(r"\bMw?\s+(\d\.\d+)", title[8])
    distance = re.search(r"Dist\s+([\d.]+)\s*km", title[8])
    if not step or not component:
        refuse(
            "no time step or component in the header",
            path,
            start + 11,
            expected="'... at 0.020 sec intervals' and 'Component N28W'",
        )
    return Component(
        acceleration_m_s2=values * 0.001 * (float(unit[1]) if unit else 1.0),
        time_step_s=positive(float(step[1]), "time step", path, start + 11),
        direction=bearing(component),
        path=path,
        line=at + 1,
        file_format=f"GeoNet {'V2A' if kind[1].lower() == 'corrected' else 'V1A'}",
        corrected=kind[1].lower() == "corrected",
        event=title[7].strip(),
        station=title[1].split()[1] if len(title[1].split()) > 1 else "",
        label=component,
        magnitude=float(moment[1]) if moment else None,
        distance_km=float(distance[1]) if distance else None,
        stated_peak_m_s2=stated_peak_m_s2(title),
    ), at + sum(rows)
