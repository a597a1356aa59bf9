"""Volumes 1 and 2 in the tradition of Caltech: CSMIP and CDMG, USC, RENADIC (Chile), BHRC (Iran).

A channel is a block of header lines, 100 integers, reals and samples; a line that begins with '/&' ends it.
Volume 1 has 13 lines of text and 14 of numbers before the samples, which are pairs of time and acceleration
or equally spaced.
"""

import re
from collections.abc import Sequence
from dataclasses import replace

from toppling.models.motions.formats.component import Component, bearing
from toppling.models.motions.formats.record_text import (
    Counted,
    RecordText,
    column_width,
    first_found,
    round_step,
    stated_peak_m_s2,
)
from toppling.models.motions.formats.units import acceleration_m_s2
from toppling.models.motions.measures import STANDARD_G_M_S2
from toppling.models.motions.place import FREE_FIELD, place_in_words

NAME = "CSMIP, USC, RENADIC or BHRC V1/V2"
_HEADER_LINES = 27
"""Number of lines of text and numbers before the samples of volume 1."""
_PAIRS_A_LINE = 5
_PAIR_WIDTH = 7
_BHRC_WIDTH = 13
"""Characters of a sample of BHRC."""
_UNEVEN_STEP_S = 0.005
"""Step to which unevenly digitised samples are interpolated."""
_EQUAL = re.compile(
    r"^\s*(\d+)\s+(?:points\s+of\s+accel\w*\s+data|accelerogram\s+points)\b(.*)$", re.IGNORECASE
)
_SPACED = re.compile(r"spaced\s+at\s*([\d.]+)\s*sec", re.IGNORECASE)
_RATE = re.compile(r"\bat\s+([\d.]+)\s*(?:pts|samples)/sec", re.IGNORECASE)
_UNIT = re.compile(r"\b(?:in units of|in|units\s*[:=])\s*([^\s.,()]+(?:\s?\*\*\s?2)?)", re.IGNORECASE)
_HEADING = re.compile(r"[A-Za-z]{4}|/&")
"""A word longer than NaN, which no line of numbers holds."""
_FORTRAN = re.compile(r"\((\d+)[fFeE](\d+)\.")
_COUNT = re.compile(r"NO\.?\s+OF\s+POINTS\s*=\s*(\d+)", re.IGNORECASE)
_LENGTH = re.compile(r"(?:DURATION|RECORD LENGTH)\s*=\s*([\d.]+)", re.IGNORECASE)
_CHANNEL = re.compile(r"^\s*(?:CHAN\s+\d+\s*:|COMP)\s*(.*)$", re.IGNORECASE)
_BEHIND_LABEL = re.compile(r"\(STA CHN.*|\bLOCATION\b.*|(?<!\s)\s{3,}\S.*$", re.IGNORECASE)
_FIRST = re.compile(
    r"^\s*(?:uncorrected accelerogram data|corrected accelerogram\b.*\bchan\b"
    r"|FILE\s+\d+\s+OF\s+UNCORRECTED ACCELEROGRAM|\* VOL1DS FILE)",
    re.IGNORECASE,
)
_TITLE_ADDITIONS = re.compile(r"\s{3,}.*$")
"""Additions of programs to the end of a title line: their version, the number of characters."""
_WHEN = re.compile(r"^(.*?)(?<!\s)\s*(?:\(ORIGIN(?:\([^)]*\))?\s*:\s*(.*?)\)?\s*)?$", re.IGNORECASE)
_DATED = re.compile(r"\b(?:19|20)\d\d\b|\d/\d+/\d")
_NO_DATE = re.compile(r"^0?1/0?1/1980\s+0?0:00")
"""Date in RENADIC's files that was not given to the program."""
_AZIMUTHS = re.compile(r"Azimuth\s+L\s*(\d+)\s+T\s*(\d+)")
_MAGNITUDE = re.compile(r"\bMW\s*=?\s*(\d\.\d+)", re.IGNORECASE)


def recognises(head: str) -> bool:
    """Whether the first line is that of a volume 1 or 2."""
    return bool(_FIRST.match(head.split("\n", 1)[0]))


