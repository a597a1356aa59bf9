"""Constraints on past ground motion and on hazard by standing rocks, under hazard curves or a set of events."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from toppling.models.arrays import Array
from toppling.models.errors import InputError, UsageError
from toppling.models.files.documents import finite, without_machine
from toppling.models.files.table import is_numeral
from toppling.models.motions.measures import COMPARED
from toppling.orchestrator.public import paths_of, unseen
from toppling.orchestrator.public import rocks as asked_rocks
from toppling.orchestrator.public.rocks import Jobs, common_measures, names_of, refuse_twins, standing_rock
from toppling.orchestrator.recorded import read_recorded
from toppling.results.analysis.constraint import Constraint
from toppling.results.analysis.exchange import read_surface
from toppling.results.analysis.fits import answered, basis_of
from toppling.results.analysis.lognormal import PAIR, Basis, Lognormal, fit
from toppling.results.analysis.resampling import SAMPLES, sampled
from toppling.results.drawing.report.constraint_page import write_constraint, write_events
from toppling.results.drawing.sentences import all_words
from toppling.results.drawing.style import short_name
from toppling.results.hazard.ages import Since, age_given, exposure, joint_ages, parse_age, parse_since
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
from toppling.results.hazard.measure_names import is_spectral
from toppling.results.hazard.places import distance_km, nearest, of_name
from toppling.results.hazard.readers import Hints, read_hazard
from toppling.results.hazard.readers.assembly import chosen_tree
from toppling.results.hazard.readers.event_sets import is_event_set, read_events
from toppling.results.hazard.survival import topples
from toppling.results.hazard.tree import HazardTree, sources
from toppling.results.hazard.update import Update

_DEFAULT_MEASURES = ("pgv_m_s", "pga_m_s2")
"""Preferred measures of a constraint if hazard and rocks have several in common, before those of `COMPARED`."""


def _weighted_paths(texts: Sequence[str]) -> tuple[list[Path], list[float] | None]:
    """Parse PATH or PATH=WEIGHT to paths and weights, None without weights."""
    paths, weights = [], []
    for text in texts:
        path, sign, weight = text.rpartition("=")
        if not sign or Path(text).exists():
            paths.append(Path(text))
            continue
        share = float(weight) if is_numeral(weight) else math.nan
        if not 0 < share < math.inf:
            raise UsageError(
                "hazard.weight_unusable",
                f"the weight of {path} is {weight!r}",
                where=text,
                expected="a positive number",
                remedy="give FILE=WEIGHT, such as mean.csv=0.6",
            )
        paths.append(Path(path))
        weights.append(share)
    if weights and len(weights) < len(paths):
        raise InputError(
            "hazard.weights_incomplete",
            what=f"{len(weights)} of {len(paths)} paths have a weight",
            where="--hazard",
            expected="a weight for each, or for none",
            remedy="give each --hazard as PATH=WEIGHT",
        )
    return paths, weights or None


@dataclass(frozen=True)
class HazardQuestion:
    """Selection of a hazard."""

    site: tuple[float, float] | str | None = None  # (longitude, latitude), or a name
    ratio: float = 1.0  # peak of the horizontal vector over the hazard's horizontal component
    measure: str | None = None  # column of the results, or two joined by +
    # Investigation time of probabilities, 0 for annual rates, for files that do not state it.
    years: float | None = None

    @property
    def measures(self) -> tuple[str, ...]:
        """Requested measures, two for `pga_m_s2+pgv_m_s`; InputError if unknown, or without a joint fragility."""
        names = tuple(part.strip() for part in self.measure.split("+")) if self.measure else ()
        unknown = any(name not in COMPARED and not is_spectral(name) for name in names)
        if unknown or (len(names) > 1 and names != PAIR):
            raise InputError(
                "measure.unknown",
                what=f"{self.measure!r} is not an intensity measure with a fragility",
                where="--measure",
                expected=f"one of {', '.join(COMPARED)}; sa_3s_m_s2, any period; or {'+'.join(PAIR)}, "
                "both together",
                remedy="leave it out to use that of the hazard, or pgv_m_s",
            )
        return names


@dataclass(frozen=True)
class Dates:
    """Relations between the ages of rocks, and dates since which they have been as fragile as now.

    Parameters
    ----------
    common : bool
        All were uncovered together: one draw of their one age for all.
    common_error : float
        Standard deviation of a relative error that the rocks' dates share, such as 0.08 of a production rate.
    fragile_since : tuple of str
        Since when each rock has been as fragile as it is, AGE or AGE:FACTOR: before, it was buried, or its medians a
        FACTOR higher.
    """

    common: bool = False
    common_error: float = 0.0
    fragile_since: tuple[str, ...] = ()

    @property
    def together(self) -> bool:
        """Whether the rocks' ages are tied to each other."""
        return self.common or self.common_error > 0


