"""What a hazard file states, before files are put together to trees."""

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
from toppling.models.files.csv_text import is_numeral
from toppling.models.files.table import Table
from toppling.models.motions.formats.units import unit_of
from toppling.results.hazard.curves import HazardCurve, curve_of
from toppling.results.hazard.measure_names import measure_of, quantity_of
from toppling.results.hazard.places import Place, distance_km, of_name

_EXPECTED = (
    "CSV with the columns MEASURE,annual_rate or MEASURE,return_period or MEASURE,probability_50_years (MEASURE: "
    "pga_m_s2, pgv_m_s ..., PGA in g, PGV in cm/s, or with its unit, PGA (m/s2)); or curves of OpenQuake "
    "(hazard_curve, quantile_curve, realizations), nshmp-haz (curves.csv), CyberShake or OpenSHA, as they wrote them"
)
_POLE_DEG = 90.0
_EXPORT_AGAIN = "export one site's curve as annual rates of exceedance"


refused = refusals(expected=f"annual rates of exceedance: {_EXPECTED}", remedy=_EXPORT_AGAIN)


def refuse(code: str, path: Path, what: str, remedy: str = _EXPORT_AGAIN) -> NoReturn:
    """Refuse a file of hazard."""
    raise InputError(code, what, where=str(path), expected=refused("", "", "").expected, remedy=remedy)


@dataclass(frozen=True)
class Hints:
    """What the user says about files that do not say it."""

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
        """By its first sign, or its name: json, xml or text."""
        first = self.text.lstrip()[:1]
        if first in ("{", "[") or self.path.suffix == ".json":
            return "json"
        return "xml" if first == "<" else "text"

    @cached_property
    def lines(self) -> list[str]:
        """As they are."""
        return self.text.splitlines()

    @cached_property
    def table(self) -> Table:
        """Rows of columns."""
        return Table.of(self.lines, self.path)

    @property
    def rows(self) -> list[tuple[int, list[str]]]:
        """Rows below the names of columns, with the numbers of their lines, from 1."""
        return [(at + 1, row) for at, row in self.table.rows[1:]]

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
        named, said = {found[0] for found in map(measure_of, words + pairs) if found}, self.hints.measure
        if len(named) == 1 and said not in (None, *named):
            self.refuse("hazard.measures_differ", f"is named after {min(named)}, and --measure is {said}",
                "give the file of that measure, or another name if it is one")  # fmt: skip
        return min(named) if len(named) == 1 else said

    def factor_stated(self, measure: str, usual: float, unit_name: str) -> float:
        """What the unit of levels is in SI by its name in the file, the usual one where it has none."""
        unit = unit_of(unit_name) if unit_name else None
        if unit_name and (unit is None or unit.quantity != quantity_of(measure)):
            self.refuse("hazard.unit_unknown", f"states levels of {measure} in {unit_name!r}",
                "correct the unit, or the name of the measure")  # fmt: skip
        return unit.factor if unit else usual

    def years_of_values(self, stated: float | None, lacks: str, remedy: str) -> float:
        """Time that the values are probabilities over, 0 for annual rates.

        Refused if file and user say different times, or neither says any: what it lacks, and the remedy.
        """
        said = self.hints.years
        if stated is None:
            return self.refuse("hazard.time_missing", lacks, remedy) if said is None else said
        if said is None:
            return stated
        if not math.isclose(stated, said):
            mine, theirs = (
                f"probabilities over {years:g} years" if years else "annual rates" for years in (stated, said)
            )
            self.refuse("hazard.values_contradicted", f"states {mine}, and --values says {theirs}",
                "leave --values out")  # fmt: skip
        return stated

    def place_of(self, line: int, row: Sequence[str], header: Sequence[str]) -> Place:
        """Longitude and latitude of a row."""
        longitude, latitude = (self.number(line, row[header.index(name)]) for name in ("lon", "lat"))
        if abs(latitude) > _POLE_DEG:
            self.refuse("site.out_of_range", f"line {line}: the latitude is {latitude:g}",
                "exchange longitude and latitude")  # fmt: skip
        return longitude, latitude

    def wanted_rows(
        self, rows: Sequence[tuple[int, list[str]]], header: Sequence[str], name_column: str | None
    ) -> list[tuple[int, list[str]]]:
        """Rows of the site that is wanted, all where none is: of the name, or the nearest; the caller judges how near.

        name_column: holds the names of sites; None in a table that states no places.
        Refused if no site has the name, or rows are shorter than the header.
        """
        for line, row in rows:
            if len(row) != len(header):
                self.refuse("table.row_wrong_length",
                    f"line {line} has {len(row)} columns, the header {len(header)}")  # fmt: skip
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
