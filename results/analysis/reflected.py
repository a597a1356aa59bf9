"""Bootstrap samples of a probit fit whose percentiles are intervals of what depends on its spread, from few records.

Percentiles of a plain bootstrap take the spread of refits for the error of the fit. Of few records, whose jobs are not
independent, beta comes out too small in the fit and smaller again in the refits, so that intervals of beta and of all
that hangs on it (a rate of toppling) lie too low. Here each refit is reflected about the fit (the basic bootstrap:
Davison and Hinkley 1997, Bootstrap methods and their application, section 5.2), in coordinates that are nearly normal:
location, logarithm of the spread and, of two measures, their direction. Deviations are widened as those of a regression
of p coefficients on n records are: by sqrt(n / (n - p)), and by Student's t of n - p over the normal quantile
(Hesterberg 2015, of means).
"""

import math

import numpy as np
from scipy.special import ndtri
from scipy.stats import t

from toppling.models.arrays import Array

_TAIL = 0.975
"""Of the intervals of 95 %, which are wanted most."""

_FARTHEST = 4.0
"""Of a reflected sample from the fit, in logarithms of the median and of beta: beyond it a refit means nothing."""


def reflected(fitted: Array, refits: Array, records: int) -> Array:
    """Coefficients whose percentiles are the ends of intervals.

    fitted: (p,), coefficients of a fit to one or two measures.
    refits: (k, p), of the samples.
    records: number that are drawn.
    Returns (k, p) array: as they were for a sample too far from the fit to mean anything.
    """
    to, back = (_of_line, _line) if len(fitted) == 2 else (_of_plane, _plane)
    freedom = records - len(fitted)
    wider = math.sqrt(records / freedom) * t.ppf(_TAIL, freedom) / ndtri(_TAIL)
    centre, away = to(fitted), to(refits) - to(fitted)
    if len(fitted) == 3:
        away[:, 2] = (away[:, 2] + math.pi) % (2 * math.pi) - math.pi
    near = np.all(np.abs(away[:, :2]) < _FARTHEST, axis=1, keepdims=True)
    return np.where(near, back(centre - wider * away), refits)


def _of_line(coefficients: Array) -> Array:
    intercept, slope = np.moveaxis(coefficients, -1, 0)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.stack([-intercept / slope, np.log(slope)], axis=-1)


def _line(coordinates: Array) -> Array:
    location, logarithm = np.moveaxis(coordinates, -1, 0)
    slope = np.exp(logarithm)
    return np.stack([-location * slope, slope], axis=-1)


def _of_plane(coefficients: Array) -> Array:
    intercept, first, second = np.moveaxis(coefficients, -1, 0)
    steepness = np.hypot(first, second)
    return np.stack([-intercept / steepness, np.log(steepness), np.arctan2(second, first)], axis=-1)


def _plane(coordinates: Array) -> Array:
    location, logarithm, direction = np.moveaxis(coordinates, -1, 0)
    steepness = np.exp(logarithm)
    return np.stack(
        [-location * steepness, steepness * np.cos(direction), steepness * np.sin(direction)], axis=-1
    )