@dataclass(frozen=True)
class EventOptions:
    """Options for events.

    Parameters
    ----------
    event_rate : float or None
        Annual rate of a scenario, which states none.
    catalogue_years : float or None
        Years that each branch's events were simulated for, where no file states them.
    correlation : float or None
        Of the residuals of PGA and PGV in one earthquake, for their two curves; 0.733 if not given.
    """

    event_rate: float | None = None
    catalogue_years: float | None = None
    correlation: float | None = None


@dataclass(frozen=True, eq=False)
class Question:
    """Request for a constraint by standing rocks, with one age and date per rock."""

    paths: tuple[Path, ...]
    ages: list[Array]
    ages_given: list[str]  # labels; empty where unknown
    since: list[Since | None]
    dates: Dates
    hazard: tuple[str, ...]
    asked: HazardQuestion
    events: EventOptions
    sites: Sequence[tuple[float, float] | str]
    confidence: float

    @property
    def dated(self) -> bool:
        """Whether ages are known."""
        return bool(np.isfinite(self.ages[0]).all())

    @cached_property
    def event_set(self) -> Path | None:
        """Set of events of the hazard, or None for curves; InputError if further files are given with a set."""
        paths, _ = _weighted_paths(self.hazard)
        sets = [path for path in paths if is_event_set(path)]
        if sets and len(paths) > 1:
            raise InputError(
                "events.given_with_others",
                what=f"{sets[0]} is a set of events, and {len(paths) - 1} more are given",
                where="--hazard",
                expected="one set of events, which has its own branches and weights",
                remedy="give it alone",
            )
        return sets[0] if sets else None

    @property
    def apart(self) -> bool:
        """Whether two measures are used jointly, which only single events support."""
        return len(self.asked.measures) > 1

    @cached_property
    def joint_ages(self) -> Array:
        """Joint draws of the ages, one column per rock."""
        return joint_ages(self.ages, self.dates.common, self.dates.common_error)


def read_tree(texts: Sequence[str], asked: HazardQuestion, rocks: Sequence[str] = COMPARED) -> HazardTree:
    """Tree selected by --hazard, --site and --measure, over a measure for which the rocks have a fragility."""
    paths, weights = _weighted_paths(texts)
    trees = read_hazard(paths, weights, Hints(asked.site, asked.measure, asked.years))
    where = texts[0] if len(texts) == 1 else "--hazard"
    measure = asked.measure or _common_measure([tree.measure for tree in trees], rocks, "--hazard")
    chosen = chosen_tree(trees, measure, asked.site, where)
    if isinstance(asked.site, tuple) and chosen.site is None:
        raise UsageError(
            "site.places_missing",
            "it selects a place, and these curves state none",
            where="--site",
            expected="files that state places",
            remedy="leave --site out",
        )
    return chosen.stronger(asked.ratio) if asked.ratio != 1.0 else chosen


def _common_measure(stated: Sequence[str], rocks: Sequence[str], where: str) -> str:
    """Measure common to a hazard and the rocks' fragilities: the first of the defaults, then of the rocks' order."""
    for name in (*_DEFAULT_MEASURES, *rocks):
        if name in stated and name in rocks:
            return name
    raise InputError(
        "hazard.measure_other",
        what=f"the hazard is over {', '.join(sorted(set(stated)))}, the rock's fragility over "
        f"{', '.join(rocks) or 'nothing'}",
        where=where,
        expected="hazard over a measure that the rock has a fragility over",
        remedy="give curves, or motions, over one of the rock's measures",
    )


