"""Which levels of a record are worth shaking: bracket where it begins to topple, bisect, audit what is skipped.

Toppling is not monotone in the level, so a skipped level is never taken for granted: each is shaken with a known
probability, and stands in all shares for those like it by the inverse of that (`results.hunted`). What is decided on a
ladder (the levels of one record, azimuth and contact) depends on the answers of that record alone, and on hashes: the
same jobs are done on any number of workers, after any number of interruptions. Decides; no input, no output, no Dask.
"""

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

AUDIT_BELOW = (0.5, 0.35, 0.25, 0.15)
"""Probability with which a skipped level is shaken, by its distance below the bracket; the last for all beyond.

Levels that stand cost most, so each of these trades cost for the error of a map's cells (benchmarks/hunt.py).
"""

AUDIT_ABOVE = (0.6, 0.4, 0.3, 0.2)
"""The same above the bracket, where rocks soon fall."""

FIRST_SHARE = 0.5
"""Of the ladder, at which the search begins where nothing is known."""


@dataclass(frozen=True)
class Bracket:
    """Two neighbouring levels between which a record begins to topple the rock, as far as was looked.

    Parameters
    ----------
    standing, toppling : int
        Numbers of the levels, weakest 0; -1, or one beyond the strongest, where there is none.
    """

    standing: int
    toppling: int


@dataclass(frozen=True)
class Ladder:
    """The levels of one record from one azimuth on one contact.

    Parameters
    ----------
    rows : tuple of int
        Of the plan, weakest level first.
    ids : tuple of str
        Of these jobs.
    """

    rows: tuple[int, ...]
    ids: tuple[str, ...]


@dataclass(frozen=True)
class Choice:
    """A job that is to be shaken as an audit, or that is skipped.

    Parameters
    ----------
    row : int
    probability : float
        With which it was chosen.
    expected : bool
        Whether the bracket says that it topples.
    """

    row: int
    probability: float
    expected: bool


def search(answers: Sequence[bool | None], start: int, seen: set[int] | None = None) -> Bracket | int:
    """Bracket the first toppling: the bracket once it is closed, else the level to shake next.

    From the start the step doubles until the answer changes; then the bracket is halved, its upper half first, as a
    rock that falls costs less than one that stands.

    Parameters
    ----------
    answers : sequence of bool or None
        Of each level whether it topples; None where it has not been shaken.
    start : int
    seen : set of int or None
        Levels that are looked at are added.
    """
    low, high, step, probe = -1, len(answers), 1, min(max(start, 0), len(answers) - 1)
    while high - low > 1:
        answer = answers[probe]
        if seen is not None:
            seen.add(probe)
        if answer is None:
            return probe
        if answer:
            high = probe
        else:
            low = probe
        if low == -1:
            probe = max(high - step, 0)
        elif high == len(answers):
            probe = min(low + step, len(answers) - 1)
        else:
            probe = (low + high + 1) // 2
        step *= 2
    return Bracket(low, high)


def searched(answers: Sequence[bool | None], start: int) -> tuple[set[int], Bracket | int]:
    """Levels that the search has looked at, and where it stands: levels that were audited are none of them."""
    seen: set[int] = set()
    return seen, search(answers, start, seen)


def chances(bracket: Bracket, levels: int) -> NDArray[np.float64]:
    """Probability of each level to be shaken as an audit, were it skipped, by its distance from the bracket."""
    number = np.arange(levels)
    below = np.array(AUDIT_BELOW)[np.clip(bracket.standing - number - 1, 0, len(AUDIT_BELOW) - 1)]
    above = np.array(AUDIT_ABOVE)[np.clip(number - bracket.toppling - 1, 0, len(AUDIT_ABOVE) - 1)]
    return np.where(number < bracket.toppling, below, above)


def drawn(job_id: str, probability: float) -> bool:
    """Whether a job is drawn; decided by a hash of its own, which no other sample goes by."""
    digest = hashlib.sha256(f"hunt:{job_id}".encode()).digest()
    return int.from_bytes(digest[:8], "big") / 2.0**64 < probability


def choices(ladder: Ladder, answers: Sequence[bool | None], start: int) -> Iterator[tuple[Choice, bool]]:
    """Levels that the search of a ladder left out, each with whether it is drawn; none before the bracket is closed."""
    seen, found = searched(answers, start)
    if isinstance(found, int):
        return
    chance = chances(found, len(answers))
    for level, (row, job_id) in enumerate(zip(ladder.rows, ladder.ids, strict=True)):
        if level not in seen:
            choice = Choice(row, float(chance[level]), level >= found.toppling)
            yield choice, drawn(job_id, choice.probability)


class Hunt:
    """The hunt over a plan's ladders: those of a record begin where its first one found its bracket.

    Parameters
    ----------
    groups : sequence of sequences of Ladder
        Of each record and contact its ladders, in the order of the campaign's azimuths.
    """

    def __init__(self, groups: Sequence[Sequence[Ladder]]) -> None:
        self.groups = groups

    def next_rows(self, known: Mapping[str, bool]) -> tuple[list[int], dict[str, Choice]]:
        """Rows of the plan to shake now, and what is to be noted of those that are audits; none when all is known.

        Parameters
        ----------
        known : mapping
            Of each job with a row whether it toppled; one without an answer counts as standing.
        """
        rows: list[int] = []
        audits: dict[str, Choice] = {}
        for ladder, answers, start in self._open(known):
            _, found = searched(answers, start)
            if isinstance(found, int):
                rows.append(ladder.rows[found])
                continue
            for choice, is_drawn in choices(ladder, answers, start):
                job_id = ladder.ids[ladder.rows.index(choice.row)]
                if is_drawn and job_id not in known:
                    rows.append(choice.row)
                    audits[job_id] = choice
        return rows, audits

    def skipped(self, known: Mapping[str, bool]) -> list[Choice]:
        """Levels that are not shaken, once :meth:`next_rows` has nothing left."""
        left = []
        for ladder, answers, start in self._open(known):
            left += [choice for choice, is_drawn in choices(ladder, answers, start) if not is_drawn]
        return left

    def _open(self, known: Mapping[str, bool]) -> Iterator[tuple[Ladder, list[bool | None], int]]:
        """Each ladder that may be searched now, with its answers and the level to begin at."""
        for group in self.groups:
            start: int | None = None
            for number, ladder in enumerate(group):
                answers = [known.get(job_id) for job_id in ladder.ids]
                if start is None:
                    start = round(FIRST_SHARE * (len(ladder.ids) - 1))
                yield ladder, answers, start
                if number == 0:
                    _, found = searched(answers, start)
                    if isinstance(found, int):
                        break  # the others wait for what the first one finds
                    start = min(max(found.toppling, 0), len(answers) - 1)
