"""Content of hazard files, assembled: trees by measure and site, and trees of several paths to one."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any, NoReturn

from numpy.typing import ArrayLike

from toppling.models.errors import InputError, refusals
from toppling.models.files.documents import listed
from toppling.models.files.table import Table, is_numeral
from toppling.models.motions.formats.units import unit_of
from toppling.results.hazard.measure_names import measure_of, quantity_of
from toppling.results.hazard.places import Place, distance_km, nearest, of_name, same_place
from toppling.results.hazard.tree import Branch, HazardCurve, HazardTree, curve_of

_EXPECTED = (
    "CSV with the columns MEASURE,annual_rate or MEASURE,return_period or MEASURE,probability_50_years (MEASURE: "
    "pga_m_s2, pgv_m_s ..., or with its unit, PGA (g), PGV (cm/s)); or curves of OpenQuake "
    "(hazard_curve, quantile_curve, realizations), nshmp-haz (curves.csv), CyberShake or OpenSHA, as they wrote them"
)
HEAD_LINES = 30
"""Number of first lines of a file that are searched for its header."""
_EXPORT_AGAIN = "export one site's curve as annual rates of exceedance"


refused = refusals(expected=f"annual rates of exceedance: {_EXPECTED}", remedy=_EXPORT_AGAIN)


def refuse(code: str, path: Path, what: str, remedy: str = _EXPORT_AGAIN) -> NoReturn:
    """Refuse a file of hazard."""
    raise InputError(code, what, where=str(path), expected=refused("", "", "").expected, remedy=remedy)


@dataclass(frozen=True)
class Hints:
    """User's statements about files that lack them."""

    site: Place | str | None = None  # (longitude, latitude): only this site of each file is read
    measure: str | None = None  # column of the results that a file is over which does not say
    # Time that values are probabilities over, in files that do not say; 0 for annual rates.
    years: float | None = None


@dataclass(frozen=True)
class HazardFile:
    """A file of hazard, or its beginning, as dialects look at it."""

    path: Path
    text: str
    hints: Hints = Hints()

    @property
    def kind(self) -> str:
        """By its first sign, or its name: json or text."""
        return "json" if self.text.lstrip()[:1] in ("{", "[") or self.path.suffix == ".json" else "text"

    @cached_property
    def lines(self) -> list[str]:
        """Lines of the file, unchanged."""
        return self.text.splitlines()

    @cached_property
    def table(self) -> Table:
        """Rows of columns."""
        return Table.of(self.lines, self.path)

    @property
    def rows(self) -> list[tuple[int, list[str]]]:
        """Rows below the names of columns, with the numbers of their lines, from 1; refused where one is not whole."""
        return [(at + 1, row) for at, row in self.table.whole_rows(refused)]

    @property
    def first_line(self) -> str:
        """The line above the columns that a program states what they are of in; a spreadsheet may have quoted it."""
        line = self.lines[0]
        quoted = line.startswith('"#') and line.endswith('"')
        return line[1:-1].replace('""', '"') if quoted else line if line.startswith("#") else ""

    def refuse(self, code: str, what: str, remedy: str = _EXPORT_AGAIN) -> NoReturn:
        """Refuse the file."""
        refuse(code, self.path, what, remedy)

    def number(self, line: int, text: str, *, endless: bool = False) -> float:
        """Number of a cell, finite unless it may be endless; 1D-3 is Fortran's 1e-3."""
        plain = text.lower().replace("d", "e")
        value = float(plain) if is_numeral(plain) else math.nan
        if not (math.isfinite(value) or (endless and value > 0)):
            self.refuse("hazard.number_unreadable", f"line {line}: {text[:40]!r} is no number")
        return value

    def measure_named(self, imt: str, remedy: str = "give curves over PGA, PGV or SA") -> tuple[str, float]:
        """Column of a measure by the file's name of it, and what its unit is in SI; refused if it is no column."""
        return measure_of(imt) or self.refuse(
            "measure.unknown", f"is over {imt!r}, which is no measure known here", remedy
        )

    @property
    def measure_elsewhere(self) -> str | None:
        """Measure that the file's name states, or else the user; refused if they differ."""
        words = re.split(r"[\s_-]+", self.path.stem)
        pairs = [f"{first} {second}" for first, second in pairwise(words)]  # of SA and its period
        named, hinted = {found[0] for found in map(measure_of, words + pairs) if found}, self.hints.measure
        if len(named) == 1 and hinted not in (None, *named):
            self.refuse("hazard.measures_differ", f"is named after {min(named)}, and --measure is {hinted}",
                "give the file of that measure, or another name if it is one")  # fmt: skip
        return min(named) if len(named) == 1 else hinted

    def factor_stated(self, measure: str, usual: float, unit_name: str) -> float:
        """Unit of levels in SI by its name in the file, the usual one where it has none."""
        unit = unit_of(unit_name) if unit_name else None
        if unit_name and (unit is None or unit.quantity != quantity_of(measure)):
            self.refuse("hazard.unit_unknown", f"states levels of {measure} in {unit_name!r}",
                "correct the unit, or the name of the measure")  # fmt: skip
        return unit.factor if unit else usual

    def years_of_values(self, stated: float | None, lacks: str, remedy: str) -> float:
        """Time that the values are probabilities over, 0 for annual rates.

        Refused if file and user say different times, or neither says any: what it lacks, and the remedy.
        """
        hinted = self.hints.years
        if stated is None:
            return self.refuse("hazard.time_missing", lacks, remedy) if hinted is None else hinted
        if hinted is None:
            return stated
        if not math.isclose(stated, hinted):
            mine, theirs = (
                f"probabilities over {years:g} years" if years else "annual rates"
                for years in (stated, hinted)
            )
            self.refuse("hazard.values_contradicted", f"states {mine}, and --values says {theirs}",
                "leave --values out")  # fmt: skip
        return stated

    def place_of(self, line: int, row: Sequence[str], header: Sequence[str]) -> Place:
        """Longitude and latitude of a row."""
        longitude, latitude = (self.number(line, row[header.index(name)]) for name in ("lon", "lat"))
        if not -90 <= latitude <= 90:
            self.refuse("site.out_of_range", f"line {line}: the latitude is {latitude:g}",
                "exchange longitude and latitude")  # fmt: skip
        return longitude, latitude

    def wanted_rows(
        self, rows: Sequence[tuple[int, list[str]]], header: Sequence[str], name_column: str | None
    ) -> list[tuple[int, list[str]]]:
        """Rows of the site that is wanted, all where none is: of the name, or the nearest; the caller judges how near.

        name_column: holds the names of sites; None in a table that states no places.
        Refused if no site has the name.
        """
        site = self.hints.site
        if site is None or name_column is None or not rows:
            return list(rows)
        if isinstance(site, str):
            names = [row[header.index(name_column)] for _, row in rows] if name_column in header else []
            return [rows[number] for number in of_name(names, site, str(self.path))]
        if "lon" not in header:
            return list(rows)
        places = [self.place_of(line, row, header) for line, row in rows]
        away = distance_km([place[0] for place in places], [place[1] for place in places], site)
        return [rows[int(away.argmin())]]

    def curve(
        self, measure: str, levels: ArrayLike, values: ArrayLike, years: float, name: str = "", **stated: Any
    ) -> HazardCurve:
        """Curve of what the file states, by the file's name if it has none of its own (:func:`curve_of`)."""
        return curve_of(
            name or self.path.stem, measure, levels, values, years, source=str(self.path), **stated
        )