def _judged_by_events(
    question: Question, jobs: Mapping[Path, Jobs], advance: Callable[[], None]
) -> tuple[Update, dict[str, Any]]:
    """Update of a set of events by standing rocks, and the statement for JSON."""
    if question.event_set:
        events, measures = _of_set(question)
    else:
        measures = question.asked.measures
        trees = [read_tree(question.hazard, replace(question.asked, measure=name)) for name in measures]
        events = _of_two_trees(trees[0], trees[1], question.events.correlation)
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
    common = common_measures(question.paths)
    measures = asked.measures or (_common_measure(events.measures, common, events.source),)
    if len(measures) > 1 and not events.correlated:
        raise InputError(
            "events.residuals_independent",
            what="holds fields of OpenQuake, which draws the residuals of two measures independently",
            where=events.source,
            expected="motions of one measure, or of two that are correlated as in earthquakes",
            remedy="give one --measure, or both hazard curves of which --correlation gives the joint rate",
        )
    return events, measures


def _fragility(
    path: Path, measures: tuple[str, ...], jobs: Jobs | None, advance: Callable[[], None]
) -> Fragility:
    """Fragility over one or two measures, with bootstrap samples, from a run or a file of curves."""
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
    """Index of each rock's site among those of the events, and its distance from the requested location, km."""
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
    """Convert trees of two measures at one site to a set of events, branch by branch."""
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
        joint_rate(first_branch.curve, second_branch.curve, scatter)
        for first_branch, second_branch in zip(first.branches, second.branches, strict=True)
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
        numbers: dict[str, Any] = rock.curve.numbers
    else:
        a, *slopes = rock.fragility.coefficients
        terms = [f"{slope:+.2f} ln {short_name(name)}" for slope, name in zip(slopes, measures, strict=True)]
        numbers = {"coefficients": [a, *slopes], "fragility": f"probit {a:.2f} {' '.join(terms)}"}
    return {
        "name": rock.name, "age": rock.age, **numbers, "site": site.name, "site_distance_km": away,
        "site_longitude_deg": site.place[0] if site.place else None,
        "site_latitude_deg": site.place[1] if site.place else None,
    } | (asdict(basis) if basis else {})  # fmt: skip


def _check(question: Question, ages: int, of_runs: Mapping[str, object]) -> None:
    """Raise UsageError for inconsistent options, before anything slow; `ages` is the number of given ages."""
    asked, dates, sites, options = question.asked, question.dates, question.sites, question.events
    count, since, hazard = len(question.paths), dates.fragile_since, question.hazard
    of_ages = {"--common-date": dates.common, "--common-error": dates.common_error, "--fragile-since": since}
    of_hazard = {"--site": sites, "--ratio": asked.ratio != 1.0, "--values": asked.years is not None}
    of_events = {"--event-rate": options.event_rate, "--catalogue-years": options.catalogue_years}
    files = [path for path in question.paths if not path.is_dir()]
    if not count:
        _refuse("fragility.none", "no rock has both topplings and survivals, which a fragility needs",
            "give a run that has both")  # fmt: skip
    if ages not in (0, 1, count):
        _refuse("age.count_differs", f"got {ages} ages for {count} rocks", "give one --age, or one per rock")
    if hazard and not ages:
        _refuse("age.needed", "a hazard needs the rocks' ages, to turn rates into probabilities",
            "give --age")  # fmt: skip
    if len(since) not in (0, 1, count):
        _refuse("age.dates_count_differs", f"got {len(since)} dates for {count} rocks",
            "give one --fragile-since, or one per rock")  # fmt: skip
    if (option := _first(of_ages)) and not ages:
        _refuse("age.needed", f"{option} applies to ages", "give the rocks' --age too")
    if (option := _first(of_hazard)) and not hazard:
        _refuse("hazard.needed", f"{option} applies to a hazard", "give --hazard too")
    if (option := _first(of_runs)) and files:
        _refuse("run.needed", f"{option} applies to jobs of runs, and {files[0]} is a file of curves",
            "give its run")  # fmt: skip
    if len(sites) > 1 and not question.event_set:
        _refuse("site.several_of_curves", "several --site apply to a set of events",
            "give one: hazard curves are of one site")  # fmt: skip
    if question.apart and not hazard:
        _refuse("hazard.needed", "two measures together need the hazard", "give --hazard too")
    if (option := _first(of_events)) and not question.event_set:
        _refuse("events.needed", f"{option} applies to a set of events",
            "give one with --hazard, or leave it out")  # fmt: skip
    if options.correlation is not None and (len(asked.measures) < 2 or question.event_set):
        _refuse("hazard.one_measure", "--correlation applies to curves of two measures",
            "name both measures, or leave it out")  # fmt: skip


