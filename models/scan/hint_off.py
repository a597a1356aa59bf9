"""Whether an interface that the user gave is where the pedestal was seen."""

from toppling.models.arrays import Array
from toppling.models.errors import InputError
from toppling.models.frames import slope_of_normal
from toppling.models.scan.doubt import Doubt, direction_told
from toppling.models.scan.interface import Interface, fit_interface
from toppling.models.scan.measure import ObservedRock
from toppling.models.scan.pointed_at import OFF_PER_HEIGHT


def off_what_was_seen(observed: ObservedRock, interface: Interface, origin_m: Array) -> Doubt | None:
    """A doubt where the pedestal that was seen beside the rock lies off the interface that the user gave.

    origin_m: (3,), survey coordinates of the scene's origin.
    """
    if observed.hint is None:
        return None
    try:
        seen = fit_interface(observed.surfels, observed.patches)
    except InputError:  # next to nothing of it was seen, which is what hints are for
        return None
    foot = interface.flat(observed.low_m) * [1.0, 1.0, 0.0]
    rises_m = -seen.flat(interface.scene(foot))[:, 2]
    low_m, high_m = float(rises_m.min()), float(rises_m.max())
    if max(-low_m, high_m) < OFF_PER_HEIGHT * observed.height_m:
        return None
    dip_deg, toward_deg = slope_of_normal(seen.normal)
    x, y, z = seen.point_m + origin_m
    return Doubt(
        "hint",
        f"below the rock the pedestal that was seen beside it lies {low_m:+.2g} to {high_m:+.2g} m over the interface "
        f"that is given, and dips by {dip_deg:.1f} degrees toward {direction_told(toward_deg)}: one too high cuts "
        f"the rock's foot off, one too low adds to it. What was seen is --plane {x:.2f} {y:.2f} {z:.2f} {dip_deg:.1f} "
        f"{toward_deg:.0f}",
    )
