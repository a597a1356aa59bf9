"""COSMOS volumes 0, 1 and 2 (format 1.20): text, integers, reals, comments, each announced, then samples."""

import math
import re
from itertools import takewhile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from toppling.models.motions.formats.component import DOWN, UP, Component, bearing, positive, refuse
from toppling.models.motions.formats.header_text import stated_peak_m_s2
from toppling.models.motions.formats.numbers import counted, exactly, numbers_in
from toppling.models.motions.formats.units import unit_of

NAME = "COSMOS V0/V1/V2"
_UNIT_CODES_M_S2 = {2: 9.80665, 4: 0.01, 7: 0.0254, 10: 0.01, 11: 0.980665}
_COUNTS = 50
_LEAST_BIT, _SENSITIVITY, _GAIN = 22, 42, 47
"""Numbers of the real header values that make volts of counts, and acceleration of volts."""
_UNKNOWN = -999
_VERSION = re.compile(r"\(Format\s+v\s*([\d.]+)\s+with\s+(\d+)\s+text lines\)", re.IGNORECASE)
_BLOCK = re.compile(
    r"^\s*(\d+)\s+(?:Integer|Real)-header values follow on\s+(\d+)\s+lines?,\s*"
    r"Format\s*=\s*\(?\s*(\d+)[IFE](\d+)",
    re.IGNORECASE,
)
_COMMENTS = re.compile(r"^\s*(\d+)\s+Comment line", re.IGNORECASE)
_COMMENT = re.compile(r"\s*\|")
_DATA = re.compile(
    r"^\s*(\d+)\s+(.*?)\bpts\b.*?units\s*=\s*(\S*?)\s*\(\s*(\d+)\s*\)\s*,?\s*"
    r"Format\s*=?\s*\(\s*(?:\d+P\s*,?\s*)?(\d+)[FEIGD](\d+)",
    re.IGNORECASE,
)
_CHANNEL = re.compile(r"^\s*Sta Chan?\s*:?\s*\S*?\s*:\s*(.*?)\s*(?:\(Rcrdr|Location|$)", re.IGNORECASE)
_LAST = re.compile(r"^\s*(?:End[- ]of[- ]data|/&)", re.IGNORECASE)


def recognises(head: str) -> bool:
    """Whether the first line announces the format's version and text lines."""
    return bool(_VERSION.search(head.split("\n", 1)[0]))


def read(path: Path, text: str) -> list[Component]:
    """Read every channel of acceleration; channels of velocity and displacement are passed over."""
    lines = text.splitlines()
    channels: list[Component] = []
    start = 0
    while start < len(lines):
        if not lines[start].strip():
            start += 1
            continue
        component, start = _channel(lines, start, path)
        if component is not None:
            channels.append(component)
    return channels


def _channel(lines: list[str], start: int, path: Path) -> tuple[Component | None, int]:
    version = _VERSION.search(lines[start])
    if not version:
        refuse(
            f"{lines[start].strip()[:60]!r} where a channel should begin",
            path,
            start + 1,
            expected="a line with '(Format v01.20 with 13 text lines)'",
        )
    title = lines[start : start + int(version[2])]
    integers, at = _header(lines, start + int(version[2]), path, whole=True)
    reals, at = _header(lines, at, path, whole=False)
    comments = _COMMENTS.match(lines[at]) if at < len(lines) else None
    notes = list(takewhile(_COMMENT.match, lines[at + 1 :])) if comments else []
    at += 1 + len(notes)
    data = _DATA.match(lines[at]) if at < len(lines) else None
    if not data:
        refuse(
            "no line with the number, the unit and the format of the samples",
            path,
            at + 1,
            expected="a line such as '13400 acceleration pts, approx 67 secs, units=g.(02)Format=(8f9.6)'",
        )
    count, width = int(data[1]), int(data[6])
    stop = next((i for i in range(at + 1, len(lines)) if _LAST.match(lines[i])), len(lines))
    if stop == len(lines) and len(numbers_in(lines[at + 1 :], path, at + 2, width)) != count:
        refuse(
            f"no 'End-of-data' after {count} samples: the file is truncated or the count is wrong",
            path,
            at + 1,
            expected="'End-of-data' after the samples",
        )
    if "accel" not in data[2].lower():
        return None, stop + 1
    body = lines[at + 1 : stop]
    found = counted(numbers_in(body, path, at + 2, width), count, body, path, at + 1, width)
    factor, note = _factor(int(data[4]), data[3], reals, path, at + 1)
    where = f"{path}", start + 1
    scnl = next((re.search(r"<SCNL>(\S+)", text) for text in notes if "<SCNL>" in text), None)
    label = _label(title)
    return Component(
        acceleration_m_s2=found.values * factor,
        time_step_s=positive(_real(reals, 62) / 1000, "time step (real header 62)", path, where[1]),
        direction=_direction(label, integers, scnl[1] if scnl else ""),
        path=path,
        line=at + 2,
        file_format=f"COSMOS V{int(integers[0])}",
        corrected=title[0].lower().startswith("corrected"),
        event=re.sub(r"^Re?co?rd of\s*", "", title[1].strip()) if len(title) > 1 else "",
        station=_after("Code:", title),
        label=label,
        magnitude=_magnitude(title),
        stated_peak_m_s2=stated_peak_m_s2(title),
        series=_after("Location:", title),
        notes=(note,) if note else (),
        warnings=found.warnings,
        missing=found.missing,
    ), stop + 1