def _first(options: Mapping[str, object]) -> str | None:
    return next((name for name, value in options.items() if value), None)


def _refuse(code: str, what: str, remedy: str) -> None:
    raise UsageError(code, what, where="constrain", expected="options that go together", remedy=remedy)


@dataclass(frozen=True, eq=False)
class RockStatement:
    """Statement of the ground motions that standing rocks reject.

    Parameters
    ----------
    content : dict
        The statement as `toppling constrain --json` prints it.
    text : str
        The statement in sentences.
    warnings : list of str
        Limitations of the statement.
    hazard_files : list of Path
        Hazard files that were read.
    page : str
        Name of the file with the complete statement, once written.
    """

    content: dict[str, Any]
    text: str
    warnings: list[str]
    hazard_files: list[Path]
    _write: Callable[[Path, dict[str, Any]], int]
    page: str = "constraint.html"

    def write(self, out: str | Path, choices: dict[str, Any] | None = None) -> int:
        """Write page, figures and tables to a folder; returns the number of files.

        Parameters
        ----------
        out : path
        choices : dict or None
            Inputs to record in the statement.
        """
        stated = self.content | ({"choices": choices} if choices else {})
        return self._write(Path(out), without_machine(stated))


def constrain(
    rocks: str | Path | Sequence[str | Path],
    *,
    age: Sequence[str] = (),
    hazard: Sequence[str] = (),
    dates: Dates = Dates(),
    where: str | None = None,
    trusted: bool = False,
    stood: Sequence[str | Path] = (),
    measure: str | None = None,
    events: EventOptions = EventOptions(),
    confidence: float = 0.95,
    sites: Sequence[tuple[float, float] | str] = (),
    ratio: float = 1.0,
    years: float | None = None,
    advance: Callable[..., None] = unseen,
) -> RockStatement:
    """State which ground motions one or several standing rocks reject, as `toppling constrain` does.

    Parameters
    ----------
    rocks : path or sequence of path
        Runs, atlases with all of their rocks, or files of fragility curves.
    age : sequence of str
        Years for which each rock has stood: 20000, 15000..30000 (uniform), 20000+-3000 (normal, one sigma), 20000*/1.2
        (lognormal) or a CSV. One for several rocks is an independent date of each; a --common-date rejects less.
    hazard : sequence of str
        Hazard: a file or folder of OpenQuake (curves, or a tree with realizations.csv), nshmp-haz or CyberShake, or two
        columns; repeatable: branches, PATH=WEIGHT each or PATH for equal weights. Or one set of events, OpenQuake's
        ground-motion fields with the files beside them, CyberShake's intensity measures or a table. They need ages.
    where : str or None
        Only jobs for which this SQL condition holds, such as those of one friction.
    stood : sequence of path
        Recorded motions (a file or ensemble each) that the rock is known to have survived; they weigh its base's draws.
    measure : str or None
        A column of the results, or pga_m_s2+pgv_m_s, both together; unless given that of the hazard, or pgv_m_s.
    confidence : float
        Confidence of all bounds; a branch is inconsistent if its survival is below 1 - confidence.
    dates, events, trusted, sites, advance
        More about ages and events; the condition may read files; the hazard's sites; called after each sample.
    ratio : float
        Ratio of the peak of the horizontal vector to the hazard's horizontal component.
    years : float or None
        What the hazard's values are, where its files do not say: annual rates (0), or probabilities over so many years.

    Raises
    ------
    InputError
        If a rock or hazard cannot be read, or a rock has no fragility over the measure.
    """
    paths, age = asked_rocks.of_atlases(paths_of(rocks), tuple(age), measure)
    ages = _per_rock(paths, [parse_age(text) for text in age] or [np.array([np.nan])])
    since = _per_rock(paths, [parse_since(text) for text in dates.fragile_since] or [None])
    dated = zip(
        _per_rock(paths, [*age] or [""]), _per_rock(paths, [*dates.fragile_since] or [""]), strict=False
    )
    given = [age_given(text, late) for text, late in dated]
    asked = HazardQuestion(sites[0] if sites else None, ratio, measure, years)
    question = Question(paths, ages, given, since, dates, tuple(hazard), asked, events, sites, confidence)
    _check(question, len(age), {"--where": where, "--stood": stood})
    recorded = read_recorded([Path(path) for path in stood]) if stood else None
    jobs = {path: asked_rocks.read_jobs(path, where, trusted, recorded) for path in paths if path.is_dir()}
    return _answer(question, jobs, advance)


