"""Tables of several curves: a row a level or a row a curve, with columns of sites, measures, means and fractiles.

As people and services write them: `lon,lat,imt,level,annual_rate`; `lat,lon,imt,agg,0.01,0.02,...`;
`level (g),PGA,SA(1.0)`; `PGA (g),mean,5%,95%`.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import zip_longest

import numpy as np

from toppling.models.files.csv_text import is_numeral
from toppling.models.motions.formats.units import unit_of
from toppling.results.hazard.measure_names import (
    LONGEST_NAME,
    imt_of,
    measure_in,
    measure_of,
    measure_with_unit,
)
from toppling.results.hazard.readers.stated import HazardFile, Statement
from toppling.results.hazard.readers.text_columns import (
    cells_of,
    is_comment,
    rows_from,
    uncommented,
    upright,
    with_usual_unit,
)
from toppling.results.hazard.readers.value_columns import says_value, values_of

_ROLES = {
    "lon": {"lon", "longitude", "long"}, "lat": {"lat", "latitude"},
    "name": {"site", "name", "site name", "location", "custom site id"},
    "imt": {"imt", "im", "measure", "intensity measure", "im type"},
    "kind": {"agg", "aggregate", "statistic", "statistics", "stat", "fractile", "quantile", "percentile"},
}  # fmt: skip
"""Names of columns by what they hold, in lower case."""
_LEVEL = re.compile(
    r"(?:(?:im|intensity|measure|ground|spectral|peak|motion|amplitudes?) )*"
    r"(?:imls?|levels?|intensity|acceleration|motion|amp(?:litude)?s?)"
)
"""Names of the column of levels, which say of no measure which it is."""
_BRACKETS = re.compile(r"\s*[(\[]([^()\[\]]*)[)\]]")
_FRACTILE = re.compile(
    r"(?:p|quantile|fractile|percentile)?[ _-]*(\d*\.?\d+)(?:th|st|nd|rd)?[ _]*(%|percent\w*|fractile|quantile)?"
)
_VALUE_WORDS = re.compile(r"\b(?:annual[ _]rate|m?afe|poe)\b[ _]*", re.IGNORECASE)
"""Beside a fractile, what it is one of: AFE mean, AFE 16th."""
_MOST_ABOVE = 50
"""Lines of a file among which its header is looked for."""
_MOST_COLUMNS = 1000
"""Of a table."""
_RATES = re.compile(r"annual (?:exceedance )?(?:rate|frequenc)|\bm?afe\b")


@dataclass(frozen=True)
class _Table:
    """What the columns of a table hold, by their places."""

    roles: Mapping[str, int]
    across: Mapping[int, str]  # names of columns of values, if several
    header: Sequence[str]

    @cached_property
    def with_places(self) -> list[str]:
        """Header whose columns of places have their plain names; empty where there are none."""
        if "lon" not in self.roles or "lat" not in self.roles:
            return []
        header = list(self.header)
        header[self.roles["lon"]], header[self.roles["lat"]] = "lon", "lat"
        return header


def _plain(name: str) -> str:
    return " ".join(re.sub(r"[_-]+", " ", _BRACKETS.sub("", name).lower()).split())


def _fractile(name: str) -> float | str | None:
    """Probability of a fractile's name, 'mean' of the mean's; None of other names."""
    name = _VALUE_WORDS.sub("", name)
    bare = _plain(name)
    if bare in ("mean", "average"):
        return "mean"
    if bare in ("median", "med"):
        return 0.5
    found = _FRACTILE.fullmatch(name.strip().lower())
    if found is None:
        return None
    value = float(found[1])
    value = value / 100 if value >= 1 or found[2] == "%" else value
    return value if 0 < value < 1 else None


def _table(header: Sequence[str]) -> _Table | None:
    """Table of a header; None if it is none of these."""
    roles: dict[str, int] = {}
    for place, name in enumerate(header):
        role = next((role for role, names in _ROLES.items() if _plain(name) in names), None)
        role = role or ("level" if _LEVEL.fullmatch(_plain(name)) and not _is_measure(name) else None)
        if role and role not in roles:
            roles[role] = place
    rest = {place: name for place, name in enumerate(header) if place not in roles.values()}
    levels = {
        n: name.removeprefix("poe-") for n, name in rest.items() if is_numeral(name.removeprefix("poe-"))
    }
    about = bool(roles.keys() & {"lon", "imt", "kind"})
    if "level" not in roles and len(levels) > 1 and about:
        return _Table(roles, levels, header)
    if "level" in roles:
        values = [n for n, name in rest.items() if says_value(name)]
        if len(values) == 1:
            return _Table({**roles, "value": values[0]}, {}, header)
        measures = {n: name for n, name in rest.items() if _is_measure(_imt(name))}
        return _Table(roles, measures, header) if measures and "imt" not in roles else None
    named = [n for n, name in rest.items() if measure_with_unit(name)]
    kinds = {n: name for n, name in rest.items() if n not in named and _fractile(name) is not None}
    stated = not all(map(is_numeral, kinds.values()))  # bare numbers may be levels of a table on its side
    if len(named) == 1 and len(kinds) == len(rest) - 1 and len(kinds) > 1 and stated:
        return _Table({**roles, "level": named[0]}, kinds, header)
    return None


def matches(file: HazardFile) -> bool:
    """Whether a header names several curves' columns, below a title perhaps."""
    return _header_line(file.table) is not None


