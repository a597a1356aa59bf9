"""Files of a set of events: which part of it each is, and whether they belong together."""

import io
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import numpy as np
import pandas as pd

from toppling.models.errors import InputError, refusals
from toppling.models.files import table as text
from toppling.models.files.given import LONGEST_LINE_BYTES, check_lines, open_given
from toppling.models.files.text_file import HEAD_BYTES, encoding_of
from toppling.results.hazard.events import EventBranch, EventSite
from toppling.results.hazard.measure_names import UNSCALED, measure_with_unit
from toppling.results.hazard.readers.openquake_curves import header_values

EVENT, SITE, BRANCH = "event_id", "site_id", "rlz_id"
_ALIASES = {"eid": EVENT, "sid": SITE, "custom_site_id": SITE, "rlzi": BRANCH, "ordinal": BRANCH}
"""Names of earlier versions of OpenQuake, and what they mean."""

_CYBERSHAKE = ("Source_ID", "Rupture_ID", "Rupture_Variation_ID", "Rupture_Probability", "IM_Value", "Units")
_LARGEST_BYTES = 4_000_000_000
_MOST_COLUMNS = 10_000
_MOST_COMMENTS = 30
"""Lines above the columns."""

RUPTURE = ["Source_ID", "Rupture_ID"]


event_error = refusals(
    expected="one set of events: OpenQuake's gmf-data with events, ruptures, realizations and sitemesh; "
    "CyberShake's query of intensity measures; or a table of annual_rate and measures",
    remedy="give the folder of one calculation, or the file with the motions",
)
"""Refuse a set of events."""


@dataclass(frozen=True, eq=False)
class Table:
    """A CSV file with what its comment line states."""

    path: Path
    header: tuple[str, ...]  # columns, by today's names
    keys: Mapping[str, str]  # of the comment line
    head: text.Table  # of the first rows
    skipped: int  # lines above the columns
    encoding: str

    def frame(self) -> pd.DataFrame:
        """All rows; identifiers of sites are text."""
        texts = dict.fromkeys(("site_id", "custom_site_id", "sid", "Site_Name"), str)
        try:
            with open_given(self.path, event_error, _LARGEST_BYTES) as file:
                check_lines(file, self.path, event_error)
                _check_cells(file, len(self.header), self.path)
                frame = pd.read_csv(
                    file,
                    sep=self.head.sign or ",",
                    skiprows=self.skipped,
                    dtype=texts,
                    encoding=self.encoding,
                    decimal=self.head.decimal,
                    thousands=self.head.thousands,
                )
        except InputError:
            raise
        except (ValueError, pd.errors.ParserError) as error:
            raise event_error("table.unreadable", f"cannot be read ({error})", self.path) from error
        return frame.rename(columns=_named)


def _check_cells(file: IO[bytes], columns: int, path: Path) -> None:
    """Refuse a table that the rows do not fill: pandas makes all of its cells, however few bytes they take.

    Every cell takes a byte at least, that of its separator.
    """
    rows = sum(chunk.count(b"\n") for chunk in iter(lambda: file.read(LONGEST_LINE_BYTES), b""))
    if rows * columns > file.tell() or columns > _MOST_COLUMNS:
        what = f"has {columns:,} columns: more than {_MOST_COLUMNS:,}, or than its {rows:,} lines fill"
        raise event_error("table.too_many_columns", what, path)
    file.seek(0)


def _named(column: str) -> str:
    """Name of a column today: of other versions, and of people who begin words with capitals."""
    bare = column.strip().strip('"')
    plain = bare.lower()
    return _ALIASES.get(plain, plain if plain in (EVENT, SITE, "annual_rate") else bare)


def opened(path: Path) -> Table | None:
    """Table of a file, of which the first lines are read; None where it is no text."""
    try:
        with open_given(path, event_error) as file:
            encoding = encoding_of(file.read(HEAD_BYTES).rpartition(b"\n")[0])
            if encoding is None:
                return None
            file.seek(0)
            lines = io.TextIOWrapper(file, encoding)
            head = text.Table.of([lines.readline(LONGEST_LINE_BYTES) for _ in range(_MOST_COMMENTS)], path)
    except (InputError, UnicodeDecodeError):
        return None
    skipped = head.rows[0][0] if head.rows else 0
    keys = header_values(head.lines[0]) if skipped else {}
    return Table(path, tuple(map(_named, head.names)), keys, head, skipped, encoding)


