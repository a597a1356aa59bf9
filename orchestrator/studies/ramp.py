"""The shake-table protocol of Purvance et al. (2008): each waveform, stronger by a step each time, until toppling.

Veeraraghavan, Hudnut and Krishnan validated their method by it on rock K (figure 4): PGA from 0.981 m/s2 in steps of
0.245 m/s2, displacement held within the table's 0.3 m by a high-pass, friction 2 so that nothing slides, and no
restitution.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor, as_completed
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from toppling.models.contact import ContactProperties
from toppling.models.errors import InputError
from toppling.models.files.csv_text import write_csv
from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.impose import impose
from toppling.models.motions.motion import Motion
from toppling.models.motions.record import Record
from toppling.models.scene import Scene
from toppling.models.statics import lift_off_m_s2
from toppling.workers.options import PHYSICS_VERSION
from toppling.workers.seating import settled
from toppling.workers.shake import shake

_WAVEFORMS = 10


@dataclass(frozen=True)
class Ramp:
    """How a rock is tried.

    Parameters
    ----------
    azimuth_deg : float
        Of the motion.
    start_m_s2 : float
        First PGA, m/s2.
    step_m_s2 : float
        Step between levels, m/s2.
    end_m_s2 : float
        PGA at which a waveform is given up, m/s2.
    peak_displacement_m : float or None
        Largest displacement of the table, m: larger motions are high-passed; 'inf' for no limit.
    friction : float
        Static and kinetic.
    restitution : float
        Of velocities in an impact.
    uniaxial : bool
        Only the stronger horizontal component shakes, as on a table of one axis.
    """

    azimuth_deg: float
    start_m_s2: float = 0.981
    step_m_s2: float = 0.245
    end_m_s2: float = 20.0
    peak_displacement_m: float | None = 0.3
    friction: float = 2.0
    restitution: float = 0.0
    preset: str = "standard"
    uniaxial: bool = True

    def levels_m_s2(self) -> list[float]:
        """PGA levels, weakest first."""
        count = int((self.end_m_s2 - self.start_m_s2) / self.step_m_s2 + 1e-9) + 1
        return [round(self.start_m_s2 + number * self.step_m_s2, 9) for number in range(max(count, 1))]


def weakest_azimuth_deg(scene: Scene, friction: float = Ramp.friction) -> float:
    """Azimuth of the ground's acceleration that lifts the rock at the least PGA, as the protocol shakes it."""
    rock_at_rest = settled(scene.with_contact(ContactProperties.of(friction)))
    azimuths = np.arange(0.0, 360.0, 5.0)
    found = lift_off_m_s2(rock_at_rest.rock, rock_at_rest.pedestal, scene.gravity_m_s2, azimuths)
    return min(found, key=lambda pair: pair[1])[0]


def chosen_waveforms(ensemble: Ensemble, count: int = _WAVEFORMS) -> list[str]:
    """Records spread evenly over the PGV/PGA that an ensemble has; all where there are no more."""
    catalog = ensemble.catalog.select(["record_id", "pgv_pga_s"]).to_pandas()
    ordered = catalog.sort_values(["pgv_pga_s", "record_id"])["record_id"].to_list()
    if len(ordered) <= count:
        return ordered
    return [ordered[round(path)] for path in np.linspace(0, len(ordered) - 1, count)]


def _climb(scene: Scene, record: Record, ramp: Ramp) -> list[dict[str, Any]]:
    """Shake a rock with one waveform, level by level until it topples; one row a level."""
    waveform = _uniaxial(record) if ramp.uniaxial else record
    contact = ContactProperties(ramp.friction, ramp.friction, ramp.restitution)
    held_scene = scene.with_contact(contact)
    rows: list[dict[str, Any]] = []
    for level in ramp.levels_m_s2():
        try:
            imposed = impose(waveform, level, ramp.azimuth_deg, ramp.peak_displacement_m)
        except InputError as error:
            rows.append(_row(record, level) | {"status": "refused", "message": error.what})
            break
        result = shake(held_scene, imposed.motion, ramp.preset)
        measures = {name: imposed.intensity[name] for name in ("pga_m_s2", "pgv_m_s", "pgv_pga_s", "pgd_m")}
        found = {"status": result.status, "toppled": result.toppled, "max_tilt_deg": result.max_tilt_deg}
        rows.append(_row(record, level) | measures | found)
        if result.toppled:
            break
    return rows


