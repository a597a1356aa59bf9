"""From files to records: read, group, orient, doubt, process. What cannot be used is named."""

import logging
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from toppling.models.errors import InputError
from toppling.models.motions.formats import read_file
from toppling.models.motions.formats.component import UP, Component
from toppling.models.motions.formats.response import is_station_xml, responses
from toppling.models.motions.metadata import Entry, looks_like_table
from toppling.models.motions.motion import Motion
from toppling.models.motions.processing import DRIFTS, drifts, process, resample
from toppling.models.motions.quality import doubts
from toppling.models.motions.record import Record
from toppling.models.motions.stations import Triple, grouped, oriented, triple
from toppling.models.motions.twins import Candidate, Shaking, twins

logger = logging.getLogger(__name__)

SAME_INSTRUMENT = 1.25
"""Factor within which the sensitivities of one instrument's channels lie."""

SAME_UNIT = 1e-3
"""Share by which two statements of one unit differ at most: g is 9.81 or 980 gal to some."""

LEFT = {
    "corrected": "left as the agency corrected it",
    "sound": "left as it came",
    "uncorrected": "left uncorrected, as asked",
}
"""What the history says of a motion that is not processed, by its quality."""

NO_RECORDS = {".md", ".json", ".parquet", ".toml", ".py", ".pdf", ".png"}
"""Suffixes of what lies beside records in a folder and is none; a file given by name is always read."""


@dataclass(frozen=True)
class Wishes:
    """What the user allows and asks for.

    Parameters
    ----------
    missing_vertical : bool
        Allow records without a vertical component.
    doubtful : bool
        Allow records beyond 5 g, clipped, with a spike or with a gap filled by a constant.
    process : bool or None
        None processes what is uncorrected, and what drifts where nobody says; True all, False none.
    corner_hz : float or None
        Corner of the high-pass; None chooses one by record.
    time_step_s : float or None
        Time step that every record is resampled to; None leaves each its own.
    """

    missing_vertical: bool = False
    doubtful: bool = False
    process: bool | None = None
    corner_hz: float | None = None
    time_step_s: float | None = None


@dataclass(frozen=True)
class Refusal:
    """Something that was left out, and why."""

    subject: str
    reason: InputError


@dataclass
class Import:
    """Outcome of an import; `unused_rows` of the metadata table name no file that was given."""

    records: list[Record] = field(default_factory=list)
    refusals: list[Refusal] = field(default_factory=list)
    unused_rows: int = 0


def record_files(paths: Iterable[Path]) -> list[Path]:
    """Files that may hold records: those given, and all in the folders given, in a fixed order.

    Raises
    ------
    InputError
        If a path does not exist.
    """
    found: dict[Path, None] = {}
    for path in paths:
        if not path.exists():
            raise InputError(
                "there is no such file or folder",
                where=str(path),
                expected="records",
                remedy="check the path",
            )
        if path.is_dir():
            found.update(
                dict.fromkeys(file for file in sorted(path.rglob("*")) if _may_be_record(file, path))
            )
        else:
            found[path] = None
    return list(found)


def _may_be_record(file: Path, folder: Path) -> bool:
    hidden = any(part.startswith(".") for part in file.relative_to(folder).parts)
    if hidden or not file.is_file() or file.suffix.lower() in NO_RECORDS:
        return False
    return not (file.suffix.lower() == ".csv" and looks_like_table(file))


def import_records(
    files: Sequence[Path],
    table: Sequence[Entry] = (),
    wishes: Wishes | None = None,
    advance: Callable[[int], None] = lambda _: None,
) -> Import:
    """Read files into records.

    Parameters
    ----------
    files : sequence of Path
        As from :func:`record_files`.
    table : sequence of Entry
        Rows of a metadata table; rows none of whose files are given are passed over and counted.
    wishes : Wishes
    advance : callable
        Called with the number of files that were read, and again when they have become records.

    Returns
    -------
    Import
        Records with ids that are unique, and refusals.

    Raises
    ------
    InputError
        If there are rows of a metadata table and none of them names a file that is given.
    """
    wishes = wishes or Wishes()
    rows = _rows_of(table, files)
    outcome = Import(unused_rows=len(table) - len(rows))
    channels = _read_files(files, outcome, advance)
    found: list[Candidate] = []
    used: set[Path] = set()
    for entry, here in rows:
        used.update(here)
        with _noting(entry.record_id or entry.where, outcome):
            found.append(_by_row(entry, here, channels, wishes))
        advance(len(here))
    rest = [c for path, components in channels.items() if path not in used for c in components]
    for group in grouped(rest):
        name = _name(group)
        with _noting(name, outcome):
            found.append(_candidate(name, triple(group), wishes, None))
        advance(len({component.path for component in group}))
    outcome.records.extend(_without_twins(found, outcome))
    _make_ids_unique(outcome.records)
    return outcome


