"""From what a scan saw of rock and pedestal to draws of the base that it did not see."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull

from toppling.models.arrays import Array
from toppling.models.errors import InputError
from toppling.models.frames import STANDARD_GRAVITY_M_S2
from toppling.models.gap import GapDraw, Relief, draw_gaps, encloses, resampled, weights
from toppling.models.intervals import FEW_DISTINCT
from toppling.models.pedestal import Pedestal
from toppling.models.rock import Rock
from toppling.models.scan.base import LEAST_GAP_PER_HEIGHT, Base, Underside
from toppling.models.scan.draw_statics import (
    BAND_PER_HEIGHT,
    FEET_PER_HEIGHT,
    DrawStatics,
    low_feet,
    outside_feet,
)
from toppling.models.scan.gap_seen import HiddenPart, hidden_part, reliefs
from toppling.models.scan.inspection import Inspection
from toppling.models.scan.interface import Interface
from toppling.models.scan.measure import ObservedRock, toppling
from toppling.models.scan.pulls import Pulls, check_joint, check_spanned, fits, log_likelihood
from toppling.models.shares import effective_number
from toppling.models.statics import equilibrium_possible
from toppling.models.unseen import BaseDraw, UnseenBase, least_feet

DRAWS = 48
"""Kept in the scene."""
CANDIDATES = 9
"""Draws of each prior, of which the likelier are kept."""
MORE_ROUNDS, ENOUGH = 3, 16.0
"""Where measured pulls leave fewer effective draws than enough, so many more rounds of candidates at most are drawn."""
LEVEL = 0.9
"""Of the intervals that are stated."""
OTHER_ERRORS_SHARE = 0.04
"""Standard deviation of the toppling acceleration that no draw shows; set on known virtual rocks, not derived
(docs/scan.md)."""
AZIMUTHS_DEG = np.arange(0.0, 360.0, 15.0)
FRICTION = 0.8
"""With which the nominal rock must stand as scanned."""
FITTING_SHARE = 1.0 / 3.0
"""Of the draws over a surface whose base fits it: as likely as one that is rough or rounded."""
SMOOTH_IS_LIKELY = 0.25
"""Mean deviation of a smooth closing's toppling acceleration from the draws' median; with more the base bulges."""
NEARLY_ALL = 0.75
"""Share of the azimuths at which the nominal scene topples within the interval; true flat bases do at .79 and more of
them, but for one."""
FLAT_MARGIN = 0.1
"""Share of the median by which a smooth closing may exceed the interval, but for the least azimuths, where no hint says
otherwise: on known flat bases, to which it is true, the draws topple too easily by 5 to 12 %."""


@dataclass(frozen=True, eq=False)
class DrawnBases:
    """Fields of gaps on which the rock stands as scanned, and what follows from each.

    Parameters
    ----------
    part : HiddenPart
    gaps : list of GapDraw
    com_m : (n, 3) array
        Centre of mass with each, scene frame.
    toppling_m_s2 : (n, azimuths) array
        Quasi-static toppling acceleration with each, for ground accelerations toward AZIMUTHS_DEG.
    com_std_m : (3,) array
        Standard deviation of the centre of mass before anything was measured on the base.
    """

    part: HiddenPart
    gaps: list[GapDraw]
    com_m: Array
    toppling_m_s2: Array
    com_std_m: Array

    @property
    def distinct(self) -> int:
        """How many of the draws differ: where weights are unlike, one draw is kept several times."""
        return len({id(gap) for gap in self.gaps})

    def interval_m_s2(self) -> tuple[Array, Array, Array]:
        """Low, median and high (azimuths,) of the toppling acceleration, other errors included."""
        tail = 0.5 * (1.0 - LEVEL)
        median = np.median(self.toppling_m_s2, axis=0)
        low, high = np.quantile(self.toppling_m_s2, [tail, 1.0 - tail], axis=0)
        # What the draws do not show is joined in quadrature, on each side.
        other = 1.645 * OTHER_ERRORS_SHARE * median
        low, high = median - np.hypot(median - low, other), median + np.hypot(high - median, other)
        return np.maximum(low, 0.0), median, high

    def apart(self, toppling_m_s2: Array) -> Array:
        """Mean deviation (...) of accelerations (..., azimuths) from the draws' median, as logarithm of their ratio."""
        middle = np.maximum(np.median(self.toppling_m_s2, axis=0), 1e-3)
        return np.asarray(np.abs(np.log(np.maximum(toppling_m_s2, 1e-3) / middle)).mean(axis=-1))

    def com_interval_m(self) -> Array:
        """Low, median and high of each coordinate of the centre of mass, (3, 3).

        Few draws do not narrow it: then it is at least what was known of the centre before them.
        """
        tail = 0.5 * (1.0 - LEVEL)
        low, median, high = np.quantile(self.com_m, [tail, 0.5, 1.0 - tail], axis=0)
        if self.distinct < FEW_DISTINCT:
            before = 1.645 * self.com_std_m
            low, high = np.minimum(low, median - before), np.maximum(high, median + before)
        return np.array([low, median, high]).T


