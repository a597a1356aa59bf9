"""The base of a scanned rock: draws on which it stands as scanned, their intervals, what to observe next."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator
from scipy.spatial import ConvexHull, QhullError, cKDTree

from toppling.models.arrays import Array, Indices
from toppling.models.caching import cached
from toppling.models.frames import STANDARD_GRAVITY_M_S2
from toppling.models.ground.body import GroundedBody
from toppling.models.hidden_base.draw_bases import (
    AZIMUTHS_DEG,
    LEVEL,
    ContradictionError,
    DrawnBases,
    draw_bases,
    interval_of,
    unseen_base,
)
from toppling.models.hidden_base.evidence import bowls, pulls_log_likelihood
from toppling.models.hidden_base.gap import (
    LEAST_GAP_PER_HEIGHT,
    Base,
    Underside,
    encloses,
    foretold_gaps,
    hidden_base,
)
from toppling.models.hidden_base.inspection import Inspection
from toppling.models.hidden_base.intervals import PULL
from toppling.models.hidden_base.observed import HiddenPart, hidden_part, reliefs
from toppling.models.hidden_base.statics import FRICTION
from toppling.models.hidden_base.unseen_base import BaseDraw, UnseenBase
from toppling.models.pedestal import Pedestal
from toppling.models.rock import Rock
from toppling.models.scan.close import ClosedRock
from toppling.models.scan.crevice import grid_triangles
from toppling.models.scan.interface import Interface, between_nodes, lattice
from toppling.models.scan.uncertainty import ObservedRock, spread_of
from toppling.models.statics import CONTACT_SHARE_OF_HEIGHT, equilibrium_possible


def observations(drawn: DrawnBases) -> list[dict[str, Any]]:
    """The pull that leaves the interval narrowest, by its expected width (median over azimuths and median).

    Each draw in turn is taken for the truth: it gives the ratio that would be measured, and the draws are weighted by
    that.

    Returns
    -------
    list of dict
        One with `kind` (`pull`), `from_deg` and `to_deg` (both the azimuth toward which the rock is pulled), `width`.
    """
    toppling = drawn.toppling_m_s2
    widths = []
    for column in range(len(AZIMUTHS_DEG)):
        ratios = toppling[:, [column]] / STANDARD_GRAVITY_M_S2
        weight = np.array([np.exp(pulls_log_likelihood([(0.0, max(r, 1e-3))], ratios)) for r in ratios[:, 0]])
        widths.append(float(_widths(toppling, weight).mean()))
    best = int(np.argmin(widths))
    toward = float((AZIMUTHS_DEG[best] + 180.0) % 360.0)
    return [{"kind": PULL, "from_deg": toward, "to_deg": toward, "width": widths[best]}]


def _widths(toppling_m_s2: Array, weight: Array) -> Array:
    """Widths (k,) of the interval over draws (n, azimuths) with each of some weights (k, n)."""
    low, median, high = interval_of(toppling_m_s2, weight)
    return np.asarray(np.median((high - low) / np.maximum(median, 1e-9), axis=1))


_AROUND_LATTICES = 12.0
"""Distance beyond the rim over which a rock is tipped on the surface."""


def _bases_on_surface(
    drawn: DrawnBases, rock: Rock, base: Base, interface: Interface, height_m: float, as_closed: bool
) -> tuple[Rock, UnseenBase, int | None]:
    """The rock, closed with a base, on the draw nearest to the draws' median, all draws for it, and which one that is.

    as_closed: the rock stays as it was closed.
    Returns None as number where it does, also because it is at rest on none of the draws.
    """
    numbers = _base_vertices(rock, base, interface, height_m)
    places = [_moved(rock.vertices_m[numbers], drawn, gap.gap_m, interface) for gap in drawn.gaps]
    nominal = None
    for number in [] if as_closed else drawn.likeliest:
        vertices = rock.vertices_m.copy()
        vertices[numbers] = interface.scene(places[number])
        standing = Rock.from_triangles(vertices, rock.faces, where="closed rock")
        ground = _surface_of(interface)
        body = GroundedBody.of(standing, ground, STANDARD_GRAVITY_M_S2, (FRICTION, FRICTION))
        if body.stands(body.touching(body.pose)):
            rock, nominal = standing, number
            break
    draws = [
        BaseDraw(interface.support(interface.scene(place)), com_m - rock.com_m)
        for place, com_m in zip(places, drawn.com_m, strict=True)
    ]
    return rock, UnseenBase(0.0, tuple(draws), vertices=numbers), nominal


def _base_vertices(rock: Rock, base: Base, interface: Interface, height_m: float) -> Indices:
    """Numbers of the rock's vertices that lie in the hidden part of its base."""
    over = interface.over(rock.vertices_m)
    closed = between_nodes(
        over[:, :2], interface.lattice_m, lambda nodes: np.asarray(base.grid.at(base.height_m, nodes))
    )
    hidden = base.hidden.ravel()[base.grid.index(over)]
    return np.flatnonzero(hidden & (np.abs(over[:, 2] - closed) < CONTACT_SHARE_OF_HEIGHT * height_m))


