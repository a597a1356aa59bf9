"""From what a scan saw of rock and pedestal to draws of the base that it did not see."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from toppling.models.arrays import ROUNDING, Array, effective_number
from toppling.models.errors import InputError
from toppling.models.frames import STANDARD_GRAVITY_M_S2
from toppling.models.hidden_base.evidence import (
    OTHER_ERRORS_SHARE,
    Pulls,
    bowls,
    conditioned,
    flat_draws,
    fractions_by_evidence,
    mixed_weights,
    pulls_log_likelihood,
)
from toppling.models.hidden_base.gap import Base, GapDraw, Underside, beyond_m, draw_gaps, encloses, resampled
from toppling.models.hidden_base.inspection import Inspection
from toppling.models.hidden_base.intervals import FEW_DISTINCT
from toppling.models.hidden_base.observed import BAND_PER_HEIGHT, HiddenPart, hidden_part, reliefs
from toppling.models.hidden_base.statics import DrawStatics, base_taken
from toppling.models.hidden_base.unseen_base import BaseDraw, UnseenBase
from toppling.models.pedestal import Pedestal
from toppling.models.rock import Rock
from toppling.models.scan.hints_file import FLAT, KINDS, ROUGH, ROUNDED
from toppling.models.scan.interface import Interface
from toppling.models.scan.uncertainty import ObservedRock

DRAWS = 48
"""Number of draws in the scene."""
CANDIDATES = 324
"""Number of candidates of each kind, of which its priors take turns."""
ENOUGH = 16.0
"""Effective number of draws that pulls leave at least; where they would leave fewer, they count less."""
LEVEL = 0.9
"""Probability of the stated intervals."""
AZIMUTHS_DEG = np.arange(0.0, 360.0, 15.0)
MOST_M_S2 = 100.0
"""Largest acceleration that is told, twice that of any record: none topples a slab down a slope."""
_NEVER = 0.02
"""Weight of a candidate over the largest below which no pull is calculated for it."""
_FITTING_SHARE = 1.0 / 3.0
"""Least share of draws over a surface whose base fits it: friction acts on contacts that three points do not have."""


@dataclass(frozen=True, eq=False)
class DrawnBases:
    """Fields of gaps on which the rock stands as scanned, and what follows from each."""

    part: HiddenPart
    gaps: list[GapDraw]
    com_m: Array  # (n, 3): centre of mass with each, scene frame
    taken_m3: Array  # (n,): what each takes of the rock as it was closed
    # (n, azimuths): quasi-static toppling acceleration with each, for ground accelerations toward AZIMUTHS_DEG.
    toppling_m_s2: Array
    # (3,): standard deviation of the centre of mass before anything was measured on the base.
    com_std_m: Array
    # (n, azimuths): acceleration at which the contacts of each begin to open; None over a surface.
    lift_off_m_s2: Array | None = None
    effective: float = DRAWS  # draws of equal weight that say as much as those among which these were drawn
    # How likely each kind of base is by the rim, before any pull.
    kind_weights: dict[str, float] = field(default_factory=dict)
    # (k, 3) of each: u, v and clearance of what decides how it rocks.
    feet: list[Array] = field(default_factory=list)
    # (pulls, 3): low, median and high ratio that the draws bear which agree with all but the pulls.
    borne: Array = field(default_factory=lambda: np.zeros((0, 3)))

    @property
    def kinds(self) -> dict[str, int]:
        """How many draws are of each kind."""
        return dict(Counter(gap.kind for gap in self.gaps))

    @property
    def distinct(self) -> int:
        """How many of the draws differ: where weights are unlike, one draw is kept several times."""
        return len({id(gap) for gap in self.gaps})

    def interval_m_s2(self) -> tuple[Array, Array, Array]:
        """Low, median and high (azimuths,) of the toppling acceleration, other errors included."""
        return interval_of(self.toppling_m_s2, count=self.effective)

    def lift_off_interval_m_s2(self) -> tuple[Array, Array, Array] | None:
        """Low, median and high (azimuths,) of the acceleration at which contacts begin to open."""
        return None if self.lift_off_m_s2 is None else interval_of(self.lift_off_m_s2, count=self.effective)

    @property
    def likeliest(self) -> list[int]:
        """Numbers of the draws, by the mean ratio of their accelerations to the draws' median, the nearest first."""
        logs = np.log(np.maximum(self.toppling_m_s2, 1e-3))
        away = np.abs(logs - np.median(logs, axis=0)).mean(axis=1)
        return np.argsort(away, kind="stable").tolist()

    def volume_interval_m3(self, closed_m3: float, closing_std_m3: float) -> list[float]:
        """Low, median and high of the volume, with the error of what was closed beside the base.

        That of the rock as it was closed, on all that may touch, lies in the interval: no draw rests so.
        """
        tail, other = 0.5 * (1.0 - LEVEL), 1.645 * closing_std_m3
        low, median, high = np.quantile(closed_m3 - self.taken_m3, [tail, 0.5, 1.0 - tail])
        high = max(high, closed_m3)
        return [median - np.hypot(median - low, other), median, median + np.hypot(high - median, other)]

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


