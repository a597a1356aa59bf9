"""COSMOS volumes 0, 1 and 2 (format 1.20): text, integers, reals, comments, each announced, then samples."""

import math
import re
from collections.abc import Sequence
from contextlib import suppress
from datetime import UTC, datetime
from itertools import takewhile

import numpy as np
from numpy.typing import NDArray

from toppling.models.motions.formats.component import DOWN, UP, Component, bearing
from toppling.models.motions.formats.record_text import RecordText, first_found, stated_peak_m_s2
from toppling.models.motions.formats.units import unit_of
from toppling.models.motions.place import BOREHOLE, Place, place_in_words

NAME = "COSMOS V0/V1/V2"
_UNIT_CODES_M_S2 = {2: 9.80665, 4: 0.01, 7: 0.0254, 10: 0.01, 11: 0.980665}
_COUNTS = 50
_REALS = {"least bit": 22, "start": 30, "sensitivity": 42, "sensor gain": 47, "time step": 62}
"""Numbers of the real header values that are read; the first three make acceleration of counts."""
_UNKNOWN = -999
_STRUCTURES = {
    10: "in a building", 11: "on a bridge", 12: "on a dam", 13: "on a wharf", 14: "in a tunnel",
    15: "on a lifeline structure", 20: "on a structure", 50: BOREHOLE.structure, 51: "in an array of unknown depths",
}  # fmt: skip
"""Types of stations (table 6) that are not of the free field; 1 to 9 are shelters, vaults and bases of buildings."""
_VERSION = re.compile(r"\(Format\s+v\s*([\d.]+)\s+with\s+(\d+)\s+text lines\)", re.IGNORECASE)
_BLOCK = re.compile(
    r"^\s*(\d+)\s+(?:Integer|Real)-header values follow on\s+(\d+)\s+lines?,\s*"
    r"Format\s*=\s*\(?\s*(\d+)[IFE](\d+)",
    re.IGNORECASE,
)
_COMMENTS = re.compile(r"^\s*(\d+)\s+Comment line", re.IGNORECASE)
_COMMENT = re.compile(r"\s*\|")
_DATA = re.compile(
    r"^\s*(\d+)\s++(.*?)\bpts\b\D*(\d*).*?units\s*=\s*(\S*?)\s*\(\s*(\d+)\s*\)\s*,?\s*"
    r"Format\s*=?\s*\(\s*(?:\d+P\s*,?\s*)?(\d+)[FEIGD](\d+)",
    re.IGNORECASE,
)
_CHANNEL = re.compile(r"^\s*Sta Chan?\s*:?\s*\S*?\s*:\s*(.*?)\s*(?:\(Rcrdr|Location|$)", re.IGNORECASE)
_SCNL = re.compile(r"<SCNL>(\S+)")
_MAGNITUDE = re.compile(r"Mw\s*=\s*(\d\.\d+)")
_LAST = re.compile(r"^\s*(?:End[- ]of[- ]data|/&)", re.IGNORECASE)


def recognises(head: str) -> bool:
    """Whether the first line announces the format's version and text lines."""
    return bool(_VERSION.search(head.split("\n", 1)[0]))


def read(file: RecordText) -> list[Component]:
    """Read every channel of acceleration; channels of velocity and displacement are passed over."""
    channels: list[Component] = []
    start = 0
    while start < len(file.lines):
        if not file.lines[start].strip():
            start += 1
            continue
        component, start = _channel(file, start)
        if component is not None:
            channels.append(component)
    return channels


def _channel(file: RecordText, start: int) -> tuple[Component | None, int]:
    lines = file.lines
    version = _VERSION.search(lines[start])
    if not version:
        what = f"{lines[start].strip()[:60]!r} where a channel should begin"
        file.refuse("record.header_missing", start, what, "a line with '(Format v01.20 with 13 text lines)'")
    title = lines[start : start + int(version[2])]
    integers, at = _header(file, start + int(version[2]), "integer")
    reals, at = _header(file, at, "real")
    comments = _COMMENTS.match(lines[at]) if at < len(lines) else None
    notes = list(takewhile(_COMMENT.match, lines[at + 1 :])) if comments else []
    at += 1 + len(notes)
    data = _DATA.match(lines[at]) if at < len(lines) else None
    if not data:
        file.refuse(
            "record.header_missing",
            at,
            "no line with the number, the unit and the format of the samples",
            "a line such as '13400 acceleration pts, approx 67 secs, units=g.(02)Format=(8f9.6)'",
        )
    count, width = int(data[1]), int(data[7])
    stop = next((i for i in range(at + 1, len(lines)) if _LAST.match(lines[i])), len(lines))
    if stop == len(lines) and len(file.numbers(at + 1, None, width)) != count:
        what = f"no 'End-of-data' after {count} samples: the file is truncated or the count is wrong"
        file.refuse("record.end_missing", at, what, "'End-of-data' after the samples")
    if "accel" not in data[2].lower():
        return None, stop + 1
    found = file.counted(at, count, at + 1, stop, width)
    step_s = file.positive(start, _real(reals, "time step") / 1000, "time step (real header 62)")
    file.check_duration(at, float(data[3]) if data[3] else None, count, step_s, 1.0)
    factor, note = _factor(file, at, int(data[5]), data[4], reals)
    scnl = first_found(_SCNL, notes)
    channel, magnitude = first_found(_CHANNEL, title), first_found(_MAGNITUDE, title[2:4])
    label = channel[1].strip() if channel else ""
    return file.channel(
        at + 1,
        found,
        factor,
        step_s,
        direction=_direction(label, integers, scnl[1] if scnl else ""),
        file_format=f"COSMOS V{int(integers[0])}",
        corrected=title[0].lower().startswith("corrected"),
        event=re.sub(r"^Re?co?rd of\s*", "", title[1].strip()) if len(title) > 1 else "",
        station=_after("Code:", title),
        label=label,
        magnitude=float(magnitude[1]) if magnitude else None,
        stated_peak_m_s2=stated_peak_m_s2(title),
        series=_after("Location:", title),
        start_s=_start_s(integers, reals),
        place=_place(title, integers),
        notes=(note,) if note else (),
    ), stop + 1