def _moved(vertices_m: Array, drawn: DrawnBases, gap_m: Array, interface: Interface) -> Array:
    """Vertices of the base as u, v and height over the plane, with the gap of a draw."""
    flat, places = interface.flat(vertices_m), drawn.part.observed.places_m
    gap = LinearNDInterpolator(places, gap_m)(flat[:, :2])
    gap = np.where(np.isfinite(gap), gap, NearestNDInterpolator(places, gap_m)(flat[:, :2]))
    touching = np.flatnonzero(gap_m <= 0.0)
    gap[cKDTree(flat[:, :2]).query(places[touching])[1]] = 0.0
    moved = np.column_stack([flat[:, :2], gap])
    return moved + interface.rise(moved)


@cached
def _surface_of(interface: Interface) -> Pedestal:
    """The pedestal below a rock as its interface describes it: the carried surface as a mesh, or the endless plane."""
    sheet = interface.sheet
    if sheet is None:
        return Pedestal(interface.point_m, interface.normal)
    reach = _AROUND_LATTICES * sheet.lattice_m
    nodes = lattice(sheet, sheet.ring_m.min(axis=0) - reach, sheet.ring_m.max(axis=0) + reach)
    flat = np.column_stack([nodes.reshape(-1, 2), sheet.at(nodes).ravel()])
    return Pedestal(
        interface.point_m, interface.normal, interface.scene(flat), grid_triangles(nodes.shape[:2])
    )


def nominal_draw(drawn: DrawnBases, unseen: UnseenBase, rock: Rock, interface: Interface) -> int | None:
    """Draw nearest to the draws' median on whose feet a rock with its own centre of mass rests; None if on none."""
    plane = Pedestal(interface.point_m, interface.normal)
    for number in drawn.likeliest:
        standing = unseen.on_feet_of(rock, plane, number)
        if equilibrium_possible(standing, plane, STANDARD_GRAVITY_M_S2, FRICTION, np.zeros(3))[0]:
            return number
    return None


