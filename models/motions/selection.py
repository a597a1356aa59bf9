"""Selection of an ensemble's records, and their weights by a site's hazard deaggregation."""

import math
import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import NoReturn

import numpy as np
import pandas as pd

from toppling.models.errors import InputError
from toppling.models.files.documents import listed, read_json, shown
from toppling.models.files.given import text_given
from toppling.models.files.table import Table, is_numeral, listed_numbers, no_table, openquake_values
from toppling.models.motions.ensemble import Ensemble

_TRACE = "T"
"""Text of nshmp-haz for a contribution below 0.01 %."""

_EDGES = ("magnitude_low", "magnitude_high", "distance_low_km", "distance_high_km", "contribution")
"""Columns of a table of bins, whose magnitudes and distances lie from the low edge to below the high one."""
_UNEVEN = 0.1
"""Share by which centres may lie nearer or farther apart than whole numbers of bins, as by rounding."""
_MOST_UNEVEN = 0.3
"""The most of it, in bins."""


@dataclass(frozen=True, eq=False)
class Deaggregation:
    """Contributions to a site's hazard, by magnitude and distance."""

    bins: pd.DataFrame  # one row a bin: `_EDGES`
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


def _bins(file: Table) -> pd.DataFrame:
    """Bins of a table of their edges; those that it splits, as by epsilon, are added up."""
    if len(file.rows) < 2:
        what = "no bin below the names of columns"
        file.refuse("deaggregation.no_bin", 0, what, "a row for each bin", "export the table again")
    names = [name.lower() for name in file.names]
    rows = _rows(file, names, _EDGES, "", f"name the columns of a table of bins {', '.join(_EDGES)}")
    bins = pd.DataFrame({name: _numbers(rows[name]) for name in _EDGES})
    ordered = (bins["magnitude_low"] < bins["magnitude_high"]) & (
        bins["distance_low_km"] < bins["distance_high_km"]
    )
    usable = ordered & np.isfinite(bins).all(axis=1) & (bins["contribution"] >= 0)
    if not usable.all():
        at = usable.idxmin()
        file.refuse("deaggregation.bin_unreadable", at, f"not a bin: {shown(rows.loc[at].tolist())}",
            f"numbers in {', '.join(_EDGES)}, low below high", "correct the table")  # fmt: skip
    return _added_up(bins)


def _added_up(bins: pd.DataFrame, *, sort: bool = False) -> pd.DataFrame:
    """Bins, each once, with the sum of its contributions in the order of the rows."""
    together = bins.groupby([*_EDGES[:4]], sort=sort, as_index=False)
    return together["contribution"].agg(lambda parts: sum(parts))


def _rows(file: Table, names: Sequence[str], needed: Sequence[str], lacks: str, remedy: str) -> pd.DataFrame:
    """Cells of the whole rows below the names, as text; each row's index is the place of its line."""
    if lacking := [name for name in needed if name not in names]:
        _refuse("deaggregation.columns_unknown", file.path,
            f"has the columns {shown(list(names))}, and no {listed(lacking)}{lacks}", remedy)  # fmt: skip
    rows = file.whole_rows(no_table)
    cells = pd.DataFrame([row for _, row in rows], [at for at, _ in rows], [*names])
    return cells.loc[:, ~cells.columns.duplicated(keep="last")]


def _numbers(cells: pd.Series) -> pd.Series:
    """Numbers of cells, NaN for what is none."""
    return cells.map(lambda cell: float(cell) if is_numeral(cell) else math.nan).astype(float)


def _checked(
    file: Table, cells: pd.Series, most: float = math.inf, states: str = "no number of 0 and more:"
) -> pd.Series:
    """Numbers of cells, finite and from 0 to `most`."""
    values = _numbers(cells)
    wrong = ~(values.between(0.0, most) & (values < math.inf))
    if wrong.any():
        at = wrong.idxmax()
        _refuse("deaggregation.value_unreadable", file.where(at), f"states {states} {cells[at][:40]!r}",
            "give the file as it was written")  # fmt: skip
    return values


def _nshmp(file: Table) -> pd.DataFrame:
    """Bins of nshmp-haz: r and m are centres, Σε is the contribution in per cent of the total."""
    remedy = "give data.csv as nshmp-haz wrote it, with r, m and Σε"
    rows = _rows(file, file.names, ("r", "m", "Σε"), "", remedy).replace(_TRACE, "0")
    distance_km, magnitude, share = (_checked(file, rows[name]) for name in ("r", "m", "Σε"))
    wide_km, wide = _widths(file.path, distance_km, magnitude)
    edges = [
        # Rounded: neighbours share an edge, and no record falls between two.
        [round(centre + side * width / 2, 6) for centre in centres]
        for centres, width in ((magnitude, wide), (distance_km, wide_km))
        for side in (-1, 1)
    ]
    return pd.DataFrame(dict(zip(_EDGES, [*edges, share.tolist()], strict=True)))