def _header_line(lines: Sequence[str]) -> int | None:
    places = [n for n, line in enumerate(lines[:_MOST_ABOVE]) if line.strip()]
    places.sort(key=lambda n: is_comment(lines[n]))  # a remark may be the header where no other line is
    for n, below in zip_longest(places, places[1:]):
        header = [name.strip(' "') for name in _split(uncommented(lines[n]))]
        if len(header) > _MOST_COLUMNS or max(map(len, header)) > LONGEST_NAME:
            continue
        if _table(header):
            return n
        on_its_side = (
            _LEVEL.fullmatch(_plain(header[0])) is not None
            and len(header) > 2
            and all(map(is_numeral, header[1:]))
        )
        if on_its_side and below is not None and _is_measure(_imt(_split(lines[below])[0].strip(' "'))):
            return n
    return None


def _split(line: str) -> list[str]:
    return ",".join(cells_of([line])[0]).split(",")


def read(file: HazardFile) -> list[Statement]:
    """Read the curves of a table.

    Raises InputError if it states no measure, or not what its values are.
    """
    lines = file.table
    at = _header_line(lines) or 0
    before = " ".join(lines[:at]).lower()
    header, rows = upright(*rows_from(file, at))
    table = _table(header)
    if table is None:
        file.refuse(f"has the columns {', '.join(header)[:200]}")
    name = header[table.roles["value"]] if "value" in table.roles else ""
    years, convert = values_of(file, name, before) if name else (_years(file, before, table), float)
    curves: dict[tuple, list[tuple[float, float]]] = {}
    for line, row in _of_site(file, rows, table):
        for key, level, value in _points(file, line, row, table, before):
            curves.setdefault(key, []).append((level, convert(value)))
    return [_statement(file, key, points, years, before) for key, points in curves.items()]


def _years(file: HazardFile, before: str, table: _Table) -> float:
    """Time that values across columns are probabilities over, 0 for rates."""
    stated = f"{before} {' '.join(table.across.values())}".lower()
    if re.search(r"\bpoe|probabilit", stated):
        return values_of(file, "poe", before)[0]
    lacks = "does not say whether its values are annual rates or probabilities over some years"
    rates = 0.0 if _RATES.search(stated) else None
    return file.years_of_values(rates, lacks, "give --values rate, or --values 50")


def _of_site(
    file: HazardFile, rows: Sequence[tuple[int, list[str]]], table: _Table
) -> list[tuple[int, list[str]]]:
    """Rows of the site that is wanted, all where the table has no places."""
    header = table.with_places
    if not header:
        return file.wanted_rows(rows, table.header, None)
    name = header[table.roles["name"]] if "name" in table.roles else ""
    nearest = file.wanted_rows(rows, header, name)
    if not isinstance(file.hints.site, tuple) or not nearest:
        return nearest
    place = [nearest[0][1][table.roles[axis]] for axis in ("lon", "lat")]
    return [(line, row) for line, row in rows if [row[table.roles[axis]] for axis in ("lon", "lat")] == place]


def _points(
    file: HazardFile, line: int, row: Sequence[str], table: _Table, before: str
) -> Iterator[tuple[tuple, float, float]]:
    """Curve, level in SI, and value of every cell of a row that holds one."""
    roles = table.roles

    def cell(role: str) -> str:
        return row[roles[role]] if role in roles else ""

    places, named = table.with_places, measure_in(before)
    site = file.place_of(line, row, places) if places else ()
    for place, name in [(roles["value"], "")] if "value" in roles else table.across.items():
        own = cell("imt") or (_imt(name) if name and not _is_kind(name) else "")
        level = cell("level") or name
        header = table.header[roles["level"]] if "level" in roles else ""
        measure, factor, bare = _measure(file, own or (header if _is_measure(header) else named), header)
        kind = cell("kind") or (name if name and _is_kind(name) and "level" in roles else "")
        yield (
            (measure, bare, kind, site, cell("name")),
            file.number(line, level) * factor,
            file.value(line, row[place]),
        )


def _is_measure(name: str) -> bool:
    return bool(measure_with_unit(name))


def _imt(name: str) -> str:
    """Measure's name of a column of values, without what stands in brackets behind it: PGA (AFE)."""
    return name if _is_measure(name) else re.sub(r"\s*[(\[][^()\[\]]*[)\]]$", "", name)


def _is_kind(name: str) -> bool:
    return _fractile(name) is not None and not _is_measure(name)


def _measure(file: HazardFile, name: str, header: str) -> tuple[str, float, bool]:
    """Column of a measure, the factor of its levels to SI, and whether nothing but its name states their unit."""
    usual = (file.hints.measure, 1.0 / imt_of(file.hints.measure)[1]) if file.hints.measure else None
    known = measure_with_unit(name) if name else usual
    if not known:
        file.refuse(
            f"is over {name or header!r}", "name a measure instead, such as PGA (g), or give --measure"
        )
    bracket = _BRACKETS.search(header)
    stated = bracket[1] if bracket and not _is_measure(header) and unit_of(bracket[1]) else ""
    return (
        known[0],
        file.factor_stated(known[0], known[1], stated),
        not stated and (not name or measure_of(name) is not None),
    )


def _statement(
    file: HazardFile, key: tuple, points: Sequence[tuple[float, float]], years: float, before: str
) -> Statement:
    measure, bare, kind, site, name = key
    levels, values = np.transpose(sorted(points))
    stated = {"site_name": name, **({"site": site} if site else {})}
    which = _fractile(kind) if kind else "mean"
    if isinstance(which, float):
        values = np.minimum.accumulate(values)
    label = f"{file.path.stem} {kind}".strip()
    curve = file.curve(measure, levels, values, years, label, **stated)
    if bare:
        curve = with_usual_unit(file, imt_of(measure)[0], curve, before)
    if isinstance(which, float):
        return Statement(curve, "fractile", which)
    return Statement(curve) if which == "mean" else Statement(curve, "other", kind)