def base_unseen(
    observed: ObservedRock,
    interface: Interface,
    closed: ClosedRock,
    pedestal: Pedestal,
    inspection: Inspection,
    unaided: list[dict[str, float]] | None = None,
) -> tuple[Rock, UnseenBase, dict[str, Any]]:
    """Draw the base, and choose the draw on which the scene itself stands.

    inspection, unaided: in the scene's frame, and the intervals without it, if they are known.
    Returns the rock as it was closed, over a surface with the base on which the scene stands; the draws; what they say.
    Raises InputError if the inspection's places are none of the base, or what was seen leaves no base on which the rock
    stands as it was scanned.
    """
    smooth = hidden_base(observed.near(interface), observed.hint, interface)
    spread = spread_of(closed)
    std_m = np.array(spread["com_std_m"])
    drawn = draw_bases(observed, interface, closed.rock, smooth, std_m, inspection, pedestal)
    report: dict[str, Any] = {"level": LEVEL} | intervals(drawn, interface)
    report["volume_m3"] = drawn.volume_interval_m3(closed.rock.volume_m3, spread["volume_std_m3"])
    report["next_observations"] = observations(drawn)
    if inspection.pulls:
        report["pulls_beyond"] = pulls_beyond(drawn, inspection)
    report["touches_at_gaps"] = touches_at_gaps(drawn.part, LEAST_GAP_PER_HEIGHT * observed.height_m)
    outlined = observed.hint is not None and observed.hint.encloses
    if outlined or not inspection.says_nothing:
        report["without_inspection"] = unaided or _unaided(
            observed, interface, closed, smooth, std_m, pedestal
        )
    rock, as_closed = closed.rock, outlined and inspection.says_nothing  # it rests flat, within the outline
    if interface.sheet is None:
        unseen = unseen_base(drawn, rock, observed.height_m)
        number = None if as_closed else nominal_draw(drawn, unseen, rock, interface)
        unseen = dataclasses.replace(unseen, nominal=number)
        return rock, unseen, report | {"nominal_at_rest": as_closed or number is not None}
    as_closed &= interface.is_plane  # over the plane as a surface it may stand as it was closed
    rock, unseen, number = _bases_on_surface(drawn, rock, smooth, interface, observed.height_m, as_closed)
    return rock, unseen, report | {"nominal_at_rest": as_closed or number is not None}


def pulls_beyond(drawn: DrawnBases, inspection: Inspection) -> list[dict[str, float]]:
    """Pulls outside of what 90 % of the draws bear that agree with all but the pulls, over the weight."""
    return [
        {"azimuth_deg": azimuth, "ratio": ratio, "low": float(low), "high": float(high)}
        for (azimuth, ratio), (low, _, high) in zip(inspection.pulls, drawn.borne, strict=True)
        if not low <= ratio <= high
    ]


_CLOSED_CHANCE = 0.01
"""Chance that a gap is closed below which a touch there contradicts what was seen."""


def touches_at_gaps(part: HiddenPart, least_m: float) -> list[dict[str, float]]:
    """Places said to touch where the rim foretells a gap, or rays left such a least one: number from 1, and gap, m."""
    if not len(part.observed.touching):
        return []
    gaps_m, chance = foretold_gaps(part.observed, [*reliefs(part.width_m), *bowls(part.width_m)])
    return [
        {"place": int(k) + 1, "gap_m": float(max(gaps_m[k], part.free_m[k]))}
        for k in np.flatnonzero((chance < _CLOSED_CHANCE) | (part.free_m > least_m))
    ]


def _unaided(
    observed: ObservedRock,
    interface: Interface,
    closed: ClosedRock,
    smooth: Base,
    std_m: Array,
    pedestal: Pedestal,
) -> list[dict[str, float]] | None:
    """Intervals of the toppling acceleration without what the user knows of the base; None if nothing stands then."""
    hint = None if observed.hint is None or observed.hint.encloses else observed.hint
    try:
        unaided = dataclasses.replace(observed, hint=hint)
        before = draw_bases(unaided, interface, closed.rock, smooth, std_m, pedestal=pedestal)
    except ContradictionError:
        return None
    return intervals(before, interface)["toppling"]


def check_inspection(observed: ObservedRock, interface: Interface, inspection: Inspection) -> None:
    """Refuse places of an inspection (in the scene's frame) that are none of the base.

    Raises
    ------
    InputError
        If a place lies off the interface, or beside the hidden base.
    """
    if len(inspection.places_m):
        near = observed.near(interface)
        hidden_part(Underside.of(near, observed.hint, interface), near, inspection, interface)


