"""The base on which a scanned scene itself stands: its smooth closing, or the draw nearest to the draws' median."""

from __future__ import annotations

import numpy as np

from toppling.models.arrays import Array
from toppling.models.frames import STANDARD_GRAVITY_M_S2
from toppling.models.hidden_base.draws import UnseenBase
from toppling.models.hidden_base.from_scan import AZIMUTHS_DEG, DrawnBases
from toppling.models.hidden_base.inspection import Inspection
from toppling.models.hidden_base.pulls import Pulls, fits
from toppling.models.hidden_base.statics import carried
from toppling.models.hidden_base.underside import LEAST_GAP_PER_HEIGHT, Base
from toppling.models.pedestal import Pedestal
from toppling.models.rock import Rock
from toppling.models.scan.interface import Interface
from toppling.models.scan.measure import toppling
from toppling.models.statics import equilibrium_possible

_FRICTION = 0.8
"""With which the nominal rock must stand as scanned."""
_SMOOTH_IS_LIKELY = 0.25
"""Mean deviation of a smooth closing's toppling acceleration from the draws' median; with more the base bulges."""
_NEARLY_ALL = 0.75
"""Share of the azimuths at which the nominal scene topples within the interval; true flat bases do at .79 and more of
them, but for one."""
FLAT_MARGIN = 0.1
"""Share of the median by which a smooth closing may exceed the interval, but for the least azimuths, where no hint says
otherwise: on known flat bases, to which it is true, the draws topple too easily by 5 to 12 %."""


def nominal_draw(
    drawn: DrawnBases,
    unseen: UnseenBase,
    rock: Rock,
    interface: Interface,
    smooth_m_s2: Array,
    smooth_fits: bool | None = None,
    pulls: Pulls = (),
) -> tuple[int | None, bool]:
    """Draw on whose feet the scene stands, and whether the rock is at rest there; None for the smooth closing's feet.

    The smooth closing is nearest to the truth of a flat base, whereas on one that bulges the rock stands too broadly:
    it is taken where its toppling acceleration toward AZIMUTHS_DEG (`smooth_m_s2`) is one that the draws give too, the
    least one included, and where it fits what was seen by inspection (`smooth_fits`; None where nothing was).
    Otherwise the draw nearest to the draws' median is taken, of those on which the rock, with its own centre of mass,
    topples within their interval; if there is none, the nearest one.
    """
    plane = Pedestal(interface.point_m, interface.normal)
    rock = carried(rock, interface)

    def at_rest(standing: Rock) -> bool:
        return bool(equilibrium_possible(standing, plane, STANDARD_GRAVITY_M_S2, _FRICTION, np.zeros(3))[0])

    margin = FLAT_MARGIN if smooth_fits is None else 0.0
    if smooth_is_likely(drawn, smooth_m_s2, margin) and smooth_fits is not False and at_rest(rock):
        return None, True
    second: int | None = None
    for number in np.argsort(drawn.apart(drawn.toppling_m_s2), kind="stable").tolist():
        standing = unseen.on_feet_of(rock, plane, number)
        if not at_rest(standing):
            continue
        if _within_interval(drawn, toppling(standing, interface, AZIMUTHS_DEG)) and fits(
            pulls, _borne_ratios(standing, interface, pulls)
        ):
            return number, True
        second = number if second is None else second
    return second, second is not None


def smooth_is_likely(drawn: DrawnBases, smooth_m_s2: Array, margin: float) -> bool:
    """Whether a smooth closing's toppling acceleration is one that the draws give too."""
    near = bool(drawn.apart(smooth_m_s2) < _SMOOTH_IS_LIKELY)
    return near and _within_interval(drawn, smooth_m_s2, margin)


def _within_interval(drawn: DrawnBases, toppling_m_s2: Array, margin: float = 0.0) -> bool:
    """Whether toppling accelerations (azimuths,) lie within the draws' interval nearly everywhere.

    At the azimuth at which least topples, of the draws and of what is asked, they must; elsewhere they may exceed it by
    a margin, as share of the median.
    """
    low, median, high = drawn.interval_m_s2()
    within = (low <= toppling_m_s2) & (toppling_m_s2 <= high)
    nearly = (low <= toppling_m_s2) & (toppling_m_s2 <= high + margin * median)
    least = [median.argmin(), toppling_m_s2.argmin()]
    return bool(nearly.mean() >= _NEARLY_ALL and within[least].all())


def _borne_ratios(rock: Rock, interface: Interface, pulls: Pulls) -> Array:
    """Largest forces over the weight (pulls,) that a rock bears toward the azimuths of pulls."""
    toward = np.array([(azimuth + 180.0) % 360.0 for azimuth, _ in pulls])
    return toppling(rock, interface, toward) / STANDARD_GRAVITY_M_S2 if len(toward) else toward


def smooth_fits_inspection(
    rock: Rock, base: Base, interface: Interface, inspection: Inspection, height_m: float
) -> bool:
    """Whether a smooth closing touches where rock and pedestal do, is open where light passes, and bears the pulls."""
    touch_m, open_m = (
        base.grid.at(base.height_m, interface.over(places)[:, :2])
        for places in (inspection.touching_m, inspection.open_m)
    )
    least_m = 0.5 * LEAST_GAP_PER_HEIGHT * height_m
    return bool(
        (touch_m < least_m).all()
        and (open_m >= least_m).all()
        and fits(inspection.pulls, _borne_ratios(rock, interface, inspection.pulls))
    )