@dataclass(frozen=True, eq=False)
class Statement:
    """A curve of a file, and which one of a calculation it is."""

    curve: HazardCurve
    # curve (a mean, a total, or the only one), realisation, fractile, or part (a contribution to the total).
    kind: str = "curve"
    key: float | str | None = None  # number of the realisation, probability of the fractile, name of the part
    calculation: str = ""  # what tells calculations apart, where a file says: OpenQuake's checksum
    weight: float | None = None  # of a realisation, where its own file states it
    path: str = ""  # of such a realisation: LEVEL=CHOICE for each level of the tree, with ~ between


@dataclass(frozen=True)
class Realisations:
    """Weights of a logic tree's branches."""

    source: str  # file
    weights: dict[int, float]
    paths: dict[int, str]


Stated = list[Statement] | Realisations


def trees_of(stated: Sequence[Stated], where: str) -> list[HazardTree]:
    """Trees of the statements of one calculation, by measure and site.

    Raises InputError if realisations lack their weights or the weights their realisations, a curve is there twice,
    or fractiles or contributions stand alone.
    """
    weights = [statement for statement in stated if isinstance(statement, Realisations)]
    if len(weights) > 1:
        _refuse("hazard.several_calculations", where,
            f"holds the realisations of {len(weights)} calculations: {listed([w.source for w in weights])}",
            "give the folder of one calculation")  # fmt: skip
    groups: dict[tuple, list[Statement]] = {}
    for files in stated:
        for statement in [] if isinstance(files, Realisations) else files:
            curve = statement.curve
            at = tuple(round(degree, 4) for degree in curve.site) if curve.site else curve.site_name
            groups.setdefault((curve.measure, at), []).append(statement)
    if not groups:
        _refuse("hazard.curves_missing", where, "states weights of realisations, but no curve",
            "give the hazard_curve-rlz files too")  # fmt: skip
    trees = [_tree(group, weights[0] if weights else None, where) for group in groups.values()]
    found = [tree for tree in trees if tree is not None]
    if not found:
        _refuse_alone([statement for group in groups.values() for statement in group], where)
    if not any(_bears_rates(tree) for tree in found):
        _refuse_empty(found[0])
    return found