def _header(lines: list[str], at: int, path: Path, *, whole: bool) -> tuple[NDArray[np.float64], int]:
    block = _BLOCK.match(lines[at]) if at < len(lines) else None
    if not block:
        refuse(
            f"no {'integer' if whole else 'real'} header",
            path,
            at + 1,
            expected="a line such as '100 Integer-header values follow on 10 lines, Format= (10I8)'",
        )
    body = lines[at + 1 : at + 1 + int(block[2])]
    numbers = numbers_in(body, path, at + 2, int(block[4]))
    return exactly(numbers, int(block[1]), path, at + 1), at + 1 + len(body)


def _real(reals: NDArray[np.float64], number: int) -> float:
    """Real header value by its number in the format's tables, from 1."""
    return float(reals[number - 1]) if len(reals) >= number else _UNKNOWN


def _factor(code: int, unit: str, reals: NDArray[np.float64], path: Path, line: int) -> tuple[float, str]:
    """One unit of the samples in m/s2; counts by the recorder's least bit, the sensor's volts per g and gain."""
    named = unit_of(unit)
    coded = _UNIT_CODES_M_S2.get(code)
    if coded and named and not (named.quantity == "acceleration" and math.isclose(named.factor, coded)):
        refuse(
            f"the unit is {unit!r} by its name, and {coded:g} m/s2 by its code {code:02d}",
            path,
            line,
            expected="one unit of the samples",
            remedy="correct the line, or fetch the file again",
        )
    if coded:
        return coded, ""
    bit, sensitivity = _real(reals, _LEAST_BIT), _real(reals, _SENSITIVITY)
    if code != _COUNTS or not (bit > 0 and sensitivity > 0):
        refuse(
            f"unit {unit!r} with code {code}",
            path,
            line,
            expected="g (02), cm/sec2 (04), or counts (50) with least bit and sensitivity in the header",
            remedy="fetch the file in g or cm/sec2",
        )
    stated = _real(reals, _GAIN)
    gain = 1.0 if stated == _UNKNOWN else positive(stated, f"sensor gain (real header {_GAIN})", path, line)
    factor = bit * 1e-6 / sensitivity / gain * 9.80665
    source = f"{bit:g} microvolt, {sensitivity:g} V/g, gain {gain:g} in the header"
    return factor, f"{factor:.6g} m/s2 per count: {source}"


def _label(title: list[str]) -> str:
    match = next((_CHANNEL.match(text) for text in title if _CHANNEL.match(text)), None)
    return match[1].strip() if match else ""


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


def _after(word: str, title: list[str]) -> str:
    text = next((text.split(word, 1)[1] for text in title if word in text), "")
    return re.split(r"\s{2,}|\s\w+:", text.strip())[0] if word == "Code:" else text.strip()


def _magnitude(title: list[str]) -> float | None:
    match = next((re.search(r"Mw\s*=\s*(\d\.\d+)", text) for text in title[2:4]), None)
    return float(match[1]) if match else None
