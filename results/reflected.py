"""Bootstrap samples of a probit fit, studentised: intervals of what depends on its spread, from few records.

Percentiles of a plain bootstrap take the spread of refits for the error of the fit. Of few records, whose jobs are not
independent, beta comes out too small in the fit and smaller again in the refits, so that intervals of beta and of all
that hangs on it (a rate of toppling) lie too low. Here each refit's deviation from the fit is measured in its own
standard errors, turned round, and given the fit's: the multivariate form of the bootstrap-t (Efron and Tibshirani
1993, An introduction to the bootstrap, section 12.5). Standard errors are sandwiches over records (Liang and Zeger
1986), in coordinates that are nearly normal: location, logarithm of the spread and, of two measures, their direction.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from toppling.models.arrays import Array

FARTHEST = 4.0
"""Of a turned sample from the fit, in logarithms of the median and of beta: beyond it standard errors mean nothing."""

STEP = 1e-6
"""Of the derivatives of coordinates."""


def studentised(
    design: Array,
    share: Array,
    trials: Array,
    codes: NDArray[np.int64],
    fitted: Array,
    refits: Array,
    drawn: Array,
) -> Array:
    """Coefficients whose percentiles are those of the bootstrap-t.

    Parameters
    ----------
    design : (n, p) array
        Ones, then the logarithms of one or two measures.
    share, trials : (n,) arrays
        Of toppled jobs in each group of jobs, and their weight.
    codes : (n,) array
        Record of each group.
    fitted : (p,) array
        Coefficients of the fit.
    refits : (k, p) array
        Of the samples.
    drawn : (k, records) array
        How often each record is in each sample.

    Returns
    -------
    (k, p) array
        As they were for a sample whose standard errors do not exist, or are too large to mean anything.
    """
    to, back = (_of_line, _line) if design.shape[1] == 2 else (_of_plane, _plane)
    once = np.ones(drawn.shape[1])
    whole = _root(design, share, trials, codes, fitted, once, to)
    if whole is None:
        return refits
    centre, found = to(fitted), refits.copy()
    for number, (coefficients, times) in enumerate(zip(refits, drawn, strict=True)):
        root = _root(design, share, trials, codes, coefficients, times, to)
        if root is None:
            continue
        turned = back(centre - whole @ np.linalg.solve(root, to(coefficients) - centre))
        if np.isfinite(turned).all() and (np.abs(to(turned) - centre)[:2] < FARTHEST).all():
            found[number] = turned
    return found


def _root(
    design: Array, share: Array, trials: Array, codes: NDArray[np.int64], coefficients: Array, times: Array,
    to: Callable[[Array], Array],
) -> Array | None:  # fmt: skip
    """Cholesky root of the covariance of the coordinates; None where there is none."""
    eta = design @ coefficients
    mean = np.clip(ndtr(eta), 1e-12, 1 - 1e-12)
    density = np.exp(-(eta**2) / 2) / np.sqrt(2 * np.pi)
    weight = trials * density / (mean * (1 - mean))
    bread = (design * (weight * density * times[codes])[:, None]).T @ design
    scores = np.zeros((len(times), design.shape[1]))
    np.add.at(scores, codes, design * (weight * (share - mean))[:, None])
    slopes = np.array([
        (to(coefficients + step) - to(coefficients - step)) / (2 * STEP) for step in STEP * np.eye(design.shape[1])
    ]).T  # fmt: skip
    try:
        half = slopes @ np.linalg.inv(bread)
        return np.linalg.cholesky(half @ (scores.T * times) @ scores @ half.T)
    except np.linalg.LinAlgError:
        return None


def _of_line(coefficients: Array) -> Array:
    intercept, slope = coefficients
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.array([-intercept / slope, np.log(slope)])


def _line(coordinates: Array) -> Array:
    slope = np.exp(coordinates[1])
    return np.array([-coordinates[0] * slope, slope])


def _of_plane(coefficients: Array) -> Array:
    intercept, *slopes = coefficients
    steepness = np.hypot(*slopes)
    return np.array([-intercept / steepness, np.log(steepness), np.arctan2(slopes[1], slopes[0])])


def _plane(coordinates: Array) -> Array:
    steepness, direction = np.exp(coordinates[1]), coordinates[2]
    return np.array([
        -coordinates[0] * steepness, steepness * np.cos(direction), steepness * np.sin(direction),
    ])  # fmt: skip
