"""What standing rocks say about past ground motion, and about its hazard."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from toppling.models.arrays import Array
from toppling.models.errors import UsageError
from toppling.orchestrator.public import unseen
from toppling.orchestrator.public.by_events import (
    EventOptions,
    Rocks,
    check_event_options,
    event_set_of,
    judged_by_events,
)
from toppling.orchestrator.public.felt import EventStatement, measures_asked
from toppling.orchestrator.public.hazard_question import HazardQuestion, read_tree
from toppling.orchestrator.public.rocks import (
    Jobs,
    apart_km,
    measures_shared,
    names_of,
    of_atlases,
    of_bases,
    read_jobs,
    refuse_twins,
    standing_rock,
)
from toppling.orchestrator.recorded import read_recorded
from toppling.results.analysis.constraint import Constraint
from toppling.results.analysis.lognormal import Basis
from toppling.results.analysis.resampling import SAMPLES
from toppling.results.drawing.constraint_folder import write_constraint, write_events
from toppling.results.drawing.constraint_words import all_words, event_words
from toppling.results.hazard.ages import Since, fragile_years, joint_ages, parse_age, parse_since
from toppling.results.hazard.tree import sources
from toppling.results.hazard.update import Update


@dataclass(frozen=True)
class Dates:
    """How long rocks have stood, beyond an age of each.

    Parameters
    ----------
    common : bool
        All were uncovered together: one draw of their one age for all.
    common_error : float
        Standard deviation of a relative error that all dates share.
    fragile_since : tuple of str
        Since when each has been as fragile as it is: AGE or AGE:FACTOR.
    """

    common: bool = False
    common_error: float = 0.0
    fragile_since: tuple[str, ...] = ()

    @property
    def together(self) -> bool:
        """Whether the rocks' ages are tied to each other."""
        return self.common or self.common_error > 0


def _check_options(
    rocks: Sequence[Path],
    age: Sequence[str],
    hazard: Sequence[str],
    asked: HazardQuestion,
    dates: Dates,
    sites: Sequence[object],
    of_runs: Mapping[str, object],
) -> None:
    """Refuse options that do not go together, before anything is read for long.

    Raises UsageError: the first of them.
    """
    count, since = len(rocks), dates.fragile_since
    of_ages = {"--common-date": dates.common, "--common-error": dates.common_error, "--fragile-since": since}
    of_hazard = {"--site": sites, "--ratio": asked.ratio != 1.0, "--values": asked.years is not None}
    files = [path for path in rocks if not path.is_dir()]
    if not rocks:
        _refuse("no rock has topplings and survivals to tell its fragility by", "give a run that has both")
    if age and len(age) not in (1, count):
        _refuse(f"got {len(age)} ages for {count} rocks", "give one --age, or one per rock")
    if hazard and not age:
        _refuse("a hazard needs the rocks' ages, to turn rates into probabilities", "give --age")
    if since and len(since) not in (1, count):
        _refuse(f"got {len(since)} dates for {count} rocks", "give one --fragile-since, or one per rock")
    if (option := _first(of_ages)) and not age:
        _refuse(f"{option} applies to ages", "give the rocks' --age too")
    if (option := _first(of_hazard)) and not hazard:
        _refuse(f"{option} applies to a hazard", "give --hazard too")
    if (option := _first(of_runs)) and files:
        _refuse(f"{option} applies to jobs of runs, and {files[0]} is a file of curves", "give its run")
    if len(sites) > 1 and not event_set_of(hazard):
        _refuse("several --site apply to a set of events", "give one: hazard curves are of one site")
    apart = len(measures_asked(asked.measure)) > 1 or _has_factor([parse_since(text) for text in since])
    if apart and not hazard:
        _refuse(
            "two measures together, and a factor of --fragile-since, need the hazard", "give --hazard too"
        )


def _has_factor(since: Sequence[Since | None]) -> bool:
    """Whether a rock was stouter before, rather than absent."""
    return any(one is not None and math.isfinite(one.factor) for one in since)