def _tree(group: Sequence[Statement], weights: Realisations | None, where: str) -> HazardTree | None:
    """Tree of the statements of one measure at one site; None where they are no branches."""
    measure = group[0].curve.measure
    by_kind: dict[str, list[Statement]] = {}
    for statement in group:
        by_kind.setdefault(statement.kind, []).append(statement)
    for kind, several in by_kind.items():
        _refuse_twice(kind, several, where)
    fractiles = {float(statement.key or 0): statement.curve for statement in by_kind.get("fractile", ())}
    parts = tuple(statement.curve for statement in by_kind.get("part", ()))
    realisations = by_kind.get("realisation", [])
    own = {int(statement.key or 0): statement for statement in realisations if statement.weight is not None}
    if own and weights is None:
        stated = {n: float(statement.weight or 0.0) for n, statement in own.items()}
        paths = {n: statement.path for n, statement in own.items()}
        weights = Realisations(realisations[0].curve.source, stated, paths)
    if len(realisations) > 1 or (realisations and weights):
        branches = _branches(realisations, weights, where)
        return HazardTree(measure, branches, str(weights and weights.source), fractiles, parts)
    sole = [*by_kind.get("curve", []), *realisations]
    if not sole:
        return None
    curve = sole[0].curve
    return HazardTree(measure, (Branch(curve.name, 1.0, curve),), "one curve", fractiles, parts)


def _branches(
    realisations: Sequence[Statement], weights: Realisations | None, where: str
) -> tuple[Branch, ...]:
    if weights is None:
        _refuse("hazard.weights_missing", where,
            f"holds {len(realisations)} realisations, but no realizations.csv that states their weights",
            "add the engine's realizations.csv, or give each file as --hazard FILE=WEIGHT")  # fmt: skip
    by_number = {int(statement.key or 0): statement.curve for statement in realisations}
    if absent := [n for n, weight in weights.weights.items() if weight > 0 and n not in by_number]:
        curve = realisations[0].curve
        at = f" at longitude {curve.site[0]:g}, latitude {curve.site[1]:g}" if curve.site else ""
        _refuse("hazard.realisations_missing", weights.source,
            f"has {len(weights.weights)} realisations, of which {len(absent)} have no curve over "
            f"{curve.measure}{at}: {listed([f'rlz-{n:03}' for n in absent])}",
            "give the files of all realisations at one site (individual_rlzs = true)")  # fmt: skip
    if unknown := [n for n in by_number if n not in weights.weights]:
        _refuse("hazard.weights_incomplete", weights.source,
            f"states no weight of {listed([f'rlz-{n:03}' for n in unknown])}",
            "give the realizations.csv of the same calculation")  # fmt: skip
    if not all(0 <= weight <= 1 for weight in weights.weights.values()):
        _refuse("hazard.weight_unusable", weights.source, "states weights outside 0 to 1",
            "give weights that sum to 1")  # fmt: skip
    return tuple(
        Branch(f"rlz-{n:03}", weights.weights[n], by_number[n], weights.paths[n], n)
        for n in sorted(by_number)
    )


def _refuse_twice(kind: str, several: Sequence[Statement], where: str) -> None:
    """Refuse two curves that claim to be one: files of two calculations, or a site that is there twice."""
    keys = [statement.key for statement in several]
    if len(set(keys)) < len(keys):
        key = next(key for key in keys if keys.count(key) > 1)
        alike = [statement.curve.source for statement in several if statement.key == key]
        which = kind if key is None else f"{kind} {key}"
        _refuse("hazard.curve_repeated", where,
            f"states the {which} of {several[0].curve.measure} at one site {len(alike)} times: "
            f"{listed(alike)}", "give the files of one calculation, each once")  # fmt: skip
    calculations = {statement.calculation for statement in several if statement.calculation}
    if kind == "realisation" and len(calculations) > 1:
        _refuse("hazard.several_calculations", where,
            f"holds realisations of {len(calculations)} calculations, by the checksum in their first line",
            "give the files of one calculation")  # fmt: skip


def _refuse_alone(group: Sequence[Statement], where: str) -> NoReturn:
    kinds = {statement.kind for statement in group}
    if "fractile" in kinds:
        _refuse("hazard.fractiles_only", where,
            "states fractiles only: these are no branches, and cannot be weighted",
            "give the mean curve, or the realisations with their weights")  # fmt: skip
    if "part" in kinds:
        _refuse("hazard.contribution_only", where,
            "is a contribution to the hazard, already multiplied by its weight, and no branch",
            "give the total, or the output's whole folder")  # fmt: skip
    _refuse("hazard.branch_alone", where, f"states the {group[0].key} of branches",
        "give the mean curve, or the realisations")  # fmt: skip


