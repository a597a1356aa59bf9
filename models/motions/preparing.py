"""From three channels to a record: checked, oriented, processed if it is needed, measured."""

import math
from dataclasses import dataclass

from toppling.models.errors import InputError
from toppling.models.motions.duplicates import Candidate, Shaking
from toppling.models.motions.metadata import Entry
from toppling.models.motions.motion import Motion
from toppling.models.motions.processing import DRIFTS, drifts, process, resample
from toppling.models.motions.quality import beyond_nature, check_samples
from toppling.models.motions.record import Record
from toppling.models.motions.stations import Triple, oriented

_LEFT = {
    "corrected": "left as the agency corrected it",
    "sound": "left as it came",
    "uncorrected": "left uncorrected, as asked",
}
"""What the history says of a motion that is not processed, by its quality."""


@dataclass(frozen=True)
class ImportOptions:
    """What the user allows and asks for of the records that are imported."""

    missing_vertical: bool = False  # allow records without a vertical component
    # Allow records beyond 5 g, clipped, with a spike or with a gap filled by a constant.
    doubtful: bool = False
    # None processes what is uncorrected, and what drifts where nobody says; True all, False none.
    process: bool | None = None
    corner_hz: float | None = None  # corner of the high-pass; None chooses one by record
    time_step_s: float | None = None  # time step that every record is resampled to; None leaves each its own
    folders_apart: bool = False  # folders are places: the same shaking in two of them is two records


def prepared(name: str, channels: Triple, options: ImportOptions, entry: Entry | None) -> Candidate:
    """Record of three channels, on its way into an ensemble.

    name: its id.
    entry: row of the metadata table, which names event and station before the files do.
    Raises InputError if time step, unit or vertical are missing, a channel is doubtful, or the channels do not fit
    together.
    """
    _refuse_incomplete(channels, options)
    if not options.doubtful:
        for component in channels.channels:
            check_samples(component)
    motion, azimuths, oriented_how = oriented(channels)
    corrected = _corrected(channels)
    motion, quality, done = _processed(motion, corrected, options.process, _corner_hz(options, entry))
    if options.time_step_s and abs(options.time_step_s / motion.time_step_s - 1) > 1e-9:
        done.append(f"resampled from {motion.time_step_s:g} to {options.time_step_s:g} s, low-passed before")
        motion = resample(motion, options.time_step_s)
    first = channels.first
    event, station, magnitude, distance_km = (
        (entry.event, entry.station, entry.magnitude, entry.distance_km) if entry else ("", "", None, None)
    )
    warnings = tuple(dict.fromkeys(text for c in channels.channels for text in c.warnings))
    record = Record.of(
        name,
        motion,
        event=event or first.event,
        station=station or first.station,
        magnitude=first.magnitude if magnitude is None else magnitude,
        distance_km=first.distance_km if distance_km is None else distance_km,
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
    )
    shaking = Shaking(event.lower(), first.event.lower(), first.station.lower(), first.series, first.start_s)
    unit = first.stated_unit_m_s2 or (entry.unit_m_s2 if entry else None)
    baseline = quality not in {"uncorrected", "drifting"}
    beyond = beyond_nature(record.intensity["pga_m_s2"], record.intensity["pgv_m_s"], unit, baseline)
    return Candidate(record, shaking, bool(corrected), (*warnings, *beyond))


def _refuse_incomplete(channels: Triple, options: ImportOptions) -> None:
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
    if channels.vertical is None and not options.missing_vertical:
        raise InputError(
            "there is no vertical component",
            where=channels.first.where,
            expected="three components",
            remedy="give the vertical's file, or allow it with --missing-vertical",
        )


def _corner_hz(options: ImportOptions, entry: Entry | None) -> float | None:
    """High-pass corner by the option, then by the table; None to choose one."""
    if options.corner_hz is not None:
        return options.corner_hz
    return entry.corner_hz if entry else None


def _corrected(channels: Triple) -> bool | None:
    """Whether the agency has corrected all channels; None if nobody says."""
    said = [component.corrected for component in channels.channels]
    return False if False in said else None if None in said else True


def _processed(
    motion: Motion, corrected: bool | None, asked: bool | None, corner_hz: float | None
) -> tuple[Motion, str, list[str]]:
    """Motion, processed if it is asked for or needed, its quality, and what was found and done."""
    quality, steps = "corrected" if corrected else "uncorrected", []
    if corrected is None:
        drifting = drifts(motion)
        quality = "uncorrected" if drifting else "sound"
        steps.append(
            f"nobody says if it was corrected: its displacement {'drifts' if drifting else 'is sound'}"
        )
    if asked if asked is not None else quality == "uncorrected":
        motion, done = process(motion, corner_hz)
        return motion, "drifting" if any(DRIFTS in step for step in done) else "processed", [*steps, *done]
    return motion, quality, [*steps, _LEFT[quality]]
