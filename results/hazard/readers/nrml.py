"""Curves of OpenQuake's NRML (XML): those of engines before 3, of other programs, and of services such as EFEHR's."""

import re
from xml.etree import ElementTree

from toppling.models.files.documents import xml_of
from toppling.results.hazard.measure_names import imt_of
from toppling.results.hazard.readers.assembly import HazardFile, Statement, refused
from toppling.results.hazard.readers.text_columns import with_usual_unit

_CURVES = re.compile(r"<(?:\w+:)?(?:hazardCurves|hazardCurveField)[\s>]")
_UNITS = ("imlUnit", "unit", "units")
_LEVELS, _VALUES = {"IMLs", "IML"}, {"poEs", "poE"}
_CONFIG = {"hazardProcessing"}
EXPORT = "export its curves as text: oq export hcurves --export-type csv"
"""Names of the elements in versions 0.4 and 0.5, and in 0.3."""


def matches(file: HazardFile) -> bool:
    """Whether a file has hazard curves in XML."""
    return _CURVES.search(file.text) is not None


def read(file: HazardFile) -> list[Statement]:
    """Read the curves of a document: a mean, a fractile, or one branch.

    Raises InputError if it states no measure or time, or is no whole document.
    """
    text = file.text
    if not matches(file):
        file.refuse("hazard.no_curve", "is XML without hazard curves")
    root = xml_of(text, file.path, refused)
    processing = {
        key: node.attrib[key] for node in root.iter("*") if _tag(node) in _CONFIG for key in node.attrib
    }
    curves = [node for node in root.iter("*") if _tag(node) in ("hazardCurves", "hazardCurveField")]
    return [statement for node in curves for statement in _statements_of(file, node, processing)]


def _tag(element: ElementTree.Element) -> str:
    """Name of an element, whatever its namespace: every version has its own."""
    return element.tag.rpartition("}")[2]


def _first(file: HazardFile, element: ElementTree.Element, names: set[str]) -> ElementTree.Element:
    found = next((node for node in element.iter("*") if _tag(node) in names), None)
    if found is None or not (found.text or "").strip():
        file.refuse("hazard.element_missing", f"has a {_tag(element)} without {' or '.join(sorted(names))}",
            "fetch the file again")  # fmt: skip
    return found


def _numbers(file: HazardFile, element: ElementTree.Element, names: set[str]) -> list[float]:
    text = str(_first(file, element, names).text)
    return [file.number(1, part) for part in re.split(r"[\s,]+", text.strip())]


def _statements_of(
    file: HazardFile, element: ElementTree.Element, processing: dict[str, str]
) -> list[Statement]:
    stated = {**processing, **element.attrib, **_first(file, element, _LEVELS).attrib}
    imt = stated.get("IMT", "")
    if imt.upper() == "SA" and "saPeriod" in stated:
        imt = f"SA({stated['saPeriod']})"
    measure, usual = file.measure_named(imt)
    named = next((stated[name] for name in _UNITS if name in stated), "")
    unit = file.factor_stated(measure, usual, named)
    time = stated.get("investigationTime") or stated.get("investigationTimeSpan")
    years = file.years_of_values(None if time is None else file.number(1, time),
        "states no investigationTime: the years that its probabilities are over",
        "give --values 50")  # fmt: skip
    levels = [level * unit for level in _numbers(file, element, _LEVELS)]
    nodes = [node for node in element.iter("*") if _tag(node) == "HCNode"]
    nodes = nodes or [node for node in element if _tag(node) == "hazardCurve"]
    if not nodes:
        file.refuse("hazard.no_curve", "has no curve", "fetch the file again")
    places = [(n, [repr(x) for x in _numbers(file, node, {"pos"})[:2]]) for n, node in enumerate(nodes)]
    found = []
    for place, site in file.wanted_rows(places, ("lon", "lat"), ""):
        values = _numbers(file, nodes[place], _VALUES)
        if len(values) != len(levels):
            file.refuse("hazard.row_unreadable", f"has {len(levels)} levels and {len(values)} probabilities",
                "fetch the file again")  # fmt: skip
        curve = file.curve(measure, levels, values, years, site=(float(site[0]), float(site[1])))
        if not named:
            with_usual_unit(file, imt_of(measure)[0], curve, "")
        found.append(Statement(curve, *_kind(stated)))
    return found


def _kind(stated: dict[str, str]) -> tuple[str, float | str | None]:
    if "quantileValue" in stated or stated.get("statistics", "").startswith("quantile"):
        value = stated.get("quantileValue") or stated["statistics"].partition("-")[2]
        return "fractile", float(value)
    return "curve", None
