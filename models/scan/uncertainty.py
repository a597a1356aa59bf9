"""Observed part of a rock, how slender it is, and how far a scan's numbers may be off."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from toppling.models.arrays import Array, Flags
from toppling.models.errors import InputError
from toppling.models.hidden_base.near_interface import NearInterface, SidesSeen
from toppling.models.scan.close import ClosedRock
from toppling.models.scan.crevice import BELOW_PER_HEIGHT, seen_apart
from toppling.models.scan.interface import Interface, middle
from toppling.models.scan.interface_hint import InterfaceHint
from toppling.models.scan.surfels import Surfels
from toppling.models.scene import Scene

_COM_PER_HEIGHT, _VOLUME_SHARE = 0.001, 0.003
"""Standard deviations of rocks seen all round: errors against known ones bound them (benchmarks/reports/scan.md)."""

# A smooth closing can miss, or add, as much as a cap with the
# invented share s of the surface: on a ball 3 s^2 - 2 s^3 of the volume.
_INVENTED_COM_PER_HEIGHT = 0.2
"""Shift of the centre of mass in each coordinate over height and such a cap's share."""
_MUCH_INVENTED = 0.15
"""Share of the surface from which on volume and centre of mass are guesses; of the crown, the height."""


def cap_share(surface_share: float) -> float:
    """Share of a ball's volume in a cap with a share of its surface."""
    return surface_share**2 * (3.0 - 2.0 * surface_share)


def spread_of(surface: ClosedRock) -> dict[str, Any]:
    """Standard deviations of volume and centre of mass beside the base, as the report states them."""
    rock, cap = surface.rock, cap_share(surface.invented_share)
    com_std_m = float(np.hypot(_COM_PER_HEIGHT, _INVENTED_COM_PER_HEIGHT * cap)) * rock.height_m
    return {
        "volume_std_m3": float(np.hypot(_VOLUME_SHARE, cap)) * rock.volume_m3,
        "com_std_m": [com_std_m] * 3,
    }


def invention_warning(scene: Scene) -> str | None:
    """Say that much of the rock was not seen, if so, and what follows; nothing for a rock that was seen."""
    surface = scene.report.get("surface", {})
    share, crown = surface.get("invented_share", 0.0), surface.get("crown_unseen_share", 0.0)
    sentences = []
    if share > _MUCH_INVENTED:
        sentences.append(
            f"{share:.0%} of the rock's surface was not seen and is invented; its volume, centre of mass and inertia "
            "are guesses: scan the rock from the other sides"
        )
    if crown > _MUCH_INVENTED:
        sentences.append(
            f"{crown:.0%} of the rock's crown was not seen and is closed at the convex hull of what was: whether it "
            "bulges above that or is dented the scan does not tell; scan it from above"
        )
    return f"warning: {'; '.join(sentences)}" if sentences else None


_BELOW_SHARE = 0.002
"""Share of the rock's patches far below the interface beyond which these are no strays."""


@dataclass(frozen=True, eq=False)
class ObservedRock:
    """Observed points and patches of rock and pedestal."""

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

    def near(self, interface: Interface) -> NearInterface:
        """Points that shape the base over an interface, with the rim below sides that were seen higher up only."""
        low, lit = interface.over(self.low_m), interface.over(self.lit_m)
        if not len(low):
            return NearInterface(low, lit, self.height_m)
        apart = seen_apart(self.surfels, self.patches, interface, self.height_m)
        patches = interface.over(self.surfels.points_m[self.patches])
        sides = SidesSeen.of(patches, self.surfels.normals[self.patches] @ interface.axes, middle(low))
        return NearInterface(low, lit, self.height_m, sides.led_down(0.0), patches, apart)


def check_above(observed: ObservedRock, interface: Interface) -> None:
    """Refuse a rock of which more than strays was seen below its interface: raises InputError."""
    over = interface.over(observed.surfels.points_m[observed.patches])
    below = over[:, 2] < -BELOW_PER_HEIGHT * observed.height_m
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


def slenderness(scene: Scene) -> list[dict[str, float]]:
    """Slenderness angle by the azimuth toward which the rock topples.

    tan(alpha) = a / g (Anooshehpoor, Brune and Zeng 2004), a the quasi-static toppling acceleration of the ground
    the other way: for a flat sharp base the angle between the vertical and the line from the centre of mass to the
    edge about which it tips.
    """
    alpha_deg = {
        (azimuth + 180.0) % 360.0: float(np.rad2deg(np.arctan(tips / scene.gravity_m_s2)))
        for azimuth, tips, _ in scene.stated
    }
    return [{"azimuth_deg": azimuth, "alpha_deg": alpha_deg[azimuth]} for azimuth in sorted(alpha_deg)]
