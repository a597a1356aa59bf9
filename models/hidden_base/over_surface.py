"""Drawn bases over a surface: the rock's own mesh with its hidden base moved, so that every contact is where it is."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator
from scipy.spatial import cKDTree

from toppling.models.arrays import Array
from toppling.models.compiled import Indices
from toppling.models.frames import STANDARD_GRAVITY_M_S2
from toppling.models.ground.body import GroundedBody
from toppling.models.hidden_base.draws import BaseDraw, UnseenBase
from toppling.models.hidden_base.from_scan import DrawnBases
from toppling.models.hidden_base.statics import FRICTION
from toppling.models.hidden_base.underside import Base
from toppling.models.kept import kept
from toppling.models.pedestal import Pedestal
from toppling.models.rock import Rock
from toppling.models.scan.crevice import grid_triangles
from toppling.models.scan.interface import Interface
from toppling.models.scan.sheet import between_nodes, lattice

_AROUND_LATTICES = 12.0
"""Distance beyond the rim over which a rock is tipped on the surface."""

Planes = Array
"""(k, 3): heights h = a + b u + c v."""
_ROUNDING = 1e-6
"""Share of the height within which a vertex lies in the base that closed the rock."""


def bases_on_surface(
    drawn: DrawnBases,
    rock: Rock,
    base: Base,
    interface: Interface,
    height_m: float,
    *,
    as_closed: bool = False,
) -> tuple[Rock, UnseenBase, int | None]:
    """The rock on the draw nearest to the draws' median, all draws for it, and which one that is.

    rock: closed with `base`.
    interface: with a surface.
    height_m: of the rock.
    as_closed: the rock stays as it was closed.
    Returns Rock, UnseenBase, int or None: None where the rock stays as it was closed, or is at rest on none of the
    draws; it then does so too.
    """
    numbers = _base_vertices(rock, base, interface, height_m)
    places = [_moved(rock.vertices_m[numbers], drawn, gap.gap_m, interface) for gap in drawn.gaps]
    nominal = None
    likeliest = np.argsort(drawn.apart(drawn.toppling_m_s2), kind="stable").tolist()
    for number in [] if as_closed else likeliest:
        vertices = rock.vertices_m.copy()
        vertices[numbers] = interface.scene(places[number])
        standing = Rock.from_triangles(vertices, rock.faces, where="closed rock")
        body = _grounded_on(standing, interface)
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
    return np.flatnonzero(hidden & (np.abs(over[:, 2] - closed) < _ROUNDING * height_m))


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


@kept
def surface_of(interface: Interface) -> Pedestal:
    """The pedestal below a rock as its interface describes it: the carried surface as a mesh, or the endless plane."""
    sheet = interface.sheet
    if sheet is None:
        return Pedestal(interface.point_m, interface.normal)
    reach = _AROUND_LATTICES * sheet.lattice_m
    nodes = lattice(sheet, sheet.ring_m.min(axis=0) - reach, sheet.ring_m.max(axis=0) + reach)
    flat = np.column_stack([nodes.reshape(-1, 2), sheet.at(nodes).ravel()])
    return Pedestal(
        interface.point_m, interface.normal, interface.scene(flat), grid_triangles(nodes.shape[:2])
    )


def _grounded_on(rock: Rock, interface: Interface) -> GroundedBody:
    """A rock on the carried surface, with the friction that every scanned scene has by default."""
    return GroundedBody.of(rock, surface_of(interface), STANDARD_GRAVITY_M_S2, (FRICTION, FRICTION))
