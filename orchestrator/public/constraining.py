"""Constraints on past ground motion and on hazard by standing rocks."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from toppling.models.errors import UsageError
from toppling.models.files.documents import without_machine
from toppling.orchestrator.public import rocks as asked_rocks
from toppling.orchestrator.public import unseen
from toppling.orchestrator.public.by_events import judged_by_events
from toppling.orchestrator.public.hazard_question import (
    Dates,
    EventOptions,
    HazardQuestion,
    Question,
    read_tree,
)
from toppling.orchestrator.recorded import read_recorded
from toppling.results.analysis.constraint import Constraint
from toppling.results.analysis.lognormal import Basis
from toppling.results.analysis.resampling import SAMPLES
from toppling.results.drawing.report.constraint_page import write_constraint, write_events
from toppling.results.drawing.sentences import all_words
from toppling.results.hazard.ages import age_given, exposure, parse_age, parse_since
from toppling.results.hazard.tree import sources
from toppling.results.hazard.update import Update


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
    rocks: Sequence[str | Path],
    *,
    age: Sequence[str] = (),
    hazard: Sequence[str] = (),
    dates: Dates = Dates(),  # noqa: B008  (frozen)
    where: str | None = None,
    trusted: bool = False,
    stood: Sequence[str | Path] = (),
    measure: str | None = None,
    events: EventOptions = EventOptions(),  # noqa: B008
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
    paths, age = asked_rocks.of_atlases(tuple(map(Path, rocks)), tuple(age), measure)
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
    """One value per rock: a single value is repeated."""
    return values * len(paths) if len(values) == 1 else values


def _by_events(
    question: Question, jobs: dict[Path, asked_rocks.Jobs], advance: Callable[..., None]
) -> RockStatement:
    """Statement under a set of events."""
    ratio = question.asked.ratio
    update, content = judged_by_events(question, jobs, advance)
    source = Path(update.events.source)
    files = sorted(source.glob("*.csv")) if source.is_dir() else [source] * source.is_file()
    warnings = _warnings(question.paths, [rock.fragility.basis for rock in update.rocks])
    content |= {"hazard_ratio": ratio, "warnings": warnings}

    def write(out: Path, stated: dict[str, Any]) -> int:
        return sum(1 for _ in write_events(update, stated, out, ratio))

    return RockStatement(content, all_words(content), warnings, files, write)


def _by_curves(
    question: Question, jobs: dict[Path, asked_rocks.Jobs], advance: Callable[..., None]
) -> RockStatement:
    """Statement on a single event, on rates, or under hazard curves."""
    paths, asked, dates = question.paths, question.asked, question.dates
    tree = read_tree(question.hazard, asked, asked_rocks.measures_shared(paths)) if question.hazard else None
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

    return RockStatement(content, all_words(content), warnings, files, write)


def _warnings(rocks: Sequence[Path], rested: Sequence[Basis | None]) -> list[str]:
    """Warnings of unfinished runs."""
    return [
        f"{path}: {basis.unfinished}: this rests on the others, a smaller sample of its records, whose "
        "intervals are wider; finish the run with 'toppling run' before you rely on it"
        for path, basis in zip(rocks, rested, strict=True)
        if basis and basis.unfinished
    ]
