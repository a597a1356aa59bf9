"""Many fits of one model at once, each with other weights of the same jobs: statsmodels takes 5 ms to set up each."""

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, ndtr, ndtri

Array = NDArray[np.float64]

_STEPS = 30
_EPSILON = float(np.finfo(float).eps)
_TOLERANCE = 1e-9
"""Of a coefficient, relative to itself or to one."""

_EDGES = {"probit": -float(ndtri(_EPSILON)), "logit": -math.log(_EPSILON)}
"""Beyond which a probability counts as that here, as statsmodels has it."""

_AT_ONCE = 200_000
"""Numbers of one table of jobs and samples: more only take memory."""


def refitted(
    design: Array, share: Array, trials: Array, link: str, start: Sequence[float], weights: NDArray[np.int64]
) -> Iterator[Array]:
    """Coefficients at maximum likelihood of each row of weights, by Fisher scoring; nan where the search does not end.

    design: (jobs, coefficients).
    share, trials: (jobs,), of a group's jobs, those that toppled; and their number.
    link: probit or logit.
    start: (coefficients,), those of the fit with all weights one.
    weights: (samples, jobs), how often each group was drawn.
    """
    each = max(1, _AT_ONCE // max(1, len(design)))
    for first in range(0, len(weights), each):
        yield from _scored(design, share, trials * weights[first : first + each], link, np.asarray(start))


def _scored(design: Array, share: Array, trials: Array, link: str, start: Array) -> Array:
    found, left = np.full((len(trials), design.shape[1]), np.nan), np.arange(len(trials))
    at = np.tile(start, (len(trials), 1))
    with np.errstate(all="ignore"):  # what is no number stays in the search, which does not end
        for _ in range(_STEPS):
            step = _step(design, share, trials[left], link, at)
            at = at + step
            ended = (np.abs(step) <= _TOLERANCE * np.maximum(np.abs(at), 1.0)).all(axis=1)
            found[left[ended]] = at[ended]
            left, at = left[~ended], at[~ended]
            if not len(left):
                break
    return found


def _step(design: Array, share: Array, trials: Array, link: str, at: Array) -> Array:
    """Fisher's step of each sample's coefficients: the inverse of the information, times the score."""
    edge = _EDGES[link]
    predictor = np.clip(at @ design.T, -edge, edge)
    if link == "probit":
        probability, slope = ndtr(predictor), np.exp(-(predictor**2) / 2.0) / math.sqrt(2.0 * math.pi)
        other = ndtr(-predictor)
    else:
        probability, other = expit(predictor), expit(-predictor)
        slope = probability * other
    weight = trials * slope / (probability * other)
    score = (weight * (share - probability)) @ design
    information = np.einsum("sj,ja,jb->sab", weight * slope, design, design, optimize=True)
    information[np.linalg.det(information) == 0.0] = np.nan  # too few jobs for the coefficients
    return np.linalg.solve(information, score[:, :, None])[:, :, 0]
