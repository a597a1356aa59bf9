"""Which records of an ensemble a question needs, and how much each of them counts."""

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from toppling.models.errors import InputError
from toppling.models.motions.deaggregation import Bin
from toppling.models.motions.ensemble import Ensemble

_LEAST_COMPONENTS = 2
"""Number of components that every record has."""
_RANGES = {
    "magnitude": ("magnitude", ""),
    "distance_km": ("distance", " km"),
    "pga_m_s2": ("PGA", " m/s2"),
    "pgv_pga_s": ("PGV/PGA", " s"),
}
"""Columns of which a choice gives a range, with their names and units in words."""


@dataclass(frozen=True)
class Choice:
    """What a record must be; None and 0 ask for nothing.

    A record of unknown magnitude or distance does not pass a range of it.
    """

    # Least and largest, both included.
    magnitude: tuple[float, float] | None = None
    distance_km: tuple[float, float] | None = None
    event: str | None = None  # part of the event's name, in any case
    components: int = 0  # at least so many
    most_per_event: int = 0  # at most so many of one event: the nearest to the source, then by id
    quality: tuple[str, ...] = ()  # any of these, as in `Record.quality`; empty for every quality
    # As `magnitude`; of the record as it is, before it is scaled.
    pga_m_s2: tuple[float, float] | None = None
    pgv_pga_s: tuple[float, float] | None = None
    count: int = 0  # at most so many, spread evenly over the ranks of PGV/PGA

    def __post_init__(self) -> None:
        for name in _RANGES:
            limits = getattr(self, name)
            if limits and not limits[0] <= limits[1]:
                raise InputError(
                    "selection.range_reversed",
                    f"{name} from {limits[0]:g} to {limits[1]:g}",
                    where="selection",
                    expected="the least value first",
                    remedy=f"did you mean {limits[1]:g} {limits[0]:g}?",
                )


def select(ensemble: Ensemble, choice: Choice) -> tuple[list[str], list[tuple[str, int]]]:
    """Ids of the records that are as chosen, in the catalogue's order; after each condition how many were left.

    Raises InputError if no record is.
    """
    columns = [*_RANGES, "record_id", "event", "components", "quality"]
    rows = ensemble.catalog.select(columns).to_pylist()
    left: list[tuple[str, int]] = []
    fit = rows
    for condition, narrow in _conditions(choice):
        fit = narrow(fit)
        left.append((condition, len(fit)))
        if not fit:
            steps = ", ".join(f"{condition}: {count} left" for condition, count in left)
            raise InputError(
                "selection.none_left",
                f"none of {len(rows)} records is as chosen ({steps})",
                where=str(ensemble.folder),
                expected="at least one",
                remedy="widen the ranges; 'toppling records show' lists each record's numbers",
            )
    chosen = {row["record_id"] for row in fit}
    return [row["record_id"] for row in rows if row["record_id"] in chosen], left


_Rows = list[dict[str, Any]]
_Narrow = Callable[[_Rows], _Rows]


def _conditions(choice: Choice) -> Iterator[tuple[str, _Narrow]]:
    """Each condition that asks for something, in words and as what it leaves of some rows."""

    def where(holds: Callable[[dict[str, Any]], bool]) -> _Narrow:
        return lambda rows: [row for row in rows if holds(row)]

    def within(column: str, limits: tuple[float, float]) -> _Narrow:
        return where(lambda row: row[column] is not None and limits[0] <= row[column] <= limits[1])

    for column, (name, unit) in _RANGES.items():
        if limits := getattr(choice, column):
            yield f"{name} {limits[0]:g} to {limits[1]:g}{unit}", within(column, limits)
    if choice.components > _LEAST_COMPONENTS:
        yield f"{choice.components} components", where(lambda row: row["components"] >= choice.components)
    if choice.quality:
        yield f"quality {' or '.join(choice.quality)}", where(lambda row: row["quality"] in choice.quality)
    if choice.event is not None:
        part = choice.event.lower()
        yield f"event {choice.event!r}", where(lambda row: part in row["event"].lower())
    if choice.most_per_event:
        yield f"at most {choice.most_per_event} an event", lambda rows: _nearest(rows, choice.most_per_event)
    if choice.count:
        yield f"at most {choice.count}, spread over PGV/PGA", lambda rows: _spread(rows, choice.count)


def _nearest(rows: _Rows, most: int) -> _Rows:
    """At most so many of each event, the nearest to the source."""

    def rank(row: dict[str, Any]) -> tuple[float, str]:
        return math.inf if row["distance_km"] is None else row["distance_km"], row["record_id"]

    taken: Counter[str] = Counter()
    nearest = []
    for row in sorted(rows, key=rank):
        taken[row["event"]] += 1
        if taken[row["event"]] <= most:
            nearest.append(row)
    return nearest


def _spread(rows: _Rows, count: int) -> _Rows:
    """`count` rows at even ranks of PGV/PGA, the shortest and the longest pulse among them."""
    ranked = sorted(rows, key=lambda row: (row["pgv_pga_s"], row["record_id"]))
    if count >= len(ranked):
        return ranked
    if count == 1:
        return [ranked[len(ranked) // 2]]
    return [ranked[round(place * (len(ranked) - 1) / (count - 1))] for place in range(count)]


def hazard_weights(
    ensemble: Ensemble, record_ids: Sequence[str], bins: Sequence[Bin]
) -> tuple[dict[str, float], list[Bin]]:
    """Weights by which records stand for a site's hazard: each bin's contribution shared by its records.

    Returns weights by record id, adding up to 1, 0 for a record in no bin; and the bins with a contribution and no
    record: hazard that the ensemble does not stand for.
    Raises InputError if no record lies in a bin with a contribution.
    """
    rows = {
        row["record_id"]: row
        for row in ensemble.catalog.select(["record_id", "magnitude", "distance_km"]).to_pylist()
    }
    home = {name: _bin_of(rows[name]["magnitude"], rows[name]["distance_km"], bins) for name in record_ids}
    count = Counter(home.values())
    total = sum(b.contribution for b in bins if count[b])
    if not total > 0:
        raise InputError(
            "selection.no_bin_filled",
            "no record lies in a bin that contributes",
            where=str(ensemble.folder),
            expected="records of the magnitudes and distances of the deaggregation",
            remedy="add such records, or check the units of the table (km)",
        )
    weights = {name: b.contribution / count[b] / total if b is not None else 0.0 for name, b in home.items()}
    return weights, [b for b in bins if b.contribution > 0 and not count[b]]


def _bin_of(magnitude: float | None, distance_km: float | None, bins: Sequence[Bin]) -> Bin | None:
    if magnitude is None or distance_km is None:
        return None
    of_magnitude = (b for b in bins if b.magnitude[0] <= magnitude < b.magnitude[1])
    return next((b for b in of_magnitude if b.distance_km[0] <= distance_km < b.distance_km[1]), None)
