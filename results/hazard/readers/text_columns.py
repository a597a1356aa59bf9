"""Plain table of columns: an intensity measure's levels, and their rates, probabilities or return periods."""

import math
import re
from collections.abc import Callable, Sequence
from functools import partial
from operator import mul

from toppling.models.files.given import LONGEST_NAME
from toppling.models.files.table import is_numeral
from toppling.results.hazard.measure_names import measure_of, measure_with_unit
from toppling.results.hazard.readers.assembly import HazardFile, Statement

_VALUES = re.compile(
    r"annual rate|(?P<period>return period)|"
    r"probability(?: of exceedance in)? (?P<years>\d+(?:\.\d+)?) years?"
)
"""Names of columns of values, with blanks, and OpenSHA's label of probabilities."""
_PERCENT = re.compile(r"[ _]*[(\[] ?% ?[)\]]")


def _words(name: str) -> str:
    """A column's name in lower case with blanks, without a per cent."""
    return " ".join(_PERCENT.sub("", name[:LONGEST_NAME].lower()).replace("_", " ").split())


def is_value_name(name: str) -> bool:
    """Whether a column's name says that it holds rates, probabilities or return periods."""
    return _VALUES.fullmatch(_words(name)) is not None


def values_of(file: HazardFile, name: str) -> tuple[float, Callable[[float], float]]:
    """Time that a column's probabilities are over, 0 for rates; and what turns a cell into either.

    Raises InputError if neither its name nor the user says so: of a name of several words nobody knows what it says.
    """
    words, convert = _words(name), partial(mul, 0.01 if _PERCENT.search(name) else 1.0)
    found = _VALUES.fullmatch(words)
    lacks, remedy = f"has the column {name!r}", "call it annual_rate, return_period or probability_50_years"
    if found is None and " " in words:
        file.refuse("hazard.values_unknown", lacks, remedy)
    stated = None if found is None else float(found["years"] or 0.0)
    years = file.years_of_values(stated, lacks, f"{remedy}, or give --values")
    if found and found["period"]:
        return years, lambda period: 1.0 / period if period > 0 else math.nan
    return years, convert


def matches(file: HazardFile) -> bool:
    """Whether a file of a folder begins with a header that names a measure and what its values are."""
    header = file.table.names
    measures = [name for name in header if measure_with_unit(name)]
    return len(measures) == 1 and (len(header) == 2 or any(map(is_value_name, header)))


def read(file: HazardFile) -> list[Statement]:
    """Read a table with a header: a column of a measure's levels, and one of their rates or probabilities.

    Raises InputError if the header does not name a measure, or not what the values are.
    """
    header = file.table.names
    levels, values = _columns(file, header)
    column, factor = measure_with_unit(header[levels]) or ("", 0.0)
    if measure_of(header[levels]):
        file.refuse("hazard.unit_missing", f"names no unit of {header[levels]}",
            f"name it in the column, such as {header[levels]} (g) or (cm/s), or pga_m_s2")  # fmt: skip
    years, rate_of = values_of(file, header[values])
    endless = rate_of(math.inf) == 0.0  # a return period
    rows = file.wanted_rows(file.rows, header, None)
    x = [file.number(line, row[levels]) * factor for line, row in rows]
    y = [rate_of(file.number(line, row[values], endless=endless)) for line, row in rows]
    return [Statement(file.curve(column, x, y, years))]


def _columns(file: HazardFile, header: Sequence[str]) -> tuple[int, int]:
    """Numbers of the columns of levels and of values; others are left."""
    named = ", ".join(header)[:200]
    if len(header) < 2:
        file.refuse("hazard.columns_unknown" if header else "file.empty",
            f"has the columns {named}" if header else "is empty")  # fmt: skip
    if is_numeral(header[0]):
        file.refuse("hazard.no_header", f"states neither measure nor unit nor time: its first line is {named[:40]!r}",
               "put a header above them, such as PGA (g),annual_rate or pgv_m_s,probability_50_years")  # fmt: skip
    if any(name.lower() in ("event_id", "eid") for name in header):
        file.refuse("hazard.is_of_events", f"is of events, with the columns {named}",
            "a set of events has the columns annual_rate and measures with their units, such as PGA (g)")  # fmt: skip
    measures = [index for index, name in enumerate(header) if measure_with_unit(name)]
    values = [index for index, name in enumerate(header) if is_value_name(name)]
    if len(header) == 2 and len(measures) == 1:
        return measures[0], 1 - measures[0]
    if not measures:
        first = next((name for index, name in enumerate(header) if index not in values), header[0])
        what = f"is over {first!r}" if len(header) == 2 else f"has the columns {named}"
        file.refuse("hazard.measure_missing", what,
            "name a measure with its unit, such as pga_m_s2, PGA or PGA (m/s2)")  # fmt: skip
    if len(measures) > 1 or len(values) != 1:
        file.refuse("hazard.columns_unknown", f"has the columns {named}",
            "give one measure and one column of its values")  # fmt: skip
    return measures[0], values[0]