def read(file: RecordText) -> list[Component]:
    """Read every channel of a volume."""
    lines = file.lines
    ends = [i for i, line in enumerate(lines) if line.startswith("/&")]
    starts = [0, *(end + 1 for end in ends)]
    stops = [*ends, len(lines)]
    blocks = [(a, b) for a, b in zip(starts, stops, strict=True) if any(line.strip() for line in lines[a:b])]
    for start, stop in blocks[1:]:
        if not any(map(_HEADING.search, lines[start:stop])):
            what = f"{stop - start} lines of numbers follow after the end of a channel"
            expected = "a channel that begins with its title, or the end of the file"
            file.refuse("record.numbers_after_end", start, what, expected,
                "fetch the file again, or cut them off")  # fmt: skip
    return [_channel(file.part(start, stop)) for start, stop in blocks]


def _channel(file: RecordText) -> Component:
    lines = file.lines
    heading = next((i for i, text in enumerate(lines[:60]) if _EQUAL.match(text)), None)
    corrected = lines[0].lstrip().lower().startswith("corrected")
    if heading is not None:
        found, unit_m_s2, step = _equally_spaced(file, heading)
        first = heading + 1
        notes: tuple[str, ...] = ()
    else:
        first, unit_m_s2 = _HEADER_LINES, 0.1 * STANDARD_G_M_S2
        found, step, notes = _headed_by_count(file)
    channel = first_found(_CHANNEL, lines[:12])
    if channel is None:
        what = "no line 'CHAN' or 'COMP' names the component"
        file.refuse("record.component_unnamed", 0, what, "a component such as 'CHAN 1: 90 DEG'")
    label = _BEHIND_LABEL.sub("", channel[1]).strip()
    location = _BEHIND_LABEL.search(channel[1])  # of the sensor, behind the component's direction
    dialect = _dialect(lines, corrected)
    event, series = _event(lines, dialect)
    magnitude = first_found(_MAGNITUDE, lines[:15])
    return file.channel(
        first,
        found,
        unit_m_s2,
        step,
        direction=_direction(label, lines),
        file_format=dialect,
        corrected=corrected,
        event=event,
        station=_station(lines),
        label=label,
        magnitude=float(magnitude[1]) if magnitude else None,
        stated_peak_m_s2=stated_peak_m_s2(lines[:first]),
        series=series,
        place=(location and place_in_words(location[0])) or FREE_FIELD,
        notes=notes,
    )


def _equally_spaced(file: RecordText, heading: int) -> tuple[Counted, float, float]:
    """Samples, unit and time step under a heading that says how many, how far apart, and in what columns."""
    text = file.lines[heading]
    match = _EQUAL.match(text)
    spaced, rate, unit = _SPACED.search(text), _RATE.search(text), _UNIT.search(text.replace("(", " "))
    factor = acceleration_m_s2(unit[1]) if unit else None
    if match is None or not (spaced or rate) or unit is None or factor is None:
        expected = "'10100 points of accel data equally spaced at 0.010 sec, in cm/sec2. (8f10.5)'"
        file.refuse("record.header_unreadable", heading, f"{text.strip()!r} does not say time step and unit",
            expected)  # fmt: skip
    step = float(spaced[1]) if spaced else 1 / file.positive(heading, float(rate[1] if rate else 0), "rate")
    first, end = heading + 1, len(file.lines)
    stop = next((i for i in range(first, end) if _HEADING.search(file.lines[i])), end)
    form = _FORTRAN.search(text)
    width = max(int(form[2]), 1) if form else (column_width(file.lines[first:stop]) or (8, 9))[1]
    found = file.counted(heading, int(match[1]), first, stop, width)
    stated = next((text for text in file.lines[:heading] if _COUNT.search(text)), "")
    if length := _LENGTH.search(stated):  # of as many points, which a corrected record's is not
        file.check_duration(heading, float(length[1]), int(match[1]), step)
    return found, factor, file.positive(heading, step, "time step")


