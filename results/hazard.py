"""From fragility to hazard: what a rock that still stands says about the ground motion that has not happened.

With an annual rate of exceedance lambda(x), toppling has the rate nu = integral of F(x) |d lambda(x)|, and
the rock survives T years with probability exp(-nu T) (Poisson events). Rocks that stand together feel the
same events: at least one topples with 1 - prod(1 - F_i(x)); taking them as independent would be biased.

A curve says nothing outside its points x_0 ... x_n. What it leaves out is not counted in nu, so nu is a least
rate and survival a greatest probability: a rejection stands, and a branch that is kept may hang on it. Two terms
are told beside the answer (`unstated_shares`):

- above x_n, at most (1 - F(x_n)) lambda(x_n): as if every event beyond it toppled a rock;
- below x_0, the integral of F(x) k lambda(x_0) (x / x_0)^-k dx / x from 0 to x_0: the first segment's power law,
  of exponent k, goes on. Hazard curves flatten toward small intensities, as there are only so many earthquakes
  a year, so this is rather too much; it is no bound for a curve that steepens there.
"""

import csv
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq
from scipy.stats import norm

from toppling.models.errors import InputError
from toppling.results.exchange import OPENQUAKE
from toppling.results.fits import Lognormal, Resampled

AGE_SAMPLES = 400
SITE_REACH_KM = 30.0
"""Farthest that a site of a hazard file may lie from the place that is asked for.

A node of a grid of 0.3 degrees is within 24 km of every place, and published grids are of 0.05 to 0.2. Farther off is
another place: nearer to a fault or beyond it, with another curve.
"""
EARTH_RADIUS_KM = 6371.0
NODES_PER_E_FOLD = 400
"""Points of the integration in an interval where intensity grows by e.

Under a power law of exponent k the rate comes out too large by (k / 400)^2 / 24 of it: 1e-6 for k = 2, 2.3e-6 for
3. A nearly sharp fragility (beta below .02) adds up to 4.4e-5 k, the most where beta is a third of an interval; a
sharp one adds nothing.
"""


@dataclass(frozen=True, eq=False)
class HazardCurve:
    """Annual rate at which an intensity is exceeded at a site, a power law between its points.

    Parameters
    ----------
    name : str
    measure : str
        Column of the results that the intensity is a value of.
    intensity : (n,) array
        Increasing and positive, in the measure's SI unit.
    annual_rate : (n,) array
        Positive, not increasing.
    weight : float
        Of this branch among others.
    site : (longitude, latitude) or None
        Degrees; where its file says that it holds.
    """

    name: str
    measure: str
    intensity: NDArray[np.float64]
    annual_rate: NDArray[np.float64]
    weight: float = 1.0
    site: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        x, rate = self.intensity, self.annual_rate
        good = len(x) >= 2 and len(x) == len(rate) and np.isfinite(x).all() and np.isfinite(rate).all()
        if not (
            good and x[0] > 0 and (np.diff(x) > 0).all() and (rate > 0).all() and (np.diff(rate) <= 0).all()
        ):
            raise _hazard_error(self.name, "intensities must rise and rates fall, all of them positive")

    def rate(self, intensity: ArrayLike) -> NDArray[np.float64]:
        """Annual rate of exceedance at intensities within the curve, interpolated on logarithms."""
        logarithm = np.interp(np.log(intensity), np.log(self.intensity), np.log(self.annual_rate))
        return np.exp(logarithm)


@dataclass(frozen=True, eq=False)
class Standing:
    """A rock that has stood for some time.

    Parameters
    ----------
    name : str
    curve : Lognormal
    years : (n,) array
        Equally likely ages; one where it is known.
    resampled : Resampled or None
        The same curve of records drawn anew; None for a curve of a file, which does not keep them.
    """

    name: str
    curve: Lognormal
    years: NDArray[np.float64]
    resampled: Resampled | None = None


