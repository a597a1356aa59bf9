"""A site's hazard deaggregation, by which records are weighted: a table of bins, nshmp-haz's data.csv, OpenQuake's."""

import csv
import json
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import NoReturn

from toppling.models import openquake
from toppling.models.errors import InputError
from toppling.models.files.csv_text import separator_of
from toppling.models.files.documents import csv_rows, listed, shown
from toppling.models.motions.metadata import text_table

_TRACE = "T"
"""What nshmp-haz prints for a contribution below 0.01 %."""

_COLUMNS = {
    "magnitude": {"magnitude", "mag", "m", "mw"},
    "distance": {"distance", "dist", "r", "rrup", "rjb", "closest distance"},
    "share": {"contribution", "share", "percent", "%", "per cent", "hazard contribution", "all ε", "total"},
}
"""Names of columns with the centres of bins, and what these contribute."""

_DEPTH = 6
"""Folders between a deaggregation of nshmp-haz and its config.json, at most."""


@dataclass(frozen=True)
class Bin:
    """One cell of a hazard deaggregation: from the low edge to below the high one, and its contribution."""

    magnitude: tuple[float, float]
    distance_km: tuple[float, float]
    contribution: float


@dataclass(frozen=True)
class Deaggregation:
    """What contributes to a site's hazard."""

    bins: list[Bin]
    # The motion that it is of, and where several were to choose from, which; empty where the file does not
    # say.
    of: str = ""


def read_deaggregation(table: Path, imt: str | None = None, poe: float | None = None) -> Deaggregation:
    """Bins of a hazard deaggregation.

    Kinds of table are told apart by their header: `magnitude_low`, `magnitude_high`, `distance_low_km`,
    `distance_high_km`, `contribution` (in any unit); the centres of such bins (`magnitude`, `distance_km`,
    `contribution`); nshmp-haz's `data.csv`; and OpenQuake's tables over magnitude and
    distance (`Mag_Dist`, `TRT_Mag_Dist`, `Mag_Dist_Eps`, of the mean or of realisations).

    Parameters
    ----------
    imt : str or None
        OpenQuake's measure, such as PGV, where its table has several; the first if not given.
    poe : float or None
        Probability, where OpenQuake's table has several; the least, of the strongest motion, if not given.

    Raises
    ------
    InputError
        If a column is missing or a number is none, with the line; or the table has no such measure or probability.
    """
    text = text_table(table).read()
    lines = text.splitlines()
    if lines and (lines[0].startswith("imt,") or openquake.header_values(lines[0])):
        return _openquake(table, lines, imt, poe)
    if imt is not None or poe is not None:
        _refuse(table, "is of one motion, so that there is none to choose", "leave --imt and --poe out")
    if lines and "Σε" in lines[0]:
        return Deaggregation(_nshmp(table, lines))
    return Deaggregation(_bins(table, text))


def _bins(table: Path, text: str) -> list[Bin]:
    """Bins of a person's table, by their edges or their centres; those that it splits, as by epsilon, are added up."""
    lines = [line for line in text.splitlines(keepends=True) if line.strip() and not line.startswith("#")]
    sign = separator_of(lines[0] if lines else "")
    rows = [
        (line, {_plain(name): cell.strip() for name, cell in row.items()}, row)
        for line, row in csv_rows(iter(lines), table, sign)
    ]
    roles = (
        {role: next((n for n in rows[0][1] if n in names), "") for role, names in _COLUMNS.items()}
        if rows
        else {}
    )
    edges = ("magnitude low", "magnitude high", "distance low", "distance high")
    by_centre = bool(roles) and all(roles.values()) and not set(edges) <= rows[0][1].keys()
    names = (roles["magnitude"], roles["distance"], roles["share"]) if by_centre else (*edges, "contribution")
    found = []
    for line, cells, row in rows:
        try:
            numbers = [float(cells[name].replace(",", ".").rstrip("% ")) for name in names]
        except (KeyError, ValueError):
            numbers = []
        ordered = by_centre or (numbers[:1] < numbers[1:2] and numbers[2:3] < numbers[3:4])
        if not (numbers and all(map(math.isfinite, numbers)) and numbers[-1] >= 0 and ordered):
            raise InputError(
                f"not a bin: {shown(list(row.values()))}",
                where=f"{table}:{line}",
                expected="numbers in magnitude_low, magnitude_high, distance_low_km, distance_high_km, contribution, "
                "low below high; or centres in magnitude, distance_km, contribution",
                remedy="correct the table",
            )
        found.append(numbers)
    if by_centre:
        km, magnitudes = _widths(table, [one[1] for one in found], [one[0] for one in found])
        found = [[*_around(m, magnitudes), *_around(r, km), share] for m, r, share in found]
    shares: dict[tuple[float, ...], float] = {}
    for one in found:
        shares[tuple(one[:4])] = shares.get(tuple(one[:4]), 0.0) + one[4]
    return [Bin((place[0], place[1]), (place[2], place[3]), share) for place, share in shares.items()]


