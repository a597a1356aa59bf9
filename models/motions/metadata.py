"""The metadata table: what record files do not say, one row a record."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from toppling.models.errors import InputError
from toppling.models.files.csv_text import is_numeral
from toppling.models.files.documents import shown
from toppling.models.files.folder import named_beside
from toppling.models.files.given import open_given
from toppling.models.files.table import Table
from toppling.models.files.text_file import text_of
from toppling.models.motions.formats.component import TIME_STEPS_S, bearing, no_record, refuse_file
from toppling.models.motions.formats.units import counted_unit, known_names

_COLUMNS = {
    "record_id": ("record_id", "rec_id"),
    "event": ("event", "earthquake_name"),
    "station": ("station", "station_name"),
    "magnitude": ("magnitude", "mag", "mw", "mag_mw", "magnitude_mw"),
    "distance_km": (
        "distance_km",
        "dist_km",
        "rrup_km",
        "rjb_km",
        "repi_km",
        "rhyp_km",
        "epicentral_distance_km",
    ),
    "h1": ("h1", "horizontal-1_acc._filename"),
    "h2": ("h2", "horizontal-2_acc._filename"),
    "v": ("v", "vertical_acc._filename"),
    "unit": ("unit", "units"),
    "time_step_s": ("time_step_s", "dt", "dt_s"),
    "processing": ("processing",),
    "corner_hz": ("corner_hz",),
    "h1_azimuth": ("h1_azimuth",),
    "h2_azimuth": ("h2_azimuth",),
    "pga_h1": ("pga_h1_m_s2", "pga_h1"),
    "pga_h2": ("pga_h2_m_s2", "pga_h2"),
    "pga_v": ("pga_v_m_s2", "pga_v"),
}
"""What is read, and the names that a table, or PEER's, may give it in any case; other columns are left alone."""

_UNCORRECTED = ("uncorrected", "raw")
"""How the column `processing` may begin, beside 'corrected'."""
_OFTEN_UNKNOWN = {"magnitude", "distance_km", "corner_hz", "h1_azimuth", "h2_azimuth"}
_UNKNOWN = {"nan", "na", "n/a", "none", "null", "unknown", "-", "?"}
_UNKNOWN_NUMBERS = {"-99", "-999", "-9999", "-12345"}
"""What flat files and databases have where nobody knows."""
_MAGNITUDES, _DISTANCES_KM = (-2.0, 10.0), (0.0, 20_100.0)
"""Of earthquakes, and on the globe."""
_AZIMUTHS, _CORNERS_HZ = (-360.0, 360.0), (1e-4, 100.0)
_AROUND = re.compile(r"^M[A-Za-z]{0,2}\s*=?\s*(?=\d)|(?<!\s)\s*km$")
"""What people write beside a magnitude or a distance: Mw 6.9, 12 km."""
_NO_PEAKS = (None, None, None)
_LONGEST_HEADER = 100_000
_LONGEST_NAME, _LONGEST_PATH = 255, 2000
"""Bytes of a file's name, and of its path: file systems have no longer ones."""


@dataclass(frozen=True, slots=True)
class Entry:
    """One row: files of the components and what they do not say; None or empty where the table is silent too.

    There may be a hundred thousand, so a row keeps words, and makes paths of them when it is asked.

    `h1_azimuth_deg` and `h2_azimuth_deg` are compass bearings; `unit_m_s2` is one unit of the file in m/s2,
    `time_step_s` that of a file without times. `peaks_m_s2` are the components' peaks, by which samples of no known
    unit are scaled.
    """

    table: Path
    line: int
    names: tuple[str, str, str]  # of the files of h1, h2 and v, relative to the table's folder
    record_id: str
    event: str
    station: str
    magnitude: float | None
    distance_km: float | None
    unit_m_s2: float | None
    time_step_s: float | None
    corrected: bool | None
    corner_hz: float | None
    h1_azimuth_deg: float | None
    h2_azimuth_deg: float | None
    peaks_m_s2: tuple[float | None, ...] = _NO_PEAKS

    @property
    def where(self) -> str:
        """Table and line, as an error names them."""
        return f"{self.table}:{self.line}"

    @property
    def files(self) -> tuple[Path, ...]:
        """Files of the record, each once."""
        return tuple(dict.fromkeys(named_beside(self.table.parent, name) for name in self.names if name))

    def refuse(self, code: str, what: str, expected: str, remedy: str) -> NoReturn:
        """Refuse the row."""
        raise InputError(code, what, where=self.where, expected=expected, remedy=remedy)


