"""What a table's column of values holds, by its name: rates, probabilities over some years, or return periods."""

import math
import re
from collections.abc import Callable
from functools import partial
from operator import mul

from toppling.results.hazard.measure_names import LONGEST_NAME
from toppling.results.hazard.readers.stated import HazardFile

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
    r"(?: (?P<years>\d+(?:\.\d+)?)(?: (?:yrs?|years?))?)?"
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


def says_value(name: str) -> bool:
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