def _first(options: Mapping[str, object]) -> str | None:
    return next((name for name, value in options.items() if value), None)


def _refuse(what: str, remedy: str) -> None:
    raise UsageError(what, where="constrain", expected="options that go together", remedy=remedy)


@dataclass(frozen=True, eq=False)
class RockStatement:
    """What standing rocks reject.

    Parameters
    ----------
    content : dict
        The statement as `toppling constrain --json` prints it.
    text : str
        In sentences.
    warnings : list of str
        What has to be known before one relies on it.
    hazard_files : list of Path
        That were read.
    page : str
        The file that states all once it is written.
    """

    content: dict[str, Any]
    text: str
    warnings: list[str]
    hazard_files: list[Path]
    _write: Callable[[Path, dict[str, Any]], int]
    page: str = "constraint.html"

    def write(self, out: str | Path, choices: dict[str, Any] | None = None) -> int:
        """Write page, figures and tables into a folder; their number.

        Parameters
        ----------
        out : path
        choices : dict or None
            Noted in the statement, for who files it.
        """
        return self._write(Path(out), self.content | ({"choices": choices} if choices else {}))


def constrain(
    rocks: Sequence[str | Path],
    *,
    age: Sequence[str] = (),
    hazard: Sequence[str] = (),
    dates: Dates = Dates(),
    where: str | None = None,
    trusted: bool = False,
    stood: Sequence[str | Path] = (),
    measure: str | None = None,
    events: EventOptions = EventOptions(),  # noqa: B008  (frozen)
    confidence: float = 0.95,
    sites: Sequence[tuple[float, float] | str] = (),
    ratio: float = 1.0,
    years: float | None = None,
    advance: Callable[..., None] = unseen,
) -> RockStatement:
    """State which ground motions one or several standing rocks reject, as `toppling constrain` does.

    Parameters
    ----------
    rocks : sequence of path
        Runs, or files of fragility curves.
    age : sequence of str
        Years that the rocks have stood, one for all or one each: "20000", "15000..30000", "20000+-3000" or a CSV.
    hazard : sequence of str
        Hazard curves or sets of events, each a path or PATH=WEIGHT; they need ages.
    dates, events
        More about ages and events.
    where, trusted, stood, measure, confidence, sites, ratio
        As the options of `toppling constrain`.
    years : float or None
        Time that the hazard's values are probabilities over, 0 for annual rates, where files do not say.
    advance : callable
        Called after each bootstrap sample.

    Raises
    ------
    InputError
        If a rock or hazard cannot be read, or a rock has no fragility over the measure.
    """
    over = "pgv_m_s" if measure is None or "+" in measure else measure
    paths, age = of_atlases(tuple(map(Path, rocks)), tuple(age), over)
    asked = HazardQuestion(sites[0] if sites else None, ratio, measure, years)
    _check_options(paths, age, hazard, asked, dates, sites, {"--where": where, "--stood": stood})
    late: list[Since | None] = [parse_since(text) for text in dates.fragile_since] or [None]
    ages = [parse_age(text) for text in age] or [np.array([np.nan])]
    question = _Question(
        paths, ages * len(paths) if len(ages) == 1 else ages, late * len(paths) if len(late) == 1 else late,
        dates, tuple(hazard), asked, confidence, dated=bool(age),
    )  # fmt: skip
    check_event_options(events, event_set_of(hazard), measures_asked(measure))
    recorded = read_recorded([Path(one) for one in stood]) if stood else None
    jobs = {path: read_jobs(path, where, trusted, recorded) for path in paths if path.is_dir()}
    advance(0, total=SAMPLES * len(jobs))
    if question.of_events:
        return _by_events(question, jobs, events, list(sites), advance)
    return _by_curves(question, jobs, advance)


