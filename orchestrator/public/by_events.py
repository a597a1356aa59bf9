"""Rocks judged event by event: event sets, two curves of two measures at once, rocks that were once stouter."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from toppling.models.errors import InputError
from toppling.models.files.documents import finite
from toppling.orchestrator.public.hazard_question import Question, read_tree, shared_measure
from toppling.orchestrator.public.rocks import Jobs, measures_shared, names_of, refuse_twins, standing_rock
from toppling.results.analysis.exchange import read_curves, read_surface
from toppling.results.analysis.fits import answered, basis_of
from toppling.results.analysis.lognormal import Surface
from toppling.results.analysis.regression import fit
from toppling.results.analysis.resampling import sampled
from toppling.results.drawing.style import printed_unit, short_name, within
from toppling.results.hazard.ages import exposure
from toppling.results.hazard.curves import events_by_intensity
from toppling.results.hazard.event_survival import EventBranch, EventSet, EventSite, FeltRock, check_measures
from toppling.results.hazard.event_update import EventUpdate
from toppling.results.hazard.places import distance_km, nearest, of_name
from toppling.results.hazard.readers.event_sets import read_events
from toppling.results.hazard.tree import Branch, HazardTree
from toppling.results.hazard.vector import READINGS, SCATTERS, SIGMA, correlation_of, joint_rate


def judged_by_events(
    question: Question, jobs: Mapping[Path, Jobs], advance: Callable[[], None]
) -> tuple[EventUpdate, dict[str, Any], dict[str, pd.DataFrame]]:
    """What events say of rocks that stand: the update, the statement for JSON, and tables by name.

    jobs: of those rocks that are runs.
    advance: called before each bootstrap sample of records.
    """
    events, measures = _of_set(question) if question.event_set else _of_curves(question)
    names = names_of(question.paths)
    sites, away_km = _placed(names, events, question.sites if question.event_set else ())
    rocks = [
        replace(_felt(question, number, measures, jobs, advance), site=site)
        for number, site in enumerate(sites)
    ]
    refuse_twins(question.paths, [rock.fragility.basis for rock in rocks])
    check_measures(rocks, events)
    felt = exposure(question.joint_ages, question.since)
    update = EventUpdate(rocks, events, felt, question.confidence)
    tables = _tables(update, measures)
    return update, _summary(update, tables, measures, away_km), tables


def _of_set(question: Question) -> tuple[EventSet, tuple[str, ...]]:
    """A set of events, and the measures of it that are meant."""
    asked, path = question.asked, question.event_set
    assert path is not None
    events = read_events(path, asked.ratio, question.events.event_rate, question.events.catalogue_years)
    shared = measures_shared(question.paths)
    measures = asked.measures or (shared_measure(events.measures, shared, events.source),)
    if len(measures) > 1 and not events.correlated:
        raise InputError(
"events.residuals_independent",
            what="holds fields of OpenQuake, which draws the residuals of two measures independently",
            where=events.source, expected="motions of one measure, or of two that are correlated as in earthquakes",
            remedy="give one --measure; or the hazard curves of both, of which --correlation gives the joint rate"
        )  # fmt: skip
    return events, measures


def _of_curves(question: Question) -> tuple[EventSet, tuple[str, ...]]:
    """Curves as a set of events."""
    asked, paths = question.asked, question.paths
    if len(asked.measures) > 1:
        trees = [read_tree(question.hazard, replace(asked, measure=one)) for one in asked.measures]
        return _of_two_trees(trees[0], trees[1], question.events.correlation), asked.measures
    tree = read_tree(question.hazard, asked, measures_shared(paths))
    medians = [read_curves(path)[tree.measure].median for path in paths if not path.is_dir()]
    return _of_tree(tree, medians), (tree.measure,)


def _felt(
    question: Question,
    number: int,
    measures: tuple[str, ...],
    jobs: Mapping[Path, Jobs],
    advance: Callable[[], None],
) -> FeltRock:
    """A rock with its fragility over one measure or two, at the first site."""
    path, since = question.paths[number], question.since[number]
    name = names_of(question.paths)[number]
    if len(measures) > 1:
        surface, drawn = _surface(path, jobs.get(path), measures, advance)
        return FeltRock(name, surface, 0, drawn, since)
    years = np.unique(question.joint_ages[:, number])
    standing = standing_rock(name, path, measures[0], jobs.get(path), years, advance)
    return FeltRock(name, standing.curve, 0, standing.drawn, since)


def _surface(
    path: Path, jobs: Jobs | None, measures: tuple[str, ...], advance: Callable[[], None]
) -> tuple[Surface, list[Surface]]:
    """Fragility over two measures, and of its bootstrap samples, from a run or a file of curves.

    Raises InputError if it states no such fragility, or its answers have no such fit.
    """
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
        raise InputError("fragility.none", what=f"has no fragility over two measures{why}", where=str(path),
            expected=f"a run, or curves of one, with a fit over {' and '.join(measures)}",
            remedy="give the run, or one --measure")  # fmt: skip
    return surface, surface.resampled.surfaces(measures) if surface.resampled else []


def _placed(
    names: Sequence[str], events: EventSet, asked: Sequence[tuple[float, float] | str]
) -> tuple[list[int], list[float | None]]:
    """Number of each rock's site among those of the events, and how far it is from the place that was asked for.

    Raises InputError if there are several sites and none is asked for, or none of the name, or too far.
    """
    if not asked:
        if len(events.sites) > 1:
            known = ", ".join(site.name for site in events.sites[:12])
            raise InputError(
"site.several",
                what=f"has {len(events.sites)} sites: {known}", where=events.source,
                expected="the site of each rock",
                remedy="choose one with --site (LON LAT, or its name), or one for each rock in their order"
            )  # fmt: skip
        return [0] * len(names), [None] * len(names)
    if len(asked) not in (1, len(names)):
        raise InputError("site.count_differs", what=f"{len(asked)} sites for {len(names)} rocks",
            where="--site", expected="one site, or one for each rock",
            remedy="repeat --site in the order of the rocks")  # fmt: skip
    found = [_site_of(one, events) for one in asked] * (len(names) // len(asked))
    return [number for number, _ in found], [away for _, away in found]


def _site_of(asked: tuple[float, float] | str, events: EventSet) -> tuple[int, float | None]:
    if isinstance(asked, str):
        return of_name([site.name for site in events.sites], asked, events.source)[0], None
    placed = [(number, site.place) for number, site in enumerate(events.sites) if site.place]
    if not placed:
        raise InputError(
"site.places_missing",
            what="states no places of its sites", where=events.source, expected="a sitemesh file beside the fields",
            remedy=f"put it there, or give a name: {', '.join(site.name for site in events.sites[:12])}"
        )  # fmt: skip
    number, place = placed[nearest([place for _, place in placed], asked, events.source)]
    return number, float(distance_km(*place, asked))


def _of_two_trees(first: HazardTree, second: HazardTree, correlation: float | None) -> EventSet:
    """Trees of two measures at one site as a set of events, branch by branch.

    Raises InputError if the trees have different branches, or no correlation is known or given.
    """
    rho = correlation_of(first.measure, second.measure) if correlation is None else correlation
    if rho is None:
        raise InputError("hazard.correlation_unknown",
            what=f"the correlation of {first.measure} and {second.measure} is not known here",
            where="--correlation", expected="the correlation of their residuals in one earthquake",
            remedy="give it with --correlation")  # fmt: skip
    if [branch.name for branch in first.branches] != [branch.name for branch in second.branches] and not (
        len(first.branches) == len(second.branches) == 1
    ):
        raise InputError(
"hazard.branches_differ",
            what=f"{len(first.branches)} branches of {first.measure}, {len(second.branches)} of {second.measure}",
            where="--hazard", expected="the same branches of both measures", remedy="give the trees of one calculation"
        )  # fmt: skip
    scatter = SIGMA * math.sqrt(1.0 - rho**2)
    branches, misfit = _joint_branches(first, second, scatter)
    notes: tuple[str, ...] = (
        f"joint rate of {first.measure} and {second.measure} from their curves: given the one, ln of the other "
        f"scatters by {scatter:.3g}, as a correlation of {rho:g} of their residuals says",
        f"its rates of {second.measure} are within {100 * misfit:.0f} % of the curve",
    )
    readings: tuple[tuple[EventBranch, ...], ...] = ()
    if correlation is None:
        readings = tuple(_joint_branches(first, second, one)[0] for one in np.linspace(*SCATTERS, READINGS))
        notes += (
            f"two curves do not tell which magnitudes they are of: intervals are over scatters of {SCATTERS[0]:g} to "
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
        replace(events, name=branch.name, model=_model(branch), weight=branch.weight)
        for (events, _), branch in zip(joints, first.branches, strict=True)
    )
    return branches, max(misfit for _, misfit in joints)


def _model(branch: Branch) -> str:
    return branch.path.partition("~")[2] or branch.name


def _of_tree(tree: HazardTree, medians: Sequence[float]) -> EventSet:
    """A tree of one measure at one site as a set of events: what rocks that were stouter before ask for."""
    branches = []
    for branch in tree.branches:
        intensity, rate = events_by_intensity(branch.curve, medians)
        motions = {tree.measure: intensity[:, None]}
        branches.append(EventBranch(branch.name, rate, motions, branch.weight, _model(branch)))
    site = EventSite(tree.site_name or "site", tree.site)
    return EventSet((site,), tuple(branches), tree.weights_from, None, (), sampled=False)


def _tables(update: EventUpdate, measures: tuple[str, ...]) -> dict[str, pd.DataFrame]:
    """Tables by name, those that hold something; of each measure at each rock's site those that are of both."""
    sites = update.events.sites
    parts = [
        [table.assign(measure=one, site=sites[at].name) for table in update.before_and_after(one, at)]
        for at in dict.fromkeys(rock.site for rock in update.rocks)
        for one in measures
    ]
    updated, changes = (pd.concat(tables, ignore_index=True) for tables in zip(*parts, strict=True))
    found = {
        "branches": update.branches, "models": update.models, "left_out": update.left_out,
        "updated": updated, "changes": changes,
    }  # fmt: skip
    return {name: table for name, table in found.items() if table is not None and len(table)}


