"""Statics of a rock on one drawn base: on the plane, on the surface carried below it."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, cKDTree

from toppling.models.arrays import Array
from toppling.models.frames import STANDARD_GRAVITY_M_S2, horizontal_unit_vector
from toppling.models.ground.facet_path import Seat
from toppling.models.hidden_base.gap import Base, GapDraw
from toppling.models.hidden_base.near_interface import SIDE_TANGENT
from toppling.models.hidden_base.observed import BAND_PER_HEIGHT, HiddenPart, clearances
from toppling.models.hidden_base.unseen_base import feet_above_m, least_feet
from toppling.models.pedestal import ContactProperties, Pedestal
from toppling.models.pivots import tips_m_s2
from toppling.models.rock import Rock
from toppling.models.scan.interface import Interface

FRICTION = ContactProperties().friction_static
"""Friction of a scanned scene unless another is given."""
FEET_PER_HEIGHT = 1e-4
"""Feet are left out while the hull of the others stays within this share of the height. With a larger one a rounded
base is a polygon, on which a slender rock topples too late."""
_ABOVE_THE_RIM_PER_HEIGHT = 0.002
"""The rock's side starts so far above its rim."""
_HIGH_FEET_PER_HEIGHT = 0.3
"""Higher ones come down only when the rock has toppled."""


@dataclass(frozen=True, eq=False)
class DrawStatics:
    """The rock on its interface plane, ready to be tipped on any draw."""

    rock: Rock
    interface: Interface
    part: HiddenPart
    side: Array
    high: Array
    height_m: float

    @classmethod
    def of(cls, rock: Rock, interface: Interface, part: HiddenPart, height_m: float) -> DrawStatics:
        """The rock with what stays of it on every draw."""
        side, high = _outside_feet(rock, interface, part, height_m)
        com = interface.flat(rock.com_m[None])[0]
        high = high[high[:, 2] < _HIGH_FEET_PER_HEIGHT * height_m]
        above = np.array([[*com[:2], 2.0 * com[2]]])
        few = least_feet(high, above, com, FEET_PER_HEIGHT * height_m)
        return cls(rock, interface, part, side, few, height_m)

    def few_feet(self, gap: GapDraw, com_m: Array) -> Array:
        """Feet (k, 3) of a draw that decide how it rocks, as a scene keeps them: u, v and clearance."""
        low = _low_feet(self.part, gap, self.side, self.height_m)
        com = self.interface.flat(com_m[None])[0]
        return least_feet(low, self.high, com, FEET_PER_HEIGHT * self.height_m)

    def path_m_s2(
        self, gap: GapDraw, com_m: Array, azimuths_deg: tuple[float, ...], few: Array | None = None
    ) -> tuple[Array, Array]:
        """Quasi-static accelerations (n,) at lift-off and at toppling on one draw; over a surface both at toppling.

        few: its feet, where not all of them are to be tipped over.
        """
        low = _low_feet(self.part, gap, self.side, self.height_m)
        feet = np.vstack([low if few is None else few, self.high])
        rock = dataclasses.replace(self.rock, com_m=com_m, feet_m=self.interface.scene(feet))
        plane = Pedestal(self.interface.point_m, self.interface.normal)
        if not self.interface.is_plane:
            tips = tips_on_surface(rock, self.rock.half_diagonal_m, low, self.interface, azimuths_deg)
            return tips, tips
        seat = Seat.of(rock, plane)
        lift_off, toppling = zip(
            *(seat.path(STANDARD_GRAVITY_M_S2, azimuth) for azimuth in azimuths_deg), strict=True
        )
        return np.array(lift_off), np.array(toppling)


def _outside_feet(rock: Rock, interface: Interface, part: HiddenPart, height_m: float) -> tuple[Array, Array]:
    """The rock's vertices beside the hidden base, within the band above the plane, and those above it (u, v, h)."""
    band_m = BAND_PER_HEIGHT * height_m
    flat = _hull_over(rock, interface)
    high = flat[flat[:, 2] >= band_m]
    if part.pedestal is not None and interface.sheet is None:
        high = interface.flat(feet_above_m(rock, part.pedestal, band_m))  # those that shakes take
    grid, side = part.under.grid, part.side_m
    unseen = flat[(flat[:, 2] < band_m) & ~part.under.hidden.ravel()[grid.index(flat)]]
    unseen = clearances(unseen, interface, part.pedestal)
    side = side[side[:, 2] < band_m]
    if len(side):
        unseen = unseen[cKDTree(side[:, :2]).query(unseen[:, :2])[0] > 4.0 * grid.cell_m]
    return np.vstack([side, unseen]), high