def nshmp_root(file: Path) -> Path | None:
    """Output folder of nshmp-haz that a file is in, by its configuration; None if there is none."""
    return next((folder for folder in file.absolute().parents if (folder / "config.json").is_file()), None)


def _widths(table: Path, distances_km: pd.Series, magnitudes: pd.Series) -> tuple[float, ...]:
    """Widths of bins in km and in magnitude: as the summary beside the table says, or the configuration, or centres."""
    summary = table.with_name("summary.txt")
    if summary.is_file():
        stated = text_given(summary, no_table)
        found = [re.search(rf"\b{name}:\s+min = .*Δ = ([\d.]+)", stated) for name in ("r", "m")]
        if all(found):
            return tuple(float(match[1]) for match in found if match)
    if folder := nshmp_root(table):
        with suppress(ValueError, KeyError, TypeError):
            bins = read_json(folder / "config.json")["deagg"]["bins"]
            return float(bins["Δr"]), float(bins["Δm"])
    widths = []
    for centres in map(np.unique, (distances_km, magnitudes)):
        gaps = np.diff(centres)
        if not len(gaps):
            _refuse("deaggregation.bin_width_unknown", table,
                "has one bin of distance or magnitude, and nothing that states how wide it is",
                "keep summary.txt beside it")  # fmt: skip
        steps = gaps / gaps.min()
        if (np.abs(steps - steps.round()) > np.minimum(_UNEVEN * steps, _MOST_UNEVEN)).any():
            _refuse("deaggregation.bins_uneven", table,
                f"has centres of bins that are not equally wide: {listed([f'{centre:g}' for centre in centres])}",
                "give magnitude_low, magnitude_high, distance_low_km and distance_high_km")  # fmt: skip
        widths.append(float(gaps.min()))
    return tuple(widths)


def _openquake(file: Table, imt: str | None, poe: float | None) -> Deaggregation:
    """Bins of OpenQuake: values are probabilities in the investigation time; bins combine as independent events do."""
    table, stated = file.path, openquake_values(file.lines[0]) if file.lines[0].startswith("#") else {}
    lacks = ": a deaggregation over magnitude and distance is needed"
    remedy = "give Mag_Dist, as disagg_outputs = Mag_Dist writes it"
    rows = _rows(file, file.names, ("imt", "poe", "mag", "dist"), lacks, remedy)
    edges = [listed_numbers(stated.get(f"{name}_bin_edges", "")) for name in ("mag", "dist")]
    if not all(len(bin_edges) > 1 and all(a < b for a, b in pairwise(bin_edges)) for bin_edges in edges):
        what = "states no mag_bin_edges and dist_bin_edges in its first line"
        _refuse("deaggregation.edges_missing", table, what, "give the file as it was written")
    chosen, of = _chosen(file, rows, imt, poe, stated.get("investigation_time", ""))
    places = [_places(file, chosen[name], known) for name, known in zip(("mag", "dist"), edges, strict=True)]
    weighted = [
        weight * _checked(file, chosen[name], 1.0, "the probability")
        for name, weight in _weights(table, list(rows), stated).items()
    ]
    rates = [-math.log1p(-min(math.fsum(parts), 1 - 1e-15)) for parts in zip(*weighted, strict=True)]
    ends = [
        np.array(known)[place + side] for known, place in zip(edges, places, strict=True) for side in (0, 1)
    ]
    bins = pd.DataFrame(dict(zip(_EDGES, [*ends, rates], strict=True)))
    return Deaggregation(_added_up(bins, sort=True), of)


def _chosen(
    file: Table, rows: pd.DataFrame, imt: str | None, poe: float | None, years: str
) -> tuple[pd.DataFrame, str]:
    """Rows of one measure and probability, and which that is."""
    imts = rows["imt"].unique().tolist()
    if imt is not None and imt not in imts:
        _refuse("deaggregation.measure_not_there", file.path, f"is over {listed(imts)}, not over {imt}",
            "give one of these as --imt")  # fmt: skip
    measure = imt or next(iter(imts), "")
    of_measure = rows[rows["imt"] == measure]
    stated = _checked(file, of_measure["poe"], 1.0, "the probability")
    poes = sorted(stated.unique())
    known = [p for p in poes if poe is None or math.isclose(p, poe, rel_tol=1e-3)]
    if not known:
        _refuse("deaggregation.probability_not_there", file.path,
            f"has the probabilities {listed([f'{p:g}' for p in poes])}" if poes else "has no row",
            "give one of these as --poe")  # fmt: skip
    others = [f"--imt {name}" for name in imts if name != measure]
    others += [f"--poe {p:g}" for p in poes if p != known[0]]
    more = f"; others with {listed(others)}" if others else ""
    chosen = of_measure[stated == known[0]]
    level = chosen["iml"].iloc[0] if "iml" in chosen else "?"
    return chosen, f"{measure} of {level}, probability {known[0]:g} in {years or '?'} years{more}"


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