@dataclass(frozen=True, eq=False)
class _Question:
    """What is asked of the rocks: each list has one entry a rock."""

    paths: tuple[Path, ...]
    ages: list[Array]
    since: list[Since | None]
    dates: Dates
    hazard: tuple[str, ...]
    asked: HazardQuestion
    confidence: float
    dated: bool

    @property
    def of_events(self) -> bool:
        """Whether an answer needs events one by one."""
        apart = len(measures_asked(self.asked.measure)) > 1 or _has_factor(self.since)
        return bool(self.hazard) and (apart or event_set_of(self.hazard) is not None)

    @property
    def joint_ages(self) -> Array:
        """Draws of the ages, one column a rock."""
        return joint_ages(self.ages, self.dates.common, self.dates.common_error)


def _by_events(
    question: _Question,
    jobs: dict[Path, Jobs],
    events: EventOptions,
    sites: list[tuple[float, float] | str],
    advance: Callable[..., None],
) -> RockStatement:
    """What rocks say event by event."""
    paths = question.paths
    named = Rocks(names_of(paths), paths, question.joint_ages, question.since, jobs, sites)
    felt: EventStatement = judged_by_events(
        named, question.hazard, question.asked, events, question.confidence, advance
    )
    content = felt.summary() | {"hazard_ratio": question.asked.ratio}
    source = Path(felt.update.events.source)
    files = sorted(source.glob("*.csv")) if source.is_dir() else [source] * source.is_file()

    def write(out: Path, stated: dict[str, Any]) -> int:
        return sum(1 for _ in write_events(felt.update, stated, felt.tables, out, question.asked.ratio))

    rested = [rock.fragility.basis for rock in felt.update.rocks]
    content["warnings"] = warnings = _warnings(paths, rested)
    return RockStatement(content, event_words(content), warnings, files, write)


def _by_curves(question: _Question, jobs: dict[Path, Jobs], advance: Callable[..., None]) -> RockStatement:
    """What rocks say of a single event, of rates, or of curves of hazard."""
    paths, asked, dates = question.paths, question.asked, question.dates
    tree = read_tree(question.hazard, asked, measures_shared(paths)) if question.hazard else None
    rocks_apart_km = apart_km(paths, tree)
    over = tree.measure if tree else asked.measure or "pgv_m_s"
    standing = [
        standing_rock(name, path, over, jobs.get(path), ages, advance=advance)
        for name, path, ages in zip(names_of(paths), paths, question.ages, strict=True)
    ]
    if dates.together or any(question.since):
        years = fragile_years(question.joint_ages, question.since)
        standing = [
            replace(rock, years=years[:, number], together=True) for number, rock in enumerate(standing)
        ]
    rested = [rock.curve.basis for rock in standing]
    refuse_twins(paths, rested)
    update = Update(standing, tree, question.confidence) if tree else None
    statement = Constraint(standing, question.confidence, update, question.dated)
    content = statement.summary(asked.ratio, asked.site if isinstance(asked.site, tuple) else None)
    content["rocks_apart_km"] = rocks_apart_km
    if dates.together:
        content["ages_independent"] = False
    if bases := [
        {"rock": rock.name, **of_bases(jobs[path], rock.curve)}
        for path, rock in zip(paths, standing, strict=True)
        if path in jobs and jobs[path].weights
    ]:
        content["stood"] = bases
    content["warnings"] = warnings = _warnings(paths, rested)
    files = [Path(one) for one in sources(tree)] if tree else []

    def write(out: Path, stated: dict[str, Any]) -> int:
        return sum(1 for _ in write_constraint(statement, stated, out, asked.ratio))

    return RockStatement(content, all_words(content), warnings, files, write)


def _warnings(rocks: Sequence[Path], rested: Sequence[Basis | None]) -> list[str]:
    """What has to be known before one relies on the rocks: runs that were not finished."""
    return [
        f"{path}: {basis.unfinished}: this rests on the others, a smaller sample of its records, whose "
        "intervals are wider; finish the run with 'toppling run' before you rely on it"
        for path, basis in zip(rocks, rested, strict=True)
        if basis and basis.unfinished
    ]
