"""What free text above samples says of them: their unit, their peak, the time step, how many there are."""

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from toppling.models.motions.formats.column_names import label_of
from toppling.models.motions.formats.component import code_direction, refuse_file
from toppling.models.motions.formats.record_text import ROWS_OFF, SURPLUS_SHARE
from toppling.models.motions.formats.units import acceleration_m_s2

_NUMBER = r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
_BETWEEN = r"(?:\D|(?<=[A-Za-z])\d{1,3}(?!\d)){0,20}"
"""What parts a value from its name: digits too, of the name of a channel or converter, as C1 or ADC16."""
_UNIT = re.compile(
    r"\b(?:\w+_)?(?:units?|unidad(?:es)?|einheit(?:en)?)\b[^:=]{0,40}[:=]\s*(.{1,60})"
    r"|\bacc?el\w*[^(\[:=]{0,60}[(\[]([^)\]]{1,30})[)\]]"
    r"|\bacc?el\w*.{0,60}?\b(?:in|en)\s+(?:units\s+of\s+)?(.{1,30})",
    re.IGNORECASE,
)
_OF_INSTRUMENT = re.compile(r"scale|calib|sensitiv|gain", re.IGNORECASE)
"""Before a unit that is not the samples' own: of what counts are multiplied to."""
_COMPONENT = re.compile(
    r"\b(?:comp(?:onent)?|direction|orientation|componente)\b\.?\s*(?:\d\s*[:=]|[:=])?\s*([^\s,;:]+)",
    re.IGNORECASE,
)
_ORIENTATIONS = re.compile(
    r"\borientations?\s*[:=]\s*([^\s,;/]+(?:\s*[,;/]\s*[^\s,;/]+)+)\s*$", re.IGNORECASE
)
"""Of all components in the order of their columns: 0,90,UP."""
_RATE = re.compile(
    rf"(?:sampl\w*[ _-]*(?:rate|freq\w*)|\bfs(?= *[:=])|\bfreq\w* *(?:of|de) *sampl\w*|"
    rf"tasa de muestreo|frecuencia de muestreo)"
    rf"{_BETWEEN}(?<![A-Za-z]){_NUMBER}",
    re.IGNORECASE,
)
_STEP = re.compile(
    rf"(?:\bdt\b|\bdelta[ _]?t\b|time *_?(?:step|interval)|spaced intervals? of|"
    rf"sampl\w*[ _-]*(?:interval|period|step|time)|"
    rf"intervalo de muestreo)({_BETWEEN}?)(?<![A-Za-z]){_NUMBER} *(ms|msec|milliseconds)?\b",
    re.IGNORECASE,
)
_COUNT = re.compile(
    r"(?:\bnpts|\bn(?:umber|o\.?|um\.?) *(?:of *)?(?:samples|points|data(?: *points)?)|numero de (?:datos|muestras))"
    r" *[:=] *(\d+)\b",
    re.IGNORECASE,
)
_COUNT_AND_STEP = re.compile(r"\s*(\d+)[\s,]+(\d*\.\d+(?:[eE][-+]?\d+)?)\s*$")
_PEAK = re.compile(
    rf"(?P<raw>uncor\w*\s+)?\b(?:max|pga|(?:acceleration:\s*)?peak)(?:\s+acceleration)?\s*[=:]?\s*{_NUMBER}\s*"
    r"(?P<unit>[a-z][a-z0-9/*^]*)",
    re.IGNORECASE,
)
_PEAKS_IN = re.compile(
    rf"\b(?:pga|peak)\b[^(\[:=]{{0,30}}[(\[]([^)\]]{{1,30}})[)\]](.{{0,100}}{_NUMBER}.{{0,100}})",
    re.IGNORECASE,
)
"""Peaks of all components behind their unit: RAW PGA VALUES (gal): (N-S) 70.2, (E-W) 105.9."""
_PEAK_OFF = 1.5
"""Factor by which a peak may differ from the samples', as by a baseline."""
_STEP_OFF = 0.02
"""Share by which text and times may differ, as of rounding."""
_MOST_LINES, _LONGEST = 200, 300


def _found(pattern: re.Pattern[str], lines: Sequence[str]) -> Iterator[re.Match[str]]:
    """What a pattern finds in lines of text."""
    for line in lines[:_MOST_LINES]:
        yield from pattern.finditer(line[:_LONGEST])