class ContradictionError(InputError):
    """What was seen leaves no base on which the rock stands as scanned."""


def draw_bases(
    observed: ObservedRock,
    interface: Interface,
    closed: Rock,
    base: Base,
    com_std_m: Array,
    inspection: Inspection | None = None,
    draws: int = DRAWS,
) -> DrawnBases:
    """Draw bases that agree with rim, crevice, standing and inspection.

    Parameters
    ----------
    observed : ObservedRock
    interface : Interface
    closed : Rock
        Closed with a base, for its mass.
    base : Base
        That base.
    com_std_m : (3,) array
        Standard deviation of its centre of mass.
    inspection : Inspection, optional
        In the scene's frame.
    draws : int

    Raises
    ------
    InputError
        If no base agrees with all of it: `ContradictionError`; if a pull lies beyond what the bases bear.
    """
    inspection = inspection or Inspection()
    low, lit = interface.over(observed.low_m), interface.over(observed.lit_m)
    under = Underside.of(low, lit, observed.height_m, observed.hint, interface.lattice_m)
    part = hidden_part(under, low, lit, observed.height_m, inspection, interface)
    random = np.random.default_rng([2026, 28])
    statics = DrawStatics.of(closed, interface, part, observed.height_m)
    priors = reliefs(part.width_m)

    def candidates() -> list[tuple[GapDraw, Array]]:
        return _standing_draws(part, base, closed, interface, com_std_m, priors, random)

    found, log_weight, measured = _weighed(candidates, statics, inspection.pulls)
    if not found:
        raise contradiction(part, interface.projected_m(closed.com_m[None])[0], interface)
    fitting = [] if interface.is_plane else _fitting(part, base, closed, interface, com_std_m, random, draws)
    kept = [
        found[number] for number in resampled(log_weight, draws - len(fitting), random, measured)
    ] + fitting
    return DrawnBases(
        part,
        [gap for gap, _ in kept],
        np.array([com for _, com in kept]),
        _toppling_of(kept, statics),
        com_std_m,
    )


def _toppling_of(kept: list[tuple[GapDraw, Array]], statics: DrawStatics) -> Array:
    """Toppling accelerations (n, azimuths) of draws, each worked out once however often it was kept."""
    once: dict[tuple[int, bytes], Array] = {}
    for gap, com_m in kept:
        if (key := (id(gap), com_m.tobytes())) not in once:
            once[key] = statics.toppling_m_s2(gap, com_m, tuple(AZIMUTHS_DEG))
    return np.array([once[id(gap), com_m.tobytes()] for gap, com_m in kept])