def _low_feet(part: HiddenPart, gap: GapDraw, side: Array, height_m: float) -> Array:
    """Feet of a draw (n, 3): its gaps, and the rock's side above its rim; none beyond the pedestal's edge."""
    places = np.column_stack([part.observed.places_m, gap.gap_m])
    unseen = part.under.side
    if unseen is not None:  # without what would lie below the side of a draw whose rim ends sooner
        side = side[side[:, 2] >= SIDE_TANGENT * unseen.beyond_m(side, gap.number)]
    rim = places[part.inner :]
    if len(rim) and len(side):
        starts = rim[cKDTree(rim[:, :2]).query(side[:, :2])[1], 2] + _ABOVE_THE_RIM_PER_HEIGHT * height_m
        places = np.vstack([places, side[side[:, 2] > starts]])
    return places[~part.beyond.ravel()[part.under.grid.index(places)]]


def _hull_over(rock: Rock, interface: Interface) -> Array:
    """The rock's vertices (n, 3) that can touch: u, v and the height over the interface."""
    if interface.is_plane:
        return interface.flat(rock.hull_vertices_m)
    over = interface.over(rock.vertices_m)
    return over[ConvexHull(over).vertices]


def tips_on_surface(
    rock: Rock, size_m: float, contacts: Array, interface: Interface, azimuths_deg: tuple[float, ...]
) -> Array:
    """Ground accelerations (n,) at which a rock tips without slip over its contacts with a surface, m/s2.

    The rests on the way to toppling follow from the clearances of the rock's feet, which close with small turns as over
    a plane; at which acceleration it leaves each of them, from where the contacts (m, 3: u, v, clearance), of which the
    feet are the outermost, then touch, along the surface's normals: on facets those within the outline count too.
    """
    seat = Seat.of(rock, Pedestal(interface.point_m, interface.normal))
    above = (interface.scene(contacts) - rock.com_m) @ seat.frame.T + seat.com
    rests = []
    for row, azimuth in enumerate(azimuths_deg):
        for turn, _, _ in seat.rests(STANDARD_GRAVITY_M_S2, azimuth):
            rests.append((row, turn, above @ turn[2] <= (seat.points @ turn[2]).min() + seat.tolerance_m))
    ever = np.any([touching for *_, touching in rests], axis=0) if rests else np.zeros(len(contacts), bool)
    down, contacts = interface.axes.T, contacts[ever]
    places = contacts + interface.rise(contacts)
    # Where two facets meet, along the second axis, a foot stands on both.
    aside = 0.5 * interface.lattice_m * np.array([[1.0, 0.0, 0.0]])
    sides = [interface.normals(contacts + aside), interface.normals(contacts - aside)]
    com, change = interface.flat(rock.com_m[None])[0], down @ seat.frame.T
    gravity, found = down @ np.array([0.0, 0.0, -STANDARD_GRAVITY_M_S2]), np.zeros(len(azimuths_deg))
    for row, turn, touching in rests:
        normals = np.vstack([side[touching[ever]] for side in sides])
        arms = np.tile((places[touching[ever]] - com) @ (change @ turn @ change.T).T, (2, 1))
        push = -down @ horizontal_unit_vector(azimuths_deg[row])
        found[row] = max(found[row], tips_m_s2(arms, normals, size_m, gravity, push) or 0.0)
    return found


def base_taken(
    part: HiddenPart, base: Base, gap_m: Array, rock: Rock, interface: Interface
) -> tuple[Array, float]:
    """Shift (3,) of the centre of mass, m, by what a draw takes from the rock as closed, and its volume, m3."""
    places = part.observed.places_m[: part.inner]
    lower, upper = base.grid.at(base.height_m, places), gap_m[: part.inner]
    closes = part.in_closing
    cell_m2 = part.width_m**2 / int(closes.sum())
    if base.passage is not None:
        closes &= ~base.passage.ravel()[base.grid.index(places)]
    taken = np.where(closes, upper - lower, 0.0) * cell_m2
    com = interface.flat(rock.com_m[None])[0]
    arms = np.column_stack([places, 0.5 * (upper + lower)]) + interface.rise(places) - com
    shift_m = interface.axes @ -(taken[:, None] * arms).sum(axis=0) / rock.volume_m3
    return shift_m, float(taken.sum())