def combined(
    parts: Sequence[Sequence[HazardTree]], names: Sequence[str], weights: Sequence[float] | None
) -> list[HazardTree]:
    """Join trees, whose branches become those of a single tree, by measure and site.

    Raises InputError if they have no measure in common, or lie at different sites.
    """
    measures = [sorted({tree.measure for tree in part}) for part in parts]
    common = sorted(set.intersection(*map(set, measures)))
    if not common:
        _refuse("hazard.several_measures", "--hazard",
            f"hazard curves over {', '.join(sorted({m for of in measures for m in of}))}",
            "give the curves of one intensity measure", "one measure")  # fmt: skip
    part_weights = list(weights) if weights is not None else [1.0 / len(parts)] * len(parts)
    found = []
    for measure in common:
        of_measure = [[tree for tree in part if tree.measure == measure] for part in parts]
        for first in of_measure[0]:
            alike = [[tree for tree in part if _same_site(tree, first)] for part in of_measure]
            if all(len(matching) == 1 for matching in alike):
                found.append(
                    _joined([matching[0] for matching in alike], names, part_weights, weights is not None)
                )
    if not found:
        places = [f"{name} at {_place_words(part[0])}" for name, part in zip(names, parts, strict=True)]
        _refuse("site.several", "--hazard", f"the curves are of different sites: {listed(places)}",
            "give curves of one site, or choose it with --site LON LAT", "branches of one site")  # fmt: skip
    return found


def _same_site(first: HazardTree, second: HazardTree) -> bool:
    if first.site is None and second.site is None and first.site_name and second.site_name:
        return first.site_name == second.site_name
    return same_place(first.site, second.site)


def _joined(
    trees: Sequence[HazardTree], names: Sequence[str], part_weights: Sequence[float], stated: bool
) -> HazardTree:
    stems = [
        tree.branches[0].curve.name if len(tree.branches) == 1 else name
        for tree, name in zip(trees, names, strict=True)
    ]
    heads = stems if len(set(stems)) == len(stems) else list(names)
    branches = []
    for tree, head, share in zip(trees, heads, part_weights, strict=True):
        for branch, part in zip(tree.branches, tree.weights, strict=True):
            name = head if len(tree.branches) == 1 else f"{head} {branch.name}"
            branches.append(Branch(name, float(share * part), branch.curve, branch.path))
    return HazardTree(trees[0].measure, tuple(branches), "--hazard" if stated else "equal")


def chosen_tree(
    trees: Sequence[HazardTree], measure: str, site: Place | str | None, where: str
) -> HazardTree:
    """The tree of a measure at the site that is meant.

    Raises InputError if there is none over the measure, none within reach of the site, or several sites and none is
    asked for.
    """
    of_measure = [tree for tree in trees if tree.measure == measure]
    if not of_measure:
        _refuse("hazard.measure_other", where,
            f"hazard curves over {', '.join(sorted({tree.measure for tree in trees}))}, but none over "
            f"{measure}", "give the curves of that measure, or another --measure", "one measure")  # fmt: skip
    if isinstance(site, tuple):
        placed = [tree for tree in of_measure if tree.site is not None]
        if placed:
            of_measure = [placed[nearest([tree.site for tree in placed if tree.site], site, where)]]
    if isinstance(site, str):
        of_measure = [
            of_measure[n] for n in of_name([statement.site_name for statement in of_measure], site, where)
        ]
    if len(of_measure) > 1:
        _refuse("site.several", where,
            f"has {len(of_measure)} sites: {listed([_place_words(tree) for tree in of_measure])}",
            "choose one with --site LONGITUDE LATITUDE, or by its name", "one site")  # fmt: skip
    if not _bears_rates(of_measure[0]):
        _refuse_empty(of_measure[0])
    return of_measure[0]


def _bears_rates(tree: HazardTree) -> bool:
    return any(len(curve.intensity) > 1 for curve in tree.curves)


def _refuse_empty(tree: HazardTree) -> NoReturn:
    where = tree.curves[0].source or tree.curves[0].name
    _refuse("hazard.too_few_levels", where, f"has fewer than two levels with a rate at {_place_words(tree)}",
            "compute the curve at more levels, from where the rock hardly topples to where it always does")  # fmt: skip


def _place_words(tree: HazardTree) -> str:
    place = f"longitude {tree.site[0]:g} latitude {tree.site[1]:g}" if tree.site else ""
    if tree.site_name and place:
        return f"{tree.site_name} ({place})"
    return tree.site_name or place or "an unknown place"


def _refuse(
    code: str,
    where: str,
    what: str,
    remedy: str,
    expected: str = "annual rates of exceedance of one tree at each site",
) -> NoReturn:
    raise InputError(code, what, where=where, expected=expected, remedy=remedy)