def interval_of(
    acceleration_m_s2: Array, weight: Array | None = None, count: float | None = None
) -> tuple[Array, Array, Array]:
    """Low, median and high of draws (n, azimuths), with what no draw shows; (k, azimuths) for weights (k, n).

    The next draw lies between the ends with the probability `LEVEL`: it lies below the k-th of n with k / (n + 1)
    (Weibull 1939), which is at the level (k - 1/2) / n of the draws (Hazen 1914). count: their effective number.
    """
    draws = acceleration_m_s2
    if weight is None:
        low, median, high = np.quantile(draws, _levels(count or len(draws)), axis=0, method="hazen")
    else:
        order = draws.argsort(axis=0)
        share = weight[:, order].cumsum(axis=1) / weight.sum(axis=1)[:, None, None]
        level = np.array([_levels(effective_number(row)) for row in weight]).T[:, :, None, None]
        first = (share >= level - ROUNDING).argmax(axis=2)
        low, median, high = np.take_along_axis(draws, order, axis=0)[first, np.arange(draws.shape[1])]
    # What the draws do not show is joined in quadrature, on each side.
    other = 1.645 * OTHER_ERRORS_SHARE * median
    low, high = median - np.hypot(median - low, other), median + np.hypot(high - median, other)
    return np.maximum(low, 0.0), median, high


def _levels(count: float) -> list[float]:
    """Levels of the low end, the middle and the high end of so many draws."""
    tail = max((0.5 * (1.0 - LEVEL) * (count + 1.0) - 0.5) / count, 0.0)
    return [tail, 0.5, 1.0 - tail]


class ContradictionError(InputError):
    """Observations that leave no base on which the rock stands as scanned."""


def draw_bases(
    observed: ObservedRock,
    interface: Interface,
    closed: Rock,
    base: Base,
    com_std_m: Array,
    inspection: Inspection | None = None,
    pedestal: Pedestal | None = None,
) -> DrawnBases:
    """Draw bases that agree with rim, crevice, standing and inspection (scene frame).

    closed, base: the rock closed with a base, for its mass, and that base.
    com_std_m: (3,), standard deviation of its centre of mass.
    pedestal: its surface, over which the rock rolls; the interface if not given.
    Raises ContradictionError if no base agrees with all of it.
    """
    inspection = inspection or Inspection()
    near = observed.near(interface)
    under = Underside.of(near, observed.hint, interface)
    part = hidden_part(under, near, inspection, interface, pedestal)
    random = np.random.default_rng([2026, 28])
    statics = DrawStatics.of(closed, interface, part, observed.height_m)
    possible = (ROUGH, ROUNDED) if inspection.touch_only else KINDS
    asked = possible if inspection.base is None else (inspection.base,)

    found = _standing_draws(part, base, closed, interface, com_std_m, asked, random)
    if not found:
        raise contradiction(part, interface.projected_m(closed.com_m[None])[0], interface, inspection)
    fractions = _fractions(found, not interface.is_plane)
    weight, borne = _weighed(found, fractions, statics, inspection.pulls)
    selected = [found[number] for number in resampled(weight, DRAWS, random)]
    lift_off, toppling, feet = zip(*_distinct_paths(selected, statics), strict=True)
    return DrawnBases(
        part,
        [gap for gap, _ in selected],
        np.array([com for _, com in selected]),
        np.array([base_taken(part, base, gap.gap_m, closed, interface)[1] for gap, _ in selected]),
        np.array(toppling),
        com_std_m,
        np.array(lift_off) if interface.is_plane else None,
        min(effective_number(weight), DRAWS),
        fractions,
        list(feet),
        borne,
    )


Candidate = tuple[GapDraw, Array]
"""A gap on which the rock stands, and the centre of mass with it."""


def _distinct_paths(selected: list[Candidate], statics: DrawStatics) -> list[tuple[Array, Array, Array]]:
    """Accelerations at lift-off and at toppling (azimuths,), and feet, of draws that may be one several times."""
    once: dict[tuple[int, bytes], tuple[Array, Array, Array]] = {}
    for gap, com_m in selected:
        if (key := (id(gap), com_m.tobytes())) not in once:
            feet = statics.few_feet(gap, com_m)
            path_m_s2 = statics.path_m_s2(gap, com_m, tuple(AZIMUTHS_DEG), feet)
            once[key] = (*np.minimum(path_m_s2, MOST_M_S2), feet)
    return [once[id(gap), com_m.tobytes()] for gap, com_m in selected]


