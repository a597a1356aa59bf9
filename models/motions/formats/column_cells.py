"""Cells of plain columns: remarks, quotes, decimal commas, and times, whatever their digits, unit or clock."""

import re
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from toppling.models.motions.formats.record_text import RecordText

COMMENT = ("#", "%", "!", "//", ";")
_COMMA_NUMBER = re.compile(r"[-+]?(?:\d+(?:,\d*)?|,\d+)(?:[EeDd][-+]?\d+)?$")
_POINT_NUMBER = re.compile(r"[-+]?\d*\.\d+$")
_THOUSANDS = re.compile(r"[-+]?\d{1,3}(?:,\d{3})+$")
SEPARATORS = ";\t,"
"""What stands between numbers, beside blanks; of names the first of these that a line has."""
_AS_BLANKS = str.maketrans(dict.fromkeys(SEPARATORS, " "))
_NOT_COMMA = SEPARATORS.replace(",", "")
_BETWEEN = re.compile(rf",(?=[\s{_NOT_COMMA}]|$)")
"""A comma with a blank behind it, which stands between two numbers whatever other commas do."""
UNITS_S = {
    "": 1.0, "s": 1.0, "sec": 1.0, "secs": 1.0, "second": 1.0, "seconds": 1.0, "ms": 1e-3, "msec": 1e-3,
    "millisecond": 1e-3, "milliseconds": 1e-3, "us": 1e-6, "microsecond": 1e-6, "microseconds": 1e-6,
    "ns": 1e-9, "nanosecond": 1e-9, "nanoseconds": 1e-9,
    "min": 60.0, "minutes": 60.0, "h": 3600.0, "hours": 3600.0,
}  # fmt: skip
"""Units of a column of times in seconds."""
_EPOCHS = {1e17: 1e-9, 1e14: 1e-6, 1e11: 1e-3}
"""Times since 1970 of our days, from which on they are in units of so many seconds."""
_CLOCK = re.compile(
    r"(?:\b\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}[T ,;\t]\s*)?(?<!\d)(\d{1,2}):(\d\d):(\d\d)(\.\d+)?"
    r"(?:Z|[-+]\d\d:\d\d| ?([AP])M)?\b",
    re.ASCII | re.IGNORECASE,
)
"""A time of day, of 24 hours or of twice twelve, and the date before it."""
_DAY_S = 86400.0
_STEP_TOLERANCE = 0.01
"""Largest departure of one time difference from their median, as a share of it."""
_REGULAR_SHARE = 0.95
_COARSE, _COARSE_RANGE, _COARSE_WINDOW = 0.1, 1.3, 50
"""Times whose last digit is more than this share of the step leave their line by this many digits where rows are lost;
the place is found by the means of so many times on both sides."""


def _as_seconds(line: str) -> str:
    """Line with the first date and time of day in it as seconds of the day, as many decimals as it has."""
    match = _CLOCK.search(line) if ":" in line else None
    if match is None:
        return line
    hours = int(match[1])
    if match[5]:
        hours = hours % 12 + 12 * (match[5] in "Pp")
    seconds = 3600 * hours + 60 * int(match[2]) + int(match[3])
    return f"{line[: match.start()]}{seconds}{match[4] or ''}{line[match.end() :]}"


def unit_of_times_s(unit: str, first: float) -> float:
    """Seconds of one unit of times, by its name, else by the first if it counts from 1970."""
    since_1970 = next((factor for least, factor in _EPOCHS.items() if first >= least), 1.0)
    return UNITS_S[unit] if unit else since_1970


