"""OpenQuake's ground-motion fields, with the events, ruptures, realizations and sites beside them."""

from collections.abc import Callable

import pandas as pd

from toppling.models.errors import InputError
from toppling.results.hazard.events import EventSet, EventSite
from toppling.results.hazard.measures import measure_of
from toppling.results.hazard.readers.event_tables import (
    BRANCH,
    EVENT,
    SITE,
    Table,
    branch_of,
    event_error,
    measure_factors,
    only_one,
)

_SITE_BYTES = 8
"""Length to which OpenQuake cuts a site's own name."""


def read_fields(
    table: Table, beside: list[Table], ratio: float, event_rate: float | None, catalogue_years: float | None
) -> EventSet:
    """Read fields with the tables beside them, as `read_events` does."""
    rows = table.frame()
    events, ruptures = only_one("events", beside), only_one("ruptures", beside)
    rows = _with_branches(rows, table, events)
    weights, paths = _realizations(only_one("realizations", beside), rows, table)
    sites = _sites(rows, only_one("sitemesh", beside), table)
    factors = measure_factors(table, "gmv_", measure_of, ratio)
    years, rate_of = _rates(table, events, ruptures, event_rate, catalogue_years)
    branches = [
        branch_of(
            f"{BRANCH} {number}" if not paths[number] else paths[number],
            mine,
            sites,
            factors,
            rate_of,
            weight,
        )
        for number, weight in weights.items()
        for mine in [rows[rows[BRANCH] == number]]
    ]
    note = () if event_rate is None else (f"the scenario's rate is taken as {event_rate:g} a year",)
    return EventSet(tuple(sites.values()), tuple(branches), str(table.path.parent), years, note)


def _with_branches(rows: pd.DataFrame, table: Table, events: Table | None) -> pd.DataFrame:
    """Rows of fields with the branch of each event."""
    if rows.duplicated([name for name in (BRANCH, EVENT, SITE) if name in rows]).any():
        raise event_error("states an event twice at one site", table.path)
    if BRANCH in rows:
        return rows
    if events is None:
        return rows.assign(**{BRANCH: 0})
    known = events.frame()[[EVENT, BRANCH]]
    joined = rows.merge(known, on=EVENT, how="left", validate="many_to_one")
    if joined[BRANCH].isna().any():
        lost = joined.loc[joined[BRANCH].isna(), EVENT].iloc[0]
        raise event_error(f"does not hold the event {lost} of {table.path.name}", events.path)
    return joined.astype({BRANCH: int})


def _realizations(
    stated: Table | None, rows: pd.DataFrame, table: Table
) -> tuple[dict[int, float], dict[int, str]]:
    """Weight and path of each branch."""
    if stated is None:
        if rows[BRANCH].nunique() > 1:
            raise event_error(
                "has several branches, and no realizations file states their weights", table.path
            )
        number = int(rows[BRANCH].iloc[0]) if len(rows) else 0
        return {number: 1.0}, {number: ""}
    branches = stated.frame()
    weights = dict(zip(branches[BRANCH], branches["weight"].astype(float), strict=True))
    unknown = set(rows[BRANCH]) - set(weights)
    if unknown or not abs(sum(weights.values()) - 1.0) < 1e-3 or min(weights.values()) < 0:
        what = (
            f"lacks the branch {min(unknown)}"
            if unknown
            else f"has weights that sum to {sum(weights.values()):g}, the least of them {min(weights.values()):g}"
        )
        raise event_error(what, stated.path)
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
    strangers = [name for name in used if name not in sites and name not in cut]
    if strangers or len(sites) < len(places):
        what = (
            f"does not hold the site {strangers[0]}"
            if strangers
            else "has sites that the fields cannot tell apart"
        )
        raise event_error(f"{what} of {table.path.name}", mesh.path)
    return sites


def _rates(
    table: Table,
    events: Table | None,
    ruptures: Table | None,
    event_rate: float | None,
    catalogue: float | None,
) -> tuple[float | None, Callable[[int], float]]:
    """Years that each branch's events span, and the rate of each of some events."""
    if event_rate is not None:
        return None, lambda count: event_rate / count
    keys = ruptures.keys if ruptures else {}
    if catalogue is None and "investigation_time" in keys:
        catalogue = float(keys["investigation_time"]) * float(keys.get("ses_per_logic_tree_path", 1))
    if catalogue is None or not catalogue > 0:
        frame = events.frame() if events else pd.DataFrame()
        scenario = "year" not in frame or not (frame["year"] > 0).any()
        option = "--event-rate, the annual rate of the scenario" if scenario else "--catalogue-years"
        if events is None:
            option += ", or --catalogue-years where they are a catalogue"
        raise InputError(
            what="is a scenario, or states no time: its events have no rate" if scenario
            else "no ruptures file states the time that the events were simulated for",
            where=str(table.path),
            expected="investigation_time and ses_per_logic_tree_path in the first line of the ruptures file",
            remedy=f"put the ruptures file beside it, or give {option}",
        )  # fmt: skip
    return catalogue, lambda _: 1.0 / catalogue
