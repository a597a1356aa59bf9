"""Selection of an ensemble's records, and their weights by a site's hazard deaggregation."""

import math
import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, NoReturn

from toppling.models.errors import InputError
from toppling.models.files.documents import listed, read_json, shown
from toppling.models.files.given import text_given
from toppling.models.files.table import Table, is_numeral, listed_numbers, no_table, openquake_values
from toppling.models.motions.ensemble import Ensemble

_TRACE = "T"
"""Text of nshmp-haz for a contribution below 0.01 %."""

_EDGES = ("magnitude_low", "magnitude_high", "distance_low_km", "distance_high_km", "contribution")
"""Columns of a table of bins."""
_UNEVEN = 0.1
"""Share by which centres may lie nearer or farther apart than whole numbers of bins, as by rounding."""
_MOST_UNEVEN = 0.3
"""The most of it, in bins."""


_Record = tuple[str, dict[str, str]]
"""File and line of a row, and its cells by the names of their columns."""


@dataclass(frozen=True)
class Bin:
    """Cell of a hazard deaggregation: from the low edge to below the high one, and its contribution."""

    magnitude: tuple[float, float]
    distance_km: tuple[float, float]
    contribution: float


@dataclass(frozen=True)
class Deaggregation:
    """Contributions to a site's hazard, by magnitude and distance."""

    bins: list[Bin]
    of: str = ""  # the motion that it is of, and which of several; empty where the file does not say


def read_deaggregation(table: Path, imt: str | None = None, poe: float | None = None) -> Deaggregation:
    """Bins of a hazard deaggregation.

    Kinds of table are recognised by their header: the columns of `_EDGES`, the contribution in any unit; nshmp-haz's
    `data.csv`; and OpenQuake's tables over magnitude and distance (`Mag_Dist`, `TRT_Mag_Dist`, `Mag_Dist_Eps`, of the
    mean or of realisations).

    imt: OpenQuake's measure, such as PGV, where its table has several; the first if not given.
    poe: probability, where OpenQuake's table has several; the least, of the strongest motion, if not given.
    Raises InputError if a column is missing or a number is none, with the line; or the table has no such measure or
    probability.
    """
    file = Table.read(table)
    first = file.lines[0] if file.lines else ""
    if first.startswith("imt,") or openquake_values(first):
        return _openquake(file, imt, poe)
    if imt is not None or poe is not None:
        _refuse("deaggregation.choice_needless", table, "is of one motion, so that there is none to choose",
            "leave --imt and --poe out")  # fmt: skip
    return Deaggregation(_nshmp(file) if "Σε" in first else _bins(file))


def _bins(file: Table) -> list[Bin]:
    """Bins of a table of their edges; those that it splits, as by epsilon, are added up."""
    if len(file.rows) < 2:
        what = "no bin below the names of columns"
        file.refuse("deaggregation.no_bin", 0, what, "a row for each bin", "export the table again")
    names = [name.lower() for name in file.names]
    if lacking := [name for name in _EDGES if name not in names]:
        _refuse("deaggregation.columns_unknown", file.path, f"has no column {listed(lacking)}",
            f"name the columns of a table of bins {', '.join(_EDGES)}")  # fmt: skip
    contributions: dict[tuple[float, ...], float] = {}
    for at, row in file.whole_rows(no_table):
        cells = [row[names.index(name)] for name in _EDGES]
        numbers = [float(cell) if is_numeral(cell) else math.nan for cell in cells]
        ordered = numbers[0] < numbers[1] and numbers[2] < numbers[3]
        if not (all(map(math.isfinite, numbers)) and numbers[-1] >= 0 and ordered):
            file.refuse("deaggregation.bin_unreadable", at, f"not a bin: {shown(row)}",
                f"numbers in {', '.join(_EDGES)}, low below high", "correct the table")  # fmt: skip
        contributions[tuple(numbers[:4])] = contributions.get(tuple(numbers[:4]), 0.0) + numbers[4]
    return [Bin((place[0], place[1]), (place[2], place[3]), share) for place, share in contributions.items()]


def _nshmp(file: Table) -> list[Bin]:
    """Bins of nshmp-haz: r and m are centres, Σε is the contribution in per cent of the total."""
    _, records = _records(file, {"r", "m", "Σε"}, "", "give data.csv as nshmp-haz wrote it, with r, m and Σε")
    rows = [
        [0.0 if row[name] == _TRACE else _number(where, row[name]) for name in ("r", "m", "Σε")]
        for where, row in records
    ]
    distance_km, magnitude = _widths(file.path, [row[0] for row in rows], [row[1] for row in rows])
    return [Bin(_around(m, magnitude), _around(r, distance_km), share) for r, m, share in rows]