def toppling_rate(curves: Sequence[Lognormal], hazard: HazardCurve) -> float:
    """Annual rate of events that topple at least one of some rocks at a site.

    Rates above the hazard curve's last point count with the probability at that point, rates below its first
    not at all (`unstated_shares`).
    """
    low, *_, high = hazard.intensity
    medians = [curve.median for curve in curves if low < curve.median < high]
    # Corners of the curve and medians are nodes: no interval straddles two power laws or a sharp threshold.
    corners = np.unique(np.log([*hazard.intensity, *medians]))
    pieces = [
        np.linspace(start, end, math.ceil((end - start) * NODES_PER_E_FOLD), endpoint=False)
        for start, end in pairwise(corners)
    ]
    x = np.exp(np.concatenate([*pieces, corners[-1:]]))
    rate = hazard.rate(x)
    middle = np.sqrt(x[1:] * x[:-1])
    return float(any_topples(curves, middle) @ -np.diff(rate) + any_topples(curves, x[-1:])[0] * rate[-1])


def continued(hazard: HazardCurve, curves: Sequence[Lognormal]) -> HazardCurve:
    """Hazard curve with what it leaves out: the first segment's power law below, all that topples above.

    It reaches as far as the rocks' fragilities ask for; the module says where the two ends come from.
    """
    x, rate = hazard.intensity, hazard.annual_rate
    exponent = math.log(rate[0] / rate[1]) / math.log(x[1] / x[0])
    # F(x) x^-k is a normal density about ln(median) - k beta^2, and nothing is left 8 beta below that.
    low = min(math.log(curve.median) - exponent * curve.beta**2 - 8 * curve.beta for curve in curves)
    if exponent > 0:  # rates that a double can hold
        low = max(low, math.log(x[0]) - 600.0 / exponent)
    high = 2.0 * max(curve.intensity(1 - 1e-12) for curve in curves)
    if math.exp(low) < x[0]:
        rate = np.concatenate([rate[:1] * (x[0] / math.exp(low)) ** exponent, rate])
        x = np.concatenate([[math.exp(low)], x])
    if high > x[-1]:
        x, rate = np.append(x, high), np.append(rate, rate[-1])
    return replace(hazard, intensity=x, annual_rate=rate)


def unstated_shares(curves: Sequence[Lognormal], hazard: HazardCurve) -> tuple[float, float]:
    """Shares of the toppling rate under the `continued` curve that lie below and above the stated points."""
    stated, whole = (toppling_rate(curves, curve) for curve in (hazard, continued(hazard, curves)))
    above = (1.0 - any_topples(curves, hazard.intensity[-1:])[0]) * hazard.annual_rate[-1]
    return max(0.0, 1.0 - (stated + above) / whole), float(above / whole)


def any_topples(curves: Sequence[Lognormal], intensity: ArrayLike) -> NDArray[np.float64]:
    """Probability that an event of some intensity topples at least one of the rocks."""
    return 1.0 - np.prod([1.0 - curve.probability(intensity) for curve in curves], axis=0)


def survival(rocks: Sequence[Standing], hazard: HazardCurve) -> float:
    """Probability that all rocks still stand, each after its own age, under common events.

    Over the years that only the older rocks stood, only they could topple. Uncertain ages are averaged over.
    """
    exponent = np.zeros(_draws(rocks))
    for standing, years in _epochs(rocks):
        exponent += years * toppling_rate(standing, hazard)
    return float(np.exp(-exponent).mean())


def branch_weights(prior: ArrayLike, survivals: ArrayLike) -> NDArray[np.float64]:
    """Bayes weights of hazard branches, given the probability of the rocks' survival under each.

    Raises
    ------
    ValueError
        If no branch lets the rocks survive.
    """
    joint = np.asarray(prior, float) * np.asarray(survivals, float)
    if not joint.sum() > 0:
        msg = "the rocks cannot have survived under any of the branches"
        raise ValueError(msg)
    return joint / joint.sum()


