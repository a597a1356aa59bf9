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

_OF_EXCEEDANCE = "(?: of exceedance)?"
_RATE = re.compile(
    rf"(?:mean )?annual (?:exceedance )?(?:rate|frequency){_OF_EXCEEDANCE}|m?afo?e|"
    rf"(?:exceedance )?(?:rate|frequency|hazard){_OF_EXCEEDANCE} per year"
)
_ANNUAL = re.compile(
    rf"annual (?:(?:exceedance )?probability{_OF_EXCEEDANCE}|poe)|aep|"
    rf"(?:poe|(?:exceedance )?probability{_OF_EXCEEDANCE}) per year"
)
_PROBABILITY = re.compile(
    rf"(?:poe|(?:exceedance )?probability{_OF_EXCEEDANCE})(?: in| over)?"
    r"(?: (?P<years>\d+(?:\.\d+)?)(?: ?(?:yrs?|years?))?)?"
)
_RETURN = re.compile(r"(?:mean )?return period(?: (?:yrs?|years?|a))?|rp(?: (?:yrs?|years?|a))?")
_BARE = re.compile(r"rates?|frequency|hazard|lambda|values?|y")
"""Names that leave to the user what the values are; of another name nobody knows what it says."""
_PER_YEAR = re.compile(r" ?(?:1/|per |/ ?)(?:yrs?|years?|a)$")
_PERCENT = re.compile(r"[ _]*[(\[] ?(?:%|percent) ?[)\]]")


def _plain(name: str) -> str:
    """A column's name in lower case, without brackets, with blanks; an annual rate's time is `per year`."""
    plain = _PERCENT.sub("", name.lower())
    plain = " ".join(re.sub(r"[\s_()\[\]-]+", " ", plain).split())
    bare, per_year = _PER_YEAR.subn("", plain)
    if not per_year:
        return plain
    return bare if _RATE.fullmatch(bare) or _ANNUAL.fullmatch(bare) else f"{bare} per year"


def is_value_name(name: str) -> bool:
    """Whether a column's name says that it holds rates, probabilities or return periods."""
    if len(name) > LONGEST_NAME:
        return False
    plain = _plain(name)
    return any(kind.fullmatch(plain) for kind in (_RATE, _ANNUAL, _RETURN, _PROBABILITY))


def values_of(file: HazardFile, name: str) -> tuple[float, Callable[[float], float]]:
    """Time that a column's probabilities are over, 0 for rates; and what turns a cell into either.

    Raises InputError if neither its name nor the user says so.
    """
    plain = _plain(name) if len(name) <= LONGEST_NAME else ""
    stated: float | None = None
    convert: Callable[[float], float] = partial(mul, 0.01 if plain and _PERCENT.search(name.lower()) else 1.0)
    if _RATE.fullmatch(plain):
        stated = 0.0
    elif _RETURN.fullmatch(plain):
        stated, convert = 0.0, lambda period: 1.0 / period if period > 0 else math.nan
    elif _ANNUAL.fullmatch(plain):
        stated = 1.0
    elif found := _PROBABILITY.fullmatch(plain):
        stated = float(found["years"]) if found["years"] else None
        if not (file.hints.years if stated is None else stated):
            remedy = "call the column after it, such as probability_50_years, or give --values 50"
            file.refuse("hazard.time_missing", f"states no time that its {name!r} is over", remedy)
    lacks, remedy = f"has the column {name!r}", "call it annual_rate, or probability_50_years after its time"
    if stated is None and not (_PROBABILITY.fullmatch(plain) or _BARE.fullmatch(plain)):
        file.refuse("hazard.values_unknown", lacks, remedy)
    return file.years_of_values(stated, lacks, f"{remedy}, or give --values"), convert


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
