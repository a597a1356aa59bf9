"""Shakes of rocks with seismograms in their recorded orientation, unscaled and slightly scaled."""

import dataclasses
import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import pandas as pd

from toppling.models.errors import InputError, UsageError
from toppling.models.motions.ensemble import CATALOG, Ensemble
from toppling.models.motions.motion import Motion
from toppling.models.motions.record import Record
from toppling.models.scene import Scene
from toppling.orchestrator.public import unseen
from toppling.orchestrator.site_table import Site, ensemble_folder, temporary_ensemble
from toppling.workers.shaking import shake


@dataclass(frozen=True)
class Verdict:
    """Effect of a seismogram and its scaled copies on a rock."""

    record_id: str
    event: str
    station: str
    # Whether the components' azimuths are known; if not, the first horizontal was taken as east.
    north_known: bool
    # Peaks of the horizontal vector, as recorded.
    pga_m_s2: float
    pgv_m_s: float
    # For the unscaled seismogram: stands, moved, toppled, lodged, or the status of a shake without an answer.
    outcome: str
    max_tilt_deg: float
    # Among the scaled copies with an answer, including the unscaled one.
    toppled: int
    shaken: int
    # Fraction of these that toppled; without an interval, because they are copies of one motion.
    probability: float | None
    least_factor: float | None  # smallest factor that toppled the rock


def neighbouring_factors(largest: float, neighbours: int) -> list[float]:
    """Factors from 1/largest to largest in equal ratios, with 1 at the centre."""
    return [float(largest ** (k / max(neighbours, 1))) for k in range(-neighbours, neighbours + 1)]


def judged(
    scene: Scene,
    record: Record,
    factors: Sequence[float],
    preset: str,
    advance: Callable[[], object] = lambda: None,
) -> Verdict:
    """Shake a rock with an unscaled record and with scaled copies."""
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


@dataclass(frozen=True)
class Seismogram:
    """A seismogram of an ensemble on disk."""

    ensemble: Path
    record_id: str
    station: str
    event: str
    files: tuple[str, ...]  # source files

    def is_at(self, site: str) -> bool:
        """Whether its station, or the folder of its files, has the name of the site."""
        folders = [Path(name).parent.name for name in self.files]
        return site.casefold() in (name.casefold() for name in (self.station, *folders))

    @property
    def scenario(self) -> str:
        """Name of its event, or else of its file."""
        return self.event or next((Path(name).stem for name in self.files), self.station)


def of_ensemble(folder: Path) -> list[Seismogram]:
    """Seismograms of an ensemble, read from its catalogue only."""
    rows = Ensemble.load(folder).catalog.select(["record_id", "station", "event", "files"]).to_pylist()
    return [Seismogram(folder, **row | {"files": tuple(row["files"])}) for row in rows]


@dataclass(frozen=True, eq=False)
class Seismograms:
    """Seismograms that were read, with remarks."""

    found: list[Seismogram]
    remarks: list[str] = field(default_factory=list)  # files left out or records processed, with reasons
    # Warnings: name of the seismogram and the anomaly.
    notes: list[tuple[str, str]] = field(default_factory=list)


def read_seismograms(
    paths: Sequence[Path], metadata: Path | None, missing_vertical: bool, *, folders_apart: bool = False
) -> Seismograms:
    """Seismograms of ensembles, and of files as 'records import' reads them, which become a temporary ensemble.

    folders_apart: whether the files of each site are in a separate folder.

    Raises UsageError if metadata is given without files that it could describe.
    Raises InputError if no file contains a seismogram; its message gives the reasons.
    """
    from toppling.models.motions.importing import ImportOptions, import_records, record_files
    from toppling.models.motions.metadata import read_table

    found = [record for path in paths if (path / CATALOG).is_file() for record in of_ensemble(path)]
    given = [path for path in paths if not (path / CATALOG).is_file()]
    if metadata and not given:
        raise UsageError(
            "metadata.no_file_given",
            "--metadata describes files, but only ensembles were given, which have their own metadata",
            where=str(metadata),
            expected="files of seismograms",
            remedy="leave it out",
        )
    files = record_files(given)
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
            "record.none_found",
            f"none of {len(files)} files gave a seismogram: {'; '.join(remarks)}",
            where=", ".join(map(str, paths)),
            expected="three-component seismograms",
            remedy="a metadata table adds what the files do not state (--metadata)",
        )
    return Seismograms(found + of_ensemble(temporary_ensemble(came.records)), remarks, list(came.warnings))


@dataclass(frozen=True)
class Checked:
    """Effect of seismograms on a rock.

    Parameters
    ----------
    verdicts : list of Verdict
        One per seismogram.
    remarks : list of str
        Files left out or records processed, with reasons.
    notes : list of (str, str)
        Warnings: name of the seismogram and the anomaly.
    """

    verdicts: list[Verdict]
    remarks: list[str] = field(default_factory=list)
    notes: list[tuple[str, str]] = field(default_factory=list)

    def frame(self) -> pd.DataFrame:
        """Table of the verdicts, one row per seismogram."""
        return pd.DataFrame([dataclasses.asdict(verdict) for verdict in self.verdicts])


