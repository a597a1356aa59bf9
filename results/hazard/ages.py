"""Ages of rocks: distributions of the time that they have been as fragile as now, for one and for several rocks.

Survival over an uncertain age A is E[exp(-nu A)], the mean over draws of A. An age is stored as equally likely years,
the quantiles at the midpoints of `_AGE_SAMPLES` equal intervals of probability: the relative error of survival over a
normal age is 2e-4.

What matters is how long a rock has been as fragile as now. It was exposed at an age A, and may have been buried or less
fragile until some later date F: in the last min(A, F) years it could topple as it can today, and before that not at
all, or with its medians multiplied by a factor.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr, ndtri

from toppling.models.arrays import Array
from toppling.models.errors import InputError, refusals
from toppling.models.files.table import Table

_AGE_SAMPLES = 400
"""Number of equally likely years that represent an age."""
_EARTH_YEARS = 4.54e9
"""Age of the Earth: no rock has stood longer."""

_UNITS = {**dict.fromkeys(("years", "year", "yr", "a"), 1.0), **dict.fromkeys(("ka", "kyr"), 1e3)}
"""Years per unit of age."""
_NUMBER = r"(\d+(?:\.\d+)?(?:e[+-]?\d+)?)"
_AGE = re.compile(
    rf"{_NUMBER}\s*(?:(±|\+/?-|\.\.|\*/)\s*{_NUMBER})?\s*({'|'.join(_UNITS)})?", re.ASCII | re.IGNORECASE
)
"""Pattern of an age, or of its mean and standard deviation, bounds, or median and factor, with its unit."""
_DOTTED = re.compile(r"[1-9]\d{0,2}(?:\.\d{3})+")
"""Pattern of dots between thousands; no age is stated in thousandths of a year."""

_ABSENT, AS_NOW, LESS_FRAGILE = range(3)
"""States of a rock at some past time."""


@dataclass(frozen=True, eq=False)
class Exposure:
    """Time that sets of rocks stood together, in each draw of their ages."""

    # (s, rocks): `_ABSENT`, `AS_NOW` or `LESS_FRAGILE` (less fragile); an absent rock cannot topple.
    states: NDArray[np.int8]
    years: Array  # (s, draws): time spent in each state

    def survival(self, annual_rates: ArrayLike) -> float:
        """Probability that no event toppled any rock, given the rate (s,) of such events in each state."""
        return float(np.exp(-(np.asarray(annual_rates, float) @ self.years)).mean())

    @property
    def of_rocks(self) -> Array:
        """Years that each rock has stood, (rocks, draws)."""
        return (self.states != _ABSENT).astype(float).T @ self.years


@dataclass(frozen=True, eq=False)
class Since:
    """Date at which a rock became as fragile as it is now."""

    years: Array  # (n,): equally likely years before the present
    factor: float = math.inf  # earlier medians over today's; infinite for a rock that could not topple


def _unit_years(name: str) -> float | None:
    """Years per unit of a column of ages, from its name (`years`, `age (ka)`); None without a unit.

    Examples
    --------
    >>> [_unit_years(name) for name in ("Age [ka]", "age_yr", "year", "site")]
    [1000.0, 1.0, None, None]
    """
    if name.strip().lower() == "year":  # a calendar year
        return None
    bare = re.sub(r"[\s_()\[\]]+", " ", name.lower())
    return _UNITS.get(bare.replace("age", "", 1).strip())


def parse_age(text: str, where: str = "--age", files: bool = True) -> Array:
    """Read an age as equally likely years.

    text: age in years, or in thousands with the unit `ka`: `20000`, `20 ka`; `15000..30000` or `15..30 ka`
    (uniform); `20000+-3000` or `20 ± 3 ka` (normal with a standard deviation, truncated at zero); `20000*/1.2`
    (lognormal: median, and factor of one standard deviation); or a path to a CSV of draws, with the header `years` (or
    `ka`) and optionally a second column `weight`.
    where: option that states it, for errors.
    files: whether it may be a path.
    Returns (n,) array: a single value for an exact age, else `_AGE_SAMPLES`.
    Raises InputError if the text is none of these, or the file has no header.
    """
    try:
        ages = _of_file(Path(text)) if files and _is_file(text) else _of_words(text)
    except InputError:
        raise
    except ValueError:
        ages = np.array([math.nan])
    if not (len(ages) and np.isfinite(ages).all() and (ages > 0).all() and (ages <= _EARTH_YEARS).all()):
        raise InputError(
            "age.unreadable",
            what=f"{text!r} is no age",
            where=where,
            expected=f"years above zero, at most {_EARTH_YEARS:.3g} (the Earth's): 20000, 20 ka, 15000..30000, "
            "20000+-3000, 20000*/1.2, or a CSV of ages; an uncertainty in the unit of its age and of its size",
            remedy="leave --age out for the statement about a single event",
        )
    return ages


def age_given(text: str, since: str = "") -> str:
    """Label of an age as given, with its unit, and the date since which the rock has been as fragile as now.

    Examples
    --------
    >>> age_given("15000..30000"), age_given("15 ± 3 ka", since="8 ka")
    ('15000..30000 years', '15 ± 3 ka, as fragile as now since 8 ka')
    """
    given = f"the ages of {Path(text).name}" if _is_file(text) else text.strip()
    years = " years" if given[-1:].isdigit() else ""
    return f"{given}{years}" + (f", as fragile as now since {age_given(since)}" if since else "")


def parse_since(text: str) -> Since:
    """Read the date at which a rock became as fragile as now: an age, or age and factor of earlier medians `8000:1.5`.

    Raises InputError if the age is invalid, or the factor is not above 1.
    """
    age, colon, stated = text.rpartition(":")
    if not colon or _is_file(text):
        return Since(parse_age(text, "--fragile-since"))
    try:
        factor = float(stated)
    except ValueError:
        factor = math.nan
    if not factor > 1:
        raise InputError(
            "age.factor_unusable",
            what=f"the factor {stated!r} of {text!r}",
            where="--fragile-since",
            expected="a number above 1, by which the rock's medians were higher before",
            remedy="leave it out for a rock that could not topple before, such as a buried one",
        )
    return Since(parse_age(age, "--fragile-since"), factor)


def joint_ages(ages: Sequence[Array], common_date: bool = False, common_error: float = 0.0) -> Array:
    """Draw the ages of several rocks together.

    ages: equally likely years of each rock.
    common_date: whether all rocks were exposed by one event: each draw has one age for all. Needs equal distributions.
    common_error: standard deviation of a relative error s common to all dates, such as that of a production rate:
    A_i = A_i0 (1 + s), where A_i0 is distributed as `ages`. Truncated where an age would not be positive.
    Returns (draws, rocks) array.
    Raises InputError if rocks with a common date have different ages.
    """
    draws = max([_AGE_SAMPLES if common_error else 1, *(len(years) for years in ages)])
    random = np.random.default_rng(0)  # the same ages at every call
    if common_date and any(not np.array_equal(years, ages[0]) for years in ages):
        raise InputError(
            "age.dates_contradicted",
            what="rocks that were uncovered together have different ages",
            where="--common-date",
            expected="one --age for all of them",
            remedy="give their one age, or leave --common-date out",
        )
    if common_date or len(ages) == 1 or draws == 1:
        drawn = np.column_stack([np.resize(years, draws) for years in ages])
    else:
        columns = [np.resize(years, draws) for years in ages]
        drawn = np.column_stack([
            column if len(years) == 1 else random.permutation(column)
            for column, years in zip(columns, ages, strict=True)
        ])  # fmt: skip
    if common_error:
        errors = _normal(0.0, common_error, -1.0, _levels(draws))
        drawn = drawn * (1.0 + random.permutation(errors))[:, None]
    return drawn


def exposure(ages: Array, since: Sequence[Since | None] | None = None) -> Exposure:
    """Find the sets of rocks that stood together, their states, and the years of each in every draw.

    ages: (draws, rocks), from `joint_ages`.
    since: date of fragility of each rock; None for a rock that has always been as fragile as now.
    """
    late = [None] * ages.shape[1] if since is None else list(since)
    draws = max(len(ages), *(len(date.years) for date in late if date), 1)
    ages = np.resize(ages, (draws, ages.shape[1]))
    fragile = ages.copy()  # minimum of a rock's age and its date of fragility
    random = np.random.default_rng([0, 1])  # pairs dates of fragility with ages
    for number, date in enumerate(late):
        if date is not None:
            fragile[:, number] = np.minimum(ages[:, number], random.permutation(np.resize(date.years, draws)))
    less_fragile = np.array([date is not None and math.isfinite(date.factor) for date in late])
    ends = np.sort(np.concatenate([fragile, ages], axis=1), axis=1)
    starts = np.concatenate([np.zeros((draws, 1)), ends[:, :-1]], axis=1)
    middle = ((starts + ends) / 2)[:, :, None]
    before = np.where(less_fragile & (middle < ages[:, None, :]), LESS_FRAGILE, _ABSENT)
    state = np.where(middle < fragile[:, None, :], AS_NOW, before).astype(np.int8)
    lasting = ends - starts
    some = (lasting > 0) & (state != _ABSENT).any(axis=2)
    states, which = np.unique(state[some], axis=0, return_inverse=True)
    years = np.zeros((len(states), draws))
    np.add.at(years, (which.ravel(), np.nonzero(some)[0]), lasting[some])
    return Exposure(states, years)


_WIDEST = 500.0
"""Ratio of a range's ends from which their units (years, thousands) must differ."""
_SUREST = 2000.0
"""Ratio of an age to its uncertainty from which they must."""
_UNSUREST = 3.0
"""Ratio of an uncertainty to its age from which they must."""


