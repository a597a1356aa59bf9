"""A warning that a rock may be no free rigid block, and the directions around it in which what was seen is counted."""

from dataclasses import dataclass

import numpy as np

from toppling.models.arrays import Array, Indices
from toppling.models.frames import azimuth_deg, compass_deg
from toppling.models.scan.interface import Interface

SECTORS = 36


@dataclass(frozen=True)
class ScanWarning:
    """Why the answer for a free rigid block may not be this rock's: its kind, and a sentence."""

    kind: str
    sentence: str


def sectors(ways: Array, count: int = SECTORS) -> Indices:
    """Which of so many sectors each of some ways (n, 2 or 3) leads into."""
    turn = np.arctan2(ways[:, 1], ways[:, 0]) / (2.0 * np.pi) + 0.5
    return np.floor(turn * count).astype(np.int64) % count


def widest_gap_deg(shown: Indices) -> tuple[float, float]:
    """Width of the widest range of directions without any of some sectors (k,), in order, and its middle, degrees."""
    empty = np.diff(np.append(shown, shown[0] + SECTORS)) - 1
    widest = int(empty.argmax())
    width = 360.0 / SECTORS
    toward = (shown[widest] + 0.5 * (empty[widest] + 2)) * width - 180.0
    return float(empty[widest] * width), float(toward % 360.0)


def middle(flat_m: Array) -> Array:
    """Middle (2,) of the rectangle around places, u and v."""
    return np.asarray(0.5 * (flat_m[:, :2].min(axis=0) + flat_m[:, :2].max(axis=0)))


def azimuth_text(direction: Array, interface: Interface) -> str:
    """Azimuth and compass bearing of a way (2,) along the interface's u and v, in words."""
    return direction_text(azimuth_deg(interface.axes[:, :2] @ direction))


def direction_text(toward_deg: float) -> str:
    """An azimuth with its compass bearing, in words."""
    return f"azimuth {toward_deg:.0f} (compass {float(compass_deg(toward_deg)):.0f})"
