"""How far a scan's numbers may be off, what no station saw included, and what the user is told of that."""

from typing import Any

import numpy as np

from toppling.models.scan.close import ClosedRock
from toppling.models.scan.surfels import LEVEL
from toppling.models.scene import Scene

_BIAS = {
    "com_per_height": 0.001,
    "volume_share": 0.003,
    "inertia_share": 0.003,
    "height_share": 0.006,  # a rock's lowest place is part of its hidden base
}
"""Standard deviations of rocks seen all round: errors against known ones bound them (benchmarks/reports/scan.md). What
half samples of the points spread by, joined with these, made them 1 to 13 % larger on five rocks."""

# A smooth closing can miss, or add, as much as a cap with the
# invented share s of the surface: on a ball 3 s^2 - 2 s^3 of the volume.
_INVENTED_COM_PER_HEIGHT = 0.2
"""Shift of the centre of mass in each coordinate over height and such a cap's share."""
_MUCH_INVENTED = 0.15
"""From this share of the surface on, volume and centre of mass are guesses; of the crown, its height."""


def cap_share(surface_share: float) -> float:
    """Share of a ball's volume in a cap with a share of its surface."""
    return surface_share**2 * (3.0 - 2.0 * surface_share)


def bias_floors(surface: ClosedRock) -> dict[str, float]:
    """Standard deviations of a rock's numbers as shares: of one seen all round, and of what is invented of it.

    An unseen crown is closed at the hull of what was seen and may rise above it, on a ball by that share of the crown's
    height.
    """
    cap = cap_share(surface.invented_share)
    grown = {
        "com_per_height": _INVENTED_COM_PER_HEIGHT * cap,
        "volume_share": cap,
        "inertia_share": cap,
        "height_share": 0.5 * (1.0 - LEVEL) * surface.crown_unseen_share,
    }
    return {name: float(np.hypot(least, grown.get(name, 0.0))) for name, least in _BIAS.items()}


def spread_of(surface: ClosedRock) -> dict[str, Any]:
    """Standard deviations of volume, centre of mass, inertia and height, as the report states them."""
    rock, share = surface.rock, bias_floors(surface)
    radius = np.sqrt(np.diag(rock.inertia_per_mass_m2))
    return {
        "volume_std_m3": share["volume_share"] * rock.volume_m3,
        "com_std_m": [share["com_per_height"] * rock.height_m] * 3,
        "inertia_per_mass_std_m2": (share["inertia_share"] * np.outer(radius, radius)).tolist(),
        "height_std_m": share["height_share"] * rock.height_m,
    }


def invention_warning(scene: Scene) -> str | None:
    """Say that much of the rock was not seen, if so, and what follows; nothing for a rock that was seen."""
    surface = scene.report.get("surface", {})
    share, crown = surface.get("invented_share", 0.0), surface.get("crown_unseen_share", 0.0)
    told = []
    if share > _MUCH_INVENTED:
        told.append(
            f"{share:.0%} of the rock's surface was not seen and is invented; its volume, centre of mass and inertia "
            f"are guesses, the volume by about ±{cap_share(share):.0%}: scan the rock from the other sides"
        )
    if crown > _MUCH_INVENTED:
        told.append(
            f"{crown:.0%} of the rock's crown was not seen and is closed at the convex hull of what was: whether it "
            "bulges above that or is dented the scan does not tell; scan it from above"
        )
    return f"warning: {'; '.join(told)}" if told else None