def _weighed(
    candidates: Callable[[], list[tuple[GapDraw, Array]]], statics: DrawStatics, pulls: Pulls
) -> tuple[list[tuple[GapDraw, Array]], Array, Array]:
    """Draws, the logarithms of their weights and of the pulls' likelihood; more draws where pulls leave too few."""
    toward = tuple((azimuth + 180.0) % 360.0 for azimuth, _ in pulls)

    def borne(found: list[tuple[GapDraw, Array]]) -> Array:
        """Ratios (n, pulls) that draws bear."""
        ratios = np.empty((len(found), len(pulls)))
        for row, (gap, com_m) in enumerate(found if pulls else []):
            ratios[row] = statics.toppling_m_s2(gap, com_m, toward) / STANDARD_GRAVITY_M_S2
        return ratios

    found = candidates()
    ratios = borne(found)
    log_weight = np.array([gap.log_weight for gap, _ in found])
    measured = log_likelihood(pulls, ratios)
    if found and pulls:
        check_spanned(pulls, ratios, weights(log_weight))
        for _ in range(MORE_ROUNDS):
            if effective_number(weights(log_weight, measured)) >= ENOUGH:
                break
            more = candidates()
            found, ratios = found + more, np.vstack([ratios, borne(more)])
            log_weight = np.array([gap.log_weight for gap, _ in found])
            measured = log_likelihood(pulls, ratios)
        check_joint(pulls, ratios, weights(log_weight, measured), weights(log_weight))
    return found, log_weight, measured


def _standing_draws(
    part: HiddenPart,
    base: Base,
    closed: Rock,
    interface: Interface,
    com_std_m: Array,
    priors: list[Relief],
    random: np.random.Generator,
) -> list[tuple[GapDraw, Array]]:
    """Candidates of each prior on which the rock stands, each with its centre of mass."""
    offsets_m = random.normal(size=(CANDIDATES, 3)) * com_std_m
    projected_com = interface.projected_m(closed.com_m + offsets_m)
    found = []
    for gap in draw_gaps(part.observed, projected_com, priors, random):
        com_m = closed.com_m + offsets_m[gap.number] + _mass_moved_m(part, base, gap.gap_m, closed, interface)
        touching = part.observed.places_m[gap.gap_m <= 0.0]
        if encloses(touching, interface.projected_m(com_m[None])[0]):
            found.append((gap, com_m))
    return found


def _fitting(
    part: HiddenPart,
    base: Base,
    closed: Rock,
    interface: Interface,
    com_std_m: Array,
    random: np.random.Generator,
    draws: int,
) -> list[tuple[GapDraw, Array]]:
    """Bases that fit the surface as closely as what was seen allows, a share of all draws; none if it stands on none.

    On facets friction shares the weight among contacts that three points do not have.
    """
    seen = part.observed
    gap_m = np.maximum(base.grid.at(base.height_m, seen.places_m), seen.floor_m)
    closed_rim = seen.gap_m < 2.0 * np.hypot(seen.std_m, seen.shared_m)
    gap_m[seen.known[closed_rim]] = 0.0
    touching = seen.places_m[gap_m <= 0.0]
    gap = GapDraw(gap_m, 0.0, 0)
    coms = closed.com_m + random.normal(size=(round(FITTING_SHARE * draws), 3)) * com_std_m
    return [(gap, com_m) for com_m in coms if encloses(touching, interface.projected_m(com_m[None])[0])]


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

    def at_rest(standing: Rock) -> bool:
        return bool(equilibrium_possible(standing, plane, STANDARD_GRAVITY_M_S2, FRICTION, np.zeros(3))[0])

    margin = FLAT_MARGIN if smooth_fits is None else 0.0
    if smooth_is_likely(drawn, smooth_m_s2, margin) and smooth_fits is not False and at_rest(rock):
        return None, True
    second: int | None = None
    for number in np.argsort(drawn.apart(drawn.toppling_m_s2), kind="stable").tolist():
        standing = unseen.on_feet_of(rock, plane, number)
        if not at_rest(standing):
            continue
        if within_interval(drawn, toppling(standing, interface, AZIMUTHS_DEG)) and fits(
            pulls, borne_ratios(standing, interface, pulls)
        ):
            return number, True
        second = number if second is None else second
    return second, second is not None