def check(
    scene: Scene | str | Path,
    seismograms: Sequence[str | Path],
    *,
    friction: float | None = None,
    metadata: str | Path | None = None,
    missing_vertical: bool = False,
    largest: float = 1.25,
    neighbours: int = 5,
    preset: str = "standard",
    advance: Callable[..., None] = unseen,
) -> Checked:
    """Test whether seismograms, unscaled and in their recorded orientation, topple a rock, as `toppling check` does.

    Parameters
    ----------
    scene : Scene or path
    seismograms : sequence of path
        Files, folders of files, or folders of ensembles.
    friction : float or None
        The scene's own unless given.
    metadata : path or None
        Table of what the files do not state, as for 'records import'.
    missing_vertical : bool
        Allow seismograms without a vertical component.
    largest : float
        Each is also shaken from 1/N to N times as strong, N being this factor.
    neighbours : int
        So many weaker and as many stronger ones; 0 for none.
    preset : str
        How finely each shake is resolved.
    advance : callable
        Called after each shake.

    Raises
    ------
    InputError
        If the scene or a table cannot be read, or no file gives a seismogram.
    """
    rock = scene if isinstance(scene, Scene) else Scene.load(Path(scene))
    if friction is not None:
        rock = rock.with_friction(friction)
    read = read_seismograms(
        tuple(map(Path, seismograms)), None if metadata is None else Path(metadata), missing_vertical
    )
    factors = neighbouring_factors(largest, neighbours)
    advance(0, total=len(read.found) * len(factors))
    load = lru_cache(maxsize=None)(Ensemble.load)
    records = (load(entry.ensemble).record(entry.record_id) for entry in read.found)
    verdicts = [judged(rock, record, factors, preset, advance) for record in records]
    return Checked(verdicts, read.remarks, read.notes)


def seismograms_of(site: Site, sites: Sequence[Site], given: Sequence[Seismogram]) -> list[Seismogram]:
    """Given seismograms at a rock's site; if none are given, the rock's own."""
    if given:
        return [seismogram for seismogram in given if seismogram.is_at(site.site)]
    own = ensemble_folder(site, sites)
    return of_ensemble(own) if own else []


def check_sites(
    sites: Sequence[Site],
    given: Sequence[Seismogram],
    factors: Sequence[float],
    preset: str,
    workers: int | None = None,
    advance: Callable[..., None] = unseen,
) -> pd.DataFrame:
    """Shake every rock with the seismograms at its site.

    given: seismograms, of which each rock takes those at its site; empty for rocks with their own.
    factors: scale factors.
    workers: number of processes; one per core unless given.
    advance: called after each seismogram.
    Returns DataFrame: one row per rock and seismogram: rock, site, longitude, latitude, scenario, the verdict's fields,
    message. A rock that cannot be shaken, or has no seismogram, has one row with that message.
    Raises InputError if no rock has a seismogram.
    """
    rows: list[dict[str, Any]] = []
    heads: list[dict[str, Any]] = []
    tasks: list[tuple[Site, Seismogram]] = []
    for site in sites:
        head = {name: getattr(site, name) for name in ("rock", "site", "longitude", "latitude")}
        found = seismograms_of(site, sites, given)
        heads += [{**head, "scenario": seismogram.scenario} for seismogram in found]
        tasks += [(site, seismogram) for seismogram in found]
        if not found:
            rows.append({**head, "outcome": "none", "message": f"no seismogram is at {site.site}"})
    if not tasks:
        raise _no_seismograms(sites, given)
    from toppling.orchestrator.cluster import local  # with Dask, which a single rock does not need

    advance(0, total=len(tasks))
    with local(workers or os.cpu_count() or 1) as client:
        answers = client.map(partial(_judged, factors, preset), tasks, pure=False)
        for head, answer in zip(heads, answers, strict=True):
            rows.append({**head, **answer.result()})
            advance()
    fullest = max(rows, key=len)  # rows arrive in any order, and failed ones have fewer columns
    frame = pd.DataFrame(rows, columns=[*fullest])
    return frame.sort_values(["rock", "scenario", "record_id"], kind="stable", ignore_index=True)


def _no_seismograms(sites: Sequence[Site], given: Sequence[Seismogram]) -> InputError:
    stations = ", ".join(sorted({seismogram.station or "(none)" for seismogram in given})[:5]) or "none"
    return InputError(
        "rocks.no_seismograms",
        f"none of {len(given)} seismograms is at a site of the table",
        where="check",
        expected=f"stations or folders named like {sites[0].site!r}; their stations are {stations}",
        remedy="name the stations in the table's column 'site', or give each rock its own 'seismograms'",
    )


def matrix_of(rows: pd.DataFrame) -> pd.DataFrame:
    """Fraction toppled of each rock (rows) under each scenario (columns); null without an answer."""
    known = rows.dropna(subset=["scenario"])
    table = known.pivot_table(
        index="rock", columns="scenario", values="probability", aggfunc="mean", dropna=False
    )
    return table.reindex(sorted(rows["rock"].unique()))


def _judged(factors: Sequence[float], preset: str, task: tuple[Site, Seismogram]) -> dict[str, Any]:
    site, seismogram = task
    try:
        scene = _scene(site.scene, site.friction)
        record = _ensemble(seismogram.ensemble).record(seismogram.record_id)
        verdict = dataclasses.asdict(judged(scene, record, factors, preset))
    # A rock that does not stand, or an unreadable seismogram, must not stop the others.
    except InputError as error:
        return {"record_id": seismogram.record_id, "outcome": "failed", "message": str(error)}
    return verdict | {"message": None}


@lru_cache(maxsize=1)
def _scene(folder: Path, friction: float | None) -> Scene:
    scene = Scene.load(folder)
    return scene if friction is None else scene.with_friction(friction)


@lru_cache(maxsize=2)
def _ensemble(folder: Path) -> Ensemble:
    """Ensemble cached in a worker process; not in the user's, where a folder may be rewritten."""
    return Ensemble.load(folder)
