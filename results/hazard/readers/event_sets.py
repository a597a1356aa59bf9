"""Sets of events: OpenQuake's ground-motion fields, CyberShake's ruptures, and a plain table; found by content."""

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
from toppling.models.files.given import HEAD_BYTES, LONGEST_LINE_BYTES, check_lines, encoding_of, open_given
from toppling.models.files.table import openquake_values
from toppling.results.hazard.events import EventBranch, EventSet, EventSite
from toppling.results.hazard.measure_names import UNSCALED, measure_of, measure_with_unit
from toppling.results.hazard.readers.assembly import HEAD_LINES

EVENT, SITE, BRANCH = "event_id", "site_id", "rlz_id"
_ALIASES = {"eid": EVENT, "sid": SITE, "custom_site_id": SITE, "rlzi": BRANCH, "ordinal": BRANCH}
"""Names of earlier versions of OpenQuake, and what they mean."""

_CYBERSHAKE = ("Source_ID", "Rupture_ID", "Rupture_Variation_ID", "Rupture_Probability", "IM_Value", "Units")
_LARGEST_BYTES = 4_000_000_000
"""Maximum size of a table of events, which pandas reads."""
_MOST_COLUMNS = 10_000
"""Maximum number of its columns."""

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
            head = text.Table.of([lines.readline(LONGEST_LINE_BYTES) for _ in range(HEAD_LINES)], path)
    except (InputError, UnicodeDecodeError):
        return None
    skipped = head.rows[0][0] if head.rows else 0
    keys = openquake_values(head.lines[0]) if skipped else {}
    return Table(path, tuple(map(_named, head.names)), keys, head, skipped, encoding)


def _kind_of(table: Table) -> str:
    """Kind of a table, by its columns."""
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


def belongs(first: Table, second: Table) -> bool:
    """Whether a file is of the same calculation: by the checksum that both state, or their names' last number."""
    stated = first.keys.get("checksum"), second.keys.get("checksum")
    if all(stated):
        return stated[0] == stated[1]
    numbers = [re.search(r"_(\d+)$", table.path.stem) for table in (first, second)]
    return not all(numbers) or numbers[0][1] == numbers[1][1]  # type: ignore[index]


def _sole(kind: str, tables: list[Table]) -> Table | None:
    """The table of a kind, of which there is to be at most one."""
    found = [table for table in tables if _kind_of(table) == kind]
    if len(found) > 1:
        names = ", ".join(table.path.name for table in found)
        raise event_error(
            "events.several_tables", f"holds several tables of {kind}: {names}", found[0].path.parent
        )
    return found[0] if found else None


