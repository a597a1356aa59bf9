"""What to observe next on a hidden base: the interval's expected width after each observation, from the draws."""

from __future__ import annotations

from typing import Any

import numpy as np

from toppling.models.arrays import Array, Flags
from toppling.models.frames import STANDARD_GRAVITY_M_S2
from toppling.models.hidden_base.draw_bases import AZIMUTHS_DEG, DrawnBases, interval_of
from toppling.models.hidden_base.evidence import pulls_log_likelihood
from toppling.models.hidden_base.intervals import LOOK, PULL
from toppling.models.scan.interface import Interface

_LOOKED_DEG, _EVERY_DEG = 40.0, 20.0
"""Width of the range of directions in which one looks under a rock, and between one and the next."""


def observations(drawn: DrawnBases, interface: Interface) -> list[dict[str, Any]]:
    """The look and the pull that leave the interval narrowest, by its expected width (median over azimuths and median).

    Each draw in turn is taken for the truth: it gives what would be observed, and the draws are weighted by that. A
    look tells whether rock and pedestal touch in a range of directions from the line of the weight; a pull, toward
    where the rock is pulled, the ratio that it bears.

    Returns
    -------
    list of dict
        `kind` (`look`, `pull`), `from_deg` and `to_deg` (azimuths; of a pull the same), `width`.
    """
    toppling = drawn.toppling_m_s2
    found: list[dict[str, Any]] = []
    for column, azimuth in enumerate(AZIMUTHS_DEG):
        ratios = toppling[:, [column]] / STANDARD_GRAVITY_M_S2
        weight = np.array([np.exp(pulls_log_likelihood([(0.0, max(r, 1e-3))], ratios)) for r in ratios[:, 0]])
        toward = float((azimuth + 180.0) % 360.0)
        width = float(_widths(toppling, weight).mean())
        found.append({"kind": PULL, "from_deg": toward, "to_deg": toward, "width": width})
    for first, touches in _looks(drawn, interface):
        share = float(touches.mean())
        width = share * _widths(toppling, touches[None].astype(float))[0] if share else 0.0
        width += (1.0 - share) * _widths(toppling, (~touches[None]).astype(float))[0] if share < 1.0 else 0.0
        found.append({"kind": LOOK, "from_deg": first, "to_deg": first + _LOOKED_DEG, "width": float(width)})
    found.sort(key=lambda look: look["width"])
    return [next(look for look in found if look["kind"] == kind) for kind in (LOOK, PULL)]


def _looks(drawn: DrawnBases, interface: Interface) -> list[tuple[float, Flags]]:
    """First azimuth of each range of directions, and which draws (n,) touch in it."""
    turns = []
    for gap, com_m in zip(drawn.gaps, drawn.com_m, strict=True):
        flat = drawn.part.observed.places_m[gap.gap_m <= 0.0] - interface.projected_m(com_m[None])[0]
        east, north = (flat @ interface.axes[:2, :2].T).T
        turns.append(np.rad2deg(np.arctan2(north, east)))
    return [
        (float(first), np.array([(np.mod(turn - first, 360.0) < _LOOKED_DEG).any() for turn in turns]))
        for first in np.arange(0.0, 360.0, _EVERY_DEG)
    ]


def _widths(toppling_m_s2: Array, weight: Array) -> Array:
    """Widths (k,) of the interval over draws (n, azimuths) with each of some weights (k, n)."""
    low, median, high = interval_of(toppling_m_s2, weight)
    return np.asarray(np.median((high - low) / np.maximum(median, 1e-9), axis=1))
