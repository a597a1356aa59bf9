"""Fragility curves for other programs: OpenQuake's NRML, CSV and JSON, written and read back.

OpenQuake states a continuous fragility by mean and standard deviation of the lognormal variable, not by
median and beta, and has other units: g for accelerations, cm/s for velocity, cm for displacement. Only this module
converts between the two. PGA and PGV are of the horizontal vector, as everywhere in this project.

Each file also holds the basis of each curve (jobs, records, strongest shaking), so that an extrapolation or an
unfinished run is recognised later. In NRML it is a comment; files of other programs need not state it.
"""

import csv
import io
import json
import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import MISSING, asdict, fields, replace
from itertools import islice
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from toppling.models.arrays import Array
from toppling.models.errors import InputError, refusals
from toppling.models.files.documents import json_of, xml_of
from toppling.models.files.folder import instead, write_text
from toppling.models.files.given import text_given
from toppling.models.files.table import Table, plain
from toppling.models.motions.measures import MEASURES, OPENQUAKE
from toppling.results.analysis.lognormal import Basis, Lognormal, Resampled, Surface
from toppling.results.hazard.measure_names import imt_of, is_spectral, measure_of

_SPACE = "http://openquake.org/xmlns/nrml/0.5"
_FIELDS = ("measure", "median", "beta")
_INTERVAL = ("median_low", "median_high")
_PARTS = {"median_records": "records", "median_base": "base"}
"""Columns of the relative half widths of the median's interval, by cause."""
_BASIS = tuple(field.name for field in fields(Basis))
_BASIS_NEEDED = tuple(field.name for field in fields(Basis) if field.default is MISSING)
_MOST_SAMPLES = 1000
"""Maximum number of bootstrap samples in a file: Python's CSV reader takes 131,072 characters a cell."""

_PLANE = ("coefficient_0", "coefficient_1", "coefficient_2")
"""Columns of a fragility over two measures: intercept of its probit, slopes of the measures' natural logarithms."""

_MARK = "toppling "
"""Beginning of the NRML comment that holds the row of CSV and JSON for a fragility function."""


_curve_error = refusals(
    expected="lognormal curves as 'toppling fragility --fit' writes them",
    remedy="fit them with 'toppling fragility RUN --fit'",
)


def moments(curve: Lognormal) -> tuple[float, float]:
    """Mean and standard deviation of the lognormal variable with a curve's median and beta."""
    mean = curve.median * math.exp(curve.beta**2 / 2)
    return mean, mean * math.sqrt(math.expm1(curve.beta**2))


def of_moments(measure: str, mean: float, deviation: float) -> Lognormal:
    """Curve from a lognormal variable's mean and standard deviation, as OpenQuake inverts them."""
    beta = math.sqrt(math.log1p((deviation / mean) ** 2))
    return Lognormal(measure, mean**2 / math.hypot(deviation, mean), beta)


def write_curves(
    path: Path, curves: Iterable[Lognormal], name: str = "rock", surfaces: Sequence[Surface] = ()
) -> Path:
    """Write curves as NRML (.xml), CSV or JSON, by the file's suffix.

    curves: NRML takes those whose measure OpenQuake has (`OPENQUAKE`).
    name: name of the rock; NRML's taxonomy is this and the measure.
    surfaces: fragilities over two measures, for CSV and JSON: NRML has none.
    Raises InputError if the suffix is another, or NRML has no name for any of the measures.
    """
    rows = [*map(_row, curves := list(curves)), *map(_surface_row, surfaces)]
    writers = {
        ".xml": lambda: _nrml(curves, name), ".csv": lambda: _csv(rows, name), ".json": lambda: _json(rows, name),
    }  # fmt: skip
    if path.suffix not in writers:
        raise _suffix_error(path)
    return write_text(writers[path.suffix](), path)


