"""From files to records: read, group, prepare, leave out duplicates. What cannot be used is named."""

import logging
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import chain, takewhile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import correlate

from toppling.models.errors import InputError
from toppling.models.files.given import open_given
from toppling.models.frames import apart_deg
from toppling.models.motions.formats import read_file
from toppling.models.motions.formats.component import Component, no_record, refuse_file
from toppling.models.motions.formats.response import is_station_xml, responses
from toppling.models.motions.metadata import Entry, channels_of_row, looks_like_table, rows_given
from toppling.models.motions.motion import Motion
from toppling.models.motions.place import BOREHOLE, Place
from toppling.models.motions.processing import DRIFTS, drifts, process, resample
from toppling.models.motions.quality import check_apart, check_samples, warnings_of
from toppling.models.motions.record import Record
from toppling.models.motions.stations import SAME_SHAKING_S, Triple, grouped, oriented, triple

_log = logging.getLogger(__name__)

_LEFT = {
    "corrected": "left as the agency corrected it",
    "sound": "left as it came",
    "uncorrected": "left uncorrected, as asked",
}
"""History entry of a motion that is not processed, by its quality."""


@dataclass(frozen=True)
class ImportOptions:
    """Options of an import of records."""

    missing_vertical: bool = False  # allow records without a vertical component
    # Allow records beyond 5 g, clipped, with a spike or with a gap filled by a constant.
    doubtful: bool = False
    # None processes what is uncorrected, and what drifts where nobody says; True all, False none.
    process: bool | None = None
    corner_hz: float | None = None  # corner of the high-pass; None chooses one by record
    place: str = "free-field"  # or any: records of boreholes and structures too
    time_step_s: float | None = None  # time step that every record is resampled to; None leaves each its own
    folders_apart: bool = False  # folders are places: the same shaking in two of them is two records


_LIKE_PEAKS = 0.1
"""Records whose PGA and PGV differ by more than this share are not compared sample by sample."""
_LIKE_SHAPE = 0.97
"""Correlation of the horizontal vectors' lengths from which two records are one."""
_COMPARED_STEP_S = 0.02
"""Time step at which they are compared."""


@dataclass(frozen=True)
class Shaking:
    """Identity of a record's shaking; empty or None where it is not stated."""

    table_event: str  # event by the metadata table
    # By the header.
    event: str
    station: str
    series: str
    start_s: float | None  # time of the first sample, seconds since 1970

    def is_that_of(self, other: "Shaking") -> bool:
        """Whether the names alone show that the two are one.

        One name is often that of a foreshock too: where table and header both name the events, both must agree, and
        records that know when they begin begin together.
        """
        at_same_place = bool(self.station) and (self.station, self.series) == (other.station, other.series)
        events = [(self.table_event, other.table_event), (self.event, other.event)]
        known = [pair for pair in events if all(pair)]
        together = (
            self.start_s is None
            or other.start_s is None
            or abs(self.start_s - other.start_s) <= SAME_SHAKING_S
        )
        return at_same_place and together and bool(known) and all(a == b for a, b in known)


@dataclass(frozen=True, eq=False)
class Candidate:
    """A record on its way into an ensemble."""

    record: Record
    shaking: Shaking
    corrected: bool
    warnings: tuple[str, ...] = ()  # what the user should know of it