def read_table(table: Path) -> list[Entry]:
    """Rows of a metadata table; paths are relative to the table's folder.

    The table may stand in a longer text, as PEER's search results do: it begins with the line that names the files'
    columns, and then ends at a blank line.

    Raises InputError if a column is missing, there is no row, a number is none, a unit is unknown, or two rows have one
    id: with the line.
    """
    file = Table.read(table)
    header = next((number for number, (_, cells) in enumerate(file.rows) if _names_files(cells)), None)
    if header is None:
        file.refuse("metadata.columns_missing", 0,
            f"no columns h1 and h2 among {shown(list(map(_name, file.names))[:8])}",
            "a CSV table with a header line and at least the columns h1, h2",
            "one row a record: h1,h2,v,unit,event,mag,dist_km,station")  # fmt: skip
    names, rows = list(map(_name, file.rows[header][1])), [*file.rows[header + 1 :]]
    if header > 0:
        blank = next(
            (n for n in range(file.rows[header][0], len(file.lines)) if not file.lines[n].strip(" ,;\t")),
            None,
        )
        rows = [(at, cells) for at, cells in rows if blank is None or at < blank]
    places = {
        key: [names.index(name) for name in spelled if name in names] for key, spelled in _COLUMNS.items()
    }
    del file
    rows.reverse()
    entries = []
    while rows:  # each row goes as its entry comes: a small file may hold a hundred thousand
        at, cells = rows.pop()
        entries.append(_entry(_Row.of(places, cells, f"{table}:{at + 1}"), table, at + 1))
    if not entries:
        remedy = "say what the files do not, or leave the table away"
        refuse_file("metadata.no_row", table, "a header and no row", "one row a record", remedy)
    seen: dict[str, Entry] = {}
    for entry in entries:
        if entry.record_id and entry.record_id in seen:
            what = f"record id {entry.record_id!r} is that of {seen[entry.record_id].where} too"
            entry.refuse("metadata.id_repeated", what, "one row a record", "give each row its own rec_id")
        seen[entry.record_id] = entry
    return entries


def looks_like_table(path: Path) -> bool:
    """Whether a CSV file has the columns of a metadata table."""
    with open_given(path, no_record) as file:
        head = text_of(file.read(_LONGEST_HEADER)) or ""
    lines = head.splitlines()
    headers = lines[:1] + [line for line in lines if "Acc. Filename" in line]
    return any(_names_files(Table.of([line], path).names) for line in headers)


def _names_files(cells: Sequence[str]) -> bool:
    """Whether a row has the names of the columns of both horizontal components' files."""
    names = set(map(_name, cells))
    return all(names.intersection(_COLUMNS[key]) for key in ("h1", "h2"))


def _name(name: str) -> str:
    """Name of a column in lower case, its unit behind it whatever parts them: `Dist (km)` is `dist_km`."""
    return re.sub(r"[\s_()\[\],]+", "_", name.strip(' \t"')).strip("_").casefold()