def _plain(name: str) -> str:
    """Name of a column in lower case, without its unit."""
    bare = re.sub(r"[(\[][^)\]]*[)\]]", "", name.lower()).replace("_", " ")
    return " ".join(bare.removesuffix(" km").split())


def _nshmp(table: Path, lines: Sequence[str]) -> list[Bin]:
    """Bins of nshmp-haz: r and m are centres, Σε is the contribution in per cent of the total."""
    header = [cell.strip() for cell in lines[0].split(",")]
    try:
        at = header.index("r"), header.index("m"), header.index("Σε")
    except ValueError:
        _refuse(
            table, f"has the columns {shown(header)}", "give data.csv as nshmp-haz wrote it, with r, m and Σε"
        )
    rows = []
    for number, line in enumerate(lines[1:], 2):
        if not line.strip():
            continue
        cells = [cell.strip() for cell in line.split(",")]
        if len(cells) != len(header):
            _refuse(
                f"{table}:{number}",
                f"has {len(cells)} columns, the header {len(header)}",
                "give the whole file",
            )
        rows.append([_number(table, number, cells[place]) for place in at])
    distance_km, magnitude = _widths(table, [row[0] for row in rows], [row[1] for row in rows])
    return [Bin(_around(m, magnitude), _around(r, distance_km), share) for r, m, share in rows]


def _around(centre: float, width: float) -> tuple[float, float]:
    """Edges about a centre, rounded: neighbours share an edge, and no record falls between two."""
    return round(centre - width / 2, 6), round(centre + width / 2, 6)


def _number(table: Path, line: int, text: str) -> float:
    try:
        value = 0.0 if text == _TRACE else float(text)
    except ValueError:
        value = math.nan
    if not 0 <= value < math.inf:
        _refuse(
            f"{table}:{line}", f"{text[:40]!r} is no number of 0 and more", "give the file as it was written"
        )
    return value


def _widths(table: Path, distances_km: Sequence[float], magnitudes: Sequence[float]) -> tuple[float, float]:
    """Widths of bins in km and in magnitude: as the summary beside the table says, or the configuration, or centres."""
    summary = table.with_name("summary.txt")
    if summary.is_file():
        stated = summary.read_text(encoding="utf-8", errors="replace")
        found = [re.search(rf"\b{name}:\s+min = .*Δ = ([\d.]+)", stated) for name in ("r", "m")]
        if all(found):
            return tuple(float(one[1]) for one in found if one)  # type: ignore[return-value]
    for folder in table.absolute().parents[:_DEPTH]:
        if (folder / "config.json").is_file():
            try:
                bins = json.loads((folder / "config.json").read_text(encoding="utf-8"))["deagg"]["bins"]
                return float(bins["Δr"]), float(bins["Δm"])
            except (ValueError, KeyError, TypeError, RecursionError):
                break
    edges = [sorted(set(values)) for values in (distances_km, magnitudes)]
    widths = [min((b - a for a, b in pairwise(known)), default=None) for known in edges]
    if None in widths:
        _refuse(table, "has one bin of distance or magnitude, and nothing that states how wide it is",
                "keep summary.txt beside it")  # fmt: skip
    return widths[0] or 0.0, widths[1] or 0.0


