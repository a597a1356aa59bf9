"""Metadata table: one row a record, with what its files do not state."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NoReturn

import numpy as np

from toppling.models.errors import InputError
from toppling.models.files.documents import shown
from toppling.models.files.folder import path_named_in
from toppling.models.files.given import LONGEST_LINE_BYTES, open_given, text_of
from toppling.models.files.table import Table, is_numeral
from toppling.models.motions.formats.component import (
    TIME_STEPS_S,
    UP,
    Component,
    bearing,
    no_record,
    refuse_file,
)
from toppling.models.motions.formats.record_text import STEP_OFF
from toppling.models.motions.formats.response import SAME_GAIN
from toppling.models.motions.formats.units import counted_unit, known_names
from toppling.models.motions.stations import Triple, triple

_COLUMNS = {
    key: f"{key} {other_names}".split()
    for key, other_names in {
        "record_id": "rec_id",
        "event": "earthquake_name",
        "station": "station_name",
        "magnitude": "mag mw mag_mw magnitude_mw",
        "distance_km": "dist_km rrup_km rjb_km repi_km rhyp_km epicentral_distance_km",
        "h1": "horizontal-1_acc._filename",
        "h2": "horizontal-2_acc._filename",
        "v": "vertical_acc._filename",
        "unit": "units",
        "time_step_s": "dt dt_s",
        **dict.fromkeys(("processing", "corner_hz", "h1_azimuth", "h2_azimuth"), ""),
    }.items()
} | {key: [f"{key}_m_s2", key] for key in ("pga_h1", "pga_h2", "pga_v")}
"""Columns that are read, and the names that a table, or PEER's, may give them in any case."""

_UNCORRECTED = ("uncorrected", "raw")
"""How the column `processing` may begin, beside 'corrected'."""
_OFTEN_UNKNOWN = {"magnitude", "distance_km", "corner_hz", "h1_azimuth", "h2_azimuth"}
_UNKNOWN = {"nan", "na", "n/a", "none", "null", "unknown", "-", "?"}
_UNKNOWN_NUMBERS = {"-99", "-999", "-9999", "-12345"}
"""Values by which flat files and databases mark an unknown number."""
_MAGNITUDES, _DISTANCES_KM = (-2.0, 10.0), (0.0, 20_100.0)
"""Ranges of magnitudes of earthquakes, and of distances on the globe."""
_AZIMUTHS, _CORNERS_HZ = (-360.0, 360.0), (1e-4, 100.0)
_NO_PEAKS = (None, None, None)
_SAME_UNIT = 1e-3
"""Share by which two statements of one unit differ at most: g is 9.81 or 980 gal to some."""