def _is_file(text: str) -> bool:
    """Whether a text names a file; False where it is too long for a name."""
    try:
        return Path(text).is_file()
    except OSError:
        return False


def _of_words(text: str) -> Array:
    """Equally likely years of an age given as text; NaN if it is invalid."""
    found = _AGE.fullmatch(text.strip())
    if found is None:
        return np.array([math.nan])
    unit, sign, levels = _UNITS[(found[4] or "years").lower()], found[2], _levels(_AGE_SAMPLES)
    if unit == 1.0 and any(_DOTTED.fullmatch(number) for number in (found[1], found[3] or "")):
        return np.array([math.nan])
    first, second = unit * float(found[1]), float(found[3] or 0.0)
    if sign is None:
        return np.array([first])
    if sign == "*/":
        return first * np.exp(math.log(second) * ndtri(levels)) if second > 1 else np.array([math.nan])
    second *= unit
    if sign == "..":
        alike = first <= second < _WIDEST * first or first == 0.0
        return first + levels * (second - first) if alike else np.array([math.nan])
    alike = second / _UNSUREST < first < (_SUREST * second if unit > 1.0 else math.inf)
    return _normal(first, second, 0.0, levels) if alike else np.array([math.nan])


def _levels(count: int) -> Array:
    return (np.arange(count) + 0.5) / count


