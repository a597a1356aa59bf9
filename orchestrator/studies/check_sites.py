"""Seismograms of scenarios at many sites, each shaken with the rocks that stand there."""

import dataclasses
import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import pandas as pd

from toppling.models.errors import InputError
from toppling.models.motions.ensemble import CATALOG, Ensemble
from toppling.models.motions.record import Record
from toppling.models.scene import Scene
from toppling.orchestrator.processes import pool_of
from toppling.orchestrator.site_table import Site, seismograms_in

_AHEAD = 4
"""Tasks a worker that are handed out: few enough that not all seismograms are in memory."""

_Judge = Callable[[Scene, Record, Sequence[float], str], Any]


@dataclass(frozen=True, eq=False)
class Seismogram:
    """One seismogram, which is read where it is shaken."""

    station: str
    event: str
    files: tuple[str, ...]  # that it was read from
    source: Record | tuple[Path, str]  # the record, or the ensemble's folder and the record's id

    def is_at(self, site: str) -> bool:
        """Whether its station, or the folder of its files, has the site's name."""
        folders = [Path(name).parent.name for name in self.files]
        return site.casefold() in (name.casefold() for name in (self.station, *folders))

    @property
    def scenario(self) -> str:
        """What it is of: its event, or else the name of its file."""
        return self.event or next((Path(name).stem for name in self.files), self.station)


def of_ensemble(folder: Path) -> list[Seismogram]:
    """Seismograms of an ensemble, by its catalogue alone."""
    rows = Ensemble.load(folder).catalog.select(["record_id", "station", "event", "files"]).to_pylist()
    return [
        Seismogram(row["station"], row["event"], tuple(row["files"]), (folder, row["record_id"]))
        for row in rows
    ]


def of_records(records: Iterable[Record]) -> list[Seismogram]:
    """Seismograms that are in memory."""
    return [Seismogram(one.station, one.event, one.files, one) for one in records]


def seismograms_of(site: Site, given: Sequence[Seismogram]) -> list[Seismogram]:
    """Of those given the ones at a rock's site; where none is given its own."""
    if given:
        return [one for one in given if one.is_at(site.site)]
    own = site.ensemble or site.seismograms
    if own is None:
        return []
    return of_ensemble(own) if (own / CATALOG).is_file() else of_records(seismograms_in(own))


def check_sites(
    sites: Sequence[Site],
    given: Sequence[Seismogram],
    judge: _Judge,
    factors: Sequence[float],
    preset: str,
    workers: int | None = None,
    advance: Callable[[], object] = lambda: None,
) -> pd.DataFrame:
    """Shake every rock with the seismograms at its site.

    given: of which each rock takes those at its site; none for rocks that have their own.
    judge: what a scene, a record, factors and a preset give: a dataclass with `outcome`.
    factors: by which each is scaled.
    workers: processes; one a core unless given.
    advance: called after each seismogram.
    Returns DataFrame: a row a rock and seismogram: rock, site, longitude, latitude, scenario, the judge's fields,
    message. A rock that cannot be shaken, or has no seismogram, has one row that says so.
    Raises InputError if no rock has a seismogram.
    """
    chosen = _with_seismograms(sites, given)
    rows: list[dict[str, Any]] = []
    count = workers or os.cpu_count() or 1
    with pool_of(count) as pool:
        flying: dict[Future, dict[str, Any]] = {}

        def land(until: int) -> None:
            while len(flying) > until:
                for future in wait(flying, return_when=FIRST_COMPLETED).done:
                    rows.append({**flying.pop(future), **future.result()})
                    advance()

        for site, found in chosen:
            head = {name: getattr(site, name) for name in ("rock", "site", "longitude", "latitude")}
            if not found:
                rows.append({**head, "outcome": "none", "message": f"no seismogram is at {site.site}"})
            for one in found:
                land(_AHEAD * count)
                task = pool.submit(_judged, site, one, judge, factors, preset)
                flying[task] = {**head, "scenario": one.scenario}
        land(0)
    return _in_order(rows)


def _with_seismograms(
    sites: Sequence[Site], given: Sequence[Seismogram]
) -> list[tuple[Site, list[Seismogram]]]:
    """Each rock with the seismograms at its site, of which some rock has one."""
    chosen = [(site, seismograms_of(site, given)) for site in sites]
    if not any(found for _, found in chosen):
        stations = ", ".join(sorted({one.station or "(none)" for one in given})[:5]) or "none"
        raise InputError(
            f"none of {len(given)} seismograms is at a site of the table",
            where="check",
            expected=f"stations or folders named like {sites[0].site!r}; their stations are {stations}",
            remedy="name the stations in the table's column 'site', or give each rock its own 'seismograms'",
        )
    return chosen


def _in_order(rows: list[dict[str, Any]]) -> pd.DataFrame:
    fullest = max(rows, key=len)  # in which order rows come is chance, and so is which columns the first has
    frame = pd.DataFrame(rows, columns=[*fullest])
    return frame.sort_values(["rock", "scenario", "record_id"], kind="stable", ignore_index=True)


def matrix_of(rows: pd.DataFrame) -> pd.DataFrame:
    """Share that topples of each rock (rows) under each scenario (columns), null where none was shaken or answered."""
    known = rows.dropna(subset=["scenario"])
    table = known.pivot_table(
        index="rock", columns="scenario", values="probability", aggfunc="mean", dropna=False
    )
    return table.reindex(sorted(rows["rock"].unique()))


def _judged(
    site: Site, one: Seismogram, judge: _Judge, factors: Sequence[float], preset: str
) -> dict[str, Any]:
    record_id = one.source[1] if isinstance(one.source, tuple) else one.source.record_id
    try:
        record = one.source
        if isinstance(record, tuple):
            record = _ensemble(record[0]).record(record[1])
        verdict = dataclasses.asdict(judge(_scene(site.scene, site.friction), record, factors, preset))
    except (
        InputError
    ) as error:  # a rock that does not stand, or a seismogram that cannot be read, holds up no other
        return {"record_id": record_id, "outcome": "failed", "message": str(error)}
    return verdict | {"message": None}


@lru_cache(maxsize=1)
def _scene(folder: Path, friction: float | None) -> Scene:
    scene = Scene.load(folder)
    return scene if friction is None else scene.with_friction(friction)


@lru_cache(maxsize=2)
def _ensemble(folder: Path) -> Ensemble:
    return Ensemble.load(folder)