def _prepared(name: str, channels: Triple, options: ImportOptions, entry: Entry | None) -> Candidate:
    """Record of three channels, on its way into an ensemble; the table's row is read before the files' headers."""
    _refuse_incomplete(channels, options)
    if not options.doubtful:
        for component in channels.channels:
            check_samples(component)
        check_apart(channels.channels)
    motion, azimuths, oriented_how = oriented(channels)
    by_file = [component.corrected for component in channels.channels]
    corrected = False if False in by_file else None if None in by_file else True  # None where nobody says
    of_table = entry.corner_hz if entry else None
    corner_hz = of_table if options.corner_hz is None else options.corner_hz
    motion, quality, done = _processed(motion, corrected, options.process, corner_hz)
    if options.time_step_s and abs(options.time_step_s / motion.time_step_s - 1) > 1e-9:
        done.append(f"resampled from {motion.time_step_s:g} to {options.time_step_s:g} s, low-passed before")
        motion = resample(motion, options.time_step_s)
    first = channels.first

    def stated(field: str) -> Any:
        """Value of the table's row, else of the header."""
        by_row = getattr(entry, field, None)
        return getattr(first, field) if by_row in (None, "") else by_row

    warnings = tuple(dict.fromkeys(text for c in channels.channels for text in c.warnings))
    record = Record.of(
        name,
        motion,
        component_azimuths_deg=azimuths,
        history=[
            f"read as {first.file_format}",
            *dict.fromkeys(note for c in channels.channels for note in (*c.notes, *c.warnings)),
            *oriented_how,
            *done,
        ],
        files=dict.fromkeys(str(c.path) for c in channels.channels),
        components=len(channels.channels),
        quality=quality,
        place=first.place,
        **{field: stated(field) for field in ("event", "station", "magnitude", "distance_km")},
    )
    by_table = entry.event.lower() if entry else ""
    shaking = Shaking(by_table, first.event.lower(), first.station.lower(), first.series, first.start_s)
    unit = first.stated_unit_m_s2 or (entry.unit_m_s2 if entry else None)
    baseline = quality not in {"uncorrected", "drifting"}
    measures = {**record.intensity}
    if azimuths is not None:
        measures["between_horizontals_deg"] = float(apart_deg(*azimuths))
    if quality == "drifting":
        warnings += ("its displacement still drifts after processing: its PGV is unreliable",)
    stated_deg = [c.direction for c in channels.channels[:2] if isinstance(c.direction, float)]
    if azimuths is None and stated_deg:
        warnings += (f"the azimuth {stated_deg[0]:g} of one horizontal counts only with that of the other",)
    found = (*warnings, *warnings_of(measures, unit, baseline))
    return Candidate(record, shaking, bool(corrected), found)


def _refuse_incomplete(channels: Triple, options: ImportOptions) -> None:
    for component in channels.channels:
        if not math.isfinite(component.time_step_s):
            component.refuse("record.step_missing", "the file does not say its time step",
                "a column of times, or the time step in the metadata table",
                "give a metadata table with the column 'dt' (--metadata)")  # fmt: skip
        if not component.unit_known:
            raise component.no_unit or InputError(
                "record.unit_unknown",
                "the file does not say in which unit its samples are",
                where=component.where,
                expected="a unit, or for counts an instrument response",
                remedy="give its StationXML too, or a metadata table with the column 'unit' (--metadata)",
            )
    if channels.vertical is None and not options.missing_vertical:
        channels.first.refuse("record.vertical_missing", "there is no vertical component", "three components",
            "give the vertical's file, or allow it with --missing-vertical")  # fmt: skip


def _refuse_elsewhere(group: Sequence[Component], options: ImportOptions) -> None:
    """Refuse channels that are not of the free field, unless those of any place are asked for."""
    elsewhere = {c.path: c.place for c in group if not c.place.free_field}
    if elsewhere and options.place != "any":
        raise InputError(
            "record.not_free_field",
            "; ".join(dict.fromkeys(map(str, elsewhere.values()))),
            where=", ".join(map(str, elsewhere)),
            expected="a sensor in the free field, which records the ground's motion",
            remedy="leave it out, or import it with --place any",
        )


def _processed(
    motion: Motion, corrected: bool | None, asked: bool | None, corner_hz: float | None
) -> tuple[Motion, str, list[str]]:
    """Motion, processed if it is asked for or needed, its quality, and what was found and done."""
    quality, steps = "corrected" if corrected else "uncorrected", []
    if corrected is None:
        quality, found = ("uncorrected", "drifts") if drifts(motion) else ("sound", "is sound")
        steps.append(f"no file states whether it was corrected: its displacement {found}")
    if asked if asked is not None else quality == "uncorrected":
        motion, done = process(motion, corner_hz)
        return motion, "drifting" if any(DRIFTS in step for step in done) else "processed", [*steps, *done]
    return motion, quality, [*steps, _LEFT[quality]]


_NO_RECORDS = {".md", ".ini", ".json", ".parquet", ".toml", ".py", ".pdf", ".png"}
"""Suffixes of what lies beside records in a folder and is none; a file given by name is always read."""


@dataclass(frozen=True)
class Refusal:
    """Something that was left out, and why."""

    subject: str
    reason: InputError