def smooth_is_likely(drawn: DrawnBases, smooth_m_s2: Array, margin: float) -> bool:
    """Whether a smooth closing's toppling acceleration is one that the draws give too."""
    near = bool(drawn.apart(smooth_m_s2) < SMOOTH_IS_LIKELY)
    return near and within_interval(drawn, smooth_m_s2, margin)


def within_interval(drawn: DrawnBases, toppling_m_s2: Array, margin: float = 0.0) -> bool:
    """Whether toppling accelerations (azimuths,) lie within the draws' interval nearly everywhere.

    At the azimuth at which least topples, of the draws and of what is asked, they must; elsewhere they may exceed it by
    a margin, as share of the median.
    """
    low, median, high = drawn.interval_m_s2()
    within = (low <= toppling_m_s2) & (toppling_m_s2 <= high)
    nearly = (low <= toppling_m_s2) & (toppling_m_s2 <= high + margin * median)
    least = [median.argmin(), toppling_m_s2.argmin()]
    return bool(nearly.mean() >= NEARLY_ALL and within[least].all())


def borne_ratios(rock: Rock, interface: Interface, pulls: Pulls) -> Array:
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
        and fits(inspection.pulls, borne_ratios(rock, interface, inspection.pulls))
    )


def unseen_base(drawn: DrawnBases, rock: Rock, interface: Interface, height_m: float) -> UnseenBase:
    """The draws as a scene keeps them, for the rock as it was closed in the end."""
    band_m = BAND_PER_HEIGHT * height_m
    side, high = outside_feet(rock, interface, drawn.part, height_m)
    com = interface.flat(rock.com_m[None])[0]
    draws = [
        BaseDraw(
            least_feet(low_feet(drawn.part, gap, side, height_m), high, com, FEET_PER_HEIGHT * height_m),
            com_m - rock.com_m,
        )
        for gap, com_m in zip(drawn.gaps, drawn.com_m, strict=True)
    ]
    return UnseenBase(band_m, tuple(draws))


def contradiction(part: HiddenPart, projected_com: Array, interface: Interface) -> ContradictionError:
    """Say which observation contradicts that the rock stands."""
    can_touch = part.observed.places_m[part.observed.floor_m <= 0.0]
    hull = ConvexHull(can_touch) if len(can_touch) > 2 else None
    outside = float((hull.equations[:, :2] @ projected_com + hull.equations[:, 2]).max()) if hull else np.inf
    x, y, _ = interface.scene(np.append(projected_com, 0.0))
    if outside > 0.0:
        what = (
            f"the line of the weight passes {outside:.3g} m beside every place where the rock may touch its pedestal "
            f"(at {x:.2f}, {y:.2f} in the scene), since daylight or the pedestal was seen below it there"
        )
    else:
        what = f"no contacts around the line of the weight (at {x:.2f}, {y:.2f} in the scene) agree with what was seen"
    return ContradictionError(
        what,
        where="standing",
        expected="a base on which the rock is at rest as it was scanned",
        remedy="one observation is wrong: the rim is not where it seems (strays, plants; crop or clean the cloud), the "
        "plane is another (--plane), a place of --contact is misread; or the rock is held by something else: a wedge, "
        "a second support, adhesion",
    )


def _mass_moved_m(part: HiddenPart, base: Base, gap_m: Array, rock: Rock, interface: Interface) -> Array:
    """Shift (3,) of the centre of mass by what a draw's base takes from the rock that another base closed."""
    places = part.observed.places_m[: part.inner]
    lower, upper = base.grid.at(base.height_m, places), gap_m[: part.inner]
    taken = (upper - lower) * part.cell_m2
    com = interface.flat(rock.com_m[None])[0]
    arms = np.column_stack([places, 0.5 * (upper + lower)]) + interface.rise(places) - com
    return np.asarray(interface.axes @ -(taken[:, None] * arms).sum(axis=0) / rock.volume_m3)
