"""Curves as JSON or GeoJSON, whoever wrote them: their points become the rows of a table, which is read as any other.

A curve is a list of levels beside a list of as many values, keys such as `poe-0.1`, or an object for each point. What
stands around it holds for it: its place, its measure, the time that its probabilities are over.
"""

import csv
import io
import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from toppling.results.hazard.measure_names import measure_with_unit
from toppling.results.hazard.readers import listed
from toppling.results.hazard.readers.stated import HazardFile, Statement

_LEVELS = ("iml", "imls", "level", "levels", "intensity", "intensities", "xs", "xvalues", "x")
_RATES = ("annual_rate", "annual_rates", "rate", "rates", "afe", "mafe", "lambda")
_POES = ("poe", "poes", "probability", "probabilities")
_PERIODS = ("return_period", "return_periods", "returnperiod")
_UNNAMED = ("value", "values", "ys", "yvalues", "y")
_VALUES = (
    dict.fromkeys(_RATES, "annual_rate")
    | dict.fromkeys(_POES, "poe")
    | dict.fromkeys(_PERIODS, "return period")
)
"""Names of columns by the keys of lists."""
_ABOUT = {
    "lon": ("lon", "longitude"), "lat": ("lat", "latitude"), "site": ("site", "site_name", "custom_site_id"),
    "imt": ("imt", "im", "measure"), "agg": ("agg", "statistic", "quantile", "fractile"),
    "unit": ("unit", "units", "iml_unit"), "years": ("investigation_time", "years", "time_span"),
}  # fmt: skip
"""Keys of what a table says in columns, in its header, or in the name of its values."""
_MOST_DEPTH = 30
_Point = tuple[dict[str, Any], str, Any, Any]


def matches(file: HazardFile) -> bool:
    """Whether a file may hold curves: keys of levels and of values that say what they are."""
    has = {key for key in (*_LEVELS, *_VALUES) if f'"{key}"' in file.text}
    return '"poe-' in file.text or (not has.isdisjoint(_LEVELS) and not has.isdisjoint(_VALUES))


def read(file: HazardFile) -> list[Statement]:
    """Read the curves of a JSON file.

    Raises InputError if it holds none, or does not say what its values are.
    """
    try:
        whole = _loaded(file.text)
    except (ValueError, RecursionError) as error:
        file.refuse(f"is no JSON ({type(error).__name__}: {error})")
    tables: dict[tuple[str, str], list[list[Any]]] = {}
    for about, value_name, level, value in _points(whole, {}, 0):
        level_name = f"level ({about['unit']})" if "unit" in about else "level"
        name = _column(file, value_name, about.get("years"))
        row = [about.get(key, "") for key in ("lon", "lat", "site", "imt", "agg")]
        tables.setdefault((level_name, name), []).append([*row, level, value])
    if not tables:
        file.refuse("is JSON without hazard curves: no list of levels stands beside one of values")
    found: list[Statement] = []
    for names, rows in tables.items():
        table = _table(["lon", "lat", "site", "imt", "agg", *names], rows)
        found += listed.read(replace(file, text=table))
    return found


def _loaded(text: str) -> Any:
    """Content of JSON, or of one JSON a line."""
    try:
        return json.loads(text, object_hook=_column_as_list)
    except json.JSONDecodeError as error:
        if not error.msg.startswith("Extra data"):
            raise
        return [json.loads(line) for line in text.splitlines() if line.strip()]


def _column_as_list(found: dict[str, Any]) -> Any:
    """The values of a column as pandas writes it, by the numbers of their rows."""
    return list(found.values()) if found and list(found) == list(map(str, range(len(found)))) else found


def _points(node: Any, around: Mapping[str, Any], depth: int) -> Iterator[_Point]:
    """Points of the curves in a part of the file, with what is said about each."""
    if depth > _MOST_DEPTH:
        return
    if isinstance(node, list):
        for each in node:
            yield from _points(each, around, depth + 1)
    if not isinstance(node, dict):
        return
    keys = {str(key).lower(): value for key, value in node.items()}
    about = dict(around) | _said(keys)
    yield from _own_points(keys, about)
    for key, value in keys.items():
        if key != "geometry":
            yield from _points(value, about, depth + 1)


def _said(keys: Mapping[str, Any]) -> dict[str, Any]:
    said = {}
    for name, among in _ABOUT.items():
        value = next((keys[key] for key in among if keys.get(key) not in (None, "")), None)
        value = value.get("value") if isinstance(value, dict) else value
        if isinstance(value, str | int | float):
            said[name] = value
    geometry = keys.get("geometry")
    place = geometry.get("coordinates") if isinstance(geometry, dict) else None
    if isinstance(place, list) and len(place) >= 2:
        said |= dict(zip(("lon", "lat"), place, strict=False))
    return said


def _own_points(keys: Mapping[str, Any], about: dict[str, Any]) -> Iterator[_Point]:
    """Points of the curve that an object is, or the point; none where it is neither."""
    for key, value in keys.items():
        if key.startswith("poe-"):
            yield about, "poe", key.removeprefix("poe-"), value
    level = next((key for key in keys if key in _LEVELS), None)
    if level is None and (level := next((key for key in keys if measure_with_unit(key)), None)):
        about = about | {"imt": level}
    values = [key for key in keys if key in (*_VALUES, *_UNNAMED)]
    if level is None or len(values) != 1:
        return
    x, y = keys[level], keys[values[0]]
    name = _VALUES.get(values[0], "")
    if isinstance(x, list) and isinstance(y, list) and len(x) == len(y):
        yield from ((about, name, *point) for point in zip(x, y, strict=True))
    elif isinstance(x, int | float) and isinstance(y, int | float):
        yield about, name, x, y


def _column(file: HazardFile, name: str, years: Any) -> str:
    """Name of a table's column of values, which says what they are."""
    if name in ("poe", "") and years is not None:
        return f"probability_{years}_years"
    if name or file.hints.years is None:
        return name or file.refuse("does not say whether its values are annual rates or probabilities",
                              "give --values rate, or --values 50")  # fmt: skip
    return f"probability_{file.hints.years}_years" if file.hints.years else "annual_rate"


def _table(header: list[str], rows: list[list[Any]]) -> str:
    """Text of CSV, without columns that nobody filled."""
    used = [n for n in range(len(header)) if any(row[n] != "" for row in rows)]
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows([[row[n] for n in used] for row in (header, *rows)])
    return out.getvalue()