def _header(file: RecordText, at: int, kind: str) -> tuple[NDArray[np.float64], int]:
    block = _BLOCK.match(file.lines[at]) if at < len(file.lines) else None
    if not block:
        expected = "a line such as '100 Integer-header values follow on 10 lines, Format= (10I8)'"
        file.refuse("record.header_missing", at, f"no {kind} header", expected)
    stop = min(at + 1 + int(block[2]), len(file.lines))
    return file.exactly(at, file.numbers(at + 1, stop, int(block[4])), int(block[1])), stop


def _real(reals: NDArray[np.float64], name: str) -> float:
    """Real header value; the format's tables number them from 1."""
    return float(reals[_REALS[name] - 1]) if len(reals) >= _REALS[name] else _UNKNOWN


def _factor(file: RecordText, at: int, code: int, unit: str, reals: NDArray[np.float64]) -> tuple[float, str]:
    """Unit of the samples in m/s2; counts by the recorder's least bit, the sensor's volts per g and gain."""
    named = unit_of(unit)
    coded = _UNIT_CODES_M_S2.get(code)
    if coded and named and not (named.quantity == "acceleration" and math.isclose(named.factor, coded)):
        what = f"the unit is {unit!r} by its name, and {coded:g} m/s2 by its code {code:02d}"
        file.refuse("record.unit_contradicted", at, what, "one unit of the samples",
            "correct the line, or fetch the file again")  # fmt: skip
    if coded:
        return coded, ""
    bit, sensitivity = _real(reals, "least bit"), _real(reals, "sensitivity")
    if code != _COUNTS or not (bit > 0 and sensitivity > 0):
        expected = "g (02), cm/sec2 (04), or counts (50) with least bit and sensitivity in the header"
        file.refuse("record.unit_unknown", at, f"unit {unit!r} with code {code}", expected,
            "fetch the file in g or cm/sec2")  # fmt: skip
    stated = _real(reals, "sensor gain")
    gain = 1.0 if stated == _UNKNOWN else file.positive(at, stated, "sensor gain (real header 47)")
    factor = bit * 1e-6 / sensitivity / gain * 9.80665
    source = f"{bit:g} microvolt, {sensitivity:g} V/g, gain {gain:g} in the header"
    return factor, f"{factor:.6g} m/s2 per count: {source}"


def _direction(label: str, integers: NDArray[np.float64], scnl: str) -> float | str | None:
    """Bearing by the text, by the channel code's last letter, by integer header 54 (400 up, 401 down)."""
    found = bearing(label)
    if found is not None:
        return found
    parts = scnl.split(".")
    if len(parts) > 1 and parts[1].endswith("Z"):
        return UP
    code = int(integers[53]) if len(integers) > 53 else _UNKNOWN
    if code in (400, 401):
        return UP if code == 400 else DOWN
    return float(code % 360) if 0 < code <= 360 else None


def _start_s(integers: NDArray[np.float64], reals: NDArray[np.float64]) -> float | None:
    """Time of the first sample by integers 40 to 45 (year, day of the year, month, day, hour, minute) and real 30."""
    seconds = _real(reals, "start")
    if len(integers) < 45 or min(*integers[39:45], seconds) < 0:
        return None
    year, _, month, day, hour, minute = map(int, integers[39:45])
    with suppress(ValueError):
        return datetime(year, month, day, hour, minute, tzinfo=UTC).timestamp() + seconds
    return None


def _place(title: Sequence[str], integers: NDArray[np.float64]) -> Place:
    """Place by the sensor's location in the text, then by integer header 19, the type of station."""
    location, kind = _after("Location:", title), int(integers[18]) if len(integers) > 18 else _UNKNOWN
    return place_in_words(location) or Place(0.0, _STRUCTURES.get(kind, ""))


def _after(word: str, title: Sequence[str]) -> str:
    text = next((text.split(word, 1)[1] for text in title if word in text), "")
    return re.split(r"\s{2,}|\s\w+:", text.strip())[0] if word == "Code:" else text.strip()