@dataclass
class Import:
    """Outcome of an import.

    `unused_rows` of the metadata table name no file that was given; `warnings` are of records that were read, by id.
    """

    records: list[Record] = field(default_factory=list)
    refusals: list[Refusal] = field(default_factory=list)
    unused_rows: int = 0
    warnings: list[tuple[str, str]] = field(default_factory=list)


def record_files(paths: Iterable[Path]) -> list[Path]:
    """Files that may hold records: those given, and all in the folders given, in a fixed order.

    Raises InputError if a path does not exist, or nothing in the folders can be a record.
    """
    found: dict[Path, None] = {}
    paths = list(paths)
    for path in paths:
        if not path.exists():
            refuse_file("file.absent", path, "there is no such file or folder", "records", "check the path")
        if path.is_dir():
            found |= dict.fromkeys(file for file in sorted(path.rglob("*")) if _may_be_record(file, path))
        else:
            found[path] = None
    if paths and not found:
        raise InputError(
            "record.none_found",
            "no file here can be a record",
            where=", ".join(map(str, paths)),
            expected="accelerograms: files of an agency, SAC, miniSEED, or tables of time and acceleration",
            remedy="give another folder; a file given by its name is read whatever that ends in",
        )
    return list(found)


def _may_be_record(file: Path, folder: Path) -> bool:
    hidden = any(part.startswith(".") for part in file.relative_to(folder).parts)
    if hidden or not file.is_file() or file.suffix.lower() in _NO_RECORDS:
        return False
    return not (file.suffix.lower() == ".csv" and looks_like_table(file))


def import_records(
    files: Sequence[Path],
    table: Sequence[Entry] = (),
    options: ImportOptions | None = None,
    advance: Callable[[int], None] = lambda _: None,
) -> Import:
    """Read files into records.

    files: as from :func:`record_files`.
    table: rows of a metadata table; rows none of whose files are given are passed over and counted.
    advance: called with the number of files that were read, and again when they have become records.
    Returns records with ids that are unique, and refusals.
    Raises InputError if there are rows of a metadata table and none of them names a file that is given.
    """
    options = options or ImportOptions()
    rows = rows_given(table, files)
    outcome = Import(unused_rows=len(table) - len(rows))
    channels = _read_files(files, outcome, advance)
    found: list[Candidate] = []
    used: set[Path] = set()
    for entry, here in rows:
        used.update(here)
        with _noting(entry.record_id or entry.where, outcome):
            together = channels_of_row(entry, here, channels)
            _refuse_elsewhere(together.channels, options)
            name = entry.record_id or _name(together.channels)
            found.append(_prepared(name, together, options, entry))
        advance(len(here))
    rest = [c for path, components in channels.items() if path not in used for c in components]
    for group in grouped(rest):
        name = _name(group)
        with _noting(name, outcome):
            _refuse_elsewhere(group, options)
            found.append(_prepared(name, triple(group), options, None))
        advance(len({component.path for component in group}))
    unique = _without_duplicates(found, outcome, options.folders_apart)
    outcome.records.extend(_with_unique_ids([candidate.record for candidate in unique]))
    for record, candidate in zip(outcome.records, unique, strict=True):
        outcome.warnings.extend((record.record_id, text) for text in candidate.warnings)
    return outcome


@contextmanager
def _noting(subject: str, outcome: Import) -> Iterator[None]:
    try:
        yield
    except InputError as error:
        _log.info("left out %s: %s", subject, error.brief)
        outcome.refusals.append(Refusal(subject, error))


def _read_files(
    files: Sequence[Path], outcome: Import, advance: Callable[[int], None]
) -> dict[Path, list[Component]]:
    """Channels by file, of the files that can be read; StationXML among them gives the responses."""
    station_xml = [path for path in files if is_station_xml(_head(path))]
    inventory = None
    for path in station_xml:
        with _noting(str(path), outcome):
            found = responses(path)
            inventory = found if inventory is None else inventory + found
    channels: dict[Path, list[Component]] = {}
    for path in files:
        if path not in station_xml:
            with _noting(str(path), outcome):
                channels[path] = read_file(path, inventory)
        advance(1)
    return _with_depths(channels)