def _places(file: Table, cells: pd.Series, edges: Sequence[float]) -> np.ndarray:
    """Numbers of the bins that the centres of rows lie in."""
    inside = pd.cut(_numbers(cells), edges, labels=False, include_lowest=True)
    if inside.isna().any():
        at = inside.isna().idxmax()
        what = f"has the centre {cells[at][:40]!r} of {cells.name}, which is in none of its bins"
        _refuse("deaggregation.place_off_bins", file.where(at), what, "give the file as it was written")
    return inside.to_numpy(int)


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
    fit = rows = ensemble.catalog.select([*_RANGES, "record_id", "event", "quality"]).to_pandas()
    left: list[tuple[str, int]] = []
    for condition, fit in _narrowed(rows, choice):
        left.append((condition, len(fit)))
        if fit.empty:
            steps = ", ".join(f"{condition}: {count} left" for condition, count in left)
            raise InputError(
                "selection.none_left",
                f"none of {len(rows)} records is as chosen ({steps})",
                where=str(ensemble.folder),
                expected="at least one",
                remedy="widen the ranges; 'toppling records show' lists each record's numbers",
            )
    return fit.sort_index()["record_id"].tolist(), left


def _narrowed(rows: pd.DataFrame, choice: Choice) -> Iterator[tuple[str, pd.DataFrame]]:
    """Conditions that restrict the selection, in words, and the rows that each leaves of those before."""
    for column, (name, unit) in _RANGES.items():
        if limits := getattr(choice, column):
            rows = rows[rows[column].between(*limits)]
            yield f"{name} {limits[0]:g} to {limits[1]:g}{unit}", rows
    if choice.quality:
        rows = rows[rows["quality"].isin(choice.quality)]
        yield f"quality {' or '.join(choice.quality)}", rows
    if choice.event is not None:
        rows = rows[rows["event"].str.lower().str.contains(choice.event.lower(), regex=False)]
        yield f"event {choice.event!r}", rows
    if most := choice.most_per_event:
        rows = rows.sort_values(["distance_km", "record_id"]).groupby("event").head(most)
        yield f"at most {most} an event", rows
    if count := choice.count:
        # At even ranks of PGV/PGA, the shortest and the longest pulse among them.
        ranked, last = rows.sort_values(["pgv_pga_s", "record_id"]), len(rows) - 1
        if count == 1:
            rows = ranked.iloc[[len(rows) // 2]]
        elif count <= last:
            rows = ranked.iloc[[round(place * last / (count - 1)) for place in range(count)]]
        yield f"at most {count}, spread over PGV/PGA", rows


def hazard_weights(
    ensemble: Ensemble, record_ids: Sequence[str], bins: pd.DataFrame
) -> tuple[dict[str, float], pd.DataFrame]:
    """Weights by which records stand for a site's hazard: each bin's contribution shared by its records.

    Returns weights by record id, adding up to 1, 0 for a record in no bin; and the bins with a contribution and no
    record: hazard that the ensemble does not stand for.
    Raises InputError if no record lies in a bin with a contribution.
    """
    catalog = ensemble.catalog.select(["record_id", "magnitude", "distance_km"]).to_pandas()
    rows = catalog.set_index("record_id").loc[list(record_ids)].to_numpy(float)
    edges = bins[[*_EDGES[:4]]].to_numpy(float)
    inside = ((edges[:, ::2] <= rows[:, None]) & (rows[:, None] < edges[:, 1::2])).all(axis=2)
    placed, home = inside.any(axis=1), inside.argmax(axis=1)
    count = np.bincount(home[placed], minlength=len(bins))
    contribution = bins["contribution"].to_numpy(float)
    total = sum(contribution[count > 0].tolist())
    if not total > 0:
        raise InputError(
            "selection.no_bin_filled",
            "no record lies in a bin that contributes",
            where=str(ensemble.folder),
            expected="records of the magnitudes and distances of the deaggregation",
            remedy="add such records, or check the units of the table (km)",
        )
    weight = np.where(placed, contribution[home] / np.maximum(count, 1)[home] / total, 0.0)
    return dict(zip(record_ids, weight.tolist(), strict=True)), bins[(contribution > 0) & (count == 0)]
