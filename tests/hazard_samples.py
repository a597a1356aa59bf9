"""Small files in the layouts of hazard programs, with numbers that can be checked by hand."""

import json
from pathlib import Path

import numpy as np

PLACES = ((0.5, -0.5), (0.85, -0.75))
WEIGHTS = (0.1, 0.2, 0.3, 0.4)
PATHS = ("AAA~AA", "AAA~AB", "AAB~AA", "AAB~AB")
LEVELS = np.geomspace(0.01, 10.0, 31)
RATE_AT_1 = 1e-6
"""Annual rate at which the first branch exceeds 1 g, or 1 cm/s, at the first place; it falls by the level's square."""

_BETWEEN = {0.05: (0, 0, 0.0), 0.16: (0, 1, 0.3), 0.5: (1, 2, 2 / 3), 0.84: (2, 3, 0.6), 0.95: (2, 3, 0.875)}
"""Branches between which a fractile lies, and how far: the weights add up to 0.1, 0.3, 0.6 and 1."""


def openquake_curves(path: Path, kind: str, imt: str, levels, rows, years: float = 50.0, **stated) -> Path:
    """OpenQuake's curves; rows are of a name, a place and probabilities, and more is stated in the first line."""
    head = f"generated_by='OpenQuake engine 3.20', kind='{kind}', investigation_time={years}, imt='{imt}'"
    head += "".join(f", {name}={value}" for name, value in stated.items())
    lines = [f'#,,,,"{head}"', "custom_site_id,lon,lat,depth," + ",".join(f"poe-{x:.7f}" for x in levels)]
    lines += [
        f"{name},{east},{north},0.0," + ",".join(f"{p:.6E}" for p in poes)
        for name, (east, north), poes in rows
    ]
    path.write_text("\n".join(lines) + "\n")
    return path


def realisations(folder: Path, weights, paths=PATHS, name="realizations.csv") -> None:
    rows = [f"{n},{path},{weight}" for n, (path, weight) in enumerate(zip(paths, weights, strict=False))]
    (folder / name).write_text("\n".join(["rlz_id,branch_path,weight", *rows]) + "\n")


def event_set(folder: Path, fields, catalogue, weights: dict, sites: dict, **stated) -> Path:
    """OpenQuake's event set: rows of motions under their header, and events of a branch and a year in sets.

    weights: by the path of their branch.
    stated: the time that a set lasts, and the number of sets.
    """
    folder.mkdir(exist_ok=True)
    line = "#,\"generated_by='OpenQuake engine 3.26.2', checksum=7{}\"\n"
    times = "".join(f", {name}={value}" for name, value in stated.items())
    branches = [f"{n},{path},{weight}" for n, (path, weight) in enumerate(weights.items())]
    tables = {
        "gmf-data": fields, "events": ["event_id,rup_id,rlz_id,year,ses_id", *catalogue],
        "ruptures": ["rup_id,multiplicity,mag", *(f"{n},1,6" for n in range(3))],
        "realizations": ["rlz_id,branch_path,weight", *branches],
        "sitemesh": ["custom_site_id,lon,lat", *(f"{name},{x},{y}" for name, (x, y) in sites.items())],
    }  # fmt: skip
    for name, rows in tables.items():
        head = line.format(times if name == "ruptures" else "")
        (folder / f"{name}_1.csv").write_text(head + "\n".join(rows) + "\n")
    return folder


def branch_poes(branch: int, place: int = 0):
    """Probabilities in 50 years: branches 0 to 3 have 1 to 4 times the rate, the second place twice the first's."""
    return -np.expm1(-50.0 * RATE_AT_1 * (branch + 1) * (place + 1) * LEVELS**-2.0)


def logic_tree(folder: Path) -> Path:
    """OpenQuake's output of four branches: PGA and PGV, and SA(1.0) of which the branches are not kept."""
    realisations(folder, [f"{weight:.7e}" for weight in WEIGHTS], name="realizations_6.csv")
    kinds = {f"rlz-{n:03}": [branch_poes(n, place) for place in (0, 1)] for n in range(4)}
    branches = np.array(list(kinds.values()))
    of_all = {"mean": np.tensordot(WEIGHTS, branches, 1)}
    for q, (low, high, share) in _BETWEEN.items():
        of_all[f"quantile-{q}"] = branches[low] + share * (branches[high] - branches[low])
    for imt in ("PGA", "PGV", "SA(1.0)"):
        for kind, poes in (of_all if imt == "SA(1.0)" else {**kinds, **of_all}).items():
            name = (
                kind.replace("quantile", "quantile_curve") if "quantile" in kind else f"hazard_curve-{kind}"
            )
            rows = list(zip(("a", "b"), PLACES, poes, strict=True))
            openquake_curves(folder / f"{name}-{imt}_6.csv", kind, imt, LEVELS, rows)
    return folder


NSHMP_RATES = {
    "curves": (0.06, 0.04, 0.01),
    "gmm/ASK_14": (0.036, 0.03, 0.008),
    "gmm/BSSA_14": (0.024, 0.01, 0.002),
}
"""Rates of the site One at 0.01, 0.05 and 0.2 g; the models' are multiplied by their weights."""


def nshmp_curves(path: Path, values) -> Path:
    """Curves of nshmp-haz at two sites, the second with half the values."""
    path.parent.mkdir(parents=True, exist_ok=True)
    rows = [f"{name},{east},0.0," + ",".join(f"{share * x:.8e}" for x in values)
            for name, east, share in (("Site One", -64.9, 1.0), ("Site Two", -65.1, 0.5))]  # fmt: skip
    path.write_text("\n".join(["name,lon,lat,0.01,0.05,0.2", *rows]) + "\n")
    return path


def nshmp_output(folder: Path, value_format: str) -> Path:
    """Output folder of nshmp-haz: totals and contributions over PGA, and the configuration."""
    for name, values in {**NSHMP_RATES, "source/FAULT": NSHMP_RATES["curves"]}.items():
        nshmp_curves(folder / "PGA" / (f"{name}.csv" if name == "curves" else f"{name}/curves.csv"), values)
    (folder / "config.json").write_text(json.dumps({"hazard": {"valueFormat": value_format}}))
    return folder


def service_answer(new: bool, label: str | None) -> dict:
    """The web service's answer for one site, as it was until 2021 and as it is since."""
    about = {"longitude": -118.1, "latitude": 34.2, **({"ylabel": label} if label else {})}
    levels, rates = [0.1, 0.2], {"Total": [1e-2, 1e-3], "Fault": [7e-3, 6e-4]}
    if new:
        data = [{"component": name, "values": {"xs": levels, "ys": ys}} for name, ys in rates.items()]
        curves = [{"imt": {"value": imt, "display": "?"}, "data": data} for imt in ("PGA", "SA0P2")]
        return {"request": about, "response": {"metadata": {"model": "CONUS_2018"}, "hazardCurves": curves}}
    data = [{"component": name, "yvalues": ys} for name, ys in rates.items()]
    return {
        "response": [
            {"metadata": {**about, "imt": imt, "xvalues": levels}, "data": data} for imt in ("PGA", "SA0P2")
        ]
    }
