"""What was seen of a rock, and how slender it is."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import ConvexHull, QhullError, cKDTree

from toppling.models.arrays import Array, Flags
from toppling.models.errors import InputError
from toppling.models.hidden_base.near_interface import NearInterface, SidesSeen
from toppling.models.rock import Rock
from toppling.models.scan.directions import middle
from toppling.models.scan.interface import Interface
from toppling.models.scan.interface_hint import InterfaceHint
from toppling.models.scan.surfels import Surfels
from toppling.models.scene import Scene

AZIMUTHS_DEG = np.arange(0.0, 360.0, 10.0)
_SUPPORT_PER_HEIGHT = 0.02
"""What lies so near to the interface could touch it."""
_BELOW_PER_HEIGHT, _BELOW_SHARE = 0.03, 0.002
"""More than this share of the rock's patches so far below the interface are a part of it, not strays."""


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
        patches = interface.over(self.surfels.points_m[self.patches])
        sides = SidesSeen.of(patches, self.surfels.normals[self.patches] @ interface.axes, middle(low))
        return NearInterface(low, lit, self.height_m, sides.led_down(0.0), patches)


def check_above(observed: ObservedRock, interface: Interface) -> None:
    """Refuse a rock of which more than strays was seen below its interface: raises InputError."""
    over = interface.over(observed.surfels.points_m[observed.patches])
    below = over[:, 2] < -_BELOW_PER_HEIGHT * observed.height_m
    if below.mean() <= _BELOW_SHARE:
        return
    # A tenth of them may be strays.
    deepest = -float(np.quantile(over[below, 2], 0.1))
    raise InputError(
        "rock.hangs_below_interface",
        f"{below.mean():.1%} of the rock's seen surface hangs below the interface, by up to about {deepest:.2g} m",
        where="interface",
        expected="a rock above the plane on which it meets its pedestal",
        remedy="one that is sunk in the ground, or hooked to a cliff, is held by it and is not supported; if what "
        "hangs there is pedestal, crop the cloud, or say where rock and pedestal meet by --plane, --point or --outline",
    )


def outside_support_m(rock: Rock, interface: Interface) -> float:
    """How far the vertical through the centre of mass passes outside all that could touch the interface."""
    over = interface.over(rock.vertices_m)
    low = over[:, 2] < _SUPPORT_PER_HEIGHT * rock.height_m
    places = interface.flat(rock.vertices_m)[low, :2]
    if interface.sheet is not None:  # where plumb lines through them pierce the plane, as that of the weight
        places = interface.projected_m(rock.vertices_m[low])
    try:
        hull = ConvexHull(places)
    except (QhullError, ValueError):  # in one line, or fewer than three
        return np.inf
    projected = interface.projected_m(rock.com_m[None])[0]
    return float((hull.equations[:, :2] @ projected + hull.equations[:, 2]).max())


def slenderness(scene: Scene) -> list[dict[str, float]]:
    """Slenderness angle by the azimuth toward which the rock topples.

    tan(alpha) = a / g (Anooshehpoor, Brune and Zeng 2004), a the quasi-static toppling acceleration of the ground
    the other way: for a flat sharp base the angle between the vertical and the line from the centre of mass to the
    edge about which it tips.
    """
    table = scene.tips_m_s2((AZIMUTHS_DEG + 180.0) % 360.0)
    return [
        {"azimuth_deg": float(azimuth), "alpha_deg": float(np.rad2deg(np.arctan(value / scene.gravity_m_s2)))}
        for azimuth, (_, value) in zip(AZIMUTHS_DEG, table, strict=True)
    ]