def _measure_factors(
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
            found[name] = (measure[0], measure[1] * (ratio if measure[0] not in UNSCALED else 1.0))
    if not found:
        raise event_error(
            "events.no_measure",
            f"states no measure that is known here: {', '.join(table.header)}",
            table.path,
        )
    return found


def _branch_of(
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


_SITE_BYTES = 8
"""Length to which OpenQuake cuts a site's own name."""


def _read_fields(
    table: Table,
    companions: list[Table],
    ratio: float,
    event_rate: float | None,
    catalogue_years: float | None,
) -> EventSet:
    rows = table.frame()
    events, ruptures = _sole("events", companions), _sole("ruptures", companions)
    realizations = _sole("realizations", companions)
    if BRANCH not in rows and events is None and (ruptures or realizations):
        what = "has no events file beside it, which states the branch of each event"
        raise event_error("events.branch_missing", what, table.path)
    rows = _with_branches(rows, table, events)
    weights, paths = _realizations(realizations, rows, table)
    sites = _sites(rows, _sole("sitemesh", companions), table)
    factors = _measure_factors(table, "gmv_", measure_of, ratio)
    years, rate_of = _rates(table, ruptures, event_rate, catalogue_years)
    branches = []
    for number, weight in weights.items():
        name, mine = paths[number] or f"{BRANCH} {number}", rows[rows[BRANCH] == number]
        branches.append(_branch_of(name, mine, sites, factors, rate_of, weight))
    note = () if event_rate is None else (f"the scenario's rate is taken as {event_rate:g} a year",)
    # The engine draws the residuals within an event for each measure by itself, whatever its cross_correlation.
    source = str(table.path.parent)
    return EventSet(tuple(sites.values()), tuple(branches), source, years, note, correlated=False)


def _with_branches(rows: pd.DataFrame, table: Table, events: Table | None) -> pd.DataFrame:
    if rows.duplicated([name for name in (BRANCH, EVENT, SITE) if name in rows]).any():
        raise event_error("events.given_twice", "states an event twice at one site", table.path)
    if BRANCH in rows:
        return rows
    if events is None:
        return rows.assign(**{BRANCH: 0})
    known = events.frame()[[EVENT, BRANCH]]
    joined = rows.merge(known, on=EVENT, how="left", validate="many_to_one")
    if joined[BRANCH].isna().any():
        lost = joined.loc[joined[BRANCH].isna(), EVENT].iloc[0]
        raise event_error(
            "events.event_unknown", f"does not hold the event {lost} of {table.path.name}", events.path
        )
    return joined.astype({BRANCH: int})


def _realizations(
    stated: Table | None, rows: pd.DataFrame, table: Table
) -> tuple[dict[int, float], dict[int, str]]:
    if stated is None:
        if rows[BRANCH].nunique() > 1:
            raise event_error(
                "hazard.weights_missing",
                "has several branches, and no realizations file states their weights",
                table.path,
            )
        number = int(rows[BRANCH].iloc[0]) if len(rows) else 0
        return {number: 1.0}, {number: ""}
    branches = stated.frame()
    weights = dict(zip(branches[BRANCH], branches["weight"].astype(float), strict=True))
    unknown = set(rows[BRANCH]) - set(weights)
    if unknown:
        raise event_error("events.branch_unknown", f"lacks the branch {min(unknown)}", stated.path)
    total, least = sum(weights.values()), min(weights.values())
    if not abs(total - 1.0) < 1e-3 or least < 0:
        raise event_error(
            "hazard.weights_sum",
            f"has weights that sum to {total:g}, the least of them {least:g}",
            stated.path,
        )
    paths = branches.get("branch_path", pd.Series("", index=branches.index)).astype(str)
    return weights, dict(zip(branches[BRANCH], paths, strict=True))


def _sites(rows: pd.DataFrame, mesh: Table | None, table: Table) -> dict[str, EventSite]:
    """Sites by the identifier that the fields use."""
    used = list(dict.fromkeys(rows[SITE]))
    if mesh is None:
        return {name: EventSite(name) for name in used}
    places = mesh.frame().set_index(SITE)
    # The engine cuts names, so that the fields' name may be the beginning of the mesh's.
    cut = {name.encode()[:_SITE_BYTES].decode(errors="ignore"): name for name in places.index}
    sites = {
        name: EventSite(full, (float(places.loc[full, "lon"]), float(places.loc[full, "lat"])))
        for full in places.index
        for name in [full if full in used else full.encode()[:_SITE_BYTES].decode(errors="ignore")]
    }
    if strangers := [name for name in used if name not in sites and name not in cut]:
        raise event_error(
            "site.unknown", f"does not hold the site {strangers[0]} of {table.path.name}", mesh.path
        )
    if len(sites) < len(places):
        raise event_error(
            "site.not_told_apart",
            f"has sites that the fields do not distinguish of {table.path.name}",
            mesh.path,
        )
    return sites


def _rates(
    table: Table, ruptures: Table | None, event_rate: float | None, catalogue: float | None
) -> tuple[float | None, Callable[[int], float]]:
    """Years that each branch's events span, and the rate of each of some events."""
    if event_rate is not None:
        return None, lambda count: event_rate / count
    keys = ruptures.keys if ruptures else {}
    if catalogue is None and "investigation_time" in keys:
        catalogue = float(keys["investigation_time"]) * float(keys.get("ses_per_logic_tree_path", 1))
    if catalogue is None or not catalogue > 0:
        raise InputError(
            "events.rate_missing",
            "is a scenario, whose events have no rate, or no ruptures file states the time that they are of",
            where=str(table.path),
            expected="investigation_time and ses_per_logic_tree_path in the first line of the ruptures file",
            remedy="put it beside the fields, or give --catalogue-years, or --event-rate, that of the scenario",
        )
    return catalogue, lambda _: 1.0 / catalogue


_BEARING = ("fields", "cybershake", "plain")
"""Kinds of tables that hold motions."""

_CM_S2 = ("cm per sec squared", "cm/s^2", "cm/s2", "cm/sec^2")


def is_event_set(path: Path) -> bool:
    """Whether a file, or a folder, holds events with their motions."""
    files = sorted(path.glob("*.csv")) if path.is_dir() else [path]
    return any(_kind_of(table) in _BEARING for file in files if (table := opened(file)))


def read_events(
    path: Path, ratio: float = 1.0, event_rate: float | None = None, catalogue_years: float | None = None
) -> EventSet:
    """Read a set of events.

    path: OpenQuake's output folder, or its ground-motion fields with the other files beside them; CyberShake's query of
    intensity measures with the number of variations of each rupture beside it; or a table with a column `annual_rate`,
    columns of measures, and perhaps `event_id` and `site_id`.
    ratio: peak of the horizontal vector over the component of the motions.
    event_rate: annual rate of a scenario, which states none.
    catalogue_years: time that each branch's events were simulated for, where no file states it.
    Raises InputError if there is no event set, several, or a part of it is missing or contradicts another.
    """
    files = sorted((path if path.is_dir() else path.parent).glob("*.csv"))
    if path.is_file() and path not in files:
        files.append(path)
    tables = [table for file in files if (table := opened(file))]
    bearing = [table for table in tables if _kind_of(table) in _BEARING]
    chosen = [table for table in bearing if path.is_dir() or table.path.samefile(path)]
    if len(chosen) != 1:
        what = f"holds {len(chosen)} event sets: {', '.join(other.path.name for other in chosen)}" if chosen else (
            "holds no events with ground motions" if path.exists() else "does not exist"
        )  # fmt: skip
        raise event_error("events.none_or_several", what, path)
    (table,) = chosen
    companions = [other for other in tables if belongs(other, table)]
    readers: dict[str, Callable[..., EventSet]] = {
        "fields": _read_fields, "cybershake": _cybershake, "plain": _plain,
    }  # fmt: skip
    try:
        return readers[_kind_of(table)](table, companions, ratio, event_rate, catalogue_years)
    except InputError:
        raise
    except (ValueError, TypeError, LookupError, ArithmeticError) as error:
        raise event_error(
            "file.unreadable", f"cannot be read ({type(error).__name__}: {str(error)[:200]})", table.path
        ) from error


def _cybershake(table: Table, companions: list[Table], ratio: float, *_: object) -> EventSet:
    rows, counts = table.frame(), _sole("variations", companions)
    components, units = (sorted(rows[name].astype(str).unique()) for name in ("Component", "Units"))
    if len(components) > 1 or any(unit not in _CM_S2 for unit in units):
        raise event_error(
            "events.component_unknown",
            f"has the components {', '.join(components)} in {', '.join(units)}, not one in cm/s²",
            table.path,
        )
    if counts is None:
        raise InputError(
            "events.variations_missing",
            what="does not state how many variations each rupture has, over which its probability is shared",
            where=str(table.path),
            expected="a CSV beside it with the columns Source_ID, Rupture_ID, Num_Rup_Vars",
            remedy="export that table of the study from the database of variations (num_rvs)",
        )
    known = counts.frame()[[*RUPTURE, "Num_Rup_Vars"]].drop_duplicates()
    rows = rows.merge(known, on=RUPTURE, how="left", validate="many_to_one")
    if rows["Num_Rup_Vars"].isna().any():
        first = rows.loc[rows["Num_Rup_Vars"].isna(), RUPTURE].iloc[0].tolist()
        raise event_error("events.rupture_unknown", f"lacks the rupture {first[0]}/{first[1]}", counts.path)
    p = rows["Rupture_Probability"].to_numpy(float)
    if not ((p >= 0) & (p < 1)).all():
        raise event_error(
            "hazard.probability_out_of_range", "has rupture probabilities outside 0 to 1", table.path
        )
    rows = rows.assign(annual_rate=-np.log1p(-p) / rows["Num_Rup_Vars"])
    source, *others = (rows[name].astype(str) for name in (*RUPTURE, "Rupture_Variation_ID"))
    rows[EVENT] = source.str.cat(others, sep="/")
    missing = int(rows.drop_duplicates(RUPTURE)["Num_Rup_Vars"].sum() - rows[EVENT].nunique())
    wide = rows.pivot_table(
        "IM_Value", [EVENT, "Site_Name", "annual_rate"], "Period", aggfunc="first", fill_value=0.0
    ).reset_index()
    periods = [name for name in wide.columns if not isinstance(name, str)]
    factors = {period: (f"sa_{period:g}s_m_s2", 0.01 * ratio) for period in periods}
    notes = ["the probabilities of ruptures are taken to be over 1 year"]
    if missing:
        notes.append(
            f"{missing} variations of the ruptures are not in the file, and are taken to topple nothing"
        )
    places = _sole("places", companions)
    return _of_rows(wide.rename(columns={"Site_Name": SITE}), factors, table, tuple(notes), places)


def _plain(table: Table, companions: list[Table], ratio: float, *_: object) -> EventSet:  # noqa: ARG001
    rows = table.frame()
    factors = _measure_factors(table, "", measure_with_unit, ratio)
    if bare := next(filter(measure_of, factors), None):
        what = f"the column {bare!r} names no unit: name it, such as {bare} (g), {bare} (cm/s), or pga_m_s2"
        raise event_error("events.unit_missing", what, table.path)
    if of_branches := [name for name in rows if name.lower() in (BRANCH, "branch", "weight")]:
        what = f"has the column {of_branches[0]!r}, and a table is of the events of one branch"
        raise event_error("events.branch_in_table", what, table.path)
    if EVENT not in rows:
        rows[EVENT] = np.arange(len(rows))
    if SITE not in rows:
        rows[SITE] = "site"
    return _of_rows(rows, factors, table, ())


def _of_rows(
    rows: pd.DataFrame, factors: Mapping, table: Table, notes: tuple[str, ...], places: Table | None = None
) -> EventSet:
    """Branch of events that state their own rates."""
    if rows.empty:
        raise event_error("events.empty", "holds no event", table.path)
    rows = rows.assign(annual_rate=pd.to_numeric(rows["annual_rate"], errors="coerce"))
    by_event = rows.groupby(EVENT, sort=False)["annual_rate"]
    if (by_event.nunique() > 1).any() or not (
        np.isfinite(rows["annual_rate"]) & (rows["annual_rate"] >= 0)
    ).all():
        raise event_error(
            "events.rates_unusable", "has rates that are negative, or an event of several rates", table.path
        )
    if rows.duplicated([EVENT, SITE]).any():
        raise event_error("events.given_twice", "states an event twice at one site", table.path)
    known = places.frame().drop_duplicates("Site_Name").set_index("Site_Name") if places else pd.DataFrame()
    at = {name: (row["Site_Longitude"], row["Site_Latitude"]) for name, row in known.iterrows()}
    sites = {name: EventSite(name, at.get(name)) for name in dict.fromkeys(rows[SITE])}
    branch = _branch_of(table.path.stem, rows, sites, factors, lambda _: 1.0, 1.0)
    rates = by_event.first().sort_index().to_numpy(float)
    return EventSet(
        tuple(sites.values()), (EventBranch(branch.name, rates, branch.motions, 1.0, branch.name),), str(table.path),
        None, notes,
    )  # fmt: skip
