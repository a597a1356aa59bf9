"""How far around a rock its rim was seen: contacts on a side that nobody saw follow from no observation."""

import numpy as np

from toppling.models.arrays import Array
from toppling.models.frames import horizontal_unit_vector
from toppling.models.scan.doubt import Doubt, azimuth_told, sectors, widest_gap_deg
from toppling.models.scan.interface import Interface
from toppling.models.scan.measure import ObservedRock

_TOLD_DEG = 130.0
"""An unseen range from which it is told: feet of one rock may lie as far apart, and those that carry it, below 180."""


def unseen_rim(observed: ObservedRock, interface: Interface, com_m: Array) -> Doubt | None:
    """A doubt where the rim was not seen over a wide range of directions about the line of the weight.

    Parameters
    ----------
    observed : ObservedRock
    interface : Interface
    com_m : (3,) array
        Centre of mass of the closed rock, scene frame.
    """
    if observed.hint is not None and observed.hint.encloses:
        return None
    places = interface.over(observed.low_m)[:, :2] - interface.projected_m(com_m[None])[0]
    range_deg, toward_deg = widest_gap_deg(np.unique(sectors(places)))
    if range_deg < _TOLD_DEG:
        return None
    toward = azimuth_told(horizontal_unit_vector(toward_deg)[:2], interface)
    beyond = (
        "what was seen of it does not surround the line of the weight, and the interval means little there"
        if range_deg >= 180.0
        else "contacts were drawn there as if the outline that was seen went on"
    )
    return Doubt(
        "rim",
        f"the rock's rim was not seen over {range_deg:.0f} degrees about {toward}: {beyond}. A station toward there "
        "would tell the most",
    )
