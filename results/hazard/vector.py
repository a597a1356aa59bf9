"""Vector hazard: joint rate of two intensity measures from their hazard curves.

An earthquake's residuals of two measures are correlated: rho is 0.733 for PGA and PGV (Bradley 2012, Earthquake
Spectra 28:855, table 2). Given one, the logarithm of the other is normal with standard deviation
s = sigma sqrt(1 - rho^2), where sigma is that of its residuals. Two curves state how often each measure is exceeded,
but not in which events; the model here is that an event of PGA x has the PGV exp(g(x) + s epsilon), with an increasing
g such that the rate of exceedance of PGV is that of its curve. This is exact

- for one recurring earthquake (two lognormal curves: g is the regression of one residual on the other);
- for two power laws, where g is the PGV of equal rate, lowered by k s^2 / 2 for an exponent k.

Where many magnitudes and distances give the same PGA, PGV varies with them too, and s is larger; where a model's
residuals are small, s is smaller. Two curves do not determine s: for seven known seismicities and four ground-motion
models (NGA-West2), some s within `SCATTERS` gives the joint rate to 3 %, and intervals are over that range.
OpenQuake draws the residuals of the measures of an event independently (rho = 0): its fields are refused for two
measures at once.
"""

import math

import numpy as np
from scipy.special import ndtr

from toppling.models.arrays import Array
from toppling.models.errors import InputError
from toppling.results.hazard.curves import HazardCurve
from toppling.results.hazard.events import EventBranch

_CORRELATIONS = {("pga_m_s2", "pgv_m_s"): 0.733, ("sa_1s_m_s2", "pgv_m_s"): 0.786}
"""Correlation of the residuals of two measures of one earthquake: Bradley (2012)."""

SIGMA = 0.65
"""Standard deviation of ln PGV about a ground-motion model: Boore et al. (2014) at magnitude 7, 20 km."""

SCATTERS = 0.36, 0.62
"""Range of the standard deviation of ln PGV given PGA for unknown seismicity: from one recurring earthquake to many
near magnitudes."""
READINGS = 5
"""Number of scatters within `SCATTERS`, both ends included, that intervals are over."""
_BINS_PER_E_FOLD = 30
"""Number of bins of the first measure per factor e of intensity."""
_EXTENDED = 3.0
"""Logarithm of the factor of intensity by which curves are extrapolated as power laws."""
_NODES = 16
"""Number of Gauss-Hermite nodes over the second measure, given the first."""
_END_SCATTERS = 4.0
"""Margin at the ends of the second measure's range, in scatters, where sums are incomplete."""
_SATURATED = 0.98
"""Fraction of the largest rate above which a curve is flat, so that the level of a rate is undefined."""
_LEVELS = 320
"""Number of levels of the second measure in the search for g."""
_STEPS = 60
"""Maximum number of iterations of the search for g."""
_CLOSE = 1e-4
"""Shift of ln(intensity) at which the search for g ends."""


def correlation_of(first: str, second: str) -> float | None:
    """Published correlation of the residuals of two measures; None if unknown."""
    return _CORRELATIONS.get((first, second), _CORRELATIONS.get((second, first)))


