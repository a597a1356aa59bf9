"""Which records of an ensemble a question needs, and how much each of them counts."""

import math
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from toppling.models.documents import csv_rows, shown
from toppling.models.errors import InputError
from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.metadata import text_table


@dataclass(frozen=True)
class Choice:
    """What a record must be; None and 0 ask for nothing.

    A record of unknown magnitude or distance does not pass a range of it.

    Parameters
    ----------
    magnitude, distance_km : pair of float or None
        Least and largest, both included.
    event : str or None
        Part of the event's name, in any case.
    components : int
        At least so many.
    most_per_event : int
        At most so many of one event: the nearest to the source, then by id.
    quality : tuple of str
        Any of these, as in `Record.quality`; empty for every quality.
    """

    magnitude: tuple[float, float] | None = None
    distance_km: tuple[float, float] | None = None
    event: str | None = None
    components: int = 0
    most_per_event: int = 0
    quality: tuple[str, ...] = ()


@dataclass(frozen=True)
class Bin:
    """One cell of a hazard deaggregation: from the low edge to below the high one, and its contribution."""

    magnitude: tuple[float, float]
    distance_km: tuple[float, float]
    contribution: float


def select(ensemble: Ensemble, choice: Choice) -> list[str]:
    """Ids of the records that are as chosen, in the catalogue's order.

    Raises
    ------
    InputError
        If no record is.
    """
    rows = ensemble.catalog.select(
        ["record_id", "event", "magnitude", "distance_km", "components", "quality"]
    ).to_pylist()
    fit = [
        row
        for row in rows
        if _within(row["magnitude"], choice.magnitude)
        and _within(row["distance_km"], choice.distance_km)
        and row["components"] >= choice.components
        and (not choice.quality or row["quality"] in choice.quality)
        and (choice.event is None or choice.event.lower() in row["event"].lower())
    ]
    if choice.most_per_event:
        by_event = defaultdict(list)
        for row in fit:
            by_event[row["event"]].append(row)
        kept: set[str] = set()
        for group in by_event.values():
            group.sort(
                key=lambda r: (math.inf if r["distance_km"] is None else r["distance_km"], r["record_id"])
            )
            kept.update(row["record_id"] for row in group[: choice.most_per_event])
        fit = [row for row in fit if row["record_id"] in kept]
    if not fit:
        raise InputError(
            f"none of {len(rows)} records is as chosen",
            where=str(ensemble.folder),
            expected="at least one",
            remedy="widen the ranges; 'toppling records show' lists magnitudes and distances",
        )
    return [row["record_id"] for row in fit]


def read_deaggregation(table: Path) -> list[Bin]:
    """Bins of a hazard deaggregation from a CSV table.

    Columns: `magnitude_low`, `magnitude_high`, `distance_low_km`, `distance_high_km`, `contribution` (in any
    unit).

    Raises
    ------
    InputError
        If a column is missing or a number is none, with the line.
    """
    names = ("magnitude_low", "magnitude_high", "distance_low_km", "distance_high_km", "contribution")
    bins = []
    with text_table(table) as file:
        for line, row in csv_rows(file, table):
            try:
                low_m, high_m, low_d, high_d, share = (float(row[name]) for name in names)
            except (KeyError, TypeError, ValueError):
                low_m = share = math.nan
            if not (0 <= share < math.inf and low_m < high_m and low_d < high_d):
                raise InputError(
                    f"not a bin: {shown(list(row.values()))}",
                    where=f"{table}:{line}",
                    expected=f"numbers in {', '.join(names)}, low below high, contribution not negative",
                    remedy="correct the table",
                )
            bins.append(Bin((low_m, high_m), (low_d, high_d), share))
    return bins


def hazard_weights(
    ensemble: Ensemble, record_ids: Sequence[str], bins: Sequence[Bin]
) -> tuple[dict[str, float], list[Bin]]:
    """Weights by which records stand for a site's hazard: each bin's contribution shared by its records.

    Returns
    -------
    weights : dict
        By record id, adding up to 1; 0 for a record in no bin.
    empty : list of Bin
        Bins with a contribution and no record: hazard that the ensemble does not stand for.

    Raises
    ------
    InputError
        If no record lies in a bin with a contribution.
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
            "no record lies in a bin that contributes",
            where=str(ensemble.folder),
            expected="records of the magnitudes and distances of the deaggregation",
            remedy="add such records, or check the units of the table (km)",
        )
    weights = {name: b.contribution / count[b] / total if b is not None else 0.0 for name, b in home.items()}
    return weights, [b for b in bins if b.contribution > 0 and not count[b]]


def _within(value: float | None, limits: tuple[float, float] | None) -> bool:
    return limits is None or (value is not None and limits[0] <= value <= limits[1])


def _bin_of(magnitude: float | None, distance_km: float | None, bins: Sequence[Bin]) -> Bin | None:
    if magnitude is None or distance_km is None:
        return None
    for b in bins:
        if (
            b.magnitude[0] <= magnitude < b.magnitude[1]
            and b.distance_km[0] <= distance_km < b.distance_km[1]
        ):
            return b
    return None