def _rows_of(table: Sequence[Entry], files: Sequence[Path]) -> list[tuple[Entry, list[Path]]]:
    """Rows of the table with those of their files that are given."""
    place = {path.resolve(): path for path in files}
    here = [(entry, [place[p.resolve()] for p in entry.files if p.resolve() in place]) for entry in table]
    rows = [(entry, paths) for entry, paths in here if paths]
    if table and not rows:
        looked_for = table[0].h1
        raise InputError(
            f"none of the {len(table)} rows of the metadata table names a file that is given:"
            f" the first looks for {looked_for}",
            where=table[0].where,
            expected="paths relative to the folder of the table",
            remedy="give this file or its folder too"
            if looked_for.exists()
            else "correct the paths in the table",
        )
    return rows


@contextmanager
def _noting(subject: str, outcome: Import) -> Iterator[None]:
    """Note what cannot be used and go on."""
    try:
        yield
    except InputError as error:
        logger.info("left out %s: %s", subject, error.what)
        outcome.refusals.append(Refusal(subject, error))


def _read_files(
    files: Sequence[Path], outcome: Import, advance: Callable[[int], None]
) -> dict[Path, list[Component]]:
    """Channels by file, of the files that can be read; StationXML among them gives the responses."""
    station_xml = [path for path in files if is_station_xml(_head(path))]
    inventory = None
    if station_xml:
        with _noting("StationXML", outcome):
            inventory = responses(station_xml)
    channels: dict[Path, list[Component]] = {}
    for path in files:
        if path not in station_xml:
            with _noting(str(path), outcome):
                channels[path] = read_file(path, inventory)
        advance(1)
    return channels


def _head(path: Path) -> str:
    if not path.is_file():  # whoever opens a pipe waits for its writer
        return ""
    with path.open("rb") as file:
        return file.read(2000).decode("utf-8", errors="replace")


def _by_row(
    entry: Entry, here: Sequence[Path], channels: dict[Path, list[Component]], wishes: Wishes
) -> Candidate:
    """Record of a metadata table's row, of whose files `here` were given."""
    named = 2 + (entry.v is not None)
    if 1 < len(entry.files) < named:
        raise InputError(
            f"the row names {len(entry.files)} files in {named} columns",
            where=entry.where,
            expected="a file of its own for every component, or one file that holds all",
            remedy="correct h1, h2 and v: two of them name the same file",
        )
    given = {path.resolve(): path for path in here}
    parts: list[list[Component]] = []
    for file in entry.files:
        path = given.get(file.resolve())
        if path is None or path not in channels:
            raise InputError(
                f"{file} is not among the files given" if path is None else f"{path} could not be read",
                where=entry.where,
                expected="every file that the row names",
                remedy="give the file or its folder too" if path is None else "see what is said of this file",
            )
        parts.append(channels[path])
    if len(parts) == 1:
        together = triple(parts[0])
    else:
        single = [_one(components, entry) for components in parts]
        together = Triple(single[0], single[1], single[2] if entry.v else None)
    return _candidate(entry.record_id or _name(together.channels), _completed(together, entry), wishes, entry)


def _one(components: list[Component], entry: Entry) -> Component:
    if len(components) != 1:
        raise InputError(
            f"{components[0].path} holds {len(components)} channels",
            where=entry.where,
            expected="one channel a file where h1, h2 and v are different files",
            remedy="name the same file in h1, h2 and v",
        )
    return components[0]


def _completed(channels: Triple, entry: Entry) -> Triple:
    """Channels with what the table says where the file is silent.

    Raises
    ------
    InputError
        If the table contradicts a header: a vertical as h1 or h2, a horizontal as v, another unit.
    """
    _refuse_contradictions(channels, entry)

    def complete(component: Component, bearing: float | None) -> Component:
        values = component.acceleration_m_s2
        known = component.unit_known
        if not known and entry.unit_m_s2 is not None:
            values, known = values * entry.unit_m_s2, True
        return replace(
            component,
            acceleration_m_s2=values,
            unit_known=known,
            time_step_s=_step(component, entry),
            direction=float(bearing % 360) if bearing is not None else component.direction,
            corrected=entry.corrected if entry.corrected is not None else component.corrected,
        )

    vertical = channels.vertical
    if vertical is not None:
        vertical = complete(vertical, None)
        if not isinstance(vertical.direction, str):
            vertical = replace(vertical, direction=UP)
    completed = Triple(
        complete(channels.first, entry.h1_azimuth_deg),
        complete(channels.second, entry.h2_azimuth_deg),
        vertical,
    )
    return completed if completed.first.unit_known else _scaled_to_peaks(completed, entry)


