"""Places that the user pointed at, against the pedestal that was seen about them."""

from __future__ import annotations

import dataclasses

import numpy as np

from toppling.models.errors import InputError
from toppling.models.frames import slope_of_normal
from toppling.models.scan.doubt import direction_told
from toppling.models.scan.interface import Interface, fit_interface
from toppling.models.scan.interface_hint import InterfaceHint
from toppling.models.scan.segment import ROCK, Segmentation

OFF_PER_HEIGHT = 0.015
"""Of the rock's height: what a measured interface may lie off what was seen."""
_AGREES_PER_HEIGHT = 0.002
"""Of the rock's height: what a place that was pointed at may lie off what was seen and still agree with it."""
_POINTED_PER_HEIGHT = 0.05
"""Of the rock's height: what places that were pointed at may be off in the mean; farther away another pedestal was
meant. One of them may be off by twice as much."""
_PLANE_PER_OFF = 1.0 / 3.0
"""Roughness of a pedestal over how far places lie off it, below which the places are off and not its plane."""


def seen_about_points(hint: InterfaceHint, parts: Segmentation) -> InterfaceHint | None:
    """The pedestal's plane as it was seen, where it is known better than by the places that the user pointed at.

    A place that was clicked or typed is off by some centimetres, by which a plane through a few of them tilts by
    degrees. A measured plane and an outline are taken as they are.

    Parameters
    ----------
    hint : InterfaceHint
    parts : Segmentation
        As split by it.

    Returns
    -------
    InterfaceHint or None
        None where the places agree with what was seen, lie too far off, or the pedestal is no plane.
    """
    if hint.kind != "points":
        return None
    rock = parts.surfel_label == ROCK
    try:
        seen = fit_interface(parts.surfels, rock)
    except InputError:  # next to nothing of it was seen, which is what hints are for
        return None
    height_m = float(np.ptp(parts.surfels.points_m[rock, 2]))
    over_m = seen.flat(hint.anchors_m)[:, 2]
    off_m = float(np.abs(over_m).max())
    if max(abs(float(over_m.mean())), 0.5 * off_m) > _POINTED_PER_HEIGHT * height_m:
        return None
    if off_m < _AGREES_PER_HEIGHT * height_m:
        return None
    if seen.roughness_m > _PLANE_PER_OFF * off_m:
        return None
    return dataclasses.replace(hint, interface=seen)


def points_told(hint: InterfaceHint, seen: Interface) -> str:
    """What to tell of places in whose stead the pedestal's plane was taken as it was seen."""
    heights_m = seen.flat(hint.anchors_m)[:, 2]
    dip_deg, toward_deg = slope_of_normal(seen.normal)
    return (
        f"the places of --point lie {heights_m.min():+.2g} to {heights_m.max():+.2g} m over the pedestal that was seen "
        f"about them, which is a plane within {seen.roughness_m:.2g} m: it was taken instead, and dips by "
        f"{dip_deg:.1f} degrees toward {direction_told(toward_deg)}. An interface that is to be taken as it is given "
        "is said by --plane"
    )