def past_midnight(time_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Times of day that go on into the next day."""
    return time_s + _DAY_S * np.concatenate([[0], np.cumsum(np.diff(time_s) < -_DAY_S / 2)])


def time_step(file: RecordText, first: int, time: NDArray[np.float64], printed: list[str]) -> float:
    """Step of equally spaced times: their span by their number, as round as the last printed digit allows.

    first: line of the first of them.
    Where nearly all differences are one number of whole digits, rounding explains no other.
    """
    if time[-1] < time[0]:
        what = f"the time goes back from {time[0]:g} to {time[-1]:g}"
        file.refuse("record.time_falls", first, what, "times that rise",
            "put the rows in the order of their times")  # fmt: skip
    steps = np.diff(time)
    mean = file.positive(first, float((time[-1] - time[0]) / len(steps)), "time step")
    usual, digit = float(np.median(steps)), _print_error(printed)
    regular = usual > 0 and float((np.abs(steps - usual) < 0.1 * digit).mean()) >= _REGULAR_SHARE
    step = usual if regular or usual > digit else mean
    wrong = np.flatnonzero(
        np.abs(steps - step) > max(_STEP_TOLERANCE * step, digit / 2 if regular else digit)
    )
    if not len(wrong) and digit > _COARSE * step:
        wrong = _jump_of_coarse_times(time, digit)
    if len(wrong):
        what = f"the time goes on by {steps[wrong[0]]:g} s where the step is {step:g} s: a gap or two steps"
        remedy = "fill or cut the gap, or resample the record to one step first"
        file.refuse("record.step_uneven", first + 1 + int(wrong[0]), what, "equal time steps", remedy)
    return _round_step(mean, digit / len(steps))


def _jump_of_coarse_times(time: NDArray[np.float64], digit: float) -> NDArray[np.int64]:
    """Place, if there is one, where times leave the line that they are on but for rounding to a digit."""
    number = np.arange(len(time))
    slope, start = np.polyfit(number, time, 1)
    off = time - start - slope * number
    if np.ptp(off) <= _COARSE_RANGE * digit:
        return np.empty(0, np.int64)
    sums = np.concatenate([[0.0], np.cumsum(off)])
    beside = min(_COARSE_WINDOW, len(time) // 2)
    middle = sums[beside:-beside]
    return np.array([np.argmax(sums[2 * beside :] + sums[: -2 * beside] - 2 * middle) + beside - 1])


def _round_step(step: float, error: float) -> float:
    """Roundest step within an error: of a few decimals, else of a whole number a second, else of nine decimals."""
    few = next(
        (round(step, digits) for digits in range(1, 5) if abs(round(step, digits) - step) <= error), 0.0
    )
    rate = round(1 / step) or 1
    if few > 0:
        return few
    return 1 / rate if abs(1 / rate - step) <= error else round(step, 9)


def _print_error(numbers: list[str]) -> float:
    """Twice the half of the last printed digit of times: what rounding alone makes of a difference.

    Where zeros at the end are left away ('0.0', '0.005') the longest shows the digit; with an exponent it is each
    number's own.
    """
    digits, largest = 0, 0
    for number in numbers:
        mantissa, _, exponent = number.upper().replace("D", "E").partition("E")
        digits = max(digits, len(mantissa.partition(".")[2]))
        largest = max(largest, int(exponent or 0))
    return 1.01 * 10.0 ** (largest - digits) if digits else 0.0


def is_decimal_comma(lines: list[str]) -> bool:
    """Whether commas in lines of numbers are decimal points: where something else stands between the numbers.

    One comma a line may be either: it stands between two columns if what is before it goes on as times do.
    """
    bare = [_BETWEEN.sub(" ", line.strip(f" {SEPARATORS}")) for line in lines if is_body(line)]
    rows = [re.split(rf"[\s{_NOT_COMMA}]+", line) for line in bare]
    numbers = [number for row in rows for number in row]
    commas = [number for number in numbers if not _POINT_NUMBER.match(number)]
    if len(commas) < len(numbers) and all(map(_THOUSANDS.match, commas)):
        return False  # points are decimal, beside columns with a comma they need not be
    if not any("," in number for number in commas) or not all(map(_COMMA_NUMBER.match, commas)):
        return False
    if all(len(row) > 1 for row in rows):
        return True
    before = [int(row[0].partition(",")[0] or 0) for row in rows]
    return any(b <= a for a, b in pairwise(before))


def plain_line(line: str) -> str:
    """Line without quotes, a time of day as seconds."""
    return _as_seconds(unquoted(line))


def unquoted(line: str) -> str:
    """Line without quotes."""
    return line.replace('"', "")


def is_body(line: str) -> bool:
    """Whether a line is neither blank nor a remark."""
    return bool(line.strip()) and not line.lstrip().startswith(COMMENT)


def separated(line: str, decimal_comma: bool) -> str:
    """Line with a blank between its numbers, and their decimals behind a point."""
    if decimal_comma:
        line = _BETWEEN.sub(" ", line).replace(",", ".")
    return line.translate(_AS_BLANKS)


def cells_of(line: str, decimal_comma: bool) -> list[str]:
    """Numbers, or words, of a line."""
    return separated(line, decimal_comma).split()
