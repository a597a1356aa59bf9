"""Curves of nshmp-haz: totals, contributions of ground-motion models and of source types, and the web service's JSON.

The header is `[name,]lon,lat,<level>...`, in OpenSHA's maps `Index,Latitude,Longitude,<level>...`, in its logic trees
`[Site Name,]Branch Index,Branch Weight,[<level of the tree>...,]<level>...`. The measure is the name of the folder
(PGA/curves.csv); whether values are annual rates or probabilities in one year, only `config.json` in the output's root
tells (`hazard.valueFormat`).
"""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from toppling.models.files.documents import json_of, read_json
from toppling.models.files.given import LONGEST_NAME
from toppling.models.files.table import is_numeral
from toppling.models.motions.formats.units import unit_of
from toppling.models.motions.selection import nshmp_root
from toppling.results.hazard.measure_names import imt_of, measure_of, quantity_of
from toppling.results.hazard.readers.assembly import HazardFile, Statement, refuse, refused
from toppling.results.hazard.tree import HazardCurve

_NAMES = {"Longitude": "lon", "Latitude": "lat", "Site Name": "name"}
"""OpenSHA's names of the columns, and nshmp-haz's."""
_BRANCH, _WEIGHT = "Branch Index", "Branch Weight"

_MAGNITUDE = re.compile(r"mag(?:nitude)?s?|m_?w", re.IGNORECASE)
"""Name of a column of magnitudes."""
_LEAST_MAGNITUDE = 1.0
"""Least magnitude of a column: a hazard curve begins below 1 g."""
_LARGEST_MAGNITUDE = 10.5
"""Largest magnitude of a column: a hazard curve ends above 10.5 cm/s."""
_EARTHQUAKE_RATES = (
    "states rates of earthquakes by magnitude, not of ground motions",
    "give the hazard curves of that calculation",
)

_FORMATS = {"ANNUAL_RATE": 0.0, "POISSON_PROBABILITY": 1.0}


def matches(file: HazardFile) -> bool:
    """Whether a header is nshmp-haz's: longitude, latitude, then numbers; or a text an answer of its web service."""
    if file.kind == "json":
        return '"response"' in file.text and ('"xvalues"' in file.text or '"xs"' in file.text)
    header = _header(file.table.names)
    first = _first_level(header)
    before = set(header[:first])
    known = before >= {"lon", "lat"} or before >= {_BRANCH, _WEIGHT}
    return known and len(header) > first + 1 and all(map(is_numeral, header[first:]))


def _header(cells: Sequence[str]) -> list[str]:
    """Names of columns, of places as nshmp-haz calls them."""
    return [_NAMES.get(cell.strip(), cell.strip()) for cell in cells]


def _first_level(header: Sequence[str]) -> int:
    """Number of the first column of values, whose name is their level."""
    return next((n for n, name in enumerate(header) if is_numeral(name)), len(header))


def other_output(file: HazardFile) -> tuple[str, str] | None:
    """Kind of a table over magnitudes, by its header, and what to give instead; None for other tables.

    Numbers in equal steps that may all be magnitudes are.
    """
    cells = file.table.names
    levels = np.array([float(cell) for cell in cells if is_numeral(cell)])
    steps = np.diff(levels)
    inside = (levels >= _LEAST_MAGNITUDE) & (levels <= _LARGEST_MAGNITUDE)
    equal = len(steps) > 1 and steps[0] != 0 and np.allclose(steps, steps[0], rtol=1e-3)
    return _EARTHQUAKE_RATES if any(map(_MAGNITUDE.fullmatch, cells)) or (equal and inside.all()) else None


def read(file: HazardFile) -> list[Statement]:
    """Read a file of curves, or an answer of the web service.

    Raises InputError if neither the folders nor the user say which measure it is over, and what its values are; if the
    answer lacks a field, or states no annual frequencies.
    """
    if file.kind == "json":
        return _service_answers(file)
    names, rows = file.table.names, file.rows
    header = _header(names)
    where = file.path.absolute()
    known = [measure_of(folder.name) for folder in where.parents[:3]]
    level = next((level for level, measured in enumerate(known) if measured), None)
    measure = file.measure_elsewhere if level is None else (known[level] or ("",))[0]
    if measure is None:
        file.refuse("hazard.measure_missing",
            "states no intensity measure, and lies in no folder of that name", "give --measure")  # fmt: skip
    part = "" if level is None else _part(where, level)
    years = _years(file)
    unit = 1.0 / imt_of(measure)[1]
    first = _first_level(header)
    levels = [file.number(1, cell) * unit for cell in header[first:]]
    if not rows:
        file.refuse("hazard.no_site", "has no site")
    total = "total" if "lon" in names else ""
    found = []
    for line, row in file.wanted_rows(rows, header, "name"):
        values = [file.number(line, cell) for cell in row[first:]]
        about = dict(zip(header[:first], row, strict=False))
        curve = file.curve(
            measure, levels, values, years, part or total, site_name=about.get("name", ""),
            site=file.place_of(line, row, header) if "lon" in about else None,
        )  # fmt: skip
        if _WEIGHT in about:
            found.append(_branch(file, line, curve, about))
        else:
            found.append(
                Statement(curve, "part" if part else "curve", part or None, str(nshmp_root(where) or ""))
            )
    return found