def _openquake(table: Path, lines: Sequence[str], imt: str | None, poe: float | None) -> Deaggregation:
    """Bins of OpenQuake: values are probabilities in the investigation time; bins combine as independent events do."""
    stated = openquake.header_values(lines[0]) if lines[0].startswith("#") else {}
    first = 1 if lines[0].startswith("#") else 0
    try:
        header, *rows = [row for row in csv.reader(lines[first:]) if row] or [[]]
    except csv.Error as error:
        _refuse(table, f"is no CSV ({error})", "give the file as it was written")
    if not {"imt", "poe", "mag", "dist"} <= set(header):
        _refuse(table, f"has the columns {shown(header)}: a deaggregation over magnitude and distance is needed",
                "give Mag_Dist, as disagg_outputs = Mag_Dist writes it")  # fmt: skip
    edges = [openquake.numbers(stated.get(f"{name}_bin_edges", "")) for name in ("mag", "dist")]
    if not all(len(one) > 1 and all(a < b for a, b in pairwise(one)) for one in edges):
        _refuse(
            table,
            "states no mag_bin_edges and dist_bin_edges in its first line",
            "give the file as it was written",
        )
    if short := next((n for n, row in enumerate(rows, first + 2) if len(row) != len(header)), None):
        _refuse(f"{table}:{short}", f"has not the header's {len(header)} columns", "give the whole file")
    records = [dict(zip(header, row, strict=True)) for row in rows]
    chosen, of = _chosen(table, records, imt, poe, stated.get("investigation_time", ""))
    weights = _weights(table, header, stated)
    stays: dict[tuple[int, int], float] = {}
    for record in chosen:
        place = _place(table, record, edges)
        p = math.fsum(weight * _probability(table, record[name]) for name, weight in weights.items())
        stays[place] = stays.get(place, 0.0) - math.log1p(-min(p, 1 - 1e-15))
    return Deaggregation(
        [
            Bin((edges[0][m], edges[0][m + 1]), (edges[1][d], edges[1][d + 1]), rate)
            for (m, d), rate in sorted(stays.items())
        ],
        of,
    )


def _chosen(
    table: Path, records: Sequence[dict[str, str]], imt: str | None, poe: float | None, years: str
) -> tuple[list[dict[str, str]], str]:
    """Rows of one measure and probability, and which that is."""
    imts = list(dict.fromkeys(record["imt"] for record in records))
    if imt is not None and imt not in imts:
        _refuse(table, f"is over {listed(imts, 12)}, not over {imt}", "give one of these as --imt")
    measure = imt or next(iter(imts), "")
    of_measure = [record for record in records if record["imt"] == measure]
    poes = sorted({_probability(table, record["poe"]) for record in of_measure})
    known = [p for p in poes if poe is None or math.isclose(p, poe, rel_tol=1e-3)]
    if not known:
        _refuse(table, f"has the probabilities {listed([f'{p:g}' for p in poes], 12)}" if poes else "has no row",
                "give one of these as --poe")  # fmt: skip
    rows = [record for record in of_measure if _probability(table, record["poe"]) == known[0]]
    others = [f"--imt {one}" for one in imts if one != measure] + [
        f"--poe {p:g}" for p in poes if p != known[0]
    ]
    more = f"; others with {listed(others, 6)}" if others else ""
    return (
        rows,
        f"{measure} of {rows[0].get('iml', '?')}, probability {known[0]:g} in {years or '?'} years{more}",
    )


def _weights(table: Path, header: Sequence[str], stated: dict[str, str]) -> dict[str, float]:
    """Weight of each column of probabilities: weights in the first line follow the columns, not the numbers."""
    if "mean" in header:
        return {"mean": 1.0}
    columns = [name for name in header if name.startswith("rlz")]
    weights = openquake.numbers(stated.get("weights", "")) or ([1.0] if len(columns) == 1 else [])
    if len(columns) == 1 and len(weights) != 1:
        weights = [1.0]
    if not columns or len(weights) != len(columns) or not math.isclose(math.fsum(weights), 1.0, rel_tol=1e-3):
        _refuse(table, f"has {len(columns)} realisations and {len(weights)} weights, which sum to "
                f"{math.fsum(weights):g}", "give the table of the mean, Mag_Dist-mean")  # fmt: skip
    return dict(zip(columns, weights, strict=True))


def _place(table: Path, record: dict[str, str], edges: Sequence[Sequence[float]]) -> tuple[int, int]:
    """Numbers of the bins that a row's centres lie in."""
    places = []
    for name, known in zip(("mag", "dist"), edges, strict=True):
        try:
            centre = float(record[name])
        except ValueError:
            centre = math.nan
        inside = [number for number, (low, high) in enumerate(pairwise(known)) if low <= centre <= high]
        if not inside:
            _refuse(table, f"has the centre {record[name][:40]!r} of {name}, which is in none of its bins",
                    "give the file as it was written")  # fmt: skip
        places.append(inside[0])
    return places[0], places[1]


def _probability(table: Path, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0 <= value <= 1:
        _refuse(table, f"states the probability {text[:40]!r}", "give the file as it was written")
    return value


def _refuse(where: object, what: str, remedy: str) -> NoReturn:
    raise InputError(
        what, where=str(where), remedy=remedy,
        expected="a hazard deaggregation: a table of bins, nshmp-haz's data.csv, or OpenQuake's Mag_Dist",
    )  # fmt: skip