def intervals(drawn: DrawnBases, interface: Interface) -> dict[str, Any]:
    """Intervals of toppling acceleration by azimuth, contact points and centre of mass over draws.

    Returns dict: `toppling`: for each azimuth of the ground acceleration its low, median and high, m/s2;
    `lift_off`: the same of the acceleration at which contacts begin to open. `kinds`: how likely each kind of base
    is by the rim, and how many draws are of it. `contacts`: convex outline of all places that touch, `outlines` of
    those that a share of the draws' contacts enclose, their number, and the support polygon's reach toward each
    azimuth from the line of the weight, low, median and high, m. `com_m`: low, median and high of each coordinate.
    """
    tail = 0.5 * (1.0 - LEVEL)
    lift_off = drawn.lift_off_interval_m_s2()
    places = drawn.part.observed.places_m
    toward = np.deg2rad(AZIMUTHS_DEG)
    directions = np.array([np.cos(toward), np.sin(toward), np.zeros(len(toward))]).T @ interface.axes
    reach, count, touched = [], [], []
    for gap, com_m in zip(drawn.gaps, drawn.com_m, strict=True):
        touching = places[gap.gap_m <= 0.0]
        touched.append(touching)
        weight = interface.projected_m(com_m[None])[0]
        assert encloses(touching, weight)
        reach.append(((touching - weight) @ directions[:, :2].T).max(axis=0))
        count.append(len(touching))
    outlines = [
        {"probability": share, "outline_m": interface.scene(_raised(corners, interface)).tolist()}
        for share in _OUTLINED
        if len(corners := _outline_of(touched, share))
    ]
    together = np.vstack(touched)
    outline_m = interface.scene(_raised(together[ConvexHull(together).vertices], interface))
    reaches = np.quantile(reach, [tail, 0.5, 1.0 - tail], axis=0)
    return {
        "draws": len(drawn.gaps),
        "distinct": drawn.distinct,
        "kinds": {
            name: {"weight": weight, "draws": drawn.kinds.get(name, 0)}
            for name, weight in drawn.kind_weights.items()
        },
        "toppling": _by_azimuth(*drawn.interval_m_s2()),
        **({} if lift_off is None else {"lift_off": _by_azimuth(*lift_off)}),
        "contacts": {
            "outline_m": outline_m.tolist(),
            "outlines": outlines,
            "count": [int(n) for n in np.quantile(count, [tail, 0.5, 1.0 - tail], method="nearest")],
            "reach": [
                {"azimuth_deg": float(a), "low_m": float(x), "median_m": float(m), "high_m": float(y)}
                for a, x, m, y in zip(AZIMUTHS_DEG, *reaches, strict=True)
            ],
        },
        "com_m": drawn.com_interval_m().tolist(),
    }


_OUTLINED, _ACROSS = (0.5, 0.95), 60
"""Shares of the draws whose contacts enclose what is outlined, and nodes across the hull of all contacts."""


def _outline_of(touched: list[Array], share: float) -> Array:
    """Corners (k, 2) of the places that the contacts (n, 2) of such a share of the draws enclose; none if few."""
    together = np.vstack(touched)
    ticks_m = [
        np.linspace(*ends, _ACROSS) for ends in zip(together.min(axis=0), together.max(axis=0), strict=True)
    ]
    nodes = np.stack(np.meshgrid(*ticks_m), axis=-1).reshape(-1, 2)
    planes = [ConvexHull(hull).equations for hull in touched]
    inside = np.mean([(nodes @ hull[:, :2].T + hull[:, 2] <= 0.0).all(axis=1) for hull in planes], axis=0)
    enclosed = nodes[inside >= share]
    try:
        return enclosed[ConvexHull(enclosed).vertices]
    except (QhullError, ValueError):  # in one line, or fewer than three
        return enclosed[:0]


def _raised(corners: Array, interface: Interface) -> Array:
    return np.pad(corners, ((0, 0), (0, 1))) + interface.rise(corners)


def _by_azimuth(low: Array, median: Array, high: Array) -> list[dict[str, float]]:
    return [
        {"azimuth_deg": float(a), "low_m_s2": float(x), "median_m_s2": float(m), "high_m_s2": float(y)}
        for a, x, m, y in zip(AZIMUTHS_DEG, low, median, high, strict=True)
    ]