def read_curves(path: Path) -> dict[str, Lognormal]:
    """Read curves from NRML, CSV or JSON, by measure.

    Raises InputError if the file is absent, of another kind, or holds no lognormal curve, or several over one measure.
    """
    curves = _read(path, _from_nrml, _curves)
    if not curves:
        raise _curve_error("fragility.none", "holds no lognormal fragility", path)
    for curve in curves:
        if curve.measure not in MEASURES and not is_spectral(curve.measure):
            what = f"is over {curve.measure!r}, which is no column of the results, such as pga_m_s2"
            raise _curve_error("measure.unknown", what, path)
        if not (curve.median > 0 and math.isfinite(curve.median) and 0 <= curve.beta < math.inf):
            raise _curve_error(
                "fragility.curve_unusable",
                f"median {curve.median}, beta {curve.beta} of {curve.measure}",
                path,
            )
    counts = Counter(curve.measure for curve in curves)
    several = [f"{count} curves over {measure}" for measure, count in counts.items() if count > 1]
    if several:
        raise _curve_error(
            "fragility.several_curves",
            f"holds {', '.join(several)}: give each rock, and each limit state, its own file",
            path,
        )
    return {curve.measure: curve for curve in curves}


def read_surface(path: Path, measures: tuple[str, ...]) -> Surface | None:
    """Read the fragility over some measures together from CSV or JSON; None where the file states none.

    Raises InputError if the file is absent, of another kind, or states one that cannot be read, or several.
    """
    found = _read(
        path, lambda *_: [], lambda rows: [_of_surface_row(row) for row in rows if _stated(row, _PLANE[:1])]
    )
    found = [surface for surface in found if surface.measures == measures]
    if len(found) > 1:
        raise _curve_error(
            "fragility.several_curves", f"holds {len(found)} surfaces over {' and '.join(measures)}", path
        )
    return found[0] if found else None


def _read(
    path: Path,
    of_nrml: Callable[[str, Path], list[Any]],
    of_rows: Callable[[list[dict[str, Any]]], list[Any]],
) -> list[Any]:
    """Parse a file: the text of NRML, or the rows of CSV or JSON."""
    if path.suffix not in (".xml", ".csv", ".json"):
        raise _suffix_error(path)
    try:
        text = text_given(path, _curve_error)
        return of_nrml(text, path) if path.suffix == ".xml" else of_rows(_rows(text, path))
    except InputError:
        raise
    except (LookupError, TypeError, ValueError, AttributeError, ArithmeticError) as error:
        raise _curve_error(
            "file.unreadable", f"cannot be read ({type(error).__name__}: {str(error)[:300]})", path
        ) from error


def _nrml(curves: list[Lognormal], name: str) -> str:
    known = [curve for curve in curves if curve.measure in OPENQUAKE or is_spectral(curve.measure)]
    if not known:
        raise InputError(
            "fragility.measure_not_in_format",
            what=f"no curve over {', '.join(OPENQUAKE)}",
            where="NRML",
            expected="a measure that OpenQuake has a name for",
            remedy="write CSV or JSON instead",
        )
    ET.register_namespace("", _SPACE)
    root = ET.Element(f"{{{_SPACE}}}nrml")
    model = ET.SubElement(
        root, f"{{{_SPACE}}}fragilityModel", id="toppling", assetCategory="rock", lossCategory="structural"
    )
    documentation = (
        f"{_unfinished(known)}Toppling of {name}; PGA, PGV, PGD and CAV of the horizontal vector, SA the largest of "
        "all azimuths, IA the sum of two components"
    )
    ET.SubElement(model, f"{{{_SPACE}}}description").text = documentation
    ET.SubElement(model, f"{{{_SPACE}}}limitStates").text = "toppled"
    for curve in known:
        imt, factor = imt_of(curve.measure)
        # Below and above these intensities the curve is within 1e-7 of 0 and 1.
        least, most = (curve.intensity(tail) * factor for tail in (1e-7, 1 - 1e-7))
        function = ET.SubElement(
            model, f"{{{_SPACE}}}fragilityFunction", id=f"{name}-{imt}", format="continuous", shape="logncdf"
        )
        limits = {"imt": imt, "noDamageLimit": repr(least), "minIML": repr(least), "maxIML": repr(most)}
        ET.SubElement(function, f"{{{_SPACE}}}imls", limits)
        mean, deviation = (value * factor for value in moments(curve))
        ET.SubElement(function, f"{{{_SPACE}}}params", ls="toppled", mean=repr(mean), stddev=repr(deviation))
        function.append(ET.Comment(f"{_MARK}{json.dumps(_row(curve))}"))
    ET.indent(root)
    return ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _unfinished(curves: Iterable[Lognormal]) -> str:
    """Remark that the run is unfinished, for the beginning of a description; empty if it is finished."""
    remarks = dict.fromkeys(curve.basis.unfinished for curve in curves if curve.basis)
    remark = "; ".join(filter(None, remarks))
    return f"UNFINISHED RUN: {remark}. " if remark else ""