def _answer(
    question: Question, jobs: dict[Path, asked_rocks.Jobs], advance: Callable[..., None]
) -> RockStatement:
    advance(0, total=SAMPLES * len(jobs))
    by_events = question.event_set or (question.hazard and question.apart)
    return (_by_events if by_events else _by_curves)(question, jobs, advance)


def _per_rock(paths: Sequence[Path], values: list[Any]) -> list[Any]:
    """Values per rock: a single value is repeated."""
    return values * len(paths) if len(values) == 1 else values


def _by_events(
    question: Question, jobs: dict[Path, asked_rocks.Jobs], advance: Callable[..., None]
) -> RockStatement:
    """Statement under a set of events."""
    ratio = question.asked.ratio
    update, content = _judged_by_events(question, jobs, advance)
    source = Path(update.events.source)
    files = sorted(source.glob("*.csv")) if source.is_dir() else [source] * source.is_file()
    warnings = _warnings(question.paths, [rock.fragility.basis for rock in update.rocks])
    content |= {"hazard_ratio": ratio, "warnings": warnings}

    def write(out: Path, stated: dict[str, Any]) -> int:
        return sum(1 for _ in write_events(update, stated, out, ratio))

    return RockStatement(content, "\n".join(all_words(content)), warnings, files, write)


def _by_curves(
    question: Question, jobs: dict[Path, asked_rocks.Jobs], advance: Callable[..., None]
) -> RockStatement:
    """Statement on a single event, on rates, or under hazard curves."""
    paths, asked, dates = question.paths, question.asked, question.dates
    tree = read_tree(question.hazard, asked, asked_rocks.common_measures(paths)) if question.hazard else None
    rocks_apart_km = asked_rocks.apart_km(paths, tree)
    over = tree.measure if tree else asked.measure or "pgv_m_s"
    standing = [
        replace(asked_rocks.standing_rock(name, path, over, jobs.get(path), advance), since=since, age=age)
        for name, path, since, age in zip(
            asked_rocks.names_of(paths), paths, question.since, question.ages_given, strict=True
        )
    ]
    rested = [rock.fragility.basis for rock in standing]
    asked_rocks.refuse_twins(paths, rested)
    stood = exposure(question.joint_ages, question.since) if question.dated else None
    update = Update.of_curves(standing, tree, stood, question.confidence) if tree and stood else None
    statement = Constraint(standing, question.confidence, update, stood)
    content = statement.summary(asked.ratio, asked.site if isinstance(asked.site, tuple) else None)
    content["rocks_apart_km"] = rocks_apart_km
    if dates.together:
        content["ages_independent"] = False
    if bases := [
        {"rock": rock.name, **asked_rocks.of_bases(jobs[path], rock.curve)}
        for path, rock in zip(paths, standing, strict=True)
        if path in jobs and jobs[path].weights
    ]:
        content["stood"] = bases
    content["warnings"] = warnings = _warnings(paths, rested)
    files = [Path(source) for source in sources(tree)] if tree else []

    def write(out: Path, stated: dict[str, Any]) -> int:
        return sum(1 for _ in write_constraint(statement, stated, out, asked.ratio))

    return RockStatement(content, "\n".join(all_words(content)), warnings, files, write)


def _warnings(rocks: Sequence[Path], rested: Sequence[Basis | None]) -> list[str]:
    """Warnings of unfinished runs."""
    return [
        f"{path}: {basis.unfinished}: this rests on the others, a smaller sample of its records, whose "
        "intervals are wider; finish the run with 'toppling run' before you rely on it"
        for path, basis in zip(rocks, rested, strict=True)
        if basis and basis.unfinished
    ]
