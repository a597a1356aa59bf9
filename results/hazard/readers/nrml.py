"""Curves of OpenQuake's NRML (XML): those of engines before 3, of other programs, and of services such as EFEHR's."""

import re
from pathlib import Path
from xml.etree import ElementTree

from toppling.results.hazard.curves import curve_of
from toppling.results.hazard.readers.stated import (
    HazardFile,
    Hints,
    Statement,
    measure_named,
    number,
    refuse,
    wanted_rows,
    years_of_values,
)

_CURVES = re.compile(r"<(?:\w+:)?(?:hazardCurves|hazardCurveField)[\s>]")
_LEVELS, _VALUES = {"IMLs", "IML"}, {"poEs", "poE"}
_CONFIG = {"hazardProcessing"}
EXPORT = "export its curves as text: oq export hcurves --export-type csv"
"""Names of the elements in versions 0.4 and 0.5, and in 0.3."""


def matches(file: HazardFile) -> bool:
    """Whether a file has hazard curves in XML."""
    return _CURVES.search(file.text) is not None


def read(file: HazardFile, hints: Hints) -> list[Statement]:
    """Read the curves of a document: a mean, a fractile, or one branch.

    Raises InputError if it states no measure or time, or is no whole document.
    """
    path, text = file.path, file.text
    if not matches(file):
        refuse(path, "is XML without hazard curves", EXPORT)
    if re.search(r"<!(?:DOCTYPE|ENTITY)", text):
        refuse(path, "defines entities, which no hazard curves need", "export the curves again")
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        refuse(path, f"is no whole XML document ({error})", "fetch the file again")
    processing = {
        key: each.attrib[key] for each in root.iter("*") if _tag(each) in _CONFIG for key in each.attrib
    }
    curves = [each for each in root.iter("*") if _tag(each) in ("hazardCurves", "hazardCurveField")]
    return [one for each in curves for one in _of_one_measure(path, each, processing, hints)]


def _tag(element: ElementTree.Element) -> str:
    """Name of an element, whatever its namespace: every version has its own."""
    return element.tag.rpartition("}")[2]


def _first(path: Path, element: ElementTree.Element, names: set[str]) -> ElementTree.Element:
    found = next((each for each in element.iter("*") if _tag(each) in names), None)
    if found is None or not (found.text or "").strip():
        refuse(path, f"has a {_tag(element)} without {' or '.join(sorted(names))}", "fetch the file again")
    return found


def _numbers(path: Path, element: ElementTree.Element, names: set[str]) -> list[float]:
    text = str(_first(path, element, names).text)
    return [number(path, 1, part) for part in re.split(r"[\s,]+", text.strip())]


def _of_one_measure(
    path: Path, element: ElementTree.Element, processing: dict[str, str], hints: Hints
) -> list[Statement]:
    stated = {**processing, **element.attrib, **_first(path, element, _LEVELS).attrib}
    imt = stated.get("IMT", "")
    if imt.upper() == "SA" and "saPeriod" in stated:
        imt = f"SA({stated['saPeriod']})"
    measure, unit = measure_named(path, imt)
    time = stated.get("investigationTime") or stated.get("investigationTimeSpan")
    years = years_of_values(
        path, None if time is None else number(path, 1, time), hints,
        "states no investigationTime: the years that its probabilities are over", "give --values 50",
    )  # fmt: skip
    levels = [level * unit for level in _numbers(path, element, _LEVELS)]
    nodes = [each for each in element.iter("*") if _tag(each) == "HCNode"]
    nodes = nodes or [each for each in element if _tag(each) == "hazardCurve"]
    if not nodes:
        refuse(path, "has no curve", "fetch the file again")
    places = [(n, [repr(x) for x in _numbers(path, node, {"pos"})[:2]]) for n, node in enumerate(nodes)]
    found = []
    for place, site in wanted_rows(path, places, ("lon", "lat"), "", hints.site):
        values = _numbers(path, nodes[place], _VALUES)
        if len(values) != len(levels):
            refuse(path, f"has {len(levels)} levels and {len(values)} probabilities", "fetch the file again")
        curve = curve_of(
            path.stem, measure, levels, values, years, site=(float(site[0]), float(site[1])), source=str(path)
        )
        found.append(Statement(curve, *_kind(stated)))
    return found


def _kind(stated: dict[str, str]) -> tuple[str, float | str | None]:
    """Which curve of a calculation it is."""
    if "quantileValue" in stated or stated.get("statistics", "").startswith("quantile"):
        value = stated.get("quantileValue") or stated["statistics"].partition("-")[2]
        return "fractile", float(value)
    return "curve", None