@dataclass(frozen=True, slots=True)
class Entry:
    """Row of a metadata table: files of the components and what they lack; None or empty where the table lacks it too.

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
        return tuple(dict.fromkeys(path_named_in(self.table.parent, name) for name in self.names if name))

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
        head = text_of(file.read(LONGEST_LINE_BYTES)) or ""
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
        if key in _OFTEN_UNKNOWN and (bare.lower() in _UNKNOWN or bare.partition(".")[0] in _UNKNOWN_NUMBERS):
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


def rows_given(table: Sequence[Entry], files: Sequence[Path]) -> list[tuple[Entry, list[Path]]]:
    """Rows of the table with those of their files that are given.

    Raises InputError if there are rows, and none of them names a file that is given.
    """
    place = {path.resolve(): path for path in files}
    rows = [
        (entry, paths)
        for entry in table
        if (paths := [place[found] for file in entry.files if (found := file.resolve()) in place])
    ]
    if table and not rows:
        looked_for = table[0].files[0]
        table[0].refuse(
            "metadata.no_file_given",
            f"none of the {len(table)} rows of the metadata table names a file that is given:"
            f" the first looks for {looked_for}",
            "paths relative to the folder of the table",
            "give this file or its folder too, or correct its path in the table",
        )
    return rows


def channels_of_row(entry: Entry, here: Sequence[Path], channels: dict[Path, list[Component]]) -> Triple:
    """Channels of a metadata table's row, of whose files `here` were given, with what the row says of them.

    Raises InputError if a file that the row names was not given or not read, is named twice, or contradicts the
    row.
    """
    named = sum(map(bool, entry.names))
    if 1 < len(entry.files) < named:
        entry.refuse("metadata.file_repeated", f"the row names {len(entry.files)} files in {named} columns",
            "a file of its own for every component, or one file that holds all",
            "correct h1, h2 and v: two of them name the same file")  # fmt: skip
    given = {path.resolve(): path for path in here}
    parts: list[list[Component]] = []
    for file in entry.files:
        path = given.get(file.resolve())
        if path is None or path not in channels:
            entry.refuse(
                "metadata.file_not_given",
                f"{file} is not among the files given" if path is None else f"{path} could not be read",
                "every file that the row names",
                "give the file or its folder too" if path is None else "see what is said of this file",
            )
        parts.append(channels[path])
    together = (
        triple(parts[0]) if len(parts) == 1 else Triple(*(_single_channel(part, entry) for part in parts))
    )
    return _completed(together, entry)


def _single_channel(components: list[Component], entry: Entry) -> Component:
    if len(components) != 1:
        entry.refuse("metadata.several_channels", f"{components[0].path} holds {len(components)} channels",
            "one channel a file where h1, h2 and v are different files",
            "name the same file in h1, h2 and v")  # fmt: skip
    return components[0]


def _completed(channels: Triple, entry: Entry) -> Triple:
    """Channels with what the table says where the file is silent."""
    for name, component in zip(("h1", "h2", "v"), channels.channels, strict=False):
        _refuse_other_direction(name, component, entry)
        _refuse_other_unit(component, entry)

    def complete(component: Component, bearing: float | None) -> Component:
        values, known = component.acceleration_m_s2, component.unit_known
        if not known and entry.unit_m_s2 is not None:
            values, known = values * entry.unit_m_s2, True
        stated, warnings = component.direction, component.warnings
        if bearing is not None and isinstance(stated, float) and bearing % 360 != stated:
            by_file = f"{component.label or component.path.name} points to {stated:g} degrees by its file"
            warnings = (*warnings, f"{by_file}, to {bearing:g} by the table, which counts")
        return replace(
            component,
            warnings=warnings,
            acceleration_m_s2=values,
            unit_known=known,
            time_step_s=_step(component, entry),
            direction=float(bearing % 360) if bearing is not None else stated,
            corrected=entry.corrected if entry.corrected is not None else component.corrected,
        )

    vertical = channels.vertical
    if vertical is not None:
        vertical = complete(vertical, None)
        if not isinstance(vertical.direction, str):
            vertical = replace(vertical, direction=UP)
    first = complete(channels.first, entry.h1_azimuth_deg)
    completed = Triple(first, complete(channels.second, entry.h2_azimuth_deg), vertical)
    return completed if first.unit_known else _scaled_to_peaks(completed, entry)


def _refuse_other_direction(name: str, component: Component, entry: Entry) -> None:
    direction = component.direction
    if not isinstance(direction, float if name == "v" else str):
        return
    points = direction if isinstance(direction, str) else f"{direction:g} degrees from north"
    entry.refuse("metadata.direction_contradicted",
        f"the row names {component.path.name} in column {name}, and the file says that it points {points}",
        "two horizontals in h1 and h2, the vertical in v", "correct h1, h2 and v")  # fmt: skip


def _refuse_other_unit(component: Component, entry: Entry) -> None:
    by_name, by_row = component.stated_unit_m_s2, entry.unit_m_s2
    if by_name is None or by_row is None or math.isclose(by_name, by_row, rel_tol=_SAME_UNIT):
        return
    entry.refuse("record.unit_contradicted",
        f"the unit is {by_row:g} m/s2 by the row, and {by_name:g} m/s2 by {component.path.name}",
        "one unit of the samples",
        "correct the column 'unit', or leave it empty where the file states one")  # fmt: skip


def _scaled_to_peaks(channels: Triple, entry: Entry) -> Triple:
    """Counts, in a unit that nobody names: without their mean, scaled to the peaks that the table states.

    The channels of one instrument have nearly one sensitivity: the same scale of all shows that the peaks are
    those of these samples. Counts are as the instrument gave them, unless the table says otherwise.
    """
    parts, scales = channels.channels, []
    centred = [c.acceleration_m_s2 - c.acceleration_m_s2.mean() for c in parts]
    for values, peak in zip(centred, entry.peaks_m_s2, strict=False):
        about_mean = float(np.abs(values).max())
        if not peak or peak < 0 or about_mean == 0:
            return channels
        scales.append(peak / about_mean)
    if max(scales) > SAME_GAIN * min(scales):
        listed = ", ".join(f"{scale:.4g}" for scale in scales)
        entry.refuse("metadata.peaks_contradicted",
            f"the peaks that the table states scale the channels by {listed} m/s2",
            f"one scale within a factor of {SAME_GAIN:g}, as one instrument has",
            "state the samples' unit in the column 'unit', or give the StationXML")  # fmt: skip
    note = (
        "mean removed, scaled to the peaks of the metadata table,"
        f" {1 / np.mean(scales):.6g} counts per m/s2 on average"
    )
    scaled = [
        replace(
            component,
            acceleration_m_s2=values * scale,
            unit_known=True,
            corrected=bool(component.corrected),
            notes=(*component.notes, note),
        )
        for component, values, scale in zip(parts, centred, scales, strict=True)
    ]
    return Triple(*scaled)


def _step(component: Component, entry: Entry) -> float:
    """Time step by the file, or by the table where the file has no times."""
    by_file, by_row = component.time_step_s, entry.time_step_s
    if not math.isfinite(by_file):
        return by_row if by_row and by_row > 0 else math.nan
    if by_row and not math.isclose(by_file, by_row, rel_tol=STEP_OFF):
        entry.refuse("record.step_contradicted",
            f"the time step is {by_row:g} s by the row, and {by_file:g} s by {component.path.name}",
            "one time step of the samples",
            "correct the column 'dt' or the file, or leave 'dt' empty where the file states it")  # fmt: skip
    return by_file