def _records(file: Table, needed: set[str], lacks: str, remedy: str) -> tuple[list[str], list[_Record]]:
    """Names in a table that a program wrote, and the whole rows below, with file and line of each."""
    header = file.names
    if not needed <= set(header):
        _refuse("deaggregation.columns_unknown", file.path, f"has the columns {shown(header)}{lacks}", remedy)
    rows = file.whole_rows(no_table)
    return header, [(file.where(at), dict(zip(header, row, strict=True))) for at, row in rows]


def _around(centre: float, width: float) -> tuple[float, float]:
    """Edges about a centre, rounded: neighbours share an edge, and no record falls between two."""
    return round(centre - width / 2, 6), round(centre + width / 2, 6)


def _number(where: str, text: str, most: float = math.inf, states: str = "no number of 0 and more:") -> float:
    value = float(text) if is_numeral(text) else math.nan
    if not (0 <= value <= most and value < math.inf):
        _refuse("deaggregation.value_unreadable", where, f"states {states} {text[:40]!r}",
            "give the file as it was written")  # fmt: skip
    return value


def _probability(where: str, text: str) -> float:
    return _number(where, text, 1.0, "the probability")


def nshmp_root(file: Path) -> Path | None:
    """Output folder of nshmp-haz that a file is in, by its configuration; None if there is none."""
    return next((folder for folder in file.absolute().parents if (folder / "config.json").is_file()), None)


def _widths(table: Path, distances_km: Sequence[float], magnitudes: Sequence[float]) -> tuple[float, float]:
    """Widths of bins in km and in magnitude: as the summary beside the table says, or the configuration, or centres."""
    summary = table.with_name("summary.txt")
    if summary.is_file():
        stated = text_given(summary, no_table)
        found = [re.search(rf"\b{name}:\s+min = .*Δ = ([\d.]+)", stated) for name in ("r", "m")]
        if all(found):
            return tuple(float(match[1]) for match in found if match)  # type: ignore[return-value]
    if folder := nshmp_root(table):
        with suppress(ValueError, KeyError, TypeError):
            bins = read_json(folder / "config.json")["deagg"]["bins"]
            return float(bins["Δr"]), float(bins["Δm"])
    edges = [sorted(set(values)) for values in (distances_km, magnitudes)]
    widths = [min((b - a for a, b in pairwise(known)), default=None) for known in edges]
    if None in widths:
        _refuse("deaggregation.bin_width_unknown", table,
            "has one bin of distance or magnitude, and nothing that states how wide it is",
            "keep summary.txt beside it")  # fmt: skip
    for known, width in zip(edges, widths, strict=True):
        steps = [(b - a) / (width or 1.0) for a, b in pairwise(known)]
        if any(abs(step - round(step)) > min(_UNEVEN * step, _MOST_UNEVEN) for step in steps):
            _refuse("deaggregation.bins_uneven", table,
                f"has centres of bins that are not equally wide: {listed([f'{centre:g}' for centre in known])}",
                "give magnitude_low, magnitude_high, distance_low_km and distance_high_km")  # fmt: skip
    return widths[0] or 0.0, widths[1] or 0.0


def _openquake(file: Table, imt: str | None, poe: float | None) -> Deaggregation:
    """Bins of OpenQuake: values are probabilities in the investigation time; bins combine as independent events do."""
    table, stated = file.path, openquake_values(file.lines[0]) if file.lines[0].startswith("#") else {}
    lacks = ": a deaggregation over magnitude and distance is needed"
    remedy = "give Mag_Dist, as disagg_outputs = Mag_Dist writes it"
    header, records = _records(file, {"imt", "poe", "mag", "dist"}, lacks, remedy)
    edges = [listed_numbers(stated.get(f"{name}_bin_edges", "")) for name in ("mag", "dist")]
    if not all(len(bin_edges) > 1 and all(a < b for a, b in pairwise(bin_edges)) for bin_edges in edges):
        what = "states no mag_bin_edges and dist_bin_edges in its first line"
        _refuse("deaggregation.edges_missing", table, what, "give the file as it was written")
    chosen, of = _chosen(table, records, imt, poe, stated.get("investigation_time", ""))
    weights = _weights(table, header, stated)
    stays: dict[tuple[int, int], float] = {}
    for where, record in chosen:
        place = _place(where, record, edges)
        p = math.fsum(weight * _probability(where, record[name]) for name, weight in weights.items())
        stays[place] = stays.get(place, 0.0) - math.log1p(-min(p, 1 - 1e-15))
    magnitudes, distances_km = (list(pairwise(bin_edges)) for bin_edges in edges)
    return Deaggregation(
        [Bin(magnitudes[m], distances_km[d], rate) for (m, d), rate in sorted(stays.items())], of
    )