def _refuse_contradictions(channels: Triple, entry: Entry) -> None:
    for name, component in zip(("h1", "h2", "v"), channels.channels, strict=False):
        _refuse_other_direction(name, component, entry)
        _refuse_other_unit(component, entry)


def _refuse_other_direction(name: str, component: Component, entry: Entry) -> None:
    direction = component.direction
    if not isinstance(direction, float if name == "v" else str):
        return
    points = direction if isinstance(direction, str) else f"{direction:g} degrees from north"
    raise InputError(
        f"the row names {component.path.name} in column {name}, and the file says that it points {points}",
        where=entry.where,
        expected="two horizontals in h1 and h2, the vertical in v",
        remedy="correct h1, h2 and v",
    )


def _refuse_other_unit(component: Component, entry: Entry) -> None:
    by_name, by_row = component.stated_unit_m_s2, entry.unit_m_s2
    if by_name is None or by_row is None or math.isclose(by_name, by_row, rel_tol=SAME_UNIT):
        return
    raise InputError(
        f"the unit is {by_row:g} m/s2 by the row, and {by_name:g} m/s2 by the names in {component.path.name}",
        where=entry.where,
        expected="one unit of the samples",
        remedy="correct the column 'unit', or the names of the file's columns",
    )


def _scaled_to_peaks(channels: Triple, entry: Entry) -> Triple:
    """Counts, in a unit that nobody names: without their mean, scaled to the peaks that the table states.

    The channels of one instrument have nearly one sensitivity: the same scale of all shows that the peaks are
    those of these samples. Counts are as the instrument gave them, unless the table says otherwise.

    Raises
    ------
    InputError
        If the scales differ, by which the peaks are of other samples.
    """
    parts = [channels.first, channels.second, *([channels.vertical] if channels.vertical else [])]
    scales = []
    for component, peak in zip(parts, entry.peaks_m_s2, strict=False):
        about_mean = float(np.abs(component.acceleration_m_s2 - component.acceleration_m_s2.mean()).max())
        if not peak or peak < 0 or about_mean == 0:
            return channels
        scales.append(peak / about_mean)
    if max(scales) > SAME_INSTRUMENT * min(scales):
        told = ", ".join(f"{scale:.4g}" for scale in scales)
        raise InputError(
            f"the peaks that the table states scale the channels by {told} m/s2",
            where=entry.where,
            expected=f"one scale within a factor of {SAME_INSTRUMENT:g}, as one instrument has",
            remedy="state the samples' unit in the column 'unit', or give the StationXML",
        )
    note = (
        "mean removed, scaled to the peaks of the metadata table,"
        f" {1 / np.mean(scales):.6g} counts per m/s2 on average"
    )
    scaled = [
        replace(
            component,
            acceleration_m_s2=(component.acceleration_m_s2 - component.acceleration_m_s2.mean()) * scale,
            unit_known=True,
            corrected=bool(component.corrected),
            notes=(*component.notes, note),
        )
        for component, scale in zip(parts, scales, strict=True)
    ]
    return Triple(scaled[0], scaled[1], scaled[2] if channels.vertical else None)


def _step(component: Component, entry: Entry) -> float:
    """Time step by the file, or by the table where the file has no times."""
    if math.isfinite(component.time_step_s):
        return component.time_step_s
    return entry.time_step_s if entry.time_step_s and entry.time_step_s > 0 else math.nan


