"""Curves of nshmp-haz: totals, contributions of ground-motion models and of source types, and the web service's JSON.

The header is `[name,]lon,lat,<level>...`. The measure is the name of the folder (PGA/curves.csv); whether values are
annual rates or probabilities in one year, only `config.json` in the output's root tells (`hazard.valueFormat`). Codes
before November 2017 wrote `PGA/total.csv`, `PGA/gmm/ASK_14.csv`, `PGA/source/Fault.csv`, always rates.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from toppling.results.hazard.curves import HazardCurve, curve_of_probabilities, curve_of_rates
from toppling.results.hazard.measure_names import imt_of, measure_of
from toppling.results.hazard.readers.stated import (
    Hints,
    Statement,
    number,
    refuse,
    rows_of,
    wanted_rows,
    years_of_values,
)

_DEPTH = 5
"""Folders between a file of curves and the root of its output, at most: IMT/source/TYPE/curves.csv."""

_FORMATS = {"ANNUAL_RATE": 0.0, "POISSON_PROBABILITY": 1.0}


def matches(lines: Sequence[str]) -> bool:
    """Whether a header is nshmp-haz's: longitude, latitude, then numbers."""
    cells = [cell.strip() for cell in lines[0].split(",")]
    if "lon" not in cells[:2] or "lat" not in cells[:3]:
        return False
    levels = cells[cells.index("lat") + 1 :]
    try:
        return len([float(level) for level in levels]) > 1
    except ValueError:
        return False


def read(path: Path, lines: Sequence[str], hints: Hints) -> list[Statement]:
    """Read a file of curves.

    Raises InputError if neither the folders nor the user say which measure it is over, and what its values are.
    """
    (_, header), *rows = list(rows_of(path, lines))
    where = path.absolute()
    measured = next(
        ((column, level) for level, column in enumerate(map(_measure, where.parents[:3])) if column), None
    )
    measure = measured[0] if measured else hints.measure
    if measure is None:
        refuse(path, "states no intensity measure, and lies in no folder of that name", "give --measure")
    part = "" if not measured else _part(where, measured[1])
    years = _years(path, hints, old=measured is not None and where.name != "curves.csv")
    unit = 1.0 / imt_of(measure)[1]
    first = header.index("lat") + 1
    levels = [number(path, 1, cell) * unit for cell in header[first:]]
    if not rows:
        refuse(path, "has no site")
    found = []
    for line, row in wanted_rows(path, rows, header, "name", hints.site):
        stated = {
            "site": (number(path, line, row[header.index("lon")]), number(path, line, row[header.index("lat")])),
            "site_name": row[header.index("name")] if "name" in header else "", "source": str(path),
        }  # fmt: skip
        values = [number(path, line, cell) for cell in row[first:]]
        curve = _curve(part or "total", measure, levels, values, years, stated)
        found.append(Statement(curve, "part" if part else "curve", part or None, str(_root(where) or "")))
    return found


def _curve(
    name: str,
    measure: str,
    levels: Sequence[float],
    values: Sequence[float],
    years: float | None,
    stated: dict,
) -> HazardCurve:
    if years is None:
        return curve_of_rates(name, measure, levels, values, **stated)
    return curve_of_probabilities(name, measure, levels, values, years, **stated)


def _measure(folder: Path) -> str | None:
    known = measure_of(folder.name)
    return known[0] if known else None


def _part(path: Path, level: int) -> str:
    """Contribution that a file in or below a measure's folder is: 'gmm ASK_14', 'source FAULT'; empty for the total."""
    inside = path.relative_to(path.parents[level]).with_suffix("").parts
    if len(inside) == 1:
        return ""
    return " ".join(inside[:-1] if inside[-1] == "curves" else inside)


def _root(path: Path) -> Path | None:
    """Folder with the configuration of the calculation that wrote a file."""
    return next((folder for folder in path.parents[:_DEPTH] if (folder / "config.json").is_file()), None)


def _years(path: Path, hints: Hints, old: bool) -> float | None:
    """Time that the values are probabilities over; None for annual rates."""
    root = _root(path.absolute())
    stated: Any = None
    if root is not None:
        try:
            stated = (
                json.loads((root / "config.json").read_text(encoding="utf-8"))
                .get("hazard", {})
                .get("valueFormat")
            )
        except (ValueError, AttributeError, RecursionError):
            refuse(
                root / "config.json",
                "is no configuration of nshmp-haz",
                "give the output folder as it was written",
            )
    years = years_of_values(path, _FORMATS.get(stated, 0.0 if old else None), hints)
    if years is None:
        refuse(
            path,
            "does not say whether its values are annual rates or probabilities in one year",
            "give the output folder with its config.json, or --values rate, or --values 1",
        )
    return years or None


def matches_json(text: str) -> bool:
    """Whether a text is an answer of the hazard web service."""
    return '"response"' in text and ('"xvalues"' in text or '"xs"' in text)


def read_json(path: Path, text: str, hints: Hints) -> list[Statement]:
    """Read an answer of the hazard web service, old or new: totals, and contributions of source types.

    Raises InputError if the answer lacks a field, or states no annual frequencies.
    """
    try:
        whole = json.loads(text)
        answers = whole["response"] if isinstance(whole["response"], list) else [whole["response"]]
        found = []
        for answer in answers:
            about: dict[str, Any] = {}
            for part in (whole, whole.get("metadata"), whole.get("request"), answer, answer.get("metadata")):
                about |= {key.lower(): value for key, value in (part or {}).items()}
            for curve in answer.get("hazardCurves", [answer]):
                found += _answer(
                    path, about | {"imt": curve.get("imt", about.get("imt"))}, curve["data"], hints
                )
        return found
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError) as error:
        if hasattr(error, "remedy"):
            raise
        refuse(path, f"is no answer of the hazard web service ({type(error).__name__}: {error})")


def _answer(path: Path, about: dict[str, Any], data: Any, hints: Hints) -> list[Statement]:
    """Curves over one measure: old answers have one list of levels, new ones levels beside each curve's values."""
    imt = about["imt"]["value"] if isinstance(about["imt"], dict) else about["imt"]
    known = measure_of(str(imt))
    if known is None:
        refuse(path, f"is over {imt!r}, which is no measure known here")
    label = about.get("ylabel")
    if "annual" not in str(label or "").lower() and (label or hints.years is None):
        remedy = "ask the service for annual frequencies of exceedance" if label else "give --values rate"
        refuse(path, f"states {label!r}" if label else "does not say what its values are", remedy)
    years = years_of_values(path, 0.0 if label else None, hints)
    stated = {"site": (float(about["longitude"]), float(about["latitude"])), "source": str(path)}
    found = []
    for one in data if isinstance(data, list) else [data]:
        total = one.get("component", "Total") == "Total"
        name = "total" if total else f"source {one['component']}"
        values = one.get("values", one)
        levels = [float(x) * known[1] for x in values.get("xs") or about["xvalues"]]
        rates = [float(y) for y in values.get("ys") or values["yvalues"]]
        curve = _curve(name, known[0], levels, rates, years or None, stated)
        found.append(Statement(curve, "curve" if total else "part", None if total else name))
    return found