def _chosen(
    table: Path, records: Sequence[_Record], imt: str | None, poe: float | None, years: str
) -> tuple[list[_Record], str]:
    """Rows of one measure and probability, and which that is."""
    imts = list(dict.fromkeys(record["imt"] for _, record in records))
    if imt is not None and imt not in imts:
        _refuse("deaggregation.measure_not_there", table, f"is over {listed(imts)}, not over {imt}",
            "give one of these as --imt")  # fmt: skip
    measure = imt or next(iter(imts), "")
    of_measure = [
        (_probability(where, record["poe"]), (where, record))
        for where, record in records
        if record["imt"] == measure
    ]
    poes = sorted({p for p, _ in of_measure})
    known = [p for p in poes if poe is None or math.isclose(p, poe, rel_tol=1e-3)]
    if not known:
        _refuse("deaggregation.probability_not_there", table,
            f"has the probabilities {listed([f'{p:g}' for p in poes])}" if poes else "has no row",
            "give one of these as --poe")  # fmt: skip
    rows = [record for p, record in of_measure if p == known[0]]
    others = [f"--imt {name}" for name in imts if name != measure]
    others += [f"--poe {p:g}" for p in poes if p != known[0]]
    more = f"; others with {listed(others)}" if others else ""
    level = rows[0][1].get("iml", "?")
    return rows, f"{measure} of {level}, probability {known[0]:g} in {years or '?'} years{more}"


def _weights(table: Path, header: Sequence[str], stated: dict[str, str]) -> dict[str, float]:
    """Weight of each column of probabilities: weights in the first line follow the columns, not the numbers."""
    if "mean" in header:
        return {"mean": 1.0}
    columns = [name for name in header if name.startswith("rlz")]
    weights = listed_numbers(stated.get("weights", "")) or ([1.0] if len(columns) == 1 else [])
    if len(columns) == 1 and len(weights) != 1:
        weights = [1.0]
    if not columns or len(weights) != len(columns) or not math.isclose(math.fsum(weights), 1.0, rel_tol=1e-3):
        _refuse("deaggregation.weights_unusable", table,
            f"has {len(columns)} realisations and {len(weights)} weights, which sum to "
            f"{math.fsum(weights):g}", "give the table of the mean, Mag_Dist-mean")  # fmt: skip
    return dict(zip(columns, weights, strict=True))


def _place(where: str, record: dict[str, str], edges: Sequence[Sequence[float]]) -> tuple[int, int]:
    """Numbers of the bins that a row's centres lie in."""
    places = []
    for name, known in zip(("mag", "dist"), edges, strict=True):
        centre = float(record[name]) if is_numeral(record[name]) else math.nan
        inside = [number for number, (low, high) in enumerate(pairwise(known)) if low <= centre <= high]
        if not inside:
            what = f"has the centre {record[name][:40]!r} of {name}, which is in none of its bins"
            _refuse("deaggregation.place_off_bins", where, what, "give the file as it was written")
        places.append(inside[0])
    return places[0], places[1]


def _refuse(code: str, where: object, what: str, remedy: str) -> NoReturn:
    raise InputError(
        code,
        what,
        where=str(where),
        remedy=remedy,
        expected="a hazard deaggregation: a table of bins, nshmp-haz's data.csv, or OpenQuake's Mag_Dist",
    )


_RANGES = {
    "magnitude": ("magnitude", ""),
    "distance_km": ("distance", " km"),
    "pga_m_s2": ("PGA", " m/s2"),
    "pgv_pga_s": ("PGV/PGA", " s"),
}
"""Columns of which a choice gives a range, with their names and units in words."""


@dataclass(frozen=True)
class Choice:
    """Conditions on records; None and 0 are no condition.

    A record of unknown magnitude or distance does not pass a range of it.
    """

    # Least and largest, both included.
    magnitude: tuple[float, float] | None = None
    distance_km: tuple[float, float] | None = None
    event: str | None = None  # part of the event's name, in any case
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
    columns = [*_RANGES, "record_id", "event", "quality"]
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
    """Conditions that restrict the selection, in words and as what they leave of some rows."""

    def where(holds: Callable[[dict[str, Any]], bool]) -> _Narrow:
        return lambda rows: [row for row in rows if holds(row)]

    def within(column: str, limits: tuple[float, float]) -> _Narrow:
        return where(lambda row: row[column] is not None and limits[0] <= row[column] <= limits[1])

    for column, (name, unit) in _RANGES.items():
        if limits := getattr(choice, column):
            yield f"{name} {limits[0]:g} to {limits[1]:g}{unit}", within(column, limits)
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