def _from_nrml(text: str, path: Path) -> list[Lognormal]:
    curves = []
    root = xml_of(text, path, _curve_error, comments=True)
    for function in root.iter(f"{{{_SPACE}}}fragilityFunction"):
        imls = function.find(f"{{{_SPACE}}}imls")
        known = None if imls is None else measure_of(str(imls.get("imt")))
        if known is None:
            continue
        measure, si = known
        for params in function.findall(f"{{{_SPACE}}}params"):
            mean, deviation = (float(str(params.get(key))) * si for key in ("mean", "stddev"))
            curves.append(_with_row(of_moments(measure, mean, deviation), _stored_row(function)))
    return curves


def _stored_row(function: ET.Element) -> Mapping[str, Any]:
    """Row that this program writes as a comment of a function; empty in other programs' files."""
    texts = [str(child.text) for child in function if child.tag is ET.Comment]
    comments = [text.removeprefix(_MARK) for text in texts if text.startswith(_MARK)]
    return dict(json_of(comments[0], "NRML", _curve_error)) if comments else {}


def _csv(rows: list[dict[str, Any]], name: str) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, ("rock", *_FIELDS, *_INTERVAL, *_PARTS, *_BASIS, *_PLANE, "samples"))
    writer.writeheader()
    for row in rows:
        writer.writerow({key: plain(value) for key, value in {"rock": name, **row}.items()})
    return text.getvalue()


def _json(rows: list[dict[str, Any]], name: str) -> str:
    parts = {
        "curves": [row for row in rows if _PLANE[0] not in row],
        "surfaces": [row for row in rows if _PLANE[0] in row],
    }
    return json.dumps({"rock": name} | {key: part for key, part in parts.items() if part}, indent=1) + "\n"


def _rows(text: str, path: Path) -> list[dict[str, Any]]:
    if path.suffix == ".csv":
        table = Table.of(text.splitlines(), path)
        return [dict(zip(table.names, row, strict=False)) for _, row in table.rows[1:]]
    document = json_of(text, path, _curve_error)
    return [*document.get("curves", ()), *document.get("surfaces", ())]


def _surface_row(surface: Surface) -> dict[str, Any]:
    row = {"measure": "+".join(surface.measures), **dict(zip(_PLANE, surface.coefficients, strict=True))}
    row |= asdict(surface.basis) if surface.basis else {}
    if surface.basis and surface.resampled:
        row["samples"] = _samples_text(surface.resampled, lambda found: found)
    return row


def _of_surface_row(row: Mapping[str, Any]) -> Surface:
    measures = tuple(str(row["measure"]).split("+"))
    coefficients = tuple(float(row[name]) for name in _PLANE)
    if len(measures) != 2 or not np.isfinite(coefficients).all():
        raise ValueError(f"a surface over {row['measure']} with the coefficients {coefficients}")
    basis = _basis_of_row(row)
    samples = str(row.get("samples") or "").removeprefix("'")  # so that spreadsheets read no formula
    if not (basis and samples):
        return Surface(measures, coefficients, basis)
    found, fitted = _of_samples_text(samples)
    refits = np.array(found).reshape(-1, len(coefficients))
    return Surface(measures, coefficients, basis, Resampled(refits, fitted))