def _summary(
    update: EventUpdate,
    tables: Mapping[str, pd.DataFrame],
    measures: tuple[str, ...],
    away_km: Sequence[float | None],
) -> dict[str, Any]:
    """The statement, for JSON.

    away_km: of each rock's site from the place that was asked for.
    """
    events = update.events
    vary = {
        "event": events.sampled, "fragility": any(rock.drawn for rock in update.rocks),
        "age": update.exposure.years.shape[1] > 1, "joint rate": bool(events.readings),
    }  # fmt: skip
    summary = {
        "measure": "+".join(measures), "confidence": update.confidence, "source": events.source,
        "events": sum(len(branch.rate) for branch in events.branches), "years_of_each_branch": events.years,
        "rocks": [_rock(rock, events, away) for rock, away in zip(update.rocks, away_km, strict=True)],
        "mean": update.mean, "decided": update.decided,
        "intervals_carry": [name for name, varies in vary.items() if varies],
        "left_out": [], "updated": [], "changes": [], "notes": list(events.notes),
    }  # fmt: skip
    return finite(summary | {name: table.to_dict("records") for name, table in tables.items()})


def _rock(rock: FeltRock, events: EventSet, away: float | None) -> dict[str, Any]:
    site = events.sites[rock.site]
    measures, basis = rock.fragility.measures, rock.fragility.basis
    if len(measures) == 1:
        curve = rock.fragility
        median = within(curve.median, curve.strongest_shaken)  # type: ignore[union-attr]
        words = (
            f"median {median} {printed_unit(measures[0])} ({short_name(measures[0])}), "
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
