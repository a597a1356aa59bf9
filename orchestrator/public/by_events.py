"""Constraint of a set of events, or of two hazard curves of different measures, by standing rocks."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from toppling.models.errors import InputError
from toppling.models.files.documents import finite
from toppling.orchestrator.public.hazard_question import Question, read_tree, shared_measure
from toppling.orchestrator.public.rocks import Jobs, measures_shared, names_of, refuse_twins, standing_rock
from toppling.results.analysis.exchange import read_surface
from toppling.results.analysis.fits import answered, basis_of
from toppling.results.analysis.lognormal import Lognormal, fit
from toppling.results.analysis.resampling import sampled
from toppling.results.drawing.style import printed_unit, short_name, within
from toppling.results.hazard.ages import exposure
from toppling.results.hazard.events import (
    READINGS,
    SCATTERS,
    SIGMA,
    EventBranch,
    EventSet,
    EventSite,
    Fragility,
    Standing,
    correlation_of,
    joint_rate,
)
from toppling.results.hazard.places import distance_km, nearest, of_name
from toppling.results.hazard.readers.event_sets import read_events
from toppling.results.hazard.survival import topples
from toppling.results.hazard.tree import HazardTree
from toppling.results.hazard.update import Update


def judged_by_events(
    question: Question, jobs: Mapping[Path, Jobs], advance: Callable[[], None]
) -> tuple[Update, dict[str, Any]]:
    """Update of a set of events by standing rocks, and the statement for JSON.

    jobs: jobs of those rocks that are runs.
    advance: called before each bootstrap sample of records.
    """
    events, measures = _of_set(question) if question.event_set else _of_curves(question)
    names = names_of(question.paths)
    sites, away_km = _placed(names, events, question.sites if question.event_set else ())
    rocks = [
        Standing(name, _fragility(path, measures, jobs.get(path), advance), site, since, age)
        for name, path, site, since, age in zip(
            names, question.paths, sites, question.since, question.ages_given, strict=True
        )
    ]
    refuse_twins(question.paths, [rock.fragility.basis for rock in rocks])
    for rock in rocks:  # before anything is computed
        topples(rock.fragility, {name: np.empty(0) for name in events.measures})
    update = Update(rocks, events, exposure(question.joint_ages, question.since), question.confidence)
    return update, _summary(update, measures, away_km)


def _of_set(question: Question) -> tuple[EventSet, tuple[str, ...]]:
    """Read the set of events, and select its measures."""
    asked, path = question.asked, question.event_set
    assert path is not None
    events = read_events(path, asked.ratio, question.events.event_rate, question.events.catalogue_years)
    shared = measures_shared(question.paths)
    measures = asked.measures or (shared_measure(events.measures, shared, events.source),)
    if len(measures) > 1 and not events.correlated:
        raise InputError(
            "events.residuals_independent",
            what="holds fields of OpenQuake, which draws the residuals of two measures independently",
            where=events.source,
            expected="motions of one measure, or of two that are correlated as in earthquakes",
            remedy="give one --measure, or both hazard curves of which --correlation gives the joint rate",
        )
    return events, measures


def _of_curves(question: Question) -> tuple[EventSet, tuple[str, ...]]:
    """Convert curves of two measures to a set of events."""
    asked = question.asked
    trees = [read_tree(question.hazard, replace(asked, measure=name)) for name in asked.measures]
    return _of_two_trees(trees[0], trees[1], question.events.correlation), asked.measures


def _fragility(
    path: Path, measures: tuple[str, ...], jobs: Jobs | None, advance: Callable[[], None]
) -> Fragility:
    """Fragility over one or two measures, with bootstrap samples, from a run or a file of curves.

    Raises InputError if there is none over two measures, or the answers have no such fit.
    """
    if len(measures) == 1:
        return standing_rock("", path, measures[0], jobs, advance).fragility
    if jobs is None:
        surface, why = read_surface(path, measures), ": it is no run, and states no surface"
    else:
        frame = jobs.frame
        frame = answered(frame[(frame[list(measures)] > 0).all(axis=1)])
        fitted = sampled(frame, fit(frame, measures), advance=advance) if len(frame) else None
        surface, why = fitted.surface if fitted else None, f" ({fitted.problem})" if fitted else ""
        if surface:
            surface = replace(surface, basis=basis_of(frame, measures[0], jobs.completeness))
    if surface is None:
        raise InputError(
            "fragility.none",
            what=f"has no fragility over two measures{why}",
            where=str(path),
            expected=f"a run, or curves of one, with a fit over {' and '.join(measures)}",
            remedy="give the run, or one --measure",
        )
    return surface


def _placed(
    names: Sequence[str], events: EventSet, asked: Sequence[tuple[float, float] | str]
) -> tuple[list[int], list[float | None]]:
    """Index of each rock's site among those of the events, and its distance from the requested location, km.

    Raises InputError if there are several sites and none is requested, or none has the name, or is near enough.
    """
    if not asked:
        if len(events.sites) > 1:
            known = ", ".join(site.name for site in events.sites[:12])
            raise InputError(
                "site.several",
                what=f"has {len(events.sites)} sites: {known}",
                where=events.source,
                expected="the site of each rock",
                remedy="choose one with --site (LON LAT, or its name), or one for each rock in order",
            )
        return [0] * len(names), [None] * len(names)
    if len(asked) not in (1, len(names)):
        raise InputError(
            "site.count_differs",
            what=f"{len(asked)} sites for {len(names)} rocks",
            where="--site",
            expected="one site, or one for each rock",
            remedy="repeat --site in the order of the rocks",
        )
    found = [_site_of(site, events) for site in asked] * (len(names) // len(asked))
    return [number for number, _ in found], [away for _, away in found]


def _site_of(asked: tuple[float, float] | str, events: EventSet) -> tuple[int, float | None]:
    if isinstance(asked, str):
        return of_name([site.name for site in events.sites], asked, events.source)[0], None
    placed = [(number, site.place) for number, site in enumerate(events.sites) if site.place]
    if not placed:
        raise InputError(
            "site.places_missing",
            what="states no places of its sites",
            where=events.source,
            expected="a sitemesh file in the folder of the fields",
            remedy=f"put it there, or give a name: {', '.join(site.name for site in events.sites[:12])}",
        )
    number, place = placed[nearest([place for _, place in placed], asked, events.source)]
    return number, float(distance_km(*place, asked))


def _of_two_trees(first: HazardTree, second: HazardTree, correlation: float | None) -> EventSet:
    """Convert trees of two measures at one site to a set of events, branch by branch.

    Raises InputError if the trees have different branches, or the correlation is unknown.
    """
    rho = correlation_of(first.measure, second.measure) if correlation is None else correlation
    if rho is None:
        raise InputError(
            "hazard.correlation_unknown",
            what=f"the correlation of {first.measure} and {second.measure} is not known here",
            where="--correlation",
            expected="the correlation of their residuals in one earthquake",
            remedy="give it with --correlation",
        )
    if [branch.name for branch in first.branches] != [branch.name for branch in second.branches] and not (
        len(first.branches) == len(second.branches) == 1
    ):
        raise InputError(
            "hazard.branches_differ",
            what=f"{len(first.branches)} branches of {first.measure}, {len(second.branches)} of {second.measure}",
            where="--hazard",
            expected="the same branches of both measures",
            remedy="give the trees of one calculation",
        )
    scatter = SIGMA * math.sqrt(1.0 - rho**2)
    branches, misfit = _joint_branches(first, second, scatter)
    notes: tuple[str, ...] = (
        f"joint rate of {first.measure} and {second.measure} from their curves: given the one, ln of the other "
        f"scatters by {scatter:.3g}, as a correlation of {rho:g} of their residuals says",
        f"its rates of {second.measure} are within {100 * misfit:.0f} % of the curve",
    )
    readings: tuple[tuple[EventBranch, ...], ...] = ()
    if correlation is None:
        readings = tuple(
            _joint_branches(first, second, scatter)[0] for scatter in np.linspace(*SCATTERS, READINGS)
        )
        notes += (
            f"two curves do not determine their magnitudes: intervals are over scatters of {SCATTERS[0]:g} to "
            f"{SCATTERS[1]:g}",
        )
    site = EventSite(first.site_name or "site", first.site)
    return EventSet((site,), branches, first.weights_from, None, notes, sampled=False, readings=readings)


def _joint_branches(
    first: HazardTree, second: HazardTree, scatter: float
) -> tuple[tuple[EventBranch, ...], float]:
    """Joint rate of each branch, and the largest misfit of the second measure's rates."""
    joints = [
        joint_rate(one.curve, other.curve, scatter)
        for one, other in zip(first.branches, second.branches, strict=True)
    ]
    branches = tuple(
        replace(events, name=branch.name, model=branch.model, weight=branch.weight)
        for (events, _), branch in zip(joints, first.branches, strict=True)
    )
    return branches, max(misfit for _, misfit in joints)