def _with_depths(channels: dict[Path, list[Component]]) -> dict[Path, list[Component]]:
    """Channels of boreholes with their depth, where one at the surface of the same station states its elevation too."""
    every = [c for components in channels.values() for c in components if c.elevation_m is not None]
    surface_m = {(c.file_format, c.station): c.elevation_m for c in every if c.place.free_field}

    def with_depth(part: Component) -> Component:
        top_m = surface_m.get((part.file_format, part.station))
        if (
            part.place != BOREHOLE
            or top_m is None
            or part.elevation_m is None
            or not top_m > part.elevation_m
        ):
            return part
        return replace(part, place=Place(round(top_m - part.elevation_m, 3)))

    return {path: list(map(with_depth, components)) for path, components in channels.items()}


def _head(path: Path) -> str:
    try:
        with open_given(path, no_record) as file:
            return file.read(2000).decode("utf-8", errors="replace")
    except InputError:  # which its reader says
        return ""


def _name(group: Sequence[Component]) -> str:
    """Name a record without a table by what the names of its files have in common."""
    stems = list(dict.fromkeys(c.path.stem for c in group))
    shared = takewhile(lambda letters: len(set(letters)) == 1, zip(*stems, strict=False))
    common = "".join(letters[0] for letters in shared).rstrip("._- ") or stems[0]
    stations = {c.station for c in group}
    if len(stems) == 1 and len(group) > 3:
        return f"{common}-{stations.pop()}" if len(stations) == 1 else common
    return common


def _without_duplicates(found: list[Candidate], outcome: Import, folders_apart: bool) -> list[Candidate]:
    """Keep candidates of which no two, or no two of a folder, are one record."""
    left_out = set()
    places: dict[Path | None, list[Candidate]] = {}
    for candidate in found:
        places.setdefault(Path(candidate.record.files[0]).parent if folders_apart else None, []).append(
            candidate
        )
    for first, duplicate in chain.from_iterable(map(_duplicates, places.values())):
        left_out.add(id(duplicate))
        error = InputError(
            "record.given_twice",
            f"the same shaking as {first.record.record_id} ({', '.join(first.record.files)})",
            where=", ".join(duplicate.record.files),
            expected="one set of files a record",
            remedy="leave one of the two out",
        )
        outcome.refusals.append(Refusal(duplicate.record.record_id, error))
    return [candidate for candidate in found if id(candidate) not in left_out]


def _with_unique_ids(records: list[Record]) -> list[Record]:
    count: dict[str, int] = {}
    unique = []
    for record in records:
        number = count[record.record_id] = count.get(record.record_id, 0) + 1
        unique.append(record if number == 1 else replace(record, record_id=f"{record.record_id}-{number}"))
    return unique


def _duplicates(candidates: Sequence[Candidate]) -> Iterator[tuple[Candidate, Candidate]]:
    """Pairs (kept, left out): of two records that are one, the corrected is kept, else the first."""
    out: set[int] = set()
    ordered = sorted(range(len(candidates)), key=lambda i: (not candidates[i].corrected, i))
    for place, i in enumerate(ordered):
        if i in out:
            continue
        for j in ordered[place + 1 :]:
            if j not in out and _are_same(candidates[i], candidates[j]):
                out.add(j)
                yield candidates[i], candidates[j]


def _are_same(a: Candidate, b: Candidate) -> bool:
    if a.shaking.is_that_of(b.shaking):
        return True
    for name in ("pga_m_s2", "pgv_m_s"):
        if abs(np.log(b.record.intensity[name] / a.record.intensity[name])) > _LIKE_PEAKS:
            return False
    x, y = _length(a.record), _length(b.record)
    likeness = correlate(x, y, method="fft").max() / np.sqrt((x @ x) * (y @ y))
    return bool(likeness > _LIKE_SHAPE)


def _length(record: Record) -> NDArray[np.float64]:
    """Length of the horizontal vector on a common step: the same whichever way the instrument was set up.

    Means over the step are as good as a resampling to distinguish records, at any ratio of the steps.
    """
    time = np.arange(np.ceil(record.motion.duration_s / _COMPARED_STEP_S) + 1) * _COMPARED_STEP_S
    horizontal = record.motion.mean_between(time)[:, :2]
    return np.hypot(horizontal[:, 0], horizontal[:, 1])