@dataclass(frozen=True)
class _Row:
    """Cells of a row by the keys of `_COLUMNS`, empty where there is none."""

    where: str
    cells: Mapping[str, str]

    @classmethod
    def of(cls, places: Mapping[str, Sequence[int]], cells: Sequence[str], where: str) -> "_Row":
        return cls(where, {
            key: next((cells[at] for at in columns if at < len(cells) and cells[at]), "")
            for key, columns in places.items()
        })  # fmt: skip

    def refuse(self, code: str, what: str, expected: str, remedy: str = "correct the table") -> NoReturn:
        raise InputError(code, what, where=self.where, expected=expected, remedy=remedy)

    def file(self, key: str) -> str:
        name = self.cells[key]
        if not name:
            self.refuse("metadata.file_missing", f"no file in column {key}", "a path", "name the file")
        size = len(name.encode())
        if size > _LONGEST_NAME and (
            size > _LONGEST_PATH or any(len(part.encode()) > _LONGEST_NAME for part in Path(name).parts)
        ):
            what = f"the file in column {key} is {shown(name)}, a name of {len(name)} characters"
            self.refuse("metadata.path_too_long", what, f"a path of names of at most {_LONGEST_NAME} bytes")
        return name

    def unit_m_s2(self) -> float | None:
        found = counted_unit(self.cells["unit"])
        if self.cells["unit"] and (found is None or found.quantity != "acceleration"):
            self.refuse("record.unit_unknown",
                f"unit {shown(self.cells['unit'])}" + (f" is one of {found.quantity}" if found else ""),
                f"acceleration in one of {known_names()}, or a factor and one of them",
                "name the unit of the samples")  # fmt: skip
        return found.factor if found else None

    def corrected(self) -> bool | None:
        """Whether the agency has corrected the record; None where nobody says."""
        processing = self.cells["processing"].lower()
        if processing and not processing.startswith(("corrected", *_UNCORRECTED)):
            self.refuse(
                "metadata.processing_unknown",
                f"processing {self.cells['processing']!r}",
                f"corrected, {', '.join(_UNCORRECTED)}, or nothing where it is not known",
                "say whether baseline and filter were done by the agency: what is uncorrected is corrected here",
            )
        return processing.startswith("corrected") if processing else None

    def azimuth(self, key: str) -> float | None:
        """Compass bearing, as a number or in letters: E, NS, N45E."""
        named = bearing(self.cells[key])
        return named if isinstance(named, float) else self.number(key, _AZIMUTHS)

    def number(self, key: str, limits: tuple[float, float] = (-1e9, 1e9)) -> float | None:
        if not (bare := self.cells[key]):
            return None
        if key in _OFTEN_UNKNOWN:
            bare = _AROUND.sub("", bare)
            if bare.lower() in _UNKNOWN or bare.partition(".")[0] in _UNKNOWN_NUMBERS:
                return None
        value = float(bare) if is_numeral(bare) else math.nan
        if not limits[0] <= value <= limits[1]:
            expected = f"a number from {limits[0]:g} to {limits[1]:g}, or nothing"
            self.refuse("metadata.value_unreadable", f"{key} is {shown(self.cells[key])}", expected)
        return value


def _entry(row: _Row, table: Path, line: int) -> Entry:
    peaks = row.number("pga_h1"), row.number("pga_h2"), row.number("pga_v")
    return Entry(
        table=table,
        line=line,
        names=(row.file("h1"), row.file("h2"), row.file("v") if row.cells["v"] else ""),
        unit_m_s2=row.unit_m_s2(),
        corrected=row.corrected(),
        record_id=row.cells["record_id"],
        event=row.cells["event"],
        station=row.cells["station"],
        magnitude=row.number("magnitude", _MAGNITUDES),
        distance_km=row.number("distance_km", _DISTANCES_KM),
        time_step_s=row.number("time_step_s", TIME_STEPS_S),
        corner_hz=row.number("corner_hz", _CORNERS_HZ),
        h1_azimuth_deg=row.azimuth("h1_azimuth"),
        h2_azimuth_deg=row.azimuth("h2_azimuth"),
        peaks_m_s2=peaks if any(peaks) else _NO_PEAKS,
    )