def _summary(update: Update, measures: tuple[str, ...], away_km: Sequence[float | None]) -> dict[str, Any]:
    """Statement for JSON; `away_km` is the distance of each rock's site from the requested location."""
    events = update.events
    summary = {
        "measure": "+".join(measures), "confidence": update.confidence, "source": events.source,
        "events": sum(len(branch.rate) for branch in events.branches), "years_of_each_branch": events.years,
        "rocks": [
            _rock(rock, events, away) | {"age_years": float(np.median(years))}
            for rock, away, years in zip(update.rocks, away_km, update.exposure.of_rocks, strict=True)
        ],
        **update.of_all_branches,
        "left_out": [], "updated": [], "changes": [], "notes": list(events.notes),
    }  # fmt: skip
    return finite(summary | {name: table.to_dict("records") for name, table in update.tables.items()})


def _rock(rock: Standing, events: EventSet, away: float | None) -> dict[str, Any]:
    site = events.sites[rock.site]
    measures, basis = rock.fragility.measures, rock.fragility.basis
    if isinstance(rock.fragility, Lognormal):
        numbers: dict[str, Any] = {
            "median": rock.curve.median, "beta": rock.curve.beta,
            "fragility": f"median {within(rock.curve.median, rock.curve.strongest_shaken)} {printed_unit(measures[0])} "
            f"({short_name(measures[0])}), beta {rock.curve.beta:.2f}",
        }  # fmt: skip
    else:
        a, *slopes = rock.fragility.coefficients
        terms = [f"{slope:+.2f} ln {short_name(name)}" for slope, name in zip(slopes, measures, strict=True)]
        numbers = {"coefficients": [a, *slopes], "fragility": f"probit {a:.2f} {' '.join(terms)}"}
    return {
        "name": rock.name, "age": rock.age, **numbers, "site": site.name, "site_distance_km": away,
        "site_longitude_deg": site.place[0] if site.place else None,
        "site_latitude_deg": site.place[1] if site.place else None,
    } | (asdict(basis) if basis else {})  # fmt: skip