def _fractions(found: list[Candidate], over_surface: bool) -> dict[str, float]:
    """Share of each kind of base before any pull."""
    fractions = fractions_by_evidence([gap for gap, _ in found])
    if over_surface and 0.0 < fractions.get(FLAT, 1.0) < _FITTING_SHARE:
        rest = (1.0 - _FITTING_SHARE) / (1.0 - fractions[FLAT])
        fractions = {k: _FITTING_SHARE if k == FLAT else rest * share for k, share in fractions.items()}
    return fractions


def _weighed(
    found: list[Candidate], fractions: Mapping[str, float], statics: DrawStatics, pulls: Pulls
) -> tuple[Array, Array]:
    """Weights (n,) of candidates, and what they bear (pulls, 3) before the pulls: low, median and high ratio."""
    weight = mixed_weights([gap for gap, _ in found], fractions)
    if not pulls:
        return weight, np.zeros((0, 3))
    toward = tuple((azimuth + 180.0) % 360.0 for azimuth, _ in pulls)
    # What next to never stands as drawn needs no pull.
    likely = np.flatnonzero(weight > _NEVER * weight.max())
    ratios = np.array([statics.path_m_s2(*found[row], toward)[1] for row in likely]) / STANDARD_GRAVITY_M_S2
    borne = np.array(interval_of(ratios, weight[None, likely]))[:, 0].T
    pulled = np.zeros(len(found))
    pulled[likely] = conditioned(weight[likely], pulls_log_likelihood(pulls, ratios), ENOUGH)
    return pulled, borne


def _standing_draws(
    part: HiddenPart,
    base: Base,
    closed: Rock,
    interface: Interface,
    com_std_m: Array,
    asked: tuple[str, ...],
    random: np.random.Generator,
) -> list[Candidate]:
    """Candidates of each prior of the kinds that are asked for, on which the rock stands, with its centre of mass."""
    offsets_m = random.normal(size=(max(CANDIDATES, DRAWS), 3)) * com_std_m
    projected_com = interface.projected_m(closed.com_m + offsets_m)
    gaps = []
    for kind, priors in ((ROUGH, reliefs(part.width_m)), (ROUNDED, bowls(part.width_m))):
        if kind in asked:
            gaps += draw_gaps(part.observed, projected_com[:CANDIDATES], priors, random, kind)
    if FLAT in asked:
        gaps += flat_draws(part, base, DRAWS)
    found = []
    for gap in gaps:
        com_m = closed.com_m + offsets_m[gap.number] + base_taken(part, base, gap.gap_m, closed, interface)[0]
        touching = part.observed.places_m[gap.gap_m <= 0.0]
        if encloses(touching, interface.projected_m(com_m[None])[0]):
            found.append((gap, com_m))
    return found


def unseen_base(drawn: DrawnBases, rock: Rock, height_m: float) -> UnseenBase:
    """The draws as a scene keeps them, for the rock as it was closed in the end."""
    draws = [BaseDraw(feet, com_m - rock.com_m) for feet, com_m in zip(drawn.feet, drawn.com_m, strict=True)]
    return UnseenBase(BAND_PER_HEIGHT * height_m, tuple(draws))


def contradiction(
    part: HiddenPart, projected_com: Array, interface: Interface, inspection: Inspection
) -> ContradictionError:
    """Say which observation contradicts that the rock stands."""
    outside = beyond_m(part.observed.places_m[part.observed.floor_m <= 0.0], projected_com)
    x, y, _ = interface.scene(np.append(projected_com, 0.0))
    if outside > 0.0:
        far = f" {outside:.3g} m" if outside < np.inf else ""
        what = (
            f"the line of the weight passes{far} beside every place where the rock may touch its pedestal "
            f"(at {x:.2f}, {y:.2f} in the scene), since daylight or the pedestal was seen below it there"
        )
    else:
        kind = f", on a {inspection.base} base," if inspection.base else ""
        what = f"no contacts around the line of the weight (at {x:.2f}, {y:.2f} in the scene){kind} agree with all seen"
    return ContradictionError(
        "base.contradicted",
        what,
        where="standing",
        expected="a base on which the rock is at rest as it was scanned",
        remedy="one observation is wrong: another thing is the rock (--near, --point), the rim is not where it seems "
        "(strays, plants; crop or clean the cloud), the plane is another (--plane), a place of --contact is misread, it"
        " touches elsewhere too (--touch-only), the base is of another kind (--base); or something else holds the rock,"
        " a wall or a wedge: give the two as meshes, --rock ROCK --pedestal PEDESTAL",
    )