def _curves(rows: Iterable[Mapping[str, Any]]) -> list[Lognormal]:
    """Curves from the rows that do not describe surfaces."""
    found = []
    for row in rows:
        if _stated(row, _PLANE[:1]):
            continue
        if absent := [name for name in _FIELDS if name not in row]:
            raise ValueError(f"it has no column {' and '.join(absent)}")
        found.append(_with_row(Lognormal(str(row["measure"]), float(row["median"]), float(row["beta"])), row))
    return found


def _row(curve: Lognormal) -> dict[str, Any]:
    row = {name: getattr(curve, name) for name in _FIELDS}
    row |= dict(zip(_INTERVAL, curve.median_interval, strict=True)) if curve.median_interval else {}
    row |= {name: curve.interval_parts[part] for name, part in _PARTS.items() if part in curve.interval_parts}
    row |= asdict(curve.basis) if curve.basis else {}
    if curve.resampled and curve.basis:
        row["samples"] = _samples_text(
            curve.resampled, lambda line: (math.exp(-line[0] / line[1]), 1 / line[1])
        )
    return row


def _samples_text(resampled: Resampled, numbers: Callable[[Array], Iterable[float]]) -> str:
    """Numbers of each bootstrap sample, `1.21 .39;1.18 .41;;...`; empty for a sample without a fit."""
    rows = [() if refit is None else numbers(refit) for refit in islice(resampled.drawn(), _MOST_SAMPLES)]
    return ";".join(" ".join(f"{value:.7g}" for value in row) for row in rows)


def _of_samples_text(text: str) -> tuple[list[tuple[float, ...]], NDArray[np.bool_]]:
    """Parse the bootstrap samples that `_samples_text` wrote, and which samples had a fit."""
    parts = text.split(";")
    return [tuple(map(float, part.split())) for part in parts if part], np.array(list(map(bool, parts)))


def _medians_and_betas(text: str) -> Resampled:
    pairs, fitted = _of_samples_text(text)
    if not all(len(pair) == 2 and min(pair) > 0 and max(pair) < math.inf for pair in pairs):
        raise ValueError("samples are pairs of median and beta, above zero")
    coefficients = np.array([(-math.log(median) / beta, 1.0 / beta) for median, beta in pairs])
    return Resampled(coefficients.reshape(-1, 2), fitted)


def _with_row(curve: Lognormal, row: Mapping[str, Any]) -> Lognormal:
    """Add basis, interval and samples from a row to a curve, each where the row states it completely."""
    basis = _basis_of_row(row)
    low, high = (float(row[name]) for name in _INTERVAL) if _stated(row, _INTERVAL) else (math.nan, math.nan)
    parts = {part: float(row[name]) for name, part in _PARTS.items() if _stated(row, [name])}
    has_samples = basis and _stated(row, ["samples"])
    resampled = _medians_and_betas(str(row["samples"])) if has_samples else None
    ends = (low, high) if low <= high else None
    return replace(curve, basis=basis, median_interval=ends, interval_parts=parts, resampled=resampled)


def _stated(row: Mapping[str, Any], names: Iterable[str]) -> bool:
    return all(row.get(name) not in (None, "") for name in names)


def _basis_of_row(row: Mapping[str, Any]) -> Basis | None:
    """Basis of a curve from its row; None where the row does not state it completely."""
    if not _stated(row, _BASIS_NEEDED):
        return None
    kinds: dict[str, Callable[[Any], Any]] = {
        "scene_id": str,
        "strongest_shaken": float,
        "weakest_shaken": float,
    }
    return Basis(**{name: kinds.get(name, int)(row[name]) for name in _BASIS if _stated(row, [name])})


def _suffix_error(path: Path) -> InputError:
    absent = not path.suffix and not path.exists()
    return InputError(
        "file.absent" if absent else "fragility.format_unknown",
        "does not exist" if absent else f"the suffix is {path.suffix!r}{instead(path)}",
        where=str(path),
        expected="the folder of a run, or a file of curves: .xml (NRML), .csv or .json",
        remedy="check the path" if absent else "rename the file by what it holds",
    )