def joint_rate(first: HazardCurve, second: HazardCurve, scatter: float) -> tuple[EventBranch, float]:
    """Joint rate of two measures from their curves.

    Rates of the first measure below its curve's first point are not counted, and those above its last point are
    extrapolated as a power law over a factor of e^`_EXTENDED`.

    first, second: curves of one site over different measures.
    scatter: standard deviation of ln(second measure) given the first, sigma sqrt(1 - rho^2).
    Returns events at one site, and the largest relative difference of the rates of the second measure from its
    curve, where both curves have rates.
    Raises InputError if the curves are over one measure, or the scatter is invalid.
    """
    if first.measure == second.measure:
        raise _vector_error(
            "hazard.measure_given_twice", f"two curves over {first.measure}", "curves of two measures"
        )
    if not 0 <= scatter < 5:
        raise _vector_error("hazard.scatter_unusable", f"a scatter of {scatter:g}", "a scatter near 0.45")
    low, high = math.log(first.intensity[0]) - _EXTENDED, math.log(first.intensity[-1]) + _EXTENDED
    edges = np.linspace(low, high, math.ceil((high - low) * _BINS_PER_E_FOLD) + 1)
    rates = np.exp(_log_rate(first, edges))
    x = np.append((edges[1:] + edges[:-1]) / 2, edges[-1])
    part = np.append(-np.diff(rates), rates[-1])
    reached = np.append((rates[1:] + rates[:-1]) / 2, rates[-1] / 2)
    centre, misfit = _coupled(second, part, reached, scatter)
    stated = (x >= math.log(first.intensity[0])) & (part > 0)
    nodes, weights = np.polynomial.hermite_e.hermegauss(_NODES)
    values = np.exp(centre[stated, None] + scatter * nodes)
    events = EventBranch(
        f"{first.name} with {second.name}",
        (part[stated, None] * weights / weights.sum()).ravel(),
        {
            first.measure: np.repeat(np.exp(x[stated]), _NODES)[:, None],
            second.measure: values.reshape(-1, 1),
        },
    )
    return events, misfit


def _log_rate(curve: HazardCurve, logarithm: Array) -> Array:
    """Logarithm of the rate of exceedance, extrapolated by the power laws of the end segments."""
    x, rate = np.log(curve.intensity), np.log(curve.annual_rate)
    first, last = (np.diff(rate[ends]) / np.diff(x[ends]) for ends in (slice(0, 2), slice(-2, None)))
    inside = np.interp(logarithm, x, rate)
    return inside + first * np.minimum(logarithm - x[0], 0.0) + last * np.maximum(logarithm - x[-1], 0.0)


def _coupled(second: HazardCurve, part: Array, reached: Array, scatter: float) -> tuple[Array, float]:
    """Log medians of the second measure in the bins of the first, and the misfit of its rates."""
    low, high = math.log(second.intensity[0]) - 3 * _EXTENDED, math.log(second.intensity[-1]) + 3 * _EXTENDED
    y = np.linspace(low, high, _LEVELS)
    falling = _log_rate(second, y) - 1e-9 * np.arange(len(y))  # strictly decreasing where the curve is flat
    wanted = np.interp(-np.log(reached), -falling, y)
    centre = wanted.copy()
    # Near the ends the sum lacks events beyond them: there the shift is that of the nearest interior bin.
    away = _END_SCATTERS * scatter
    inside = np.flatnonzero(
        (wanted > wanted[0] + away) & (wanted < wanted[-1] - away) & (reached < _SATURATED * reached.max())
    )
    if scatter > 0 and len(inside):
        for _ in range(_STEPS):
            modelled = ndtr((centre - y[:, None]) / scatter) @ part
            at = np.interp(
                -np.log(reached), -np.log(np.maximum(modelled, 1e-300)) + 1e-9 * np.arange(len(y)), y
            )
            shift = np.interp(np.arange(len(part)), inside, (at - wanted)[inside])
            centre = np.minimum.accumulate((centre - shift)[::-1])[::-1]
            if np.abs(shift).max() < _CLOSE:
                break
    if not scatter > 0 or not len(inside):
        return centre, 0.0
    ends = reached[inside[[-1, 0]]]
    stated = second.intensity[(second.annual_rate > ends[0]) & (second.annual_rate < ends[1])]
    if not len(stated):
        return centre, 0.0
    found = ndtr((centre - np.log(stated)[:, None]) / scatter) @ part
    return centre, float(np.abs(found / second.rate(stated) - 1.0).max())


def _vector_error(code: str, what: str, expected: str) -> InputError:
    return InputError(
        code,
        what,
        where="--hazard",
        expected=expected,
        remedy="give one curve of each measure, of one site and component",
    )
