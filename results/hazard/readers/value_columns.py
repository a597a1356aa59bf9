"""What a table's columns of values hold, by their names: rates, probabilities over some years, return periods."""

import math
import re
from collections.abc import Callable
from functools import partial
from operator import mul

from toppling.results.hazard.measure_names import LONGEST_NAME
from toppling.results.hazard.readers.stated import HazardFile

_LAMBDA = r"(?:lambda|λ)(?: ?\([^()]*\))?"
_RATE = re.compile(
    r"(?:mean )?annual (?:exceedance )?(?:rate|frequency|hazard)(?: of exceedance)?|(?:mean )?m?afo?e|m?aro?e|maf|mar|"
    rf"(?:mean )?(?:exceedance )?(?:rate|frequency|hazard|{_LAMBDA})(?: of exceedance)? per (?P<unit>year|kyr)|"
    rf"(?:mean )?{_LAMBDA}|(?:exceedances|events) per (?P<each>year|kyr)"
)
_ANNUAL = re.compile(
    r"annual (?:exceedance )?probability(?: of exceedance)?|annual poe|aep|apo?e|"
    r"(?:poe|(?:exceedance )?probability(?: of exceedance)?) per year"
)
_PROBABILITY = re.compile(
    r"(?:poe|pe\b|(?:exceedance )?probability(?: of (?P<non>non ?)?exceedance)?)[^0-9]*(?P<years>\d+(?:\.\d+)?)?[^0-9]*"
)
_PERCENT = re.compile(r"[ _]*[(\[] ?(?:%|percent) ?[)\]]|(?<![\d ]) ?%|\bpercent\b|(?<=\))%")
"""Of a column's values; a percentage behind a number is that of a hazard level."""
_SHARE_IN = re.compile(r"(?:%|percent)(?: of exceedance)?(?: in | ?/ ?)(?=\d)")
"""A name that begins with what the values are a share of: % in 50 years."""
_RETURN = re.compile(
    r"(?:mean |average )?(?:return period|recurrence interval|recurrence)(?: years?)?|mrp|mri|ari|rp|tr"
)
_EACH = re.compile(r"\b(yr|years?|a|kyr|ka)[ _]*(?:\^?[({]?-1[)}]?|⁻¹)|\b(?:p\. ?a\.|per annum)")
"""A year's inverse, as a power or in Latin."""
_TIMES = re.compile(r"[ /(\[]*(?:\b1/|\bper |/ ?)(?P<time>yr|years?|a|kyr|ka|1000 (?:yr|years?))[)\]]*$")
_YEARS = re.compile(r"[(\[](?P<time>yrs?|years?|a|kyr|ka|anni|años|anos|ans|jahre?)[)\]]$")
_STATED_YEARS = re.compile(
    r"(?:investigation[_ ]time\D{0,5}|\bin )(\d+(?:\.\d+)?)(?= ?-?(?:yr|years?|$|[,;]))"
)


def _plain(name: str) -> str:
    """A column's name in lower case, with blanks, and its time, if any, as `per year` or `per kyr`."""
    plain = _SHARE_IN.sub("poe in ", _EACH.sub(lambda each: f"1/{each[1] or 'year'}", name.lower()), count=1)
    plain = re.sub(r"[ _-]+", " ", _PERCENT.sub("", plain)).strip()
    if not (found := _TIMES.search(plain)):
        return _YEARS.sub("", plain).strip()
    time = " per kyr" if found["time"][0] in "k1" else " per year"
    bare = plain[: found.start()].strip()
    return bare if bare.startswith(("annual", "mean annual")) and time == " per year" else bare + time


def is_share(text: str) -> bool:
    """Whether a text begins as the name of a column of percentages over some years."""
    return _SHARE_IN.match(text.lower()) is not None


def says_value(name: str) -> bool:
    """Whether a column's name says that it holds rates, probabilities or return periods."""
    if len(name) > LONGEST_NAME:
        return False
    plain = _plain(name)
    return any(kind.fullmatch(plain) for kind in (_RATE, _ANNUAL, _RETURN, _PROBABILITY))


def is_probability(name: str) -> bool:
    """Whether the column of values of a name holds probabilities, which lose their digits near 1."""
    return _PROBABILITY.fullmatch(_plain(name)) is not None


def values_of(file: HazardFile, name: str, before: str) -> tuple[float, Callable[[float], float]]:
    """Time that a column's probabilities are over, 0 for rates; and what turns a cell into either.

    Raises InputError if neither its name, nor the lines before in lower case, nor the user says so.
    """
    plain = _plain(name) if len(name) <= LONGEST_NAME else ""
    stated: float | None = None
    scale = 0.01 if plain and _PERCENT.search(name.lower()) else 1.0
    convert: Callable[[float], float] = partial(mul, scale)
    if rate := _RATE.fullmatch(plain):
        stated = 0.0
        if "kyr" in (rate["unit"], rate["each"]):
            convert = partial(mul, scale / 1000.0)
    elif _RETURN.fullmatch(plain):
        kyr = (time := _YEARS.search(name.lower())) and time["time"].startswith("k")
        stated, convert = 0.0, partial(_rate_of_return, 1000.0 if kyr else 1.0)
    elif _ANNUAL.fullmatch(plain):
        stated = 1.0
    elif found := _PROBABILITY.fullmatch(plain):
        above = set(_STATED_YEARS.findall(before))
        text = found["years"] or (above.pop() if len(above) == 1 else None)
        stated = float(text) if text else None
        if found["non"]:
            convert = partial(_exceedance, scale)
        if not (file.hints.years if stated is None else stated):
            remedy = "call the column after it, such as probability_50_years, or give --values 50"
            file.refuse(f"states no time that its {name!r} is over", remedy)
    remedy = "call it annual_rate, or probability_50_years after its time, or give --values"
    return file.years_of_values(stated, f"has the column {name!r}", remedy), convert


def _rate_of_return(unit_years: float, period: float) -> float:
    return 1.0 / (unit_years * period) if period > 0 else math.nan


def _exceedance(scale: float, non_exceedance: float) -> float:
    return 1.0 - scale * non_exceedance
