"""Cases with exact answers, in groups of a kind: `front.py` runs them."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from toppling.models.scene import Scene

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
sys.path.insert(0, str(Path(__file__).parent.parent / "tests" / "verification"))
import engine_cases as case

BLOCKS = ((10.0, 1.0), (18.4349, 0.632), (30.0, 2.0))
"""Slenderness, degrees, and half diagonal, m, of the blocks that rock freely."""


def free_rocking(preset: Any) -> list[Any]:
    """Blocks released at a half and at nine tenths of their slenderness."""
    return [case.free_rocking(*block, share, preset) for block in BLOCKS for share in (0.5, 0.9)]


def small_swings(preset: Any) -> list[Any]:
    """A block let go at three and at one hundredth of its slenderness, eight swings long."""
    return [error for share in (0.03, 0.01) for error in case.small_swing_errors(share, preset)]


def thresholds(preset: Any) -> list[Any]:
    """Full sines that overturn without and after an impact, and a rectangular pulse."""
    return [
        case.full_sine_error(18.4349, 0.632, 4.0, preset, span=0.05),
        case.full_sine_error(18.4349, 0.632, 3.0, preset, "after impact", span=0.05),
        case.full_sine_error(5.0, 0.05, 4.0, preset, span=0.05),
        case.pulse_error(18.4349, 0.632, 0.5, preset, span=0.05),
    ]


def many_feet(preset: Any) -> list[Any]:
    """Full sines that overturn prisms whose bases have 12 to 48 feet."""
    return [
        case.many_contacts_error(sides, leading, preset, span=0.05)
        for sides, leading in ((12, "edge"), (24, "edge"), (48, "edge"), (29, "vertex"))
    ]


def slips(preset: Any) -> list[Any]:
    """A flat block on the level and on a slope, under pulses, and an oblong one sent off across its axes."""
    return [
        case.slip_error(0.6, 0, 0, 1.2, 0.1, preset, 0),
        case.slip_error(0.6, 0, 0, 1.2, 0.1, preset, 30),
        case.slip_error(0.6, 5, 135, 1.2, 0.1, preset, 315),
        case.sliding_error(case.plate((0.5, 1.5, 0.05)), 30, preset),
    ]


def drops(preset: Any) -> list[Any]:
    """A cube dropped flat: its largest distance from where it should be, falling and then at rest, over the drop."""
    found, scene = [], Scene.block(0.5, 0.5, 0.5, friction=0.5)
    options = {"trajectory": True, "shortcuts": False}
    for drop in (0.1, 0.2, 0.35):
        start = {"position_m": (0.0, 0.0, 0.5 + drop)}
        path = case.shake(scene, case.STILL, preset, initial=start, **options).trajectory
        exact = np.maximum(drop - 0.5 * case.G * path.time_s**2, 0.0)
        found.append(np.abs(path.position_m[:, 2] - 0.5 - exact).max() / drop)
    return found


def wobbles(preset: Any) -> list[Any]:
    """A tall and a thin cylinder on their rims."""
    return [case.wobble_error(0.2, half_height, 10, preset, sides=256) for half_height in (0.6, 0.02)]


def many_corners(preset: Any) -> list[Any]:
    """Bases of 8, 16 and 32 corners on an arc."""
    return [case.many_corners_error(corners, preset) for corners in (8, 16, 32)]


CASES: tuple[tuple[tuple[str, ...], Callable[[Any], list[Any]]], ...] = (
    (("time to the first impact", "impact ratio", "energy lost in an impact"), free_rocking),
    (("decay of small swings",), small_swings),
    (("overturning threshold",), thresholds),
    (("threshold on many feet",), many_feet),
    (("slip",), slips),
    (("dropped body",), drops),
    (("rate of wobble",), wobbles),
    (("energy after many corners",), many_corners),
)
TARGET_OF_STANDARD = {
    "time to the first impact": 0.002,
    "impact ratio": 0.002,
    "energy lost in an impact": 0.03,
    "overturning threshold": 0.002,
    "threshold on many feet": 0.002,
    "slip": 0.002,
    "rate of wobble": 0.01,
}


def worst_errors(found: list[Any], labels: tuple[str, ...]) -> np.ndarray:
    """Largest error (labels,) of each kind among what a group's cases found."""
    return np.asarray(np.abs(np.array(found, float).reshape(-1, len(labels))).max(axis=0))
