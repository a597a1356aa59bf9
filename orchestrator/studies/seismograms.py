"""Seismograms, unscaled and in their own directions, and what they and their scaled neighbours do to a rock."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from toppling.models.errors import InputError
from toppling.models.motions.ensemble import CATALOG, Ensemble
from toppling.models.motions.motion import Motion
from toppling.models.motions.record import Record
from toppling.models.scene import Scene
from toppling.workers.shake import shake


@dataclass(frozen=True)
class Verdict:
    """What one seismogram and its scaled neighbours do to the rock."""

    record_id: str
    event: str
    station: str
    # Whether the components' azimuths are known; if not, the first horizontal was taken as east.
    north_known: bool
    # Peaks of the horizontal vector, as recorded.
    pga_m_s2: float
    pgv_m_s: float
    # Of the seismogram as it is: stands, moved, toppled, lodged, or the status of a shake without an answer.
    outcome: str
    max_tilt_deg: float
    # Of the scaled neighbours with an answer, including the seismogram itself.
    toppled: int
    shaken: int
    # Share of these that toppled. They are copies of one motion, so no interval is given.
    probability: float | None
    least_factor: float | None  # least factor that toppled the rock


def neighbouring_factors(largest: float, neighbours: int) -> list[float]:
    """Factors from 1/largest to largest in equal ratios, 1 in the middle."""
    return [float(largest ** (k / max(neighbours, 1))) for k in range(-neighbours, neighbours + 1)]


def judged(
    scene: Scene,
    record: Record,
    factors: Sequence[float],
    preset: str,
    advance: Callable[[], object] = lambda: None,
) -> Verdict:
    """Shake a rock with an unscaled record, and with a little weaker and stronger ones."""
    answers: dict[float, bool | None] = {}
    outcome, tilt = "", math.nan
    for factor in factors:
        motion = Motion(factor * record.motion.acceleration_m_s2, record.motion.time_step_s)
        result = shake(scene, motion, preset)
        answers[factor] = result.toppled
        if factor == 1.0:
            outcome, tilt = result.outcome or result.status, result.max_tilt_deg
        advance()
    known = [answer for answer in answers.values() if answer is not None]
    return Verdict(
        record_id=record.record_id,
        event=record.event,
        station=record.station,
        north_known=record.north_known,
        pga_m_s2=float(record.intensity["pga_m_s2"]),
        pgv_m_s=float(record.intensity["pgv_m_s"]),
        outcome=outcome,
        max_tilt_deg=tilt,
        toppled=sum(known),
        shaken=len(known),
        probability=sum(known) / len(known) if known else None,
        least_factor=min((factor for factor, answer in answers.items() if answer), default=None),
    )


@dataclass(frozen=True, eq=False)
class Seismograms:
    """Seismograms as they were read."""

    records: list[Record]
    remarks: list[str] = field(default_factory=list)  # what was left out or processed, and why
    # What is odd in a seismogram: its name and the oddity.
    notes: list[tuple[str, str]] = field(default_factory=list)


def read_seismograms(
    paths: Sequence[Path], metadata: Path | None, missing_vertical: bool, *, folders_apart: bool = False
) -> Seismograms:
    """Records of ensembles, and of files as 'records import' reads them; of sites, by folders, each its own.

    Raises InputError if no file gives a seismogram; its message says why each was left out.
    """
    from toppling.models.motions.importing import ImportOptions, import_records, record_files
    from toppling.models.motions.metadata import read_table

    found: list[Record] = []
    for folder in (path for path in paths if (path / CATALOG).is_file()):
        ensemble = Ensemble.load(folder)
        found += [ensemble.record(record_id) for record_id in ensemble.record_ids]
    files = record_files([path for path in paths if not (path / CATALOG).is_file()])
    if not files:
        return Seismograms(found)
    table = read_table(metadata) if metadata else []
    came = import_records(
        files, table, ImportOptions(missing_vertical=missing_vertical, folders_apart=folders_apart)
    )
    remarks = [f"left out {refusal.subject}: {refusal.reason}" for refusal in came.refusals]
    if came.unused_rows:
        unused = f"{came.unused_rows} of {len(table)} rows of {metadata} name files that were not given"
        remarks.insert(0, unused)
    remarks += [
        f"{record.record_id} was uncorrected or drifting, and has been processed"
        " ('corrected' in the table's column 'processing' prevents this)"
        for record in came.records
        if record.quality in {"processed", "drifting"}
    ]
    if not came.records:
        raise InputError(
            f"none of {len(files)} files gave a seismogram: {'; '.join(remarks)}",
            where=", ".join(map(str, paths)),
            expected="three-component seismograms",
            remedy="a metadata table adds what the files do not state (--metadata)",
        )
    return Seismograms([*found, *came.records], remarks, list(came.warnings))