def _candidate(name: str, channels: Triple, wishes: Wishes, entry: Entry | None) -> Candidate:
    first = channels.first
    for component in channels.channels:
        if not math.isfinite(component.time_step_s):
            raise InputError(
                "the file does not say its time step",
                where=component.where,
                expected="a column of times, or the time step in the metadata table",
                remedy="give a metadata table with the column 'dt' (--metadata)",
            )
        if not component.unit_known:
            raise component.no_unit or InputError(
                "the file does not say in which unit its samples are",
                where=component.where,
                expected="a unit, or for counts an instrument response",
                remedy="give its StationXML too, or a metadata table with the column 'unit' (--metadata)",
            )
    if channels.vertical is None and not wishes.missing_vertical:
        raise InputError(
            "there is no vertical component",
            where=first.where,
            expected="three components",
            remedy="give the vertical's file, or allow it with --missing-vertical",
        )
    if not wishes.doubtful:
        for component in channels.channels:
            doubts(component)
    motion, azimuths, history = oriented(channels)
    steps = [
        f"read as {first.file_format}",
        *dict.fromkeys(n for c in channels.channels for n in (*c.notes, *c.warnings)),
        *history,
    ]
    corrected = _corrected(channels)
    motion, quality, done = _processed(motion, corrected, wishes.process, _corner_hz(wishes, entry))
    steps.extend(done)
    if wishes.time_step_s and abs(wishes.time_step_s / motion.time_step_s - 1) > 1e-9:
        steps.append(f"resampled from {motion.time_step_s:g} to {wishes.time_step_s:g} s, low-passed before")
        motion = resample(motion, wishes.time_step_s)
    says = entry.magnitude if entry else None, entry.distance_km if entry else None
    record = Record.of(
        name,
        motion,
        event=(entry.event if entry else "") or first.event,
        station=(entry.station if entry else "") or first.station,
        magnitude=says[0] if says[0] is not None else first.magnitude,
        distance_km=says[1] if says[1] is not None else first.distance_km,
        component_azimuths_deg=azimuths,
        history=steps,
        files=dict.fromkeys(str(c.path) for c in channels.channels),
        components=len(channels.channels),
        quality=quality,
    )
    told = entry.event if entry else ""
    shaking = Shaking(told.lower(), first.event.lower(), first.station.lower(), first.series, first.start_s)
    return Candidate(record, shaking, bool(corrected))


def _corner_hz(wishes: Wishes, entry: Entry | None) -> float | None:
    """High-pass corner by the option, then by the table; None to choose one."""
    if wishes.corner_hz is not None:
        return wishes.corner_hz
    return entry.corner_hz if entry else None


def _corrected(channels: Triple) -> bool | None:
    """Whether the agency has corrected all channels; None if nobody says."""
    said = [component.corrected for component in channels.channels]
    return False if False in said else None if None in said else True


def _processed(
    motion: Motion, corrected: bool | None, wish: bool | None, corner_hz: float | None
) -> tuple[Motion, str, list[str]]:
    """Motion, processed if it is wished or needed, its quality, and what was found and done."""
    quality, steps = "corrected" if corrected else "uncorrected", []
    if corrected is None:
        drifting = drifts(motion)
        quality = "uncorrected" if drifting else "sound"
        steps.append(
            f"nobody says if it was corrected: its displacement {'drifts' if drifting else 'is sound'}"
        )
    if wish if wish is not None else quality == "uncorrected":
        motion, done = process(motion, corner_hz)
        return motion, "drifting" if any(DRIFTS in step for step in done) else "processed", [*steps, *done]
    return motion, quality, [*steps, LEFT[quality]]


def _name(group: Sequence[Component]) -> str:
    """Name a record without a table by what the names of its files have in common."""
    stems = list(dict.fromkeys(c.path.stem for c in group))
    common = stems[0]
    for stem in stems[1:]:
        while not stem.startswith(common):
            common = common[:-1]
    common = common.rstrip("._- ") or stems[0]
    stations = {c.station for c in group}
    if len(stems) == 1 and len(group) > 3:
        return f"{common}-{stations.pop()}" if len(stations) == 1 else common
    return common


def _without_twins(found: list[Candidate], outcome: Import) -> list[Record]:
    """Keep records of which no two are one."""
    left_out = set()
    for kept, twin in twins(found):
        left_out.add(id(twin))
        error = InputError(
            f"the same shaking as {kept.record.record_id} ({', '.join(kept.record.files)})",
            where=", ".join(twin.record.files),
            expected="one set of files a record",
            remedy="leave one of the two out",
        )
        outcome.refusals.append(Refusal(twin.record.record_id, error))
    return [candidate.record for candidate in found if id(candidate) not in left_out]


def _make_ids_unique(records: list[Record]) -> None:
    count: dict[str, int] = {}
    for index, record in enumerate(records):
        count[record.record_id] = count.get(record.record_id, 0) + 1
        if count[record.record_id] > 1:
            records[index] = replace(record, record_id=f"{record.record_id}-{count[record.record_id]}")
