"""What is asked of standing rocks, and which of it goes together."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from toppling.models.errors import UsageError
from toppling.orchestrator.public.by_events import event_set_of
from toppling.orchestrator.public.felt import measures_asked
from toppling.orchestrator.public.hazard_question import HazardQuestion
from toppling.results.hazard.ages import Since, parse_since


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


@dataclass(frozen=True)
class Given:
    """What else is given, as the options of `toppling constrain`."""

    hazard: tuple[str, ...] = ()
    where: str | None = None
    stood: tuple[str | Path, ...] = ()
    sites: tuple[tuple[float, float] | str, ...] = ()


def check_options(
    rocks: Sequence[Path], age: Sequence[str], asked: HazardQuestion, dates: Dates, given: Given
) -> None:
    """Refuse options that do not go together, before anything is read for long.

    Raises UsageError: the first of them.
    """
    count, since = len(rocks), dates.fragile_since
    of_ages = {"--common-date": dates.common, "--common-error": dates.common_error, "--fragile-since": since}
    of_hazard = {"--site": given.sites, "--ratio": asked.ratio != 1.0, "--values": asked.years is not None}
    of_runs = {"--where": given.where, "--stood": given.stood}
    files = [path for path in rocks if not path.is_dir()]
    if not rocks:
        _refuse("no rock has topplings and survivals to tell its fragility by", "give a run that has both")
    if age and len(age) not in (1, count):
        _refuse(f"got {len(age)} ages for {count} rocks", "give one --age, or one per rock")
    if given.hazard and not age:
        _refuse("a hazard needs the rocks' ages, to turn rates into probabilities", "give --age")
    if since and len(since) not in (1, count):
        _refuse(f"got {len(since)} dates for {count} rocks", "give one --fragile-since, or one per rock")
    if (option := _first(of_ages)) and not age:
        _refuse(f"{option} applies to ages", "give the rocks' --age too")
    if (option := _first(of_hazard)) and not given.hazard:
        _refuse(f"{option} applies to a hazard", "give --hazard too")
    if (option := _first(of_runs)) and files:
        _refuse(f"{option} applies to jobs of runs, and {files[0]} is a file of curves", "give its run")
    if len(given.sites) > 1 and not event_set_of(given.hazard):
        _refuse("several --site apply to a set of events", "give one: hazard curves are of one site")
    apart = len(measures_asked(asked.measure)) > 1 or has_factor([parse_since(text) for text in since])
    if apart and not given.hazard:
        _refuse(
            "two measures together, and a factor of --fragile-since, need the hazard", "give --hazard too"
        )


def has_factor(since: Sequence[Since | None]) -> bool:
    """Whether a rock was stouter before, rather than absent."""
    return any(one is not None and math.isfinite(one.factor) for one in since)


def _first(options: Mapping[str, object]) -> str | None:
    return next((name for name, value in options.items() if value), None)


def _refuse(what: str, remedy: str) -> None:
    raise UsageError(what, where="constrain", expected="options that go together", remedy=remedy)
