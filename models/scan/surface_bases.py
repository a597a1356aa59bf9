"""Drawn bases over a surface: the rock's own mesh with its hidden base moved, so that every contact is where it is."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator
from scipy.spatial import cKDTree

from toppling.models.arrays import Array
from toppling.models.compiled import Indices
from toppling.models.rock import Rock
from toppling.models.scan.base import Base
from toppling.models.scan.interface import Interface
from toppling.models.scan.sheet import between_nodes, grounded_on
from toppling.models.scan.unseen import DrawnBases
from toppling.models.unseen import BaseDraw, UnseenBase

ROUNDING = 1e-6
"""Share of the height within which a vertex lies in the base that closed the rock."""


def bases_on_surface(
    drawn: DrawnBases, rock: Rock, base: Base, interface: Interface, height_m: float
) -> tuple[Rock, UnseenBase, int | None]:
    """The rock on the draw nearest to the draws' median, all draws for it, and which one that is.

    Parameters
    ----------
    drawn : DrawnBases
    rock : Rock
        Closed with `base`.
    base : Base
    interface : Interface
        With a surface.
    height_m : float
        Of the rock.

    Returns
    -------
    Rock, UnseenBase, int or None
        None where the rock is at rest on none of them; it then stays as it was closed.
    """
    numbers = _base_vertices(rock, base, interface, height_m)
    places = [_moved(rock.vertices_m[numbers], drawn, gap.gap_m, interface) for gap in drawn.gaps]
    middle = np.maximum(np.median(drawn.toppling_m_s2, axis=0), 1e-3)
    apart = np.abs(np.log(np.maximum(drawn.toppling_m_s2, 1e-3) / middle)).mean(axis=1)
    nominal = None
    for number in np.argsort(apart, kind="stable").tolist():
        vertices = rock.vertices_m.copy()
        vertices[numbers] = interface.scene(places[number])
        standing = Rock.from_triangles(vertices, rock.faces, where="closed rock")
        body = grounded_on(standing, interface)
        if body.stands(body.touching(body.pose)):
            rock, nominal = standing, number
            break
    draws = [
        BaseDraw(interface.support(interface.scene(place)), com_m - rock.com_m)
        for place, com_m in zip(places, drawn.com_m, strict=True)
    ]
    return rock, UnseenBase(0.0, tuple(draws), vertices=numbers), nominal


def _base_vertices(rock: Rock, base: Base, interface: Interface, height_m: float) -> Indices:
    """Numbers of the rock's vertices that lie in the hidden part of its base."""
    over = interface.over(rock.vertices_m)
    closed = between_nodes(over[:, :2], interface.lattice_m, lambda nodes: _at_nodes(base, nodes))
    hidden = base.hidden.ravel()[base.grid.index(over)]
    return np.flatnonzero(hidden & (np.abs(over[:, 2] - closed) < ROUNDING * height_m))


def _at_nodes(base: Base, nodes: Array) -> Array:
    return np.asarray(base.grid.at(base.height_m, nodes))


def _moved(vertices_m: Array, drawn: DrawnBases, gap_m: Array, interface: Interface) -> Array:
    """Vertices of the base as u, v and height over the plane, with the gap of a draw."""
    flat, places = interface.flat(vertices_m), drawn.part.observed.places_m
    gap = LinearNDInterpolator(places, gap_m)(flat[:, :2])
    gap = np.where(np.isfinite(gap), gap, NearestNDInterpolator(places, gap_m)(flat[:, :2]))
    touching = np.flatnonzero(gap_m <= 0.0)
    gap[cKDTree(flat[:, :2]).query(places[touching])[1]] = 0.0
    moved = np.column_stack([flat[:, :2], gap])
    return moved + interface.rise(moved)
