"""Text of a file of records: the numbers of its lines, the count in its header, and what text above them states."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from toppling.models.files.given import LONGEST_NAME, TextFile
from toppling.models.files.table import is_numeral
from toppling.models.motions.formats.component import Component, check_time_step, refuse_file
from toppling.models.motions.formats.units import UNITS_S, acceleration_m_s2

SURPLUS_FRACTION = 0.01
"""Error of a count that programs make, as a fraction of the samples; beyond it something is missing."""
ROWS_OFF = 2
"""Error of a count in rows that is allowed for short records, where it exceeds `SURPLUS_FRACTION`."""
_NEAR = 200
"""Number of samples on both sides of a place between two rows with which its bend is compared."""
_JUMP_RATIO = 4.0
"""Ratio of that bend to the sharpest within rows from which a row is lost there."""
_FORTRAN = re.compile(r"(\d\.?)[dD]([-+]?\d)")
_GLUED = re.compile(r"(?<=\d)(?=[-+]\d*\.\d)")
"""Place between two numbers of full Fortran columns: before a sign that is no exponent's, which no point follows."""
PRINTED_TIME_S = 0.0015
"""Largest error of a time step between times that are printed to a millisecond."""
_GAP_STEPS = 5.0
"""Number of mean steps between two times from which there is a gap: curves are digitised where they bend."""
_GAP_S = 0.02
"""Time between two others below which there is none, s."""
_COMMA_NUMBER = re.compile(r"\s*[-+]?(?:\d+,\d*|,\d+|\d+)(?:[EeDd][-+]?\d+)?\s*$")

_NUMBER = r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
_PAIR = re.compile(r"\W*([^:=]{1,80}?)\s*[:=]\s*(\S.*)")
"""A key and its value, as a line above the samples states them."""
_OF_SAMPLES = r"(?:(?:acc\w*|data|samples?|amplitude|field|record|signal|channel)[ _-]+)*"
"""Words before such a key: after any other ('original', 'scale', 'PGA') it states something of other samples."""
_KEYS = {
    name: re.compile(_OF_SAMPLES + f"(?:{key})", re.IGNORECASE)
    for name, key in {
        "unit": r"(?:units?|unidad(?:es)?)\b",
        "rate": r"sampl\w*[ _-]*(?:rate|freq)|fs\b|(?:tasa|frecuencia) de muestreo",
        "step": r"dt\b|time[ _]*(?:step|interval)|sampl\w*[ _-]*(?:interval|period|step)|intervalo de muestreo",
        "count": r"npts\b|n(?:umber|o\.?|um\.?) *(?:of *)?(?:samples|points|data)\b|numero de (?:datos|muestras)",
    }.items()
}
"""Keys that are understood, by what they state."""
_WITH_UNIT = re.compile(rf"{_NUMBER}\s*([a-z]*)", re.IGNORECASE)
_RATE = re.compile(
    rf"(?>{_NUMBER})\s*(?:(k)?(?:hz|sps)|(?:samples?|points|pts|muestras)?(?:\s*(?:/|per|por)\s*s\w*)?)"
    r"(?!\s*/?\s*[a-z])",
    re.IGNORECASE,
)
"""A rate per second; k of thousands."""
_PEAK = re.compile(
    rf"(?P<raw>uncor\w*\s+)?\b(?:max|pga|(?:acceleration:\s*)?peak)(?:\s+acceleration)?\s*[=:]?\s*{_NUMBER}\s*"
    r"(?P<unit>[a-z][a-z0-9/*^]*)",
    re.IGNORECASE,
)
PEAK_OFF = 1.5
"""Factor by which a stated peak may differ from the samples', as by a baseline; beyond it their unit is another."""
STEP_OFF = 0.02
"""Share by which two statements of one time step may differ, as by rounding."""
HEADER_LINES = 500
"""Maximum number of lines of a header that are searched."""


