"""Rocks under events, as 'toppling constrain' takes them: event sets, or two curves of two measures at once."""

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from toppling.models.errors import InputError
from toppling.models.files.documents import finite
from toppling.models.motions.measures import COMPARED
from toppling.orchestrator.public.rocks import Jobs
from toppling.results.analysis.exchange import read_surface
from toppling.results.analysis.fits import SURFACES, answered, basis_of
from toppling.results.analysis.regression import fit
from toppling.results.analysis.resampling import bootstrap
from toppling.results.drawing.style import printed_unit, short_name
from toppling.results.hazard.ages import Since, exposure
from toppling.results.hazard.curves import events_by_intensity
from toppling.results.hazard.event_survival import EventBranch, EventSet, EventSite, FeltRock, check_measures
from toppling.results.hazard.event_update import EventUpdate
from toppling.results.hazard.measure_names import is_spectral
from toppling.results.hazard.places import distance_km, nearest, of_name
from toppling.results.hazard.surfaces import drawn_surfaces, measures_of, surface_of
from toppling.results.hazard.survival import Standing
from toppling.results.hazard.tree import HazardTree
from toppling.results.hazard.vector import READINGS, SCATTERS, SIGMA, correlation_of, joint_rate


def measures_asked(text: str | None) -> tuple[str, ...]:
    """Measures of `pga_m_s2` or `pga_m_s2+pgv_m_s`; none where none is asked for.

    Raises InputError if one is unknown, or two together have no fragility.
    """
    names = tuple(part.strip() for part in text.split("+")) if text else ()
    unknown = any(name not in COMPARED and not is_spectral(name) for name in names)
    if unknown or (len(names) > 1 and names != SURFACES[0]):
        raise InputError(
            what=f"{text!r} is not an intensity measure with a fragility", where="--measure",
            expected=f"one of {', '.join(COMPARED)}; sa_3s_m_s2, any period; or {'+'.join(SURFACES[0])}, both together",
            remedy="leave it out to use that of the hazard, or pgv_m_s",
        )  # fmt: skip
    return names


