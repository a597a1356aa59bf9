"""Columns of text: an intensity measure, and its annual rate, or its probability over a stated time."""

import math
import re
from collections.abc import Callable, Sequence
from pathlib import Path

from toppling.models.files.csv_text import is_numeral
from toppling.results.hazard.curves import curve_of_probabilities, curve_of_rates
from toppling.results.hazard.measures import LONGEST_NAME, measure_with_unit
from toppling.results.hazard.readers.statement import (
    Hints,
    Statement,
    number,
    refuse,
    rows_of,
    years_of_values,
)

_RATE = re.compile(
    r"(?:mean )?annual (?:exceedance )?(?:rate|frequency)(?: of exceedance)?|m?afe|m?are|"
    r"(?:exceedance )?(?:rate|frequency)(?: of exceedance)? per (?P<unit>year|kyr)|exceedances per (?P<each>year|kyr)"
)
_ANNUAL = re.compile(r"annual (?:exceedance )?probability(?: of exceedance)?|annual poe|aep|ape")
_PROBABILITY = re.compile(
    r"(?:poe|probability(?:[_ ]of[_ ]exceedance)?)[^0-9]*(?P<years>\d+(?:\.\d+)?)?[^0-9]*"
)
_RETURN = re.compile(r"(?:mean )?(?:return period|recurrence interval|recurrence)(?: years?)?|mrp|mri")
_TIMES = re.compile(r"[ /(\[]*(?:\b1/|\bper |/ ?)(?P<time>yr|years?|a|kyr|ka|1000 (?:yr|years?))[)\]]*$")
_COMMENTS = ("#", "%", "//")


def matches(lines: Sequence[str]) -> bool:
    """Whether a file of a folder begins with a header that names a measure and what its values are."""
    bare = [line for line in lines if line and not line.startswith(_COMMENTS)]
    if not bare:
        return False
    header = ",".join(_cells(bare[:1])[0]).split(",")
    measures = [name for name in header if measure_with_unit(name)]
    return len(measures) == 1 and (len(header) == 2 or any(map(_says_value, header)))


def read(path: Path, lines: Sequence[str], hints: Hints) -> list[Statement]:
    """Read a table with a header: a column of a measure's levels, and one of their rates or probabilities.

    Raises InputError if the header does not name a measure, or not what the values are.
    """
    lines = [line for line in lines if line.strip() and not line.lstrip().startswith(_COMMENTS)]
    if not lines:
        refuse(path, "holds no table")
    (_, header), *rows = list(rows_of(path, [",".join(cells) for cells in _cells(lines)])) or [(0, [])]
    levels, values = _columns(path, lines[0], header)
    column, factor = measure_with_unit(header[levels]) or ("", 0.0)
    years, rate_of = _values(path, header[values], hints)
    x, y = [], []
    for line, row in rows:
        if len(row) != len(header):
            refuse(path, f"line {line} has {len(row)} columns, the header {len(header)}")
        x.append(number(path, line, row[levels]) * factor)
        y.append(rate_of(number(path, line, row[values])))
    origin = {"source": str(path)}
    if not years:
        return [Statement(curve_of_rates(path.stem, column, x, y, **origin))]
    return [Statement(curve_of_probabilities(path.stem, column, x, y, years, **origin))]


def _columns(path: Path, line: str, header: Sequence[str]) -> tuple[int, int]:
    """Numbers of the columns of levels and of values; others, where a header says what these two are, are left."""
    if len(header) < 2:
        refuse(path, f"has the columns {', '.join(header)[:200]}" if header else "is empty")
    if is_numeral(header[0]):
        refuse(path, f"states neither measure nor unit nor time: its first line is {line[:40]!r}",
               "put a header above them, such as PGA (g),annual_rate or pgv_m_s,probability_50_years")  # fmt: skip
    measures = [index for index, name in enumerate(header) if measure_with_unit(name)]
    values = [index for index, name in enumerate(header) if _says_value(name)]
    if len(header) == 2 and len(measures) == 1:
        return measures[0], 1 - measures[0]
    if not measures:
        first = next(
            name for index, name in enumerate(header) if index not in values or len(values) == len(header)
        )
        remedy = "name a measure with its unit, such as pga_m_s2, PGA or PGA (m/s2)"
        refuse(
            path,
            f"is over {first!r}" if len(header) == 2 else f"has the columns {', '.join(header)[:200]}",
            remedy,
        )
    if len(measures) != 1 or len(values) != 1:
        refuse(
            path,
            f"has the columns {', '.join(header)[:200]}",
            "give one measure and one column of its values",
        )
    return measures[0], values[0]


def _cells(lines: Sequence[str]) -> list[list[str]]:
    """Cells of lines that commas, tabs, semicolons or blanks part, told by the first."""
    sign = next((sign for sign in (",", "\t", ";") if sign in lines[0]), None)
    if sign == ",":
        return [[line] for line in lines]
    if sign:
        return [line.replace(",", ".").split(sign) for line in lines]  # decimal commas
    return [[part.strip() for part in line.strip().rpartition(" ")[::2]] for line in lines]


def _plain(name: str) -> str:
    """A column's name in lower case, with blanks, and its time, if any, as `per year` or `per kyr`."""
    plain = re.sub(r"[ _-]+", " ", name.lower()).strip()
    if not (found := _TIMES.search(plain)):
        return re.sub(r" ?[(\[](?:yr|years?|a)[)\]]$", "", plain)
    time = " per kyr" if found["time"][0] in "k1" else " per year"
    bare = plain[: found.start()].strip()
    return bare if bare.startswith(("annual", "mean annual")) and time == " per year" else bare + time


def _says_value(name: str) -> bool:
    if len(name) > LONGEST_NAME:
        return False
    plain = _plain(name)
    return any(kind.fullmatch(plain) for kind in (_RATE, _ANNUAL, _RETURN)) or bool(
        _PROBABILITY.fullmatch(name.lower())
    )


def _values(path: Path, name: str, hints: Hints) -> tuple[float, Callable[[float], float]]:
    """Time that a column's probabilities are over, 0 for rates; and what turns a cell into either."""
    plain = _plain(name) if len(name) <= LONGEST_NAME else ""
    stated: float | None = None
    convert: Callable[[float], float] = float
    if rate := _RATE.fullmatch(plain):
        stated = 0.0
        if "kyr" in (rate["unit"], rate["each"]):
            convert = _per_year
    elif _RETURN.fullmatch(plain):
        stated, convert = 0.0, _rate_of_return
    elif _ANNUAL.fullmatch(plain):
        stated = 1.0
    elif found := _PROBABILITY.fullmatch(name.lower()) if plain else None:
        stated = float(found["years"]) if found["years"] else None
        if not (hints.years if stated is None else stated):
            remedy = "call the column after it, such as probability_50_years, or give --values 50"
            refuse(path, f"states no time that its {name!r} is over", remedy)
    elif hints.years is None:
        remedy = "call it annual_rate, or probability_50_years after its time, or give --values"
        refuse(path, f"has the column {name!r}", remedy)
    return years_of_values(path, stated, hints) or 0.0, convert


def _per_year(per_kyr: float) -> float:
    return per_kyr / 1000.0


def _rate_of_return(years: float) -> float:
    return 1.0 / years if years > 0 else math.nan
