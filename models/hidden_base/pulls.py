"""Pull tests against draws of a base: how likely each draw makes what was measured, and whether any comes near it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from toppling.models.arrays import Array
from toppling.models.errors import InputError

_PULL_STD_SHARE = 0.05
"""How well a pull or tilt test tells the ratio: of the force's direction, height and reading together."""
_ERROR_STDS = 2.0
"""Standard deviations beyond which a measured ratio contradicts a base."""
_SPANNED_SHARE = 0.99
"""Of the draws' weight: the others were drawn, but next to none of them would be kept."""
Pulls = Sequence[tuple[float, float]]


def likelihood(pulls: Pulls, ratios: Array) -> Array:
    """How likely (n,) draws with such ratios (n, pulls) make what was measured, the likeliest 1."""
    squares = (np.minimum(_misfits(pulls, ratios), 1e3) ** 2).sum(axis=1)
    return np.exp(-0.5 * (squares - squares.min()))


def fits(pulls: Pulls, ratios: Array) -> bool:
    """Whether one base with ratios (pulls,) agrees with all that was measured."""
    return bool((_misfits(pulls, np.asarray(ratios)[None]) <= _ERROR_STDS).all())


def check_spanned(pulls: Pulls, ratios: Array, weight: Array) -> None:
    """Refuse a pull that no draw comes near.

    pulls: sequence of (azimuth_deg, ratio).
    ratios: (n, pulls), what each draw bears toward the azimuths.
    weight: (n,), of the draws, before anything was measured.
    Raises InputError if a ratio lies outside of what the draws span by more than its error.
    """
    error = _ERROR_STDS * _PULL_STD_SHARE
    for (azimuth, ratio), drawn in zip(pulls, ratios.T, strict=True):
        low, high = _span(drawn, weight)
        if low < ratio * (1.0 + error) and high > ratio * (1.0 - error):
            continue
        raise _contradicted(
            f"no drawn base agrees with a largest force of {ratio:g} of the weight toward azimuth {azimuth:g}°: there "
            f"they bear {low:.3g} to {high:.3g}",
            f"--pull {azimuth:g} {ratio:g}",
            f"a ratio that a drawn base bears, within the test's error of {100 * error:.0f} %",
        )


def check_joint(pulls: Pulls, ratios: Array, weight: Array, before: Array) -> None:
    """Refuse pulls with which, although some draw agrees with each, the likeliest draws do not.

    pulls: sequence of (azimuth_deg, ratio).
    ratios: (n, pulls).
    weight, before: (n,), of the draws, with and without what was measured.
    Raises InputError if half of the draws' weight is on bases that contradict a pull.
    """
    agree = (_misfits(pulls, ratios) <= _ERROR_STDS).all(axis=1)
    if weight[agree].sum() >= 0.5 * weight.sum():
        return
    listed = "; ".join(
        "toward azimuth {:g}° they bear {:.3g} to {:.3g}, measured is {:g}".format(
            azimuth, *_span(drawn, before), ratio
        )
        for (azimuth, ratio), drawn in zip(pulls, ratios.T, strict=True)
    )
    raise _contradicted(
        f"next to no drawn base agrees with {'all pulls' if len(pulls) > 1 else 'the pull'}: {listed}",
        "--pull" if len(pulls) > 1 else "--pull {:g} {:g}".format(*pulls[0]),
        f"ratios that one drawn base bears, within the test's error of {100 * _ERROR_STDS * _PULL_STD_SHARE:.0f} %",
    )


def _misfits(pulls: Pulls, ratios: Array) -> Array:
    """Deviations (n, pulls) in standard deviations of the measurement."""
    measured = np.array([ratio for _, ratio in pulls])
    return np.asarray(np.abs(ratios / measured - 1.0) / _PULL_STD_SHARE)


def _span(drawn: Array, weight: Array) -> tuple[float, float]:
    """Between what ratios nearly all of the draws' weight lies."""
    order = np.argsort(drawn)
    below = np.cumsum(weight[order]) / weight.sum()
    tail = 0.5 * (1.0 - _SPANNED_SHARE)
    low, high = np.searchsorted(below, [tail, 1.0 - tail]).clip(max=len(drawn) - 1)
    return float(drawn[order[low]]), float(drawn[order[high]])


def _contradicted(what: str, where: str, expected: str) -> InputError:
    return InputError(
        what,
        where=where,
        expected=expected,
        remedy="check that AZIMUTH is the direction of the pull (the opposite of the ground's acceleration), in "
        "degrees counter-clockwise from east, and RATIO the largest force over the weight; else the interface "
        "(--plane, --point, --outline) or a place of --contact is wrong",
    )