def rejected_rate(
    rocks: Sequence[Standing], intensity: ArrayLike, confidence: float = 0.95
) -> NDArray[np.float64]:
    """Annual rate of exceedance above which an intensity is rejected, whatever the rest of the hazard curve.

    Fragility rises with intensity, so the toppling rate is at least F(x) lambda(x), and the rocks' survival
    at most exp(-F(x) lambda(x) T). Returned is the rate at which that bound is 1 - confidence; infinite where
    F(x) is 0.
    """
    values = np.atleast_1d(np.asarray(intensity, float))
    exposure = np.zeros((_draws(rocks), len(values)))
    for standing, years in _epochs(rocks):
        exposure += np.outer(years, any_topples(standing, values))
    return np.array([_solve(column, 1.0 - confidence) for column in exposure.T])


def unexceeded(curves: Sequence[Lognormal], confidence: float = 0.95) -> float:
    """Intensity that no single event has exceeded, at a confidence, since the rocks stand: F(x) = confidence.

    What can be said without an age or a hazard curve. Infinite where no curve gets there.
    """
    low, high = (min(curve.intensity(share) for curve in curves) for share in (1e-9, confidence))
    if len(curves) == 1 or math.isinf(high):
        return high
    return float(brentq(lambda x: any_topples(curves, x) - confidence, low, high * (1 + 1e-9)))


def read_hazard(
    path: Path, weight: float = 1.0, site: tuple[float, float] | None = None, ratio: float = 1.0
) -> HazardCurve:
    """Read a hazard curve: two columns of CSV, or OpenQuake's CSV of hazard curves.

    Two columns have a header: the measure (a column of the results in SI, or OpenQuake's name in OpenQuake's
    unit) and `annual_rate`. OpenQuake's file states probabilities of exceedance in its investigation time,
    which become rates.

    Parameters
    ----------
    path : Path
    weight : float
    site : (longitude, latitude) or None
        A place in degrees: the nearest site of an OpenQuake file is taken, if it lies within `SITE_REACH_KM`. Needed
        where the file has several; two columns state no place, and it says nothing of them.
    ratio : float
        Peak of the horizontal vector over the horizontal component that the hazard is stated for.

    Raises
    ------
    InputError
        If the file is absent, is neither, needs a site, or has none within reach.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()  # spreadsheets begin with a byte order mark
    except FileNotFoundError:
        raise _hazard_error(path, "does not exist") from None
    except UnicodeDecodeError as error:
        raise _hazard_error(path, "is no text in UTF-8") from error
    if not lines:
        raise _hazard_error(path, "is empty")
    try:
        measure, x, rate, taken = (
            _openquake(lines, path, site) if lines[0].startswith("#") else (*_two_columns(lines, path), None)
        )
    except (ValueError, IndexError, StopIteration, csv.Error, ZeroDivisionError) as error:
        if isinstance(error, InputError):
            raise
        raise _hazard_error(path, f"cannot be read ({error})") from error
    told = rate != 0  # OpenQuake states zero where the rate underflows
    return HazardCurve(path.stem, measure, x[told] * ratio, rate[told], weight, taken)


def distance_km(
    longitude_deg: ArrayLike, latitude_deg: ArrayLike, site: tuple[float, float]
) -> NDArray[np.float64]:
    """Distances of places from a site (longitude, latitude) along the great circle; 241.9 and -118.1 east are one."""
    east, north, here = (
        np.deg2rad(np.asarray(angle, float)) for angle in (longitude_deg, latitude_deg, site)
    )
    lengths = np.sin((north - here[1]) / 2) ** 2
    widths = np.cos(north) * np.cos(here[1]) * np.sin((east - here[0]) / 2) ** 2
    return 2.0 * EARTH_RADIUS_KM * np.arcsin(np.sqrt(np.minimum(lengths + widths, 1.0)))


def parse_age(text: str) -> NDArray[np.float64]:
    """Read an age: `20000`, `15000..30000` (uniform) or `20000+-3000` years (normal, cut at zero).

    A path to a CSV with the header `years`, or `years,weight`, is read.

    Raises
    ------
    InputError
        If the text is none of these, or the file has no header.
    """
    levels = (np.arange(AGE_SAMPLES) + 0.5) / AGE_SAMPLES
    try:
        if Path(text).is_file():
            years, weights = _read_ages(Path(text))
            order = np.argsort(years)
            cumulated = np.cumsum(weights[order]) / weights.sum()
            ages = years[order][np.searchsorted(cumulated, levels)]
        elif "+-" in text:
            mean, deviation = map(float, text.split("+-"))
            floor = norm.cdf(0.0, mean, deviation)
            ages = norm.ppf(floor + levels * (1 - floor), mean, deviation)
        elif ".." in text:
            low, high = map(float, text.split(".."))
            ages = low + levels * (high - low)
        else:
            ages = np.array([float(text)])
    except InputError:
        raise
    except ValueError:
        ages = np.array([math.nan])
    if not (np.isfinite(ages).all() and (ages > 0).all()):
        raise InputError(
            what=f"{text!r} is no age",
            where="--age",
            expected="years above zero: 20000, 15000..30000, 20000+-3000, or a CSV of years and weights",
            remedy="leave --age out for the statement about a single event",
        )
    return ages


def _read_ages(path: Path) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Years and weights of a file, weights of one where it has none."""
    text = path.read_text(
        encoding="utf-8-sig"
    )  # a byte order mark would hide that the first line is a number
    header, *rows = [line for line in text.splitlines() if line.strip()] or [""]
    if _is_number(header.split(",")[0]):
        raise InputError(
            what=f"the first line, {header!r}, is no header",
            where=str(path),
            expected="the header 'years' or 'years,weight', then one age a line",
            remedy="put the header above the ages",
        )
    table = np.loadtxt(rows, delimiter=",", ndmin=2) if rows else np.empty((0, 1))
    years, weights = table[:, 0], table[:, 1] if table.shape[1] > 1 else np.ones(len(table))
    if not (len(years) and table.shape[1] <= 2 and (weights >= 0).all() and 0 < weights.sum() < math.inf):
        msg = "ages and weights, one of them above zero"
        raise ValueError(msg)
    return years, weights


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _draws(rocks: Sequence[Standing]) -> int:
    return max(len(rock.years) for rock in rocks)