def _branch(file: HazardFile, line: int, curve: HazardCurve, about: dict[str, str]) -> Statement:
    """Branch of a logic tree of OpenSHA, whose choices stand between its weight and its values."""
    number, weight = (file.number(line, about[name]) for name in (_BRANCH, _WEIGHT))
    at = list(about).index(_WEIGHT) + 1
    path = "~".join(f"{level}={choice}" for level, choice in list(about.items())[at:])
    return Statement(curve, "realisation", int(number), weight=weight, path=path)


def _part(path: Path, level: int) -> str:
    """Contribution that a file in or below a measure's folder is: 'gmm ASK_14', 'source FAULT'; empty for the total."""
    inside = path.relative_to(path.parents[level]).with_suffix("").parts
    if len(inside) == 1:
        return ""
    return " ".join(inside[:-1] if inside[-1] == "curves" else inside)


def _years(file: HazardFile) -> float:
    """Time that the values are probabilities over; 0 for annual rates."""
    root = nshmp_root(file.path)
    stated: Any = None
    if root is not None:
        try:
            stated = read_json(root / "config.json").get("hazard", {}).get("valueFormat")
        except (ValueError, AttributeError):
            what = "is no configuration of nshmp-haz"
            refuse("hazard.configuration_unreadable", root / "config.json", what,
                "give the output folder as it was written")  # fmt: skip
    return file.years_of_values(
        _FORMATS.get(stated),
        "does not say whether its values are annual rates or probabilities in one year",
        "give the output folder with its config.json, or --values rate, or --values 1",
    )  # fmt: skip


def _service_answers(file: HazardFile) -> list[Statement]:
    """Curves of the web service, old or new: totals, and contributions of source types."""
    try:
        whole = json_of(file.text, file.path, refused)
        answers = whole["response"] if isinstance(whole["response"], list) else [whole["response"]]
        found = []
        for answer in answers:
            about: dict[str, Any] = {}
            for part in (whole, whole.get("metadata"), whole.get("request"), answer, answer.get("metadata")):
                about |= {key.lower(): value for key, value in (part or {}).items()}
            for curve in answer.get("hazardCurves", [answer]):
                imt = curve.get("imt", about.get("imt"))
                found += _answer(file, about | {"imt": imt}, curve["data"])
        return found
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        if hasattr(error, "remedy"):
            raise
        file.refuse("document.unreadable",
            f"is no answer of the hazard web service ({type(error).__name__}: {error})")  # fmt: skip


def _answer(file: HazardFile, about: dict[str, Any], data: Any) -> list[Statement]:
    """Curves over one measure: old answers have one list of levels, new ones levels beside each curve's values."""
    imt = about["imt"]["value"] if isinstance(about["imt"], dict) else about["imt"]
    measure, unit = file.measure_named(str(imt))
    if quantity_of(measure) == "acceleration":  # the service says g of velocities too
        brackets = re.findall(r"\(([^()]*)\)", str(about.get("xlabel", ""))[:LONGEST_NAME])
        unit = file.factor_stated(measure, unit, next(filter(unit_of, brackets), ""))
    label = about.get("ylabel")
    if label and "annual" not in str(label).lower():
        file.refuse("hazard.not_rates", f"states {label!r}",
            "ask the service for annual frequencies of exceedance")  # fmt: skip
    lacks = "does not say what its values are"
    years = file.years_of_values(0.0 if label else None, lacks, "give --values rate")
    place = float(about["longitude"]), float(about["latitude"])
    found = []
    for entry in data if isinstance(data, list) else [data]:
        total = entry.get("component", "Total") == "Total"
        name = "total" if total else f"source {entry['component']}"
        values = entry.get("values", entry)
        levels = [float(x) * unit for x in values.get("xs") or about["xvalues"]]
        rates = [float(y) for y in values.get("ys") or values["yvalues"]]
        curve = file.curve(measure, levels, rates, years, name, site=place)
        found.append(Statement(curve, "curve" if total else "part", None if total else name))
    return found