def kind_of(table: Table) -> str:
    """What a table is, by its columns."""
    columns = set(table.header)
    if EVENT in columns and any(name.startswith("gmv_") for name in columns):
        return "fields"
    if columns.issuperset(_CYBERSHAKE):
        return "cybershake"
    if {"rup_id", "multiplicity"} <= columns:
        return "ruptures"
    if EVENT in columns and columns <= {EVENT, "rup_id", BRANCH, "year", "ses_id"}:
        return "events"
    if {BRANCH, "weight"} <= columns:
        return "realizations"
    if {"Num_Rup_Vars", *RUPTURE} <= columns:
        return "variations"
    if {"Site_Name", "Site_Longitude", "Site_Latitude"} <= columns:
        return "places"
    if {SITE, "lon", "lat"} <= columns <= {SITE, "lon", "lat", "depth", "vs30"}:
        return "sitemesh"
    measures = [name for name in table.header if measure_with_unit(name)]
    if "annual_rate" in columns and (len(measures) > 1 or (measures and columns & {EVENT, SITE})):
        return "plain"  # one measure alone and no events or sites: a hazard curve
    return ""


def belongs(one: Table, to: Table) -> bool:
    """Whether a file is of the same calculation: by the checksum that both state, or their names' last number."""
    stated = one.keys.get("checksum"), to.keys.get("checksum")
    if all(stated):
        return stated[0] == stated[1]
    numbers = [re.search(r"_(\d+)$", table.path.stem) for table in (one, to)]
    return not all(numbers) or numbers[0][1] == numbers[1][1]  # type: ignore[index]


def only_one(kind: str, tables: list[Table]) -> Table | None:
    """The table of a kind, of which there is to be at most one."""
    found = [table for table in tables if kind_of(table) == kind]
    if len(found) > 1:
        names = ", ".join(table.path.name for table in found)
        raise event_error(
            "events.several_tables", f"holds several tables of {kind}: {names}", found[0].path.parent
        )
    return found[0] if found else None


def measure_factors(
    table: Table, prefix: str, known: Callable[[str], tuple[str, float] | None], ratio: float
) -> dict[str, tuple[str, float]]:
    """Column and factor to SI of each measure that is known."""
    found: dict[str, tuple[str, float]] = {}
    for name in table.header:
        measure = known(name.removeprefix(prefix)) if name.startswith(prefix) else None
        if measure and measure[0] in [column for column, _ in found.values()]:
            raise event_error(
                "events.measure_repeated",
                f"states {measure[0]} in two columns, {name} the second",
                table.path,
            )
        if measure:
            found[name] = (
                measure[0],
                measure[1] * (ratio if measure[0] not in UNSCALED else 1.0),
            )
    if not found:
        raise event_error(
            "events.no_measure",
            f"states no measure that is known here: {', '.join(table.header)}",
            table.path,
        )
    return found


def branch_of(
    name: str, rows: pd.DataFrame, sites: Mapping[str, EventSite], factors: Mapping[str, tuple[str, float]],
    rate_of: Callable[[int], float], weight: float,
) -> EventBranch:  # fmt: skip
    """Events of one branch: what a row is missing for was below the engine's least intensity, and counts as 0."""
    events, event = np.unique(rows[EVENT], return_inverse=True)
    site = rows[SITE].map({name: number for number, name in enumerate(sites)}).to_numpy(int)
    motions = {}
    for column, (measure, factor) in factors.items():
        values = pd.to_numeric(rows[column], errors="coerce").to_numpy(float)
        if wrong := values[~(np.isfinite(values) & (values >= 0))].tolist():
            raise InputError(
                "events.motion_negative",
                what=f"states a motion of {wrong[0]:g}",
                where=f"{name}, {column}",
                expected="numbers of 0 and above",
                remedy="remove the row, or correct it",
            )
        grid = np.zeros((len(events), len(sites)))
        grid[event, site] = values * factor
        motions[measure] = grid
    rate = np.full(len(events), rate_of(len(events)) if len(events) else 0.0)
    model = name.partition("~")[2] or name  # ground-motion part of a branch's path
    return EventBranch(name, rate, motions, weight, model)
