"""The base of a scanned rock: draws on which it stands as scanned, the closing that goes with them, their intervals."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from toppling.models.arrays import Array
from toppling.models.hidden_base.draws import UnseenBase
from toppling.models.hidden_base.from_scan import (
    AZIMUTHS_DEG,
    LEVEL,
    OTHER_ERRORS_SHARE,
    ContradictionError,
    DrawnBases,
    draw_bases,
    unseen_base,
)
from toppling.models.hidden_base.gap import encloses
from toppling.models.hidden_base.inspection import Inspection
from toppling.models.hidden_base.nominal import (
    FLAT_MARGIN,
    bases_on_surface,
    nominal_draw,
    smooth_fits_inspection,
    smooth_is_likely,
)
from toppling.models.hidden_base.observed import check_on_interface, hidden_part
from toppling.models.hidden_base.statics import hooked_m_s2
from toppling.models.hidden_base.underside import Base, Underside, hidden_base
from toppling.models.rock import Rock
from toppling.models.scan.close import ClosedRock
from toppling.models.scan.half_samples import bias_floors
from toppling.models.scan.interface import Interface
from toppling.models.scan.measure import ObservedRock, toppling


def base_unseen(
    observed: ObservedRock,
    interface: Interface,
    closed: ClosedRock,
    core: float,
    com_std_m: list[float] | None,
    inspection: Inspection,
    unaided: list[dict[str, float]] | None = None,
) -> tuple[Rock, UnseenBase, dict[str, Any]]:
    """Draw the base, and choose the draw on which the scene itself stands.

    Parameters
    ----------
    observed, interface, closed
        The rock as it was closed smoothly, whatever stands on it.
    core : float
        Of the feet of that closing.
    com_std_m : list of float or None
        Spread of the centre of mass over half samples, if they were drawn.
    inspection, unaided : Inspection, optional list of dict
        In the scene's frame; the intervals without it, if they are known.

    Returns
    -------
    Rock, UnseenBase, dict
        The rock as it was closed, over a surface with the base on which the scene stands; the draws; what they say.

    Raises
    ------
    InputError
        If the inspection's places are none of the base, a pull is none that a base bears, or what was seen leaves no
        base on which the rock stands as it was scanned.
    """
    smooth = hidden_base(observed.near(interface), core, observed.hint, interface=interface)
    least = np.full(3, bias_floors(closed.invented_share)["com_per_height"] * observed.height_m)
    std_m = least if com_std_m is None else np.array(com_std_m)
    central = toppling(closed.rock, interface, AZIMUTHS_DEG)
    report: dict[str, Any] = {"level": LEVEL, "smooth_closing_m_s2": central.tolist()}
    drawn = draw_bases(observed, interface, closed.rock, smooth, std_m, inspection)
    report |= intervals(drawn, interface)
    report["toppling"] = _or_hooked(report["toppling"], hooked_m_s2(closed.rock, interface, AZIMUTHS_DEG))
    if not inspection.says_nothing or (observed.hint is not None and observed.hint.encloses):
        report["without_inspection"] = unaided or _unaided(observed, interface, closed, smooth, std_m)
    parts = (drawn, observed, interface, closed.rock, smooth, central, inspection)
    if interface.sheet is not None:
        rock, unseen, nominal = _over_surface(*parts)
        return rock, unseen, report | nominal
    unseen, at_rest = _over_plane(*parts)
    return closed.rock, unseen, report | {"nominal_draw": unseen.nominal, "nominal_at_rest": at_rest}


def _or_hooked(rows: list[dict[str, float]], hooked_m_s2: Array) -> list[dict[str, float]]:
    """Intervals that reach to what a rock bears that hooks the cliff which a part of it hangs over."""
    most = hooked_m_s2 * (1.0 + 1.645 * OTHER_ERRORS_SHARE)
    return [
        {**row, "high_m_s2": max(row["high_m_s2"], float(high))} for row, high in zip(rows, most, strict=True)
    ]


def _over_surface(
    drawn: DrawnBases,
    observed: ObservedRock,
    interface: Interface,
    rock: Rock,
    smooth: Base,
    central_m_s2: Array,
    inspection: Inspection,
) -> tuple[Rock, UnseenBase, dict[str, Any]]:
    """The rock on the base on which the scene stands, the bases over the surface, and what the report says of them.

    Over the plane as a surface it may stand as it was closed.
    """
    says_nothing = inspection.says_nothing
    as_closed = interface.is_plane and (
        (observed.hint is not None and observed.hint.encloses and says_nothing)
        or smooth_is_likely(drawn, central_m_s2, FLAT_MARGIN if says_nothing else 0.0)
    )
    if as_closed and not says_nothing:
        as_closed = smooth_fits_inspection(rock, smooth, interface, drawn.part.inspection, observed.height_m)
    parts = (drawn, rock, smooth, interface, observed.height_m)
    rock, unseen, number = bases_on_surface(*parts, as_closed=as_closed)
    nominal = central_m_s2 if as_closed else None if number is None else drawn.toppling_m_s2[number]
    return (
        rock,
        unseen,
        {
            "nominal_draw": number,
            "nominal_at_rest": nominal is not None,
            "nominal_m_s2": None if nominal is None else nominal.tolist(),
        },
    )


def _over_plane(
    drawn: DrawnBases,
    observed: ObservedRock,
    interface: Interface,
    rock: Rock,
    smooth: Base,
    central_m_s2: Array,
    inspection: Inspection,
) -> tuple[UnseenBase, bool]:
    """Bases over the interface plane with the one on which the scene stands, and whether it is at rest there."""
    unseen = unseen_base(drawn, rock, interface, observed.height_m)
    number, at_rest = None, True  # as the user says where it rests: flat, within the outline
    if observed.hint is None or not observed.hint.encloses or not inspection.says_nothing:
        agrees = None
        if not inspection.says_nothing:
            agrees = smooth_fits_inspection(rock, smooth, interface, drawn.part.inspection, observed.height_m)
        number, at_rest = nominal_draw(drawn, unseen, rock, interface, central_m_s2, agrees, inspection.pulls)
    return dataclasses.replace(unseen, nominal=number), at_rest


def _unaided(
    observed: ObservedRock, interface: Interface, closed: ClosedRock, smooth: Base, std_m: Array
) -> list[dict[str, float]] | None:
    """Intervals of the toppling acceleration without what the user knows of the base; None if nothing stands then."""
    hint = None if observed.hint is None or observed.hint.encloses else observed.hint
    try:
        before = draw_bases(dataclasses.replace(observed, hint=hint), interface, closed.rock, smooth, std_m)
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
        check_on_interface(inspection, interface, observed.height_m)
        near = observed.near(interface)
        hidden_part(Underside.of(near, observed.hint, interface), near, inspection, interface)


def intervals(drawn: DrawnBases, interface: Interface) -> dict[str, Any]:
    """Intervals of toppling acceleration by azimuth, contact points and centre of mass over draws.

    Returns dict: `toppling`: for each azimuth of the ground acceleration its low, median and high, m/s2;
    `lift_off`: the same of the acceleration at which contacts begin to open. `kinds`: how likely each kind of base
    is by the rim, and how many draws are of it. `contacts`: number of places that touch, and the support polygon's
    reach toward each azimuth from the line of the weight, low, median and high, m. `com_m`: low, median and high of
    each coordinate.
    """
    tail = 0.5 * (1.0 - LEVEL)
    lift_off = drawn.lift_off_interval_m_s2()
    places = drawn.part.observed.places_m
    toward = np.deg2rad(AZIMUTHS_DEG)
    ways = np.array([np.cos(toward), np.sin(toward), np.zeros(len(toward))]).T @ interface.axes
    reach, count = [], []
    for gap, com_m in zip(drawn.gaps, drawn.com_m, strict=True):
        touching = places[gap.gap_m <= 0.0]
        weight = interface.projected_m(com_m[None])[0]
        assert encloses(touching, weight)
        reach.append(((touching - weight) @ ways[:, :2].T).max(axis=0))
        count.append(len(touching))
    reaches = np.quantile(reach, [tail, 0.5, 1.0 - tail], axis=0)
    return {
        "draws": len(drawn.gaps),
        "distinct": drawn.distinct,
        "kinds": {
            each: {"weight": weight, "draws": drawn.kinds.get(each, 0)}
            for each, weight in drawn.kind_weights.items()
        },
        "toppling": _by_azimuth(*drawn.interval_m_s2()),
        **({} if lift_off is None else {"lift_off": _by_azimuth(*lift_off)}),
        "contacts": {
            "count": [int(n) for n in np.quantile(count, [tail, 0.5, 1.0 - tail], method="nearest")],
            "reach": [
                {"azimuth_deg": float(a), "low_m": float(x), "median_m": float(m), "high_m": float(y)}
                for a, x, m, y in zip(AZIMUTHS_DEG, *reaches, strict=True)
            ],
        },
        "com_m": drawn.com_interval_m().tolist(),
    }


def _by_azimuth(low: Array, median: Array, high: Array) -> list[dict[str, float]]:
    return [
        {"azimuth_deg": float(a), "low_m_s2": float(x), "median_m_s2": float(m), "high_m_s2": float(y)}
        for a, x, m, y in zip(AZIMUTHS_DEG, low, median, high, strict=True)
    ]
