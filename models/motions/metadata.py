"""The metadata table: what record files do not say, one row a record."""

import io
import math
import re
from dataclasses import dataclass
from pathlib import Path

from toppling.models.errors import InputError
from toppling.models.files.csv_text import separator_of
from toppling.models.files.documents import LARGEST_CSV_BYTES, check_size, csv_rows, shown
from toppling.models.files.folder import named_beside
from toppling.models.files.markup import table_text
from toppling.models.motions.formats.component import TIME_STEPS_S, bearing
from toppling.models.motions.formats.units import counted_unit, known_names

_COLUMNS = {
    "record_id": ("record_id", "rec_id"),
    "event": ("event",),
    "station": ("station",),
    "magnitude": ("magnitude", "mag"),
    "distance_km": ("distance_km", "dist_km"),
    "h1": ("h1",),
    "h2": ("h2",),
    "v": ("v",),
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
"""What is read, and the names that a table may give it, in any case; other columns are left alone."""


_WORDS = {"record_id", "event", "station", "h1", "h2", "v", "processing"}
"""Columns that hold no number."""
_UNCORRECTED = ("uncorrected", "raw")
"""How the column `processing` may begin, beside 'corrected'."""
_OFTEN_UNKNOWN = {"magnitude", "distance_km"}
_UNKNOWN = {"nan", "na", "n/a", "none", "null", "unknown", "-", "?"}
_UNKNOWN_NUMBERS = {"-99", "-999", "-9999", "-12345"}
"""What flat files and databases have where nobody knows."""
_MAGNITUDES, _DISTANCES_KM = (-2.0, 10.0), (0.0, 20_100.0)
"""Of earthquakes, and on the globe."""
_AROUND = re.compile(r"^M[A-Za-z]{0,2}\s*=?\s*(?=\d)|\s*km$")
"""What people write beside a magnitude or a distance: Mw 6.9, 12 km."""
_LONGEST_HEADER = 100_000
_LONGEST_NAME, _LONGEST_PATH = 255, 2000
"""Bytes of a file's name, and of its path: file systems have no longer ones."""


@dataclass(frozen=True)
class Entry:
    """One row: files of the components and what they do not say; None or empty where the table is silent too.

    `h1_azimuth_deg` and `h2_azimuth_deg` are compass bearings; `unit_m_s2` is one unit of the file in m/s2,
    `time_step_s` that of a file without times. `peaks_m_s2` are the components' peaks, by which samples of no known
    unit are scaled.
    """

    where: str
    record_id: str
    event: str
    station: str
    magnitude: float | None
    distance_km: float | None
    h1: Path
    h2: Path
    v: Path | None
    unit_m_s2: float | None
    time_step_s: float | None
    corrected: bool | None
    corner_hz: float | None
    h1_azimuth_deg: float | None
    h2_azimuth_deg: float | None
    peaks_m_s2: tuple[float | None, float | None, float | None] = (None, None, None)

    @property
    def files(self) -> tuple[Path, ...]:
        """Files of the record, each once."""
        return tuple(dict.fromkeys(path for path in (self.h1, self.h2, self.v) if path is not None))


def read_table(table: Path) -> list[Entry]:
    """Rows of a metadata table; paths are relative to the table's folder.

    Raises
    ------
    InputError
        If a column is missing, there is no row, a number is none, a unit is unknown, or two rows have one id: with
        the line.
    """
    with text_table(table) as file:
        head = file.readline(_LONGEST_HEADER)
        delimiter = separator_of(head)
        file.seek(0)
        named = [(line, _by_names(row)) for line, row in csv_rows(file, table, delimiter)]
        names = _names(head) if not named else list(named[0][1])
    if "h1" not in names or "h2" not in names:
        raise InputError(
            f"no columns h1 and h2 among {shown(names[:8])}",
            where=f"{table}:1",
            expected="a CSV table with a header line and at least the columns h1, h2",
            remedy="one row a record: h1,h2,v,unit,event,mag,dist_km,station",
        )
    entries = [_entry(row, table, line, delimiter != ",") for line, row in named if any(row.values())]
    if not entries:
        raise InputError(
            "a header and no row",
            where=str(table),
            expected="one row a record",
            remedy="say what the files do not, or leave the table away",
        )
    seen: dict[str, str] = {}
    for entry in entries:
        if entry.record_id and entry.record_id in seen:
            raise InputError(
                f"record id {entry.record_id!r} is that of {seen[entry.record_id]} too",
                where=entry.where,
                expected="one row a record",
                remedy="give each row its own rec_id",
            )
        seen[entry.record_id] = entry.where
    return entries


def text_table(table: Path) -> io.StringIO:
    """Open a CSV table, whole in memory, without what fills it up behind its end.

    Raises InputError if it is not in UTF-8, nor UTF-16 that says so, or holds a zero: with the line.
    """
    check_size(table, LARGEST_CSV_BYTES, "CSV")
    content = table.read_bytes()
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        content = content.decode("utf-16", errors="replace").encode()
    content = content.rstrip(b"\0\x1a \t\r\n") + b"\n"
    if b"\0" in content:
        raise InputError(
            "a zero byte",
            where=f"{table}:{content[: content.index(0)].count(10) + 1}",
            expected="a CSV table in UTF-8",
            remedy="save the table again",
        )
    try:
        return io.StringIO(table_text(content.decode("utf-8-sig")), newline="")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise InputError(
            f"the byte {content[error.start : error.start + 1]!r} is not UTF-8",
            where=f"{table}:{line}",
            expected="a CSV table in UTF-8",
            remedy="save it as 'CSV UTF-8', or convert it: iconv -f latin1 -t utf-8",
        ) from None


def looks_like_table(path: Path) -> bool:
    """Whether a CSV file has the columns of a metadata table."""
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        head = file.readline(_LONGEST_HEADER)
    return {"h1", "h2"} <= set(_names(head))


def _names(head: str) -> list[str]:
    """Names of a header's columns, as `_COLUMNS` spells them."""
    return [_name(name) for name in head.strip().split(separator_of(head))]


def _name(name: str) -> str:
    return name.strip(' \t"').casefold()


def _by_names(row: dict[str, str]) -> dict[str, str]:
    return {_name(name): cell for name, cell in row.items()}


def _entry(row: dict[str, str], table: Path, line: int, decimal_comma: bool) -> Entry:
    where = f"{table}:{line}"
    text = {key: next((row[n].strip() for n in names if row.get(n)), "") for key, names in _COLUMNS.items()}
    if decimal_comma:
        text |= {key: text[key].replace(",", ".") for key in text if key not in _WORDS}
    for key in ("h1", "h2"):
        if not text[key]:
            raise InputError(
                f"no file in column {key}", where=where, expected="a path", remedy="name the file"
            )
    for key in ("h1", "h2", "v"):
        if len(text[key].encode()) > _LONGEST_PATH or any(
            len(p.encode()) > _LONGEST_NAME for p in Path(text[key]).parts
        ):
            raise InputError(
                f"the file in column {key} is {shown(text[key])}, a name of {len(text[key])} characters",
                where=where,
                expected=f"a path of names of at most {_LONGEST_NAME} bytes",
                remedy="correct the table",
            )
    found = counted_unit(text["unit"])
    unit = found.factor if found and found.quantity == "acceleration" else None
    if text["unit"] and unit is None:
        raise InputError(
            f"unit {shown(text['unit'])}" + (f" is one of {found.quantity}" if found else ""),
            where=where,
            expected=f"acceleration in one of {known_names()}, or a factor and one of them",
            remedy="name the unit of the samples",
        )
    processing = text["processing"].lower()
    if processing and not processing.startswith(("corrected", *_UNCORRECTED)):
        raise InputError(
            f"processing {text['processing']!r}",
            where=where,
            expected=f"corrected, {', '.join(_UNCORRECTED)}, or nothing where it is not known",
            remedy="say whether baseline and filter were done by the agency: what is uncorrected is corrected here",
        )
    return Entry(
        where=where,
        record_id=text["record_id"],
        event=text["event"],
        station=text["station"],
        magnitude=_number(text, "magnitude", where, _MAGNITUDES),
        distance_km=_number(text, "distance_km", where, _DISTANCES_KM),
        h1=named_beside(table.parent, text["h1"]),
        h2=named_beside(table.parent, text["h2"]),
        v=named_beside(table.parent, text["v"]) if text["v"] else None,
        unit_m_s2=unit,
        time_step_s=_number(text, "time_step_s", where, TIME_STEPS_S),
        corrected=None if not processing else processing.startswith("corrected"),
        corner_hz=_number(text, "corner_hz", where),
        h1_azimuth_deg=_azimuth(text, "h1_azimuth", where),
        h2_azimuth_deg=_azimuth(text, "h2_azimuth", where),
        peaks_m_s2=(
            _number(text, "pga_h1", where),
            _number(text, "pga_h2", where),
            _number(text, "pga_v", where),
        ),
    )


def _azimuth(text: dict[str, str], key: str, where: str) -> float | None:
    """Compass bearing, as a number or in letters: E, NS, N45E."""
    named = bearing(text[key])
    return named if isinstance(named, float) else _number(text, key, where)


def _number(
    text: dict[str, str], key: str, where: str, limits: tuple[float, float] = (-1e9, 1e9)
) -> float | None:
    if not (bare := text[key]):
        return None
    if key in _OFTEN_UNKNOWN:
        bare = _AROUND.sub("", bare)
        if bare.lower() in _UNKNOWN or bare.partition(".")[0] in _UNKNOWN_NUMBERS:
            return None
    try:
        value = float(bare)
    except ValueError:
        value = math.nan
    if not limits[0] <= value <= limits[1]:
        raise InputError(
            f"{key} is {shown(text[key])}",
            where=where,
            expected=f"a number from {limits[0]:g} to {limits[1]:g}, or nothing",
            remedy="correct the table",
        )
    return value