def _epochs(rocks: Sequence[Standing]) -> list[tuple[list[Lognormal], NDArray[np.float64]]]:
    """Find the sets of rocks that stood together, and how long in each draw of their ages.

    Independent ages are drawn by shuffling each rock's equally likely ones with a fixed seed.
    """
    random = np.random.default_rng(0)
    draws = _draws(rocks)
    if len(rocks) > 1 and draws > 1:
        draws_of = [random.permutation(np.resize(rock.years, draws)) for rock in rocks]
    else:
        draws_of = [np.resize(rock.years, draws) for rock in rocks]
    ages = np.array(draws_of)
    order = np.argsort(-ages, axis=0)
    epochs: dict[tuple[int, ...], NDArray[np.float64]] = {}
    for draw in range(draws):
        for count in range(len(rocks)):
            standing = tuple(sorted(order[: count + 1, draw]))
            younger = ages[order[count + 1, draw], draw] if count + 1 < len(rocks) else 0.0
            years = ages[order[count, draw], draw] - younger
            epochs.setdefault(standing, np.zeros(draws))[draw] += years
    return [([rocks[number].curve for number in standing], years) for standing, years in epochs.items()]


def _solve(exposure: NDArray[np.float64], chance: float) -> float:
    if not exposure.mean() > 0:
        return math.inf
    # The mean of exp(-rate A) lies between exp(-rate mean(A)), by Jensen, and exp(-rate min(A)).
    low = -math.log(chance) / exposure.mean()
    high = -math.log(chance) / exposure.min() if exposure.min() > 0 else low * 1e6
    if high <= low * (1 + 1e-12):
        return low
    return float(
        brentq(lambda rate: np.exp(-rate * exposure).mean() - chance, low * (1 - 1e-9), high * (1 + 1e-9))
    )


