"""What the scan knows about its own result: the standing rock, how sure the split is, and how slender it is."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, cKDTree

from toppling.models.arrays import Array, Flags
from toppling.models.hidden_base.near_interface import NearInterface, SidesSeen
from toppling.models.hidden_base.statics import on_plane, on_surface
from toppling.models.hidden_base.underside import CORES_OF_HOLES, hidden_base
from toppling.models.rock import Rock
from toppling.models.scan.close import ClosedRock, close_rock
from toppling.models.scan.doubt import SECTORS, middle, sectors
from toppling.models.scan.interface import Interface
from toppling.models.scan.interface_hint import InterfaceHint
from toppling.models.scan.segment import PEDESTAL, ROCK, Segmentation
from toppling.models.scan.surfels import Surfels
from toppling.models.scene import Scene
from toppling.models.statics import CONTACT_SHARE_OF_HEIGHT

AZIMUTHS_DEG = np.arange(0.0, 360.0, 10.0)
_BESIDE_PER_HEIGHT = 0.02
"""Pedestal seen this near to the rock shows the crevice."""
_SUPPORT_PER_HEIGHT = 0.02
"""What lies so near to the interface could touch it."""


@dataclass(frozen=True, eq=False)
class ObservedRock:
    """What was seen of rock and pedestal."""

    # (n, 3): points about the interface, scene frame.
    rock_m: Array
    pedestal_m: Array
    # (n, 3): those of them that shape the base (`near_the_interface`).
    low_m: Array
    lit_m: Array
    surfels: Surfels
    patches: Flags  # (k,): which surfels are the rock's
    height_m: float
    hint: InterfaceHint | None  # the interface as the user knows it

    @cached_property
    def patches_apart(self) -> float:
        """Median distance of the rock's patches to their fourth neighbours, in their width: 1.1 where they touch."""
        points = self.surfels.points_m[self.patches]
        return float(np.median(cKDTree(points).query(points, k=5)[0][:, 4])) / self.surfels.voxel_m

    def near(self, interface: Interface) -> NearInterface:
        """What shapes the base over an interface, with the rim below sides that were seen higher up only."""
        low, lit = interface.over(self.low_m), interface.over(self.lit_m)
        if not len(low):
            return NearInterface(low, lit, self.height_m)
        sides = SidesSeen.of(
            interface.over(self.surfels.points_m[self.patches]),
            self.surfels.normals[self.patches] @ interface.axes,
            middle(low),
        )
        return NearInterface(low, lit, self.height_m, sides.led_down(0.0))


def close_standing(observed: ObservedRock, interface: Interface) -> tuple[ClosedRock, float]:
    """Close the rock on the narrowest feet on which it stands, and say how narrow: it stood when it was scanned."""
    near = observed.near(interface)
    cores = CORES_OF_HOLES if observed.hint is None or not observed.hint.encloses else CORES_OF_HOLES[:1]
    for core in cores:
        base = hidden_base(near, core, observed.hint, interface=interface)
        closed = close_rock(observed.surfels, observed.patches, base, interface)
        if stands(closed.rock, interface) or outside_support_m(closed.rock, interface) > 0.0:
            break  # no feet hold a rock whose centre of mass hangs beside all of its base
    return closed, core


def outside_support_m(rock: Rock, interface: Interface, share: float = _SUPPORT_PER_HEIGHT) -> float:
    """How far the vertical through the centre of mass passes outside all that is within a share of the height."""
    over = interface.over(rock.vertices_m)
    low = over[:, 2] < share * rock.height_m
    if interface.edge is not None:
        low &= interface.edge.carries(over)
    if low.sum() < 3:
        return np.inf
    places = interface.flat(rock.vertices_m)[low, :2]
    if interface.sheet is not None:  # where plumb lines through them pierce the plane, as that of the weight
        places = interface.projected_m(rock.vertices_m[low])
    hull = ConvexHull(places)
    projected = interface.projected_m(rock.com_m[None])[0]
    return float((hull.equations[:, :2] @ projected + hull.equations[:, 2]).max())


def stands(rock: Rock, interface: Interface) -> bool:
    """Whether the rock stays up by itself."""
    if not interface.is_plane:
        return outside_support_m(rock, interface, CONTACT_SHARE_OF_HEIGHT) < 0.0
    return bool((toppling(rock, interface, AZIMUTHS_DEG[::3]) > 0.0).all())


def toppling(rock: Rock, interface: Interface, azimuths_deg: Array) -> Array:
    """Quasi-static toppling accelerations (n,) on the interface plane, or the surface carried below the rock, m/s2."""
    if not interface.is_plane:
        return on_surface(rock, interface, azimuths_deg)
    return on_plane(rock, interface, azimuths_deg)


def slenderness(scene: Scene, nominal_m_s2: list[float] | None = None) -> list[dict[str, float]]:
    """Slenderness angle by the azimuth toward which the rock topples.

    From the accelerations toward evenly spaced azimuths from 0 on where they are known already (`nominal_m_s2`).

    tan(alpha) = a / g (Anooshehpoor, Brune and Zeng 2004), a the quasi-static toppling acceleration of the ground
    the other way: for a flat sharp base the angle between the vertical and the line from the centre of mass to the
    edge about which it tips.
    """
    ground = (AZIMUTHS_DEG + 180.0) % 360.0
    if nominal_m_s2 is None:
        table = scene.quasi_static_toppling_m_s2(ground)
    else:
        at = 360.0 / len(nominal_m_s2) * np.arange(len(nominal_m_s2))
        table = [(each, float(np.interp(each, at, nominal_m_s2, period=360.0))) for each in ground]
    return [
        {"azimuth_deg": float(azimuth), "alpha_deg": float(np.rad2deg(np.arctan(value / scene.gravity_m_s2)))}
        for azimuth, (_, value) in zip(AZIMUTHS_DEG, table, strict=True)
    ]


def confidence(
    parts: Segmentation, points_m: Array, label: NDArray[np.int8], interface: Interface, height_m: float
) -> dict[str, float]:
    """How sure the split is: four numbers, each 0 to 1.

    `concave_share_of_cut`: share of the cut that runs through creases, 1 where a crevice goes all round.
    `crevice_seen_share`: share of the directions in which the pedestal was seen beside the rock.
    `undisputed_share`: share of the points near the interface whose six nearest neighbours have their label.
    `runner_up`: height of the highest other thing that stands there, over the rock's.
    """
    flat = interface.over(points_m)
    near = (np.abs(flat[:, 2]) < 0.1 * height_m) & (label != 2)
    flat, sides = flat[near], label[near]
    step = max(1, len(flat) // 200_000)
    flat, sides = flat[::step], sides[::step]
    rock, pedestal = flat[sides == ROCK], flat[sides == PEDESTAL]
    neighbours = cKDTree(flat).query(flat, 7)[1][:, 1:]
    alone = (sides[neighbours] != sides[:, None]).any(axis=1)
    reach = _BESIDE_PER_HEIGHT * height_m
    beside = pedestal[cKDTree(rock).query(pedestal, distance_upper_bound=reach)[0] < reach]
    return {
        "concave_share_of_cut": parts.concave_share,
        "crevice_seen_share": len(np.unique(sectors(beside[:, :2] - middle(rock)))) / SECTORS,
        "undisputed_share": 1.0 - float(alone.mean()),
        "runner_up": max((other[3] for other in parts.others), default=0.0) / height_m,
    }
