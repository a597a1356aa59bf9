"""Two columns of CSV: an intensity measure, and its annual rate, or its probability over a stated time."""

import re
from collections.abc import Sequence
from pathlib import Path

from toppling.results.hazard.curves import curve_of_probabilities, curve_of_rates
from toppling.results.hazard.measures import measure_with_unit
from toppling.results.hazard.readers.statement import Hints, Statement, number, refuse, rows_of

_RATE = {"annual_rate", "annual rate", "annual_frequency", "annual frequency", "annual_rate_of_exceedance",
         "annual frequency of exceedance", "afe"}  # fmt: skip
_PROBABILITY = re.compile(
    r"(?:poe|probability(?:[_ ]of[_ ]exceedance)?)[^0-9]*(?P<years>\d+(?:\.\d+)?)?[^0-9]*"
)


def matches(lines: Sequence[str]) -> bool:
    """Whether a file of a folder begins with a header that names a measure and one more column."""
    line = lines[0] if "," in lines[0] else _with_commas(lines[0])
    cells = line.split(",")
    return len(cells) == 2 and measure_with_unit(cells[0]) is not None


def read(path: Path, lines: Sequence[str], hints: Hints) -> list[Statement]:
    """Read a table of two columns with a header.

    Raises
    ------
    InputError
        If the header does not name a measure, or not what the values are.
    """
    lines = [line for line in lines if not line.lstrip().startswith("#")]
    if not lines:
        refuse(path, "holds no table")
    if "," not in lines[0]:
        lines = [_with_commas(line) for line in lines]
    (_, header), *rows = list(rows_of(path, lines)) or [(0, [])]
    if len(header) != 2:
        refuse(path, f"has the columns {', '.join(header)[:200]}" if header else "is empty")
    if _is_number(header[0]):
        refuse(path, f"states neither measure nor unit nor time: its first line is {lines[0][:40]!r}",
               "put a header above them, such as PGA (g),annual_rate or pgv_m_s,probability_50_years")  # fmt: skip
    known = measure_with_unit(header[0])
    if known is None:
        refuse(
            path,
            f"is over {header[0]!r}",
            "name a measure with its unit, such as pga_m_s2, PGA or PGA (m/s2)",
        )
    years = _years(path, header[1], hints)
    values = [[number(path, line, cell) for cell in row] for line, row in rows if _pair(path, line, row)]
    x, y = [row[0] * known[1] for row in values], [row[1] for row in values]
    origin = {"source": str(path)}
    if years is None:
        return [Statement(curve_of_rates(path.stem, known[0], x, y, **origin))]
    return [Statement(curve_of_probabilities(path.stem, known[0], x, y, years, **origin))]


def _with_commas(line: str) -> str:
    """A line of two columns that tabs, semicolons or blanks part, parted by a comma."""
    for sign in ("\t", ";"):
        if sign in line:
            return line.replace(sign, ",")
    first, _, last = line.strip().rpartition(" ")
    return f"{first.strip()},{last}"


def _pair(path: Path, line: int, row: list[str]) -> bool:
    if len(row) != 2:
        refuse(path, f"line {line} has {len(row)} columns, the header 2")
    return True


def _years(path: Path, name: str, hints: Hints) -> float | None:
    """Time that the second column's probabilities are over; None for annual rates."""
    if name.lower() in _RATE:
        return None
    found = _PROBABILITY.fullmatch(name.lower())
    if not found:
        refuse(
            path, f"has the column {name!r}", "call it annual_rate, or probability_50_years after its time"
        )
    years = float(found["years"]) if found["years"] else hints.years
    if not years:
        remedy = "call the column after it, such as probability_50_years, or give --values 50"
        refuse(path, f"states no time that its {name!r} is over", remedy)
    return years


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
