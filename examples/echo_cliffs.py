"""The rock at Echo Cliffs, as far as Veeraraghavan, Hudnut and Krishnan (2017) print it; the rest is made up.

Printed are its size, its overhang, how much of its base lies beyond the cliff's edge, the slope below it, and the
static toppling accelerations toward either side of the edge. The base's radius and how far the top leans back from the
cliff are what these accelerations leave open and fix.

    python examples/echo_cliffs.py scenes/echo_cliffs
"""

import sys

import numpy as np
import trimesh

from toppling import Scene

_HEIGHT_M, _LENGTH_M, _WIDTH_M = 13.55, 10.0, 8.0
"""Extents of the rock along the interface's normal (14 m plumb), toward the cliff, across (8 m: figure 1)."""

_SLOPE_DEG, _DOWNHILL_AZIMUTH_DEG = 5.0, 135.0
"""Azimuth of the interface plane's dip. Toward the same azimuth the rock overhangs, and the cliff looks."""

_OVERHANG_M = 3.65
"""How far the rock reaches beyond the cliff's edge, along the interface: 4 m in plan."""

_EDGE_FRACTION = 0.404
"""In radii of the base, from its centre: a quarter of a disc's area lies beyond."""

_BASE_RADIUS_M, _LEAN_M = 2.46, 0.25
"""With which ground that accelerates toward 135 degrees topples the rock at 3.65 m/s2, as printed, and ground that
accelerates toward 315 degrees at the least of those printed, 2 m/s2."""

_NOSE_FRACTION = 0.7
"""Fraction of the length from where the rock is widest toward the cliff."""

_PROFILE = (
    (0.32, 1.0, 0.0),
    (0.54, 0.95, 0.3),
    (0.71, 0.78, 0.7),
    (0.87, 0.55, 1.0),
    (0.96, 0.3, 1.0),
    (1.0, 0.1, 1.0),
)
"""Rings above the base: height, size and lean, of the largest."""

_SIDES = 24
_REACH_M, _DROP_M, _BATTER_M = 20.0, 16.0, 0.2
"""Half of the pedestal's extent; height of its cliff, and how far the cliff's foot stands out from its edge."""

_Mesh = tuple[np.ndarray, np.ndarray]


def echo_cliffs() -> Scene:
    """A convex rock that stands over the edge of a cliff, on the pedestal's own surface; friction 1."""
    edge_m = _EDGE_FRACTION * _BASE_RADIUS_M
    slope, azimuth = np.radians(_SLOPE_DEG), np.radians(_DOWNHILL_AZIMUTH_DEG)
    across = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    down = np.array([np.cos(slope) * np.cos(azimuth), np.cos(slope) * np.sin(azimuth), -np.sin(slope)])
    axes = np.column_stack([down, across, np.cross(down, across)])
    (rock, faces), (ground, triangles) = _rock(edge_m), _pedestal(edge_m)
    return Scene.from_mesh((rock @ axes.T, faces), friction=1.0, pedestal=(ground @ axes.T, triangles))


def _rock(edge_m: float) -> _Mesh:
    """Hull of horizontal rings: a round base, and above it ovals with a nose toward x, over the cliff."""
    angle = 2.0 * np.pi * np.arange(_SIDES) / _SIDES
    across, along = np.sin(angle), np.cos(angle)
    nose_m, back_m = _NOSE_FRACTION * _LENGTH_M, (1.0 - _NOSE_FRACTION) * _LENGTH_M
    widest_m = edge_m + _OVERHANG_M - nose_m
    rings = [np.column_stack([_BASE_RADIUS_M * along, _BASE_RADIUS_M * across, np.zeros(_SIDES)])]
    for height, size, lean in _PROFILE:
        x = widest_m - lean * _LEAN_M + size * np.where(along > 0.0, nose_m, back_m) * along
        rings.append(
            np.column_stack([x, 0.5 * size * _WIDTH_M * across, np.full(_SIDES, height * _HEIGHT_M)])
        )
    hull = trimesh.convex.convex_hull(np.vstack(rings))
    return np.asarray(hull.vertices), np.asarray(hull.faces)


def _pedestal(edge_m: float) -> _Mesh:
    """A level top that ends at x = `edge_m`, and the cliff below."""
    foot_m = edge_m + _BATTER_M
    corners = [(-_REACH_M, 0.0), (edge_m, 0.0), (foot_m, -_DROP_M)]
    vertices = np.array([(x, y, z) for x, z in corners for y in (-_REACH_M, _REACH_M)])
    return vertices, np.array([(0, 2, 1), (1, 2, 3), (2, 4, 3), (3, 4, 5)])


if __name__ == "__main__":
    print(echo_cliffs().save(sys.argv[1] if len(sys.argv) > 1 else "scenes/echo_cliffs"))
