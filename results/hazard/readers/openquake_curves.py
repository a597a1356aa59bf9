"""OpenQuake's CSV: hazard curves of any kind, and the realisations' weights.

The first line holds `key=value` pairs, quoted as one cell since engine 3, bare before; the keys decide, not the file's
name. Probabilities are over `investigation_time`; PGA and SA are in g, PGV in cm/s, which no file says.
"""

import re

import numpy as np

from toppling.models.files.table import openquake_values
from toppling.results.hazard.measure_names import imt_of
from toppling.results.hazard.readers.assembly import HazardFile, Realisations, Stated, Statement

_NAMED = re.compile(r"rlz-\d+|quantile(?:_curve)?-\d*\.?\d+|mean|max|std")
"""Kind in a file's name, which repeats its first line where that was lost."""


def _names(file: HazardFile) -> list[str]:
    """Names of columns without types: engine 2 writes poe-0.1:float32; before 3.8, branches have an `ordinal`."""
    bare = [name.partition(":")[0] for name in file.table.names]
    return ["rlz_id" if name == "ordinal" else name for name in bare]


def matches(file: HazardFile) -> bool:
    """Whether a file is one of OpenQuake's that is read here: curves, or realisations."""
    names = _names(file)
    return any(name.startswith("poe-") for name in names) or names[:3] == ["rlz_id", "branch_path", "weight"]


_ADD_IMT = "add imt='PGA' to its first line, or give --measure"
_CURVES = "give the hazard_curve files of that calculation, or its folder"
_OTHERS = {
    r"(imt,.*\bpoe\b|poe,imt\b|mag,.*\bpoe|dist,.*\bpoe)": (
        "is a disaggregation: it says what exceeds one level, not how often levels are exceeded",
        f"{_CURVES}; disaggregations go to 'toppling magnitudes' and 'toppling records select --deaggregation'",
    ),
    r"lon,lat,(depth,)?.*\d~": (
        "holds uniform hazard spectra: one level of each measure for few rates",
        _CURVES,
    ),
    r"lon,lat,(depth,)?\D[^,]*-0?\.\d": ("is a hazard map: one level of each measure for few rates", _CURVES),
    r"(event_id|eid)\b": ("is part of a set of events", "give the folder of that calculation"),
    r"(rup_?id)\b": ("is part of a set of events", "give the folder of that calculation"),
    r"(custom_)?site_id\b": ("lists sites, or mean motions at them", _CURVES),
}
"""Other files of the engine by the beginning of their columns: what they are, and what to give instead."""


def other_output(file: HazardFile) -> tuple[str, str] | None:
    """Kind of another output of the engine, and what to give instead; None for other tables."""
    columns = ",".join(_names(file)).lower()
    if matches(file) or not (file.first_line or "~" in columns):
        return None
    found = next((of for of_columns, of in _OTHERS.items() if re.match(of_columns, columns)), None)
    return found and (f"{found[0]} (columns {columns[:60]})", found[1])


def read(file: HazardFile) -> Stated:
    """Read a file of curves or of realisations.

    Raises InputError if the file states no measure or time, or something else than probabilities.
    """
    header, rows = _names(file), file.rows
    if "branch_path" in header:
        return _realisations(file, header, rows)
    return _curves(file, openquake_values(file.first_line), header, rows)


def _realisations(file: HazardFile, header: list[str], rows: list[tuple[int, list[str]]]) -> Realisations:
    at = [header.index(name) for name in ("rlz_id", "branch_path", "weight")]
    weights, paths = {}, {}
    for line, row in rows:
        identity = file.number(line, row[at[0]])
        if identity in weights:
            file.refuse("hazard.realisation_repeated",
                f"line {line}: realisation {identity:g} is there twice",
                "give each realisation once")  # fmt: skip
        weights[int(identity)] = file.number(line, row[at[2]])
        paths[int(identity)] = row[at[1]]
    return Realisations(str(file.path), weights, paths)


def _curves(
    file: HazardFile, stated: dict[str, str], header: list[str], rows: list[tuple[int, list[str]]]
) -> list[Statement]:
    places = [index for index, name in enumerate(header) if name.startswith("poe-")]
    absent = [name for name in ("lon", "lat") if name not in header]
    if absent or not rows:
        file.refuse("hazard.columns_unknown" if absent else "hazard.no_site",
            f"has no column {', '.join(absent)}" if absent else "has no site")  # fmt: skip
    imt = stated.get("imt")
    if not imt and not file.measure_elsewhere:
        file.refuse("hazard.measure_missing", "states no imt", _ADD_IMT)
    measure, unit = file.measure_named(imt or imt_of(str(file.measure_elsewhere))[0], _ADD_IMT)
    time = stated.get("investigation_time")
    years = file.years_of_values(None if time is None else file.number(1, time),
        "states no investigation_time: the years that its probabilities are over",
        "add investigation_time=50.0 to its first line, or give --values 50")  # fmt: skip
    kind, key = _kind(file, stated.get("kind", ""))
    levels = [file.number(2, header[index].removeprefix("poe-").replace(",", ".")) * unit for index in places]
    found = []
    for line, row in file.wanted_rows(rows, header, "custom_site_id"):
        poes = [file.number(line, row[index]) for index in places]
        if kind == "fractile":  # by the engine's rule they may rise where branches' curves cross
            poes = np.minimum.accumulate(poes).tolist()
        curve = file.curve(
            measure, levels, poes, years, site=file.place_of(line, row, header),
            site_name=row[header.index("custom_site_id")] if "custom_site_id" in header else "",
        )  # fmt: skip
        found.append(Statement(curve, kind, key, stated.get("checksum", "")))
    return found


def _kind(file: HazardFile, kind: str) -> tuple[str, float | str | None]:
    """Kind of a curve in a calculation, by its key, or its file's name where it has none."""
    if not kind and (found := _NAMED.search(file.path.name)):
        kind = found[0].replace("_curve", "")
    if kind.startswith("rlz-"):
        return "realisation", int(kind.removeprefix("rlz-"))
    if kind.startswith("quantile-"):
        return "fractile", float(kind.removeprefix("quantile-"))
    return ("other", kind) if kind in ("max", "std") else ("curve", None)