def _row(record: Record, level: float) -> dict[str, Any]:
    return {"record_id": record.record_id, "event": record.event, "level_pga_m_s2": level}


def _uniaxial(record: Record) -> Record:
    """The record's stronger horizontal component alone, along x."""
    acceleration = record.motion.acceleration_m_s2
    azimuth = np.deg2rad(record.intensity["strong_azimuth_deg"])
    strong = acceleration[:, :2] @ np.array([np.cos(azimuth), np.sin(azimuth)])
    alone = np.column_stack([strong, np.zeros((len(strong), 2))])
    return Record.of(
        record.record_id,
        Motion(alone, record.motion.time_step_s),
        event=record.event,
        component_azimuths_deg=(0.0, 90.0),
    )


def carry_out(
    scene: Path,
    ensemble: Path,
    records: Sequence[str],
    ramp: Ramp,
    folder: Path,
    pool: Executor,
    advance: Callable[[str], None] = lambda _: None,
) -> pd.DataFrame:
    """Climb with every waveform, each a task of its own; what is done already is read from the folder.

    scene, ensemble: folders, which every worker sees.
    folder: keeps a table a waveform, so that an interrupted ramp goes on.
    pool: processes here, or a cluster's.
    advance: told each waveform that is done.
    Returns DataFrame: one row a level of a waveform.
    """
    key = _key(Scene.load(scene).id, Ensemble.load(ensemble), ramp)
    places = {name: folder / f"{number:03d}-{key(name)}.csv" for number, name in enumerate(records)}
    waiting = {
        pool.submit(_climbed, str(scene), str(ensemble), name, ramp): name
        for name, path in places.items()
        if not path.exists()
    }
    for name, path in places.items():
        if path.exists():
            advance(name)
    for future in as_completed(waiting):
        name = waiting[future]
        write_csv(pd.DataFrame(future.result()), places[name], digits=None)
        advance(name)
    tables = [pd.read_csv(path) for path in places.values()]
    return pd.concat(tables, ignore_index=True)


def summary(levels: pd.DataFrame) -> pd.DataFrame:
    """One row a waveform: its PGV/PGA averaged over the levels, and the PGA that toppled, null where none did.

    Returns DataFrame: record_id, event, pgv_pga_s, toppling_pga_m_s2, toppling_level_m_s2, strongest_standing_m_s2,
    levels.
    """
    rows = []
    for name, climbed in levels.groupby("record_id", sort=False):
        shaken = climbed[climbed["status"] != "refused"]
        toppled = shaken[shaken["toppled"].eq(other=True)]
        standing = shaken[shaken["toppled"].eq(other=False)]
        rows.append({
            "record_id": name,
            "event": climbed["event"].iloc[0],
            "pgv_pga_s": shaken["pgv_pga_s"].mean(),
            "toppling_pga_m_s2": toppled["pga_m_s2"].min(),
            "toppling_level_m_s2": toppled["level_pga_m_s2"].min(),
            "strongest_standing_m_s2": standing["pga_m_s2"].max(),
            "levels": len(shaken),
        })  # fmt: skip
    return pd.DataFrame(rows)


def _key(scene_id: str, ensemble: Ensemble, ramp: Ramp) -> Callable[[str], str]:
    from toppling.orchestrator.campaign import hash_of

    protocol: Mapping[str, Any] = dataclasses.asdict(ramp)
    return lambda name: hash_of(
        [scene_id, ensemble.sha(name), PHYSICS_VERSION, repr(sorted(protocol.items()))]
    )


@lru_cache(maxsize=1)
def _assets(scene: str, ensemble: str) -> tuple[Scene, Ensemble]:
    return Scene.load(scene), Ensemble.load(ensemble)


def _climbed(scene: str, ensemble: str, record_id: str, ramp: Ramp) -> list[dict[str, Any]]:
    rock, motions = _assets(scene, ensemble)
    return _climb(rock, motions.record(record_id), ramp)
