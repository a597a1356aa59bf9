"""`toppling constrain` where rocks are judged event by event: event sets, two measures at once, rocks once stouter."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from toppling.models.arrays import Array
from toppling.models.errors import InputError, UsageError
from toppling.orchestrator.public.felt import (
    EventStatement,
    felt,
    felt_by_both,
    joined,
    of_tree,
    place_rocks,
    under_events,
)
from toppling.orchestrator.public.hazard_question import (
    HazardQuestion,
    read_tree,
    shared_measure,
    weighted_paths,
)
from toppling.orchestrator.public.rocks import Jobs, measures_shared, refuse_twins, standing_rock
from toppling.results.analysis.exchange import read_curves
from toppling.results.hazard.ages import Since
from toppling.results.hazard.event_survival import EventSet, FeltRock
from toppling.results.hazard.readers.event_sets import is_event_set, read_events

_INDEPENDENT = (
    "OpenQuake draws the residuals of each measure independently, unless told otherwise: fields of two measures "
    "understate how often both are strong at once"
)


@dataclass(frozen=True)
class EventOptions:
    """What is said of events."""

    event_rate: float | None = None  # annual rate of a scenario
    catalogue_years: float | None = None  # time of each branch's events, where no file states it
    correlation: float | None = None  # of the residuals of two measures


@dataclass(frozen=True, eq=False)
class Rocks:
    """Rocks as the command line names them."""

    names: list[str]
    paths: tuple[Path, ...]
    ages: Array  # (draws, rocks)
    since: list[Since | None]
    jobs: dict[Path, Jobs]  # of those that are runs
    sites: Sequence[tuple[float, float] | str]


def event_set_of(hazard: Sequence[str]) -> Path | None:
    """The set of events that --hazard names; None where it names curves.

    Raises InputError if it names a set and more beside it.
    """
    paths, _ = weighted_paths(hazard)
    sets = [path for path in paths if is_event_set(path)]
    if sets and len(paths) > 1:
        raise InputError(
            what=f"{sets[0]} is a set of events, and {len(paths) - 1} more are given", where="--hazard",
            expected="one set of events, which has its own branches and weights", remedy="give it alone",
        )  # fmt: skip
    return sets[0] if sets else None


def check_event_options(options: EventOptions, events: Path | None, measures: tuple[str, ...]) -> None:
    """Refuse options that apply to nothing."""
    given = {"--event-rate": options.event_rate, "--catalogue-years": options.catalogue_years}
    for option, value in given.items():
        if value is not None and events is None:
            raise UsageError(
                f"{option} applies to a set of events", where="constrain", expected="a set of events",
                remedy="give one with --hazard, or leave it out",
            )  # fmt: skip
    if options.correlation is not None and (len(measures) < 2 or events):
        raise UsageError(
            "--correlation applies to curves of two measures", where="constrain",
            expected="hazard curves and --measure pga_m_s2+pgv_m_s", remedy="name both measures, or leave it out",
        )  # fmt: skip


def judged_by_events(
    rocks: Rocks,
    hazard: Sequence[str],
    asked: HazardQuestion,
    options: EventOptions,
    confidence: float,
    advance: Callable[[], None],
) -> EventStatement:
    """Judge rocks event by event.

    asked: its measure may be two, joined by a plus.
    advance: called before each bootstrap sample of records.
    """
    measures = tuple(asked.measure.split("+")) if asked.measure else ()
    path = event_set_of(hazard)
    if path:
        events = read_events(path, asked.ratio, options.event_rate, options.catalogue_years)
        measures = measures or (shared_measure(events.measures, measures_shared(rocks.paths), events.source),)
        if len(measures) > 1 and len(events.branches[0].motions) > 1:
            events = replace(events, notes=(*events.notes, _INDEPENDENT))
    else:
        events, measures = _of_curves(rocks, hazard, asked, options, measures)
    sites, away = place_rocks(rocks.names, events, rocks.sites if path else ())
    felt_rocks = [_felt(rocks, number, site, measures, advance) for number, site in enumerate(sites)]
    refuse_twins(rocks.paths, [rock.fragility.basis for rock in felt_rocks])
    return under_events(felt_rocks, rocks.ages, events, confidence, away)


def _of_curves(
    rocks: Rocks,
    hazard: Sequence[str],
    asked: HazardQuestion,
    options: EventOptions,
    measures: tuple[str, ...],
) -> tuple[EventSet, tuple[str, ...]]:
    if len(measures) > 1:
        first, second = (
            read_tree(hazard, HazardQuestion(asked.site, asked.ratio, one, asked.years)) for one in measures
        )
        return joined(first, second, options.correlation), measures
    tree = read_tree(hazard, asked, measures_shared(rocks.paths))
    medians = [read_curves(path)[tree.measure].median for path in rocks.paths if not path.is_dir()]
    return of_tree(tree, medians), (tree.measure,)


def _felt(
    rocks: Rocks, number: int, site: int, measures: tuple[str, ...], advance: Callable[[], None]
) -> FeltRock:
    name, path = rocks.names[number], rocks.paths[number]
    if len(measures) > 1:
        one = felt_by_both(name, path, rocks.jobs.get(path), measures, advance)
        return FeltRock(one.name, one.fragility, site, one.drawn, rocks.since[number])
    years = np.unique(rocks.ages[:, number])
    standing = standing_rock(name, path, measures[0], rocks.jobs.get(path), years, advance)
    return felt(standing, site, rocks.since[number])