def stated_unit(lines: Sequence[str]) -> float | None:
    """One unit of the samples in m/s2, where the lines name one acceleration's unit and no other."""
    found = set()
    for match in _found(_UNIT, lines):
        clause = re.split("[;,|]", match.string[: match.start(match.lastindex or 0)])[-1]
        text = next(filter(None, match.groups())).strip()
        if not text or _OF_INSTRUMENT.search(clause):
            continue
        in_brackets = text.partition("(")[2].partition(")")[0]
        ways = (text, *re.split(r"[(,;]| {2,}", text), text.split()[0], in_brackets)
        found.add(next(filter(None, map(acceleration_m_s2, ways)), None))
    found.discard(None)
    return found.pop() if len(found) == 1 else None


def unit_of_peaks(lines: Sequence[str], largest: float) -> float | None:
    """Unit in m/s2 of peaks that the lines state, where it is that of the samples: their largest is such a peak."""
    for match in _found(_PEAKS_IN, lines):
        unit, peaks = acceleration_m_s2(match[1]), re.findall(_NUMBER, match[2])
        peak = max(abs(float(each)) for each in peaks)
        if unit and largest / _PEAK_OFF < peak < largest * _PEAK_OFF:
            return unit
    return None


def stated_direction(lines: Sequence[str]) -> float | str | None:
    """Direction of one component, where the lines name one and no other."""
    found = {code_direction(label_of(match[1]) or match[1]) for match in _found(_COMPONENT, lines)}
    found.discard(None)
    return found.pop() if len(found) == 1 else None


def stated_orientations(lines: Sequence[str]) -> list[float | str]:
    """Directions of several components, in their order, where one line states them all; none else."""
    found = [match[1] for match in _found(_ORIENTATIONS, lines)]
    said = [code_direction(word.strip()) for word in re.split("[,;/]", found[0])] if len(found) == 1 else []
    return [each for each in said if each is not None] if None not in said else []


def stated_step_s(lines: Sequence[str], rows: int) -> float | None:
    """Time step in s, where the lines state one and no other.

    A last line of two numbers is count and step, if the count is that of the rows.
    """
    found = {1 / float(match[1]) for match in _found(_RATE, lines) if float(match[1]) > 0}
    for match in _found(_STEP, lines):
        milli = match[3] or re.search(r"\bms(?:ec)?\b|milli", match[1], re.IGNORECASE)
        found.add(float(match[2]) * (1e-3 if milli else 1.0))
    pair = _COUNT_AND_STEP.match(lines[-1]) if lines else None
    if pair and int(pair[1]) == rows:
        found.add(float(pair[2]))
    found = {round(step, 9) for step in found if step > 0}
    return found.pop() if len(found) == 1 else None


def stated_counts(lines: Sequence[str]) -> set[int]:
    """Numbers of samples that the lines state."""
    return {int(match[1]) for match in _found(_COUNT, lines)}


def check_stated(lines: Sequence[str], step_s: float, shape: tuple[int, int], path: Path) -> None:
    """Refuse samples that are not those that the lines above them tell of.

    shape: of the samples, rows and columns.
    Raises InputError if the lines state another time step, or another number of samples.
    """
    stated = stated_step_s(lines, shape[0])
    if stated is not None and abs(stated - step_s) > _STEP_OFF * step_s:
        what = f"the time goes on by {step_s:g} s, and by {stated:g} s by the text above"
        refuse_file("record.step_contradicted", path, what, "one time step", "correct the text, or the times")
    counts = stated_counts(lines)
    near = [
        count for count in counts for n in (shape[0], shape[0] * shape[1])
        if abs(count - n) <= max(ROWS_OFF, SURPLUS_SHARE * n)
    ]  # fmt: skip
    if len(counts) == 1 and not near:
        what = f"{shape[0]} rows of samples, and {counts.pop()} samples by the text above"
        remedy = "fetch the file again if it is cut, or correct the text"
        refuse_file("record.count_contradicted", path, what, "as many samples as stated", remedy)


def stated_peak_m_s2(lines: Sequence[str]) -> float | None:
    """Size of the largest sample, where the lines state it in a unit of acceleration; before correction if only so.

    One of a single digit is rounded too much to be held against the samples.
    """
    found = [match for match in _found(_PEAK, lines) if len(re.sub(r"^[-+.0]+|\.|[eE].*", "", match[2])) > 1]
    found.sort(key=lambda match: match["raw"] is not None)
    peaks = ((abs(float(match[2])), acceleration_m_s2(match["unit"])) for match in found)
    return next((size * unit for size, unit in peaks if unit and size), None)
