"""Fragility curves for other programs: OpenQuake's NRML, CSV and JSON, written and read back.

OpenQuake states a continuous fragility by mean and standard deviation of the lognormal variable, not by
median and beta, and has units of its own: g for accelerations, cm/s for velocity, cm for displacement. The
conversion is done here and nowhere else. PGA and PGV are of the horizontal vector, as everywhere here.

CSV and JSON also keep what each curve rests on, so that an extrapolation is known for one wherever the file goes; NRML
has no place for it, and files of other programs need not state it.
"""

import csv
import io
import json
import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from toppling.models.errors import InputError
from toppling.models.folder import new_file
from toppling.results.fits import Basis, Lognormal

OPENQUAKE_G_M_S2 = 9.80665
OPENQUAKE = {
    "pga_m_s2": ("PGA", 1 / OPENQUAKE_G_M_S2),
    "pgv_m_s": ("PGV", 100.0),
    "pgd_m": ("PGD", 100.0),
    "sa_1s_m_s2": ("SA(1.0)", 1 / OPENQUAKE_G_M_S2),
    "sa_2s_m_s2": ("SA(2.0)", 1 / OPENQUAKE_G_M_S2),
    "arias_m_s": ("IA", 1.0),
    "cav_m_s": ("CAV", 1 / OPENQUAKE_G_M_S2),
}
"""Name in OpenQuake (hazardlib/imt.py) and factor from SI to OpenQuake's unit, by column of the results."""

_SPACE = "http://openquake.org/xmlns/nrml/0.5"
_FIELDS = ("measure", "median", "beta")
_BASIS = tuple(field.name for field in fields(Basis))


def moments(curve: Lognormal) -> tuple[float, float]:
    """Mean and standard deviation of the lognormal variable with a curve's median and beta."""
    mean = curve.median * math.exp(curve.beta**2 / 2)
    return mean, mean * math.sqrt(math.expm1(curve.beta**2))


def of_moments(measure: str, mean: float, deviation: float) -> Lognormal:
    """Curve of a lognormal variable's mean and standard deviation: OpenQuake's own inversion."""
    beta = math.sqrt(math.log1p((deviation / mean) ** 2))
    return Lognormal(measure, mean**2 / math.hypot(deviation, mean), beta)


def write_curves(path: Path, curves: Iterable[Lognormal], name: str = "rock") -> Path:
    """Write curves as NRML (.xml), CSV or JSON, by the file's suffix.

    Parameters
    ----------
    path : Path
    curves : iterable of Lognormal
        NRML takes those whose measure OpenQuake has (`OPENQUAKE`).
    name : str
        Of the rock; NRML's taxonomy is this and the measure.

    Raises
    ------
    InputError
        If the suffix is another, or NRML has no name for any of the measures.
    """
    writers = {".xml": _nrml, ".csv": _csv, ".json": _json}
    if path.suffix not in writers:
        raise _suffix_error(path)
    text = writers[path.suffix](list(curves), name)
    with new_file(path) as hidden:
        hidden.write_text(text)
    return path


def read_curves(path: Path) -> dict[str, Lognormal]:
    """Read curves from NRML, CSV or JSON, by measure.

    Raises
    ------
    InputError
        If the file is absent, of another kind, or holds no lognormal curve, or several over one measure.
    """
    readers = {".xml": _from_nrml, ".csv": _from_csv, ".json": _from_json}
    if path.suffix not in readers:
        raise _suffix_error(path)
    try:
        curves = readers[path.suffix](path.read_text())
    except FileNotFoundError:
        raise _curve_error(path, "does not exist") from None
    except (
        ET.ParseError,
        csv.Error,
        LookupError,
        TypeError,
        ValueError,
        AttributeError,
        ArithmeticError,
        RecursionError,
    ) as error:
        raise _curve_error(path, f"cannot be read ({type(error).__name__}: {str(error)[:300]})") from error
    if not curves:
        raise _curve_error(path, "holds no lognormal fragility")
    for curve in curves:
        if not (curve.median > 0 and math.isfinite(curve.median) and 0 <= curve.beta < math.inf):
            raise _curve_error(path, f"median {curve.median}, beta {curve.beta} of {curve.measure}")
    counts = Counter(curve.measure for curve in curves)
    several = [f"{count} curves over {measure}" for measure, count in counts.items() if count > 1]
    if several:
        raise _curve_error(
            path, f"holds {', '.join(several)}: give each rock, and each limit state, its own file"
        )
    return {curve.measure: curve for curve in curves}