def place_rocks(
    names: Sequence[str], events: EventSet, asked: Sequence[tuple[float, float] | str]
) -> tuple[list[int], list[float | None]]:
    """Number of each rock's site among those of the events, and how far it is from the place that was asked for.

    Raises InputError if there are several sites and none is asked for, or none of the name, or too far.
    """
    if not asked:
        if len(events.sites) > 1:
            known = ", ".join(site.name for site in events.sites[:12])
            raise InputError(
                what=f"has {len(events.sites)} sites: {known}", where=events.source,
                expected="the site of each rock",
                remedy="choose one with --site (LON LAT, or its name), or one for each rock in their order",
            )  # fmt: skip
        return [0] * len(names), [None] * len(names)
    if len(asked) not in (1, len(names)):
        raise InputError(
            what=f"{len(asked)} sites for {len(names)} rocks", where="--site",
            expected="one site, or one for each rock",
            remedy="repeat --site in the order of the rocks",
        )  # fmt: skip
    found = [_site_of(one, events) for one in asked]
    return (
        [number for number, _ in found] * (len(names) // len(found)),
        [away for _, away in found] * (len(names) // len(found)),
    )


def _site_of(asked: tuple[float, float] | str, events: EventSet) -> tuple[int, float | None]:
    if isinstance(asked, str):
        return of_name([site.name for site in events.sites], asked, events.source)[0], None
    placed = [(number, site.place) for number, site in enumerate(events.sites) if site.place]
    if not placed:
        raise InputError(
            what="states no places of its sites", where=events.source, expected="a sitemesh file beside the fields",
            remedy=f"put it there, or give a name: {', '.join(site.name for site in events.sites[:12])}",
        )  # fmt: skip
    number, place = placed[nearest([place for _, place in placed], asked, events.source)]
    return number, float(distance_km(*place, asked))


def felt(rock: Standing, site: int, since: Since | None) -> FeltRock:
    """A rock of one measure at a site of the events."""
    return FeltRock(rock.name, rock.curve, site, rock.drawn, since)


def felt_by_both(
    name: str, path: Path, jobs: Jobs | None, measures: tuple[str, ...], advance: Callable[[], None]
) -> FeltRock:
    """A rock whose fragility is over two measures, from a run or a file of curves.

    Raises InputError if it states no such fragility, or its answers have no such fit.
    """
    if jobs is None:
        surface, why = read_surface(path, measures), ": it is no run, and states no surface"
        drawn = surface.resampled if surface else None
    else:
        frame = jobs.frame
        frame = answered(frame[(frame[list(measures)] > 0).all(axis=1)])
        fitted = fit(frame, measures) if len(frame) else None
        surface, why = surface_of(fitted) if fitted else None, f" ({fitted.problem})" if fitted else ""
        drawn = bootstrap(frame, fitted, advance=advance) if fitted and surface else None
        if surface:
            surface = replace(surface, basis=basis_of(frame, measures[0], jobs.completeness))
    if surface is None:
        raise InputError(
            what=f"has no fragility over two measures{why}",
            where=str(path), expected=f"a run, or curves of one, with a fit over {' and '.join(measures)}",
            remedy="give the run, or one --measure",
        )  # fmt: skip
    return FeltRock(name, surface, 0, drawn_surfaces(drawn, measures) if drawn else [])


def joined(first: HazardTree, second: HazardTree, correlation: float | None) -> EventSet:
    """Trees of two measures at one site as a set of events, branch by branch.

    Raises InputError if the trees have different branches, or no correlation is known or given.
    """
    rho = correlation_of(first.measure, second.measure) if correlation is None else correlation
    if rho is None:
        raise InputError(
            what=f"the correlation of {first.measure} and {second.measure} is not known here", where="--correlation",
            expected="the correlation of their residuals in one earthquake", remedy="give it with --correlation",
        )  # fmt: skip
    if [branch.name for branch in first.branches] != [branch.name for branch in second.branches] and not (
        len(first.branches) == len(second.branches) == 1
    ):
        raise InputError(
            what=f"{len(first.branches)} branches of {first.measure}, {len(second.branches)} of {second.measure}",
            where="--hazard", expected="the same branches of both measures", remedy="give the trees of one calculation",
        )  # fmt: skip
    scatter = SIGMA * math.sqrt(1.0 - rho**2)
    branches, misfit = _joined(first, second, scatter)
    notes: tuple[str, ...] = (
        f"joint rate of {first.measure} and {second.measure} from their curves: given the one, ln of the other "
        f"scatters by {scatter:.3g}, as a correlation of {rho:g} of their residuals says",
        f"its rates of {second.measure} are within {100 * misfit:.0f} % of the curve",
    )
    readings: tuple[tuple[EventBranch, ...], ...] = ()
    if correlation is None:
        readings = tuple(_joined(first, second, one)[0] for one in np.linspace(*SCATTERS, READINGS))
        notes += (
            f"two curves do not tell which magnitudes they are of: intervals are over scatters of {SCATTERS[0]:g} to "
            f"{SCATTERS[1]:g}",
        )
    site = EventSite(first.site_name or "site", first.site)
    return EventSet((site,), branches, first.weights_from, None, notes, sampled=False, readings=readings)


def _joined(first: HazardTree, second: HazardTree, scatter: float) -> tuple[tuple[EventBranch, ...], float]:
    """Joint rate of each branch, and the largest misfit of the second measure's rates."""
    joints = [
        joint_rate(one.curve, other.curve, scatter)
        for one, other in zip(first.branches, second.branches, strict=True)
    ]
    branches = tuple(
        replace(
            joint.events,
            name=branch.name,
            model=branch.path.partition("~")[2] or branch.name,
            weight=branch.weight,
        )
        for joint, branch in zip(joints, first.branches, strict=True)
    )
    return branches, max(joint.misfit for joint in joints)


def of_tree(tree: HazardTree, medians: Sequence[float]) -> EventSet:
    """A tree of one measure at one site as a set of events: what rocks that were stouter before ask for."""
    branches = []
    for branch in tree.branches:
        intensity, rate = events_by_intensity(branch.curve, medians)
        motions = {tree.measure: intensity[:, None]}
        model = branch.path.partition("~")[2] or branch.name
        branches.append(EventBranch(branch.name, rate, motions, branch.weight, model))
    site = EventSite(tree.site_name or "site", tree.site)
    return EventSet((site,), tuple(branches), tree.weights_from, None, (), sampled=False)


@dataclass(frozen=True, eq=False)
class EventStatement:
    """What rocks say under a set of events."""

    update: EventUpdate
    away_km: Sequence[float | None]  # of each rock's site from the place that was asked for

    @property
    def measures(self) -> tuple[str, ...]:
        """Measures of the rocks' fragilities, which are alike."""
        return measures_of(self.update.rocks[0].fragility)

    def _everywhere(self, table: Callable[[str, int], pd.DataFrame]) -> pd.DataFrame:
        """A table of each measure at each rock's site, with the columns measure and site."""
        events = self.update.events
        parts = [
            table(measure, site).assign(measure=measure, site=events.sites[site].name)
            for site in dict.fromkeys(rock.site for rock in self.update.rocks)
            for measure in self.measures
        ]
        return pd.concat(parts, ignore_index=True)

    @cached_property
    def tables(self) -> dict[str, pd.DataFrame]:
        """Tables by name, those that hold something."""
        update = self.update
        found = {
            "branches": update.branches, "models": update.models, "left_out": update.left_out,
            "updated": self._everywhere(update.updated), "changes": self._everywhere(update.changes),
        }  # fmt: skip
        return {name: table for name, table in found.items() if table is not None and len(table)}

    def summary(self) -> dict[str, Any]:
        """The statement, for JSON."""
        update, events = self.update, self.update.events
        vary = {
            "event": events.sampled, "fragility": any(rock.drawn for rock in update.rocks),
            "age": update.exposure.years.shape[1] > 1, "joint rate": bool(events.readings),
        }  # fmt: skip
        summary = {
            "measure": "+".join(self.measures), "confidence": update.confidence, "source": events.source,
            "events": sum(len(branch.rate) for branch in events.branches), "years_of_each_branch": events.years,
            "rocks": [_rock(rock, events, away) for rock, away in zip(update.rocks, self.away_km, strict=True)],
            "mean": update.mean, "decided": update.decided,
            "intervals_carry": [name for name, varies in vary.items() if varies],
            "left_out": [], "updated": [], "changes": [], "notes": list(events.notes),
        }  # fmt: skip
        return finite(summary | {name: table.to_dict("records") for name, table in self.tables.items()})


def under_events(
    rocks: Sequence[FeltRock],
    ages: np.ndarray,
    events: EventSet,
    confidence: float,
    away_km: Sequence[float | None],
) -> EventStatement:
    """Judge rocks under a set of events.

    ages: (draws, rocks), from `results.hazard.ages.joint_ages`.
    """
    check_measures(rocks, events)
    late = [rock.since for rock in rocks]
    return EventStatement(EventUpdate(rocks, events, exposure(ages, late), confidence), away_km)


def _rock(rock: FeltRock, events: EventSet, away: float | None) -> dict[str, Any]:
    site = events.sites[rock.site]
    measures, basis = measures_of(rock.fragility), rock.fragility.basis
    if len(measures) == 1:
        curve = rock.fragility
        words = (
            f"median {curve.median:.3g} {printed_unit(measures[0])} ({short_name(measures[0])}), "  # type: ignore[union-attr]
            f"beta {curve.beta:.2f}"  # type: ignore[union-attr]
        )
        numbers = {"median": curve.median, "beta": curve.beta}  # type: ignore[union-attr]
    else:
        a, *slopes = rock.fragility.coefficients  # type: ignore[union-attr]
        terms = " ".join(
            f"{slope:+.2f} ln {short_name(name)}" for slope, name in zip(slopes, measures, strict=True)
        )
        words = f"probit {a:.2f} {terms}"
        numbers = {"coefficients": [a, *slopes]}
    return {
        "name": rock.name, "fragility": words, **numbers, "site": site.name, "site_distance_km": away,
        "site_longitude_deg": site.place[0] if site.place else None,
        "site_latitude_deg": site.place[1] if site.place else None,
    } | (asdict(basis) if basis else {})  # fmt: skip
