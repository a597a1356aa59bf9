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
    rf"(?:mean )?(?:exceedance )?(?:rate|frequency|hazard|{_LAMBDA})(?: of exceedance)?"
    r" per (?:year|(?P<some>\d+) years)|"
    rf"(?:mean )?{_LAMBDA}|(?:exceedances|events) per (?:year|(?P<years>\d+) years)"
)
_ANNUAL = re.compile(
    r"annual (?:exceedance )?probability(?: of exceedance)?|annual poe|aep|apo?e|"
    r"(?:poe|(?:exceedance )?probability(?: of exceedance)?) per year"
)
_PROBABILITY = re.compile(
    r"(?:(?P<first>\d+(?:\.\d+)?) ?(?:yrs?|years?) )?"
    r"(?:poe|pe(?=\b|\d)|(?:exceedance )?probability(?: of (?P<non>non ?)?exceedance)?)"
    r"[^0-9]*(?P<years>\d+(?:\.\d+)?)?[^0-9]*"
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
_TIMES = re.compile(
    r"[ /(\[]*(?:\b1/|\bper |/ ?)(?P<number>1[0, ]*0 |million |thousand )?(?P<time>yrs?|years?|a|kyr|ka|myr|ma)[)\]]*$"
)
_MANY = {"million": 1_000_000, "thousand": 1000, "m": 1_000_000, "k": 1000}
_SCALED = re.compile(
    r"[ _]*[(\[]? ?(?:[x×*·] ?)?(?:10\^|10\*\*|1e)\(?(?P<power>[-+]?\d{1,2})\)?[)\]]?|"
    r"[ _(\[]+[x×*·] ?1(?P<zeros>0+)\b[)\]]?"
)
"""Of what values are multiples, (x10^-3), or by what they were multiplied, x 1000: either way they are less."""
_YEARS = re.compile(r"[(\[](?P<time>yrs?|years?|a|kyr|ka|anni|años|anos|ans|jahre?)[)\]]$")
_STATED_YEARS = re.compile(
    r"(?:investigation[_ ]?time\D{0,5}|\bin )(\d+(?:\.\d+)?)(?= ?-?(?:yr|years?|$|[,;]))"
)


def _plain(name: str) -> str:
    """A column's name in lower case, with blanks, and its time, if any, as `per year` or `per 1000 years`."""
    plain = _SHARE_IN.sub("poe in ", _EACH.sub(lambda each: f"1/{each[1] or 'year'}", name.lower()), count=1)
    plain = re.sub(r"[ _-]+", " ", _PERCENT.sub("", plain)).strip()
    if not (found := _TIMES.search(plain)):
        return _YEARS.sub("", plain).strip()
    many = (found["number"] or "1").strip().replace(",", "").replace(" ", "")
    years = _MANY.get(many) or int(many)
    if found["time"][0] in "km":
        years *= _MANY[found["time"][0]]
    bare = plain[: found.start()].strip()
    if years == 1:
        return bare if _RATE.fullmatch(bare) or _ANNUAL.fullmatch(bare) else f"{bare} per year"
    return f"{bare} per {years} years"


def _unscaled(name: str) -> tuple[str, float]:
    """Plain name of a column without its power of ten, and what its values are to be multiplied by."""
    found = _SCALED.search(name.lower())
    if found is None:
        return _plain(name), 1.0
    power = abs(int(found["power"])) if found["power"] else len(found["zeros"])
    plain = _plain(name[: found.start()] + name[found.end() :])
    return ("" if _RETURN.fullmatch(plain) else plain), 10.0**-power


def is_share(text: str) -> bool:
    """Whether a text begins as the name of a column of percentages over some years."""
    return _SHARE_IN.match(text.lower()) is not None


def says_value(name: str) -> bool:
    """Whether a column's name says that it holds rates, probabilities or return periods."""
    if len(name) > LONGEST_NAME:
        return False
    plain, _ = _unscaled(name)
    return any(kind.fullmatch(plain) for kind in (_RATE, _ANNUAL, _RETURN, _PROBABILITY))


def is_probability(name: str) -> bool:
    """Whether the column of values of a name holds probabilities, which lose their digits near 1."""
    return _PROBABILITY.fullmatch(_unscaled(name)[0]) is not None


def values_of(file: HazardFile, name: str, before: str) -> tuple[float, Callable[[float], float]]:
    """Time that a column's probabilities are over, 0 for rates; and what turns a cell into either.

    Raises InputError if neither its name, nor the lines before in lower case, nor the user says so.
    """
    plain, scale = _unscaled(name) if len(name) <= LONGEST_NAME else ("", 1.0)
    stated: float | None = None
    if plain and _PERCENT.search(name.lower()):
        scale *= 0.01
    convert: Callable[[float], float] = partial(mul, scale)
    if rate := _RATE.fullmatch(plain):
        stated, convert = 0.0, partial(mul, scale / float(rate["some"] or rate["years"] or 1.0))
    elif _RETURN.fullmatch(plain):
        kyr = (time := _YEARS.search(name.lower())) and time["time"].startswith("k")
        stated, convert = 0.0, partial(_rate_of_return, 1000.0 if kyr else 1.0)
    elif _ANNUAL.fullmatch(plain):
        stated = 1.0
    elif found := _PROBABILITY.fullmatch(plain):
        above = set(_STATED_YEARS.findall(before))
        text = found["first"] or found["years"] or (above.pop() if len(above) == 1 else None)
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