def _headed_by_count(file: RecordText) -> tuple[Counted, float, tuple[str, ...]]:
    """Read samples after the 27 header lines, as pairs of time and acceleration or ten to a line (BHRC)."""
    lines = file.lines
    at = next((i for i, text in enumerate(lines[:_HEADER_LINES]) if _COUNT.search(text)), None)
    unit = next((text for text in lines[:_HEADER_LINES] if re.search(r"\bUNITS\b", text, re.IGNORECASE)), "")
    if at is None or "G/10" not in unit.upper().replace(" ", ""):
        what = "no 'NO. OF POINTS' and 'UNITS ARE SEC AND G/10' in the header"
        file.refuse("record.header_missing", 0, what, "the header of a volume 1 channel")
    count = int(_COUNT.search(lines[at])[1])  # type: ignore[index]
    if len(lines) <= _HEADER_LINES:
        file.refuse("record.no_samples", _HEADER_LINES, "no samples after the header", "samples")
    if re.search("[EeDd]", lines[_HEADER_LINES]):
        length = _LENGTH.search(lines[at])
        found = file.counted(at, count, _HEADER_LINES, None, _BHRC_WIDTH)
        step = file.positive(at, float(length[1]) / max(count, 1) if length else 0.0, "time step")
        return found, round_step(step, step / max(count - 1, 1)), ()  # some count the intervals
    file = replace(file, lines=[*lines[:_HEADER_LINES], *_uncontrolled(lines[_HEADER_LINES:])])
    if len(file.numbers(_HEADER_LINES, None, _PAIR_WIDTH)) % 2:
        what = "a time without an acceleration at the end: the file is truncated"
        file.refuse("record.truncated", len(file.lines) - 1, what, "pairs of time and acceleration")
    found = file.counted(at, 2 * count, _HEADER_LINES, None, _PAIR_WIDTH)
    pairs = found.values.reshape(-1, 2)
    values, step, notes = file.evenly(_HEADER_LINES, pairs, _PAIRS_A_LINE, _UNEVEN_STEP_S)
    return replace(found, values=values), step, notes


def _uncontrolled(body: Sequence[str]) -> list[str]:
    """Lines of pairs in columns of seven characters, without the carriage-control column if there is one."""
    filled = body[0].rstrip()
    offset = next(
        (o for o in (0, 1) if all(filled[k : k + 1] == "." for k in range(o + 3, len(filled), _PAIR_WIDTH))),
        0,
    )
    return [text[offset:] for text in body if text.strip()]


def _direction(label: str, lines: Sequence[str]) -> float | str | None:
    """Bearing by the label; BHRC's L and T by the azimuths in the station's line."""
    letter = re.fullmatch(r"([LTV])\d?", label.strip().upper())
    if letter:
        found = first_found(_AZIMUTHS, lines[:12])
        if found and letter[1] in "LT":
            return float(found[1] if letter[1] == "L" else found[2]) % 360
        return bearing(letter[1])
    return bearing(label)


def _dialect(lines: Sequence[str], corrected: bool) -> str:
    head = "\n".join(lines[:13]).upper()
    if "VOL1DS" in head or "BHRC" in head:
        return "BHRC V1"
    if "RENADIC" in head:
        return "RENADIC V1"
    if "USC#" in head:
        return "USC V1"
    return "CSMIP V2" if corrected else "CSMIP V1"


def _title_line(lines: Sequence[str]) -> int:
    """Line, from 0, that names the event: volume 2 begins with a line of its own."""
    return 2 if lines[0].lstrip().lower().startswith("corrected") else 1


def _event(lines: Sequence[str], dialect: str) -> tuple[str, str]:
    """Event, and another name that distinguishes two records of one station.

    A name alone is that of the aftershocks too: it is followed by date and time in the header's words. RENADIC's are
    typed station by station, and those of one event differ by seconds: there they are kept beside the name.
    """
    if dialect == "BHRC V1":
        origin = next((text.partition(":")[2] for text in lines[:12] if text.startswith("Origin Time")), "")
        return " ".join(origin.split()), ""
    at = _title_line(lines)
    name = re.sub(r"^Re?co?rd of\s*", "", _printed(lines[at])) if len(lines) > at else ""
    when = _when(lines[at + 1]) if len(lines) > at + 1 else ""
    return (name, when) if dialect == "RENADIC V1" else (", ".join(filter(None, (name, when))), "")


def _when(line: str) -> str:
    """Date and time of the line below the name, else the origin in its brackets; nothing if neither is a date."""
    match = _WHEN.match(line)
    texts = [_printed(text) for text in match.groups() if text] if match else []
    return next((text for text in texts if _DATED.search(text) and not _NO_DATE.match(text)), "")


def _printed(text: str) -> str:
    return " ".join(_TITLE_ADDITIONS.sub("", text.strip()).split())


def _station(lines: Sequence[str]) -> str:
    """Station by its own line: the sixth (V2: seventh), in BHRC what stands before the word 'Station'."""
    bhrc = next((text for text in lines[:12] if re.search(r"\sStation\s+[\d.]", text)), None)
    if bhrc:
        return bhrc.split("Station")[0].strip()
    at = _title_line(lines) + 4
    return re.split(r"\s{3,}|\sS/N\s", lines[at].strip())[0] if len(lines) > at else ""