def _nrml(curves: list[Lognormal], name: str) -> str:
    known = [curve for curve in curves if curve.measure in OPENQUAKE]
    if not known:
        raise InputError(
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
    told = (
        f"Toppling of {name}; PGA, PGV, PGD and CAV of the horizontal vector, SA the largest of all azimuths, "
        "IA the sum of two components"
    )
    ET.SubElement(model, f"{{{_SPACE}}}description").text = told
    ET.SubElement(model, f"{{{_SPACE}}}limitStates").text = "toppled"
    for curve in known:
        imt, factor = OPENQUAKE[curve.measure]
        # Below and above these the curve is 0 and 1 to a part in ten million.
        least, most = (curve.intensity(tail) * factor for tail in (1e-7, 1 - 1e-7))
        function = ET.SubElement(
            model, f"{{{_SPACE}}}fragilityFunction", id=f"{name}-{imt}", format="continuous", shape="logncdf"
        )
        limits = {"imt": imt, "noDamageLimit": repr(least), "minIML": repr(least), "maxIML": repr(most)}
        ET.SubElement(function, f"{{{_SPACE}}}imls", limits)
        mean, deviation = (value * factor for value in moments(curve))
        ET.SubElement(function, f"{{{_SPACE}}}params", ls="toppled", mean=repr(mean), stddev=repr(deviation))
    ET.indent(root)
    return ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _from_nrml(text: str) -> list[Lognormal]:
    measures = {imt: (measure, factor) for measure, (imt, factor) in OPENQUAKE.items()}
    curves = []
    for function in ET.fromstring(text.encode()).iter(f"{{{_SPACE}}}fragilityFunction"):
        imls = function.find(f"{{{_SPACE}}}imls")
        if imls is None or imls.get("imt") not in measures:
            continue
        measure, factor = measures[str(imls.get("imt"))]
        for params in function.findall(f"{{{_SPACE}}}params"):
            mean, deviation = (float(str(params.get(key))) / factor for key in ("mean", "stddev"))
            curves.append(of_moments(measure, mean, deviation))
    return curves


def _csv(curves: list[Lognormal], name: str) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, ("rock", *_FIELDS, *_BASIS))
    writer.writeheader()
    writer.writerows({"rock": name, **_row(curve)} for curve in curves)
    return text.getvalue()


def _from_csv(text: str) -> list[Lognormal]:
    rows = csv.DictReader(io.StringIO(text))
    return [_of_row(row) for row in rows if row["median"]]


def _json(curves: list[Lognormal], name: str) -> str:
    return json.dumps({"rock": name, "curves": [_row(curve) for curve in curves]}, indent=1) + "\n"


def _from_json(text: str) -> list[Lognormal]:
    return [_of_row(row) for row in json.loads(text)["curves"]]


def _row(curve: Lognormal) -> dict[str, Any]:
    told = {name: getattr(curve, name) for name in _FIELDS}
    return told | (asdict(curve.basis) if curve.basis else {})


def _of_row(row: Mapping[str, Any]) -> Lognormal:
    """Curve of a row of numbers or of their text; its basis where the row states all of it."""
    stated = all(row.get(name) not in (None, "") for name in _BASIS)
    basis = Basis(
        scene_id=str(row["scene_id"]),
        jobs=int(row["jobs"]),
        toppled=int(row["toppled"]),
        records=int(row["records"]),
        without_answer=int(row["without_answer"]),
        strongest_shaken=float(row["strongest_shaken"]),
    ) if stated else None  # fmt: skip
    return Lognormal(str(row["measure"]), float(row["median"]), float(row["beta"]), basis)


def _suffix_error(path: Path) -> InputError:
    return InputError(
        f"the suffix is {path.suffix!r}", where=str(path), expected=".xml (NRML), .csv or .json",
        remedy="rename the file by what it holds",
    )  # fmt: skip


def _curve_error(path: Path, what: str) -> InputError:
    return InputError(
        what, where=str(path), expected="lognormal curves as 'toppling fragility --fit' writes them",
        remedy="fit them with 'toppling fragility RUN --fit'",
    )  # fmt: skip