@dataclass(frozen=True, eq=False)
class Counted:
    """Samples, as many as counted or as there are; the number that the header counts more; warnings of that."""

    values: NDArray[np.float64]
    missing: int = 0
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class RecordText(TextFile):
    """A file of records, or a channel in it."""

    def part(self, start: int, stop: int) -> "RecordText":
        """Some of the lines."""
        return RecordText(self.path, self.lines[start:stop], self.above + start)

    def positive(self, at: int, value: float, name: str) -> float:
        """Value of a header, if it is a positive finite number."""
        if not (np.isfinite(value) and value > 0):
            remedy = "correct the header, or fetch the file again"
            self.refuse("record.header_unreadable", at, f"{name} is {value:g}", f"a positive {name}", remedy)
        return value

    def numbers(self, start: int, stop: int | None = None, width: int | None = None) -> NDArray[np.float64]:
        """Numbers of some lines, separated by blanks or in columns of a fixed width.

        width: characters to a number; None for blanks.
        Raises InputError: at the first line with something that is not a finite number.

        Decimal commas are read where no number has a point, and none a comma that could stand between two.
        """
        lines = self.lines[start:stop]
        tokens = [token for line in lines for token in _tokens(line, width)]
        values = _floats(tokens)
        if values is None:
            values = _floats([_FORTRAN.sub(r"\1E\2", token) for token in tokens])
        if values is None and all(map(_COMMA_NUMBER.match, tokens)):
            values = _floats([_FORTRAN.sub(r"\1E\2", token.replace(",", ".")) for token in tokens])
        if values is None and width is None and any(map(_GLUED.search, tokens)):
            return replace(self, lines=[parted(line) for line in self.lines]).numbers(start, stop)
        if values is not None and np.isfinite(values).all():
            return values
        left = len(tokens)
        for at, line in enumerate(lines, start):
            for token in _tokens(line, width):
                left -= 1
                if not (is_numeral(token) and np.isfinite(float(token))):
                    end = ": the file is truncated" if left == 0 and _floats([token]) is None else ""
                    self.refuse("record.number_unreadable", at,
                        f"{token.strip()!r} is not a finite number{end}", "one finite number after another",
                        "fetch the file again, or cut the damaged part and correct its count")  # fmt: skip
        return np.empty(0)

    def block(self, at: int, start: int, count: int, form: str) -> tuple[NDArray[np.float64], int]:
        """Numbers in a format of Fortran, such as 10F8.1, from a line on, and the line behind them.

        at: line of the count.
        Raises InputError as `numbers`, or if there are fewer.
        """
        across, width = map(int, re.findall(r"\d+", form)[:2])
        stop = start - (-count // across)
        return self.exactly(at, self.numbers(start, stop, width), count), stop

    def exactly(self, at: int, values: NDArray[np.float64], count: float) -> NDArray[np.float64]:
        """Values, if they are as many as a line of the header says.

        Raises InputError if there are fewer (a truncated file) or more.
        """
        if len(values) != count:
            self._refuse_count(at, len(values), count)
        return values

    def check_duration(
        self, at: int, stated_s: float | None, count: int, step_s: float, printed_s: float = 0.0
    ) -> None:
        """Refuse a duration that is not that of the samples: one of step, count and duration is wrong.

        printed_s: last digit of the duration as it is printed.
        """
        if stated_s is None or abs(count * step_s - stated_s) <= 0.01 * stated_s + 2 * step_s + printed_s:
            return
        self.refuse("record.duration_contradicted", at,
            f"{count} samples at {step_s:g} s last {count * step_s:g} s, and {stated_s:g} s by the header",
            "a duration that is the number of samples by their time step",
            "correct the time step, the count or the duration, or fetch the file again")  # fmt: skip

    def _refuse_count(self, at: int, found: float, count: float) -> NoReturn:
        end, remedy = "", "correct the count in the header"
        if found < count:
            end, remedy = ": the file is truncated", "fetch the file again"
        what = f"{found:.10g} samples follow where the header counts {count:.10g}{end}"
        self.refuse("record.count_contradicted", at, what, f"{count:.10g} samples", remedy)

    def counted(
        self,
        at: int,
        count: int,
        start: int,
        stop: int | None = None,
        width: int | None = None,
        channels: int = 1,
    ) -> Counted:
        """Numbers of some lines by the header's count, or by their rows where these are whole and it is a little off.

        at: line of the count.
        width: characters to a number; None for blanks.
        channels: side by side in a row: the header counts rows.
        Raises InputError if more than two rows are missing, a row in the middle is not whole, or the values jump
        between two rows.
        """
        values, body = self.numbers(start, stop, width), self.lines[start:stop]
        rows, count = count, count * channels
        surplus = len(values) - count
        if surplus == 0:
            return Counted(values)
        lengths = np.array([len(_tokens(text, width)) for text in body if text.strip()])
        ends = np.cumsum(lengths)
        few = ROWS_OFF * int(lengths.max(initial=1))
        if surplus > 0:
            whole = surplus <= max(few, SURPLUS_FRACTION * count) and (count in ends or surplus < lengths[-1])
        else:
            whole = -surplus <= few and len(lengths) > 1 and bool((lengths[:-1] == lengths.max()).all())
        if count < 1 or not whole or _jumps(values[:count], ends):
            self._refuse_count(at, len(values) / channels, rows)
        warning = f"{self.path.name}: {len(values) / channels:.10g} samples where the header counts {rows}"
        if surplus > 0:
            return Counted(values[:count], 0, (f"{warning}: the last {surplus / channels:g} left out",))
        return Counted(values, -surplus // channels, (f"{warning}: read as they are, the rows are whole",))

    def evenly(
        self, start: int, pairs: NDArray[np.float64], pairs_a_line: int, uneven_step_s: float
    ) -> tuple[NDArray[np.float64], float, tuple[str, ...]]:
        """Acceleration at equal steps: as it is where times are equal but for printing, else interpolated.

        start: line of the first pair.
        pairs: (n, 2), time in seconds, and acceleration in any unit.
        uneven_step_s: step to which uneven samples are interpolated.
        Raises InputError if a time does not follow the one before, or only after a gap: with its line.
        """
        time, values = pairs.T
        if len(time) < 2:
            self.refuse("record.too_few_samples", start, "fewer than two samples", "a record")
        steps = np.diff(time)
        step = (time[-1] - time[0]) / len(steps)
        wrong = np.flatnonzero((steps < 0) | (steps > max(_GAP_STEPS * step, _GAP_S) + PRINTED_TIME_S))
        if not step > 0 or len(wrong):
            at = int(wrong[0]) if len(wrong) else 0
            what = f"the time goes from {time[at]:g} to {time[at + 1]:g} s: a gap or a damaged line"
            remedy = "cut the record at the gap, or fetch the file again"
            self.refuse("record.step_uneven", start + at // pairs_a_line, what,
                f"times about {step:.4g} s apart", remedy)  # fmt: skip
        check_time_step(step, self.where(start))  # before the record is interpolated
        span, nice = time[-1] - time[0], round(step, 3)
        nice = nice if nice and abs(nice * len(steps) - span) <= PRINTED_TIME_S else step
        if np.abs(time - time[0] - nice * np.arange(len(time))).max() <= PRINTED_TIME_S:
            return values, float(round(nice, 9)), ()
        even = np.arange(time[0], time[-1] + 1e-9, uneven_step_s)
        note = f"uneven times, mean step {step:.4g} s, interpolated to {uneven_step_s:g} s"
        return np.interp(even, time, values), uneven_step_s, (note,)

    def channel(
        self, at: int, found: Counted, unit_m_s2: float, time_step_s: float, **stated: Any
    ) -> Component:
        """Channel of samples in a unit, of which the first stands in a line, with what else the header states."""
        return Component(
            acceleration_m_s2=found.values * unit_m_s2,
            time_step_s=time_step_s,
            path=self.path,
            line=self.above + at + 1,
            missing=found.missing,
            **{"warnings": found.warnings} | stated,
        )


def round_step(step: float, error: float) -> float:
    """Roundest step within an error: of a few decimals, else of a whole number a second, else of nine decimals."""
    rounded = (round(step, digits) for digits in range(1, 5))
    few = next((value for value in rounded if abs(value - step) <= error), 0.0)
    rate = round(1 / step) or 1
    return few if few > 0 else 1 / rate if abs(1 / rate - step) <= error else round(step, 9)


def first_found(pattern: re.Pattern[str], lines: Sequence[str]) -> re.Match[str] | None:
    """First match of a pattern in some lines; None where there is none."""
    return next(filter(None, map(pattern.search, lines)), None)


def parted(line: str) -> str:
    """Line with a blank between numbers that fill their columns."""
    return _GLUED.sub(" ", line)


def _jumps(values: NDArray[np.float64], ends: NDArray[np.int64]) -> bool:
    """Whether values bend far more sharply somewhere between two rows than near it within rows: a row is lost there."""
    if len(values) < 3:
        return False
    bend = np.abs(np.diff(values, 2))  # of the sample one further on
    between = np.zeros(len(values) + 1, bool)
    inner = ends[(ends > 0) & (ends < len(values))]
    if 5 * len(inner) > len(values):  # few numbers a row, or several channels: nothing lies within rows
        return False
    between[inner], between[inner - 1] = True, True
    between = between[1 : len(values) - 1]
    for place in np.argsort(np.where(between, bend, 0.0))[-20:]:
        window = slice(max(place - _NEAR, 0), place + _NEAR)
        within = bend[window][~between[window]]
        if len(within) and bend[place] > _JUMP_RATIO * within.max():
            return True
    return False


def column_width(body: Sequence[str]) -> tuple[int, int] | None:
    """Number of numbers in a full line, and of characters of one, by where decimal points stand.

    None where they do not stand at equal distances.
    """
    longest = max((text.rstrip() for text in body[:5]), key=len, default="")
    points = [place for place, letter in enumerate(longest) if letter == "."]
    distances = {b - a for a, b in pairwise(points)}
    return (len(points), distances.pop()) if len(distances) == 1 else None


def _floats(tokens: list[str]) -> NDArray[np.float64] | None:
    try:
        return np.array(list(map(float, tokens)))
    except ValueError:
        return None


def _tokens(line: str, width: int | None) -> list[str]:
    if width is None:
        return line.split()
    body = line.rstrip()
    return [body[i : i + width] for i in range(0, len(body), width)]


def _stated(lines: Sequence[str], what: str) -> Iterator[tuple[str, str]]:
    """Keys and values of the lines of a header that state something of `_KEYS`."""
    for line in lines[:HEADER_LINES]:
        pairs = filter(None, map(_PAIR.match, re.split("[;|]", line[:LONGEST_NAME])))
        yield from ((pair[1], pair[2]) for pair in pairs if _KEYS[what].match(pair[1]))


def stated_unit(lines: Sequence[str]) -> float | None:
    """Unit of the samples in m/s2, where the lines name one acceleration's unit and no other."""
    found = set()
    for _, value in _stated(lines, "unit"):
        spellings = (value.strip(), *re.split(r"[(),]| {2,}", value))
        found.add(next(filter(None, map(acceleration_m_s2, spellings)), None))
    found.discard(None)
    return found.pop() if len(found) == 1 else None


def stated_step_s(lines: Sequence[str]) -> float | None:
    """Time step in s, where the lines state one and no other."""
    found = set()
    for key, value in _stated(lines, "rate"):
        behind = [] if re.search("[A-Za-z]", value) else re.findall(r"\(([^)]*)\)", key)[-1:]
        if (rate := _RATE.search(" ".join([value, *behind]))) and float(rate[1]) > 0:
            found.add((1e-3 if rate[2] else 1.0) / float(rate[1]))
    for key, value in _stated(lines, "step"):
        if step := _WITH_UNIT.search(value):
            unit = step[2] or (re.findall(r"\((\w+)\)", key) or [""])[-1]
            found.add(float(step[1]) * UNITS_S.get(unit.lower(), 0.0))
    found = {round(step, 9) for step in found if step > 0}
    return found.pop() if len(found) == 1 else None


def check_stated(lines: Sequence[str], step_s: float, shape: tuple[int, int], path: Path) -> None:
    """Refuse samples that contradict the lines above them.

    shape: of the samples, rows and columns.
    Raises InputError if the lines state another time step, or another number of samples.
    """
    stated = stated_step_s(lines)
    if stated is not None and abs(stated - step_s) > STEP_OFF * step_s:
        what = f"the time advances by {step_s:g} s, and by {stated:g} s by the text above"
        refuse_file("record.step_contradicted", path, what, "one time step", "correct the text, or the times")
    counts = {int(value) for _, value in _stated(lines, "count") if value.isdecimal()}
    near = [
        count for count in counts for n in (shape[0], shape[0] * shape[1])
        if abs(count - n) <= max(ROWS_OFF, SURPLUS_FRACTION * n)
    ]  # fmt: skip
    if len(counts) == 1 and not near:
        what = f"{shape[0]} rows of samples, and {counts.pop()} samples by the text above"
        remedy = "fetch the file again if it is cut, or correct the text"
        refuse_file("record.count_contradicted", path, what, "as many samples as stated", remedy)


def stated_peak_m_s2(lines: Sequence[str]) -> float | None:
    """Size of the largest sample, where the lines state it in a unit of acceleration; before correction if only so.

    One of a single digit is rounded too much to be held against the samples.
    """
    matches = (match for line in lines[:HEADER_LINES] for match in _PEAK.finditer(line[:LONGEST_NAME]))
    found = [match for match in matches if len(re.sub(r"^[-+.0]+|\.|[eE].*", "", match[2])) > 1]
    found.sort(key=lambda match: match["raw"] is not None)
    peaks = ((abs(float(match[2])), acceleration_m_s2(match["unit"])) for match in found)
    return next((size * unit for size, unit in peaks if unit and size), None)