def _two_columns(lines: list[str], path: Path) -> tuple[str, NDArray[np.float64], NDArray[np.float64]]:
    header, *rows = list(csv.reader(line for line in lines if line.strip()))
    names = [name.strip() for name in header]
    measures = {imt: measure for measure, (imt, _) in OPENQUAKE.items()}
    if len(names) != 2 or names[1] != "annual_rate":
        raise _hazard_error(path, f"has the columns {', '.join(names)}")
    measure = measures.get(names[0], names[0])
    if measure not in OPENQUAKE:
        raise _hazard_error(path, f"is over {names[0]!r}")
    factor = OPENQUAKE[measure][1] if names[0] in measures else 1.0
    table = np.array([[float(value) for value in row] for row in rows])
    return measure, table[:, 0] / factor, table[:, 1]


def _openquake(
    lines: list[str], path: Path, site: tuple[float, float] | None
) -> tuple[str, NDArray[np.float64], NDArray[np.float64], tuple[float, float]]:
    measures = {imt: (measure, factor) for measure, (imt, factor) in OPENQUAKE.items()}
    imt = re.search(r"imt='([^']+)'", lines[0])
    time = re.search(r"investigation_time=([0-9.eE+-]+)", lines[0])
    if imt is None or time is None or imt[1] not in measures:
        raise _hazard_error(
            path, "states no imt that is known here, or no investigation_time, in its first line"
        )
    header, *rows = list(csv.reader(lines[1:]))
    places = [number for number, name in enumerate(header) if name.startswith("poe-")]
    # Other columns may hold text: a site model's own names (custom_site_id).
    at = [header.index("lon"), header.index("lat"), *places]
    table = np.array([[float(row[place]) for place in at] for row in rows])
    if len(table) > 1 and site is None:
        raise _hazard_error(path, f"has {len(table)} sites: choose one with --site LONGITUDE LATITUDE")
    nearest = _nearest(table, site, path) if site else 0
    measure, factor = measures[imt[1]]
    levels = np.array([float(header[place].removeprefix("poe-")) for place in places])
    # A probability of one in the investigation time is a rate without bound: such points are left out.
    exceeded = np.minimum(table[nearest, 2:], 1.0)
    stated = exceeded < 1.0
    rates = -np.log1p(-exceeded[stated]) / float(time[1])
    return measure, levels[stated] / factor, rates, (float(table[nearest, 0]), float(table[nearest, 1]))


def _nearest(table: NDArray[np.float64], site: tuple[float, float], path: Path) -> int:
    """Row of the site that is meant, of rows that begin with longitude and latitude."""
    asked = f"{site[0]:g} {site[1]:g}"
    if not (-180 <= site[0] <= 360 and -90 <= site[1] <= 90):
        raise InputError(
            what=f"{asked} is no place on Earth",
            where="--site",
            expected="a longitude of -180 to 360 degrees, then a latitude of -90 to 90",
            remedy="give the longitude first: --site LONGITUDE LATITUDE",
        )
    away_km = distance_km(table[:, 0], table[:, 1], site)
    nearest = int(away_km.argmin())
    if not away_km[nearest] <= SITE_REACH_KM:
        raise InputError(
            what=f"the nearest site to {asked}, at longitude {table[nearest, 0]:g} and latitude {table[nearest, 1]:g}, "
            f"is {away_km[nearest]:.0f} km away",
            where=str(path),
            expected=f"a site within {SITE_REACH_KM:g} km",
            remedy="see that the longitude comes first, or compute the hazard at the rock",
        )
    return nearest


def _hazard_error(where: object, what: str) -> InputError:
    return InputError(
        what,
        where=str(where),
        expected="CSV with the columns MEASURE,annual_rate (MEASURE: pga_m_s2, pgv_m_s ... or as OpenQuake "
        "has them, PGA in g, PGV in cm/s), or OpenQuake's hazard_curve CSV",
        remedy="export one site's curve as annual rates of exceedance",
    )