def _normal(mean: float, deviation: float, least: float, levels: Array) -> Array:
    """Quantiles of a normal variable truncated below at `least`; NaN if it is invalid."""
    if not deviation > 0:
        return np.array([math.nan])
    floor = ndtr((least - mean) / deviation)
    return mean + deviation * ndtri(floor + levels * (1 - floor))


def _of_file(path: Path) -> Array:
    years, weights = _read_ages(path)
    order = np.argsort(years)
    cumulated = np.cumsum(weights[order]) / weights.sum()
    return years[order][np.minimum(np.searchsorted(cumulated, _levels(_AGE_SAMPLES)), len(years) - 1)]


def _read_ages(path: Path) -> tuple[Array, Array]:
    """Years and weights from a file; unit weights where it has none."""
    table = Table.read(path, _file_error)
    names, rows = table.names, [row for _, row in table.whole_rows(_file_error)]
    del table
    unit = _unit_years(names[0]) if names else None
    if unit is None:
        raise _file_error("age.no_header", f"the first line, {','.join(names)!r}, is no header", path)
    if [name.lower() for name in names[1:]] not in ([], ["weight"], ["probability"]):
        raise _file_error("age.columns_unknown", f"it has the columns {', '.join(names)}", path)
    if unit == 1.0 and rows and all(_DOTTED.fullmatch(row[0]) for row in rows):
        raise _file_error(
            "age.decimals_ambiguous", f"{rows[0][0]!r} may be decimals, or thousands with a dot between", path
        )
    try:
        values = np.fromiter((float(cell) for row in rows for cell in row), float).reshape(-1, len(names))
    except ValueError as error:
        raise _file_error(
            "age.row_unreadable", f"it has a line that is no {' and '.join(names)} ({error})", path
        ) from error
    years = values[:, 0] * unit
    weights = values[:, 1] if len(names) > 1 else np.ones(len(values))
    if not (len(values) and np.isfinite(values).all() and (years > 0).all()):
        raise _file_error("age.not_positive", "there is no age, or one that is not above zero", path)
    if not ((weights >= 0).all() and weights.sum() > 0):
        raise _file_error("age.weights_unusable", "no weight is above zero, or one is negative", path)
    return years, weights


_file_error = refusals(
    expected="ages: the header 'years' or 'years,weight' (or 'ka'), then one age a line",
    remedy="put the header above the ages: it states their unit",
)
