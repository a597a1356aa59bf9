"""One job of a campaign: a record, scaled and turned, on a scene with its contact properties, becomes a row."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from toppling.models.caching import cached
from toppling.models.errors import InputError
from toppling.models.frames import compass_deg
from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.imposing import Imposed, impose
from toppling.models.pedestal import FRICTION_SPREAD, ContactProperties
from toppling.models.scene import COM_SPREAD_SHARE, Scene
from toppling.workers.engines import DEFAULT
from toppling.workers.options import PHYSICS_VERSION
from toppling.workers.outcome import ShakeResult
from toppling.workers.shaking import shake
from toppling.workers.unmeasured import Unmeasured


@dataclass(frozen=True, slots=True)
class JobSpec:
    """All that decides a job's answer, the contents of scene and record by their hashes.

    Parameters
    ----------
    pga_m_s2 : float
        Level that the record's horizontal vector PGA is scaled to.
    azimuth_deg : float
        Where its strong component is turned to, degrees counter-clockwise from x.
    realisation : int
        0 for the scene as it is; others draw base, centre of mass and friction from their uncertainty.
    peak_displacement_m : float or None
        Largest ground displacement to impose.
    unmeasured : Unmeasured or None
        What realisations draw besides.
    """

    scene_id: str
    record_id: str
    record_sha: str
    pga_m_s2: float
    azimuth_deg: float
    friction_static: float
    friction_kinetic: float
    restitution: float
    realisation: int
    preset: str
    engine: str = DEFAULT
    peak_displacement_m: float | None = None
    unmeasured: Unmeasured | None = None

    @property
    def job_id(self) -> str:
        """Hash of the specification and the physics version."""
        content = {name: getattr(self, name) for name in _FIELDS}
        content["unmeasured"] = self.unmeasured and dataclasses.asdict(self.unmeasured)
        canonical = json.dumps({**content, "physics_version": PHYSICS_VERSION}, sort_keys=True)
        return hashlib.sha256(canonical.encode()).hexdigest()[:24]


_FIELDS = tuple(field.name for field in dataclasses.fields(JobSpec))
ASKED = {
    "level_pga_m_s2" if name == "pga_m_s2" else name: name
    for name in ("job_id", *_FIELDS)
    if name not in ("record_sha", "peak_displacement_m", "unmeasured")
}
"""Columns of a row that repeat what was asked, with the attribute of the specification that each repeats."""

AXES = ("pga_m_s2", "azimuth_deg", "friction_static", "friction_kinetic", "restitution", "realisation")
"""Fields of a job that are the axes of a campaign, beside the record."""


@dataclass(frozen=True, eq=False)
class Assets:
    """Scene and motions that a worker caches between jobs."""

    scene: Scene
    ensemble: Ensemble


def run_job(spec: JobSpec, assets: Assets) -> dict[str, Any]:
    """Shake once. No clock, network or global state decides the answer.

    Parameters
    ----------
    assets : Assets
        Holding the scene and the record that the specification names.

    Returns
    -------
    dict
        A row of :data:`results.schema.SCHEMA`, without what the orchestrator adds.

    Raises
    ------
    InputError
        If the assets are not those of the specification, or the job asks for what the engine refuses.
    """
    scene, imposed = prepared(spec, assets)
    result = shake(scene, imposed.motion, spec.preset, engine=spec.engine)
    record = assets.ensemble.record(spec.record_id)
    return {
        **identity(spec), "event": record.event, "physics_version": PHYSICS_VERSION,
        **_drawn(spec, scene), **imposed.intensity, **outcome_of(result),
    }  # fmt: skip


def prepared(spec: JobSpec, assets: Assets) -> tuple[Scene, Imposed]:
    """Scene and motion of a job.

    Raises
    ------
    InputError
        If the assets are not those of the specification.
    """
    record = assets.ensemble.record(spec.record_id)
    if (assets.scene.id, record.sha) != (spec.scene_id, spec.record_sha):
        raise InputError(
            "job.assets_differ",
            f"scene {assets.scene.id} and record {record.sha}",
            where=f"job {spec.job_id}",
            expected=f"scene {spec.scene_id} and record {spec.record_sha}",
            remedy="plan the campaign anew: its scene or ensemble has changed",
        )
    unmeasured = spec.unmeasured or Unmeasured()
    azimuth_deg = spec.azimuth_deg + unmeasured.turn_deg(spec.realisation)
    record = unmeasured.record(record, spec.realisation)
    imposed = impose(record, spec.pga_m_s2, azimuth_deg, spec.peak_displacement_m)
    contact = ContactProperties(spec.friction_static, spec.friction_kinetic, spec.restitution)
    return _realised(assets.scene, contact, unmeasured, spec.realisation), imposed


@cached
def _realised(scene: Scene, contact: ContactProperties, unmeasured: Unmeasured, realisation: int) -> Scene:
    """The scene with the job's contact properties, and with what the realisation draws."""
    drawn = drawn_contact(scene.id, contact, unmeasured, realisation)
    if realisation == 0:
        return scene.with_contact(drawn)
    if scene.unseen is not None:  # base and centre of mass are drawn together: on each base the rock stands
        number = scene.unseen.number_of(realisation)
        assert number is not None
        return scene.on_base(number).with_contact(drawn)
    spread_m = scene.com_std_m
    if spread_m is None:
        spread_m = np.full(3, COM_SPREAD_SHARE * scene.rock.height_m)
    offset_m = _normal(scene.id, realisation)[:3] * spread_m
    rock = dataclasses.replace(scene.rock, com_m=scene.rock.com_m + offset_m)
    return dataclasses.replace(scene, rock=rock, contact=drawn)


def drawn_contact(
    scene_id: str, contact: ContactProperties, unmeasured: Unmeasured, realisation: int
) -> ContactProperties:
    """Contact properties that a realisation draws, by their uncertainty or from the stated distributions."""
    if realisation == 0:
        return contact
    factor = float(np.exp(_normal(scene_id, realisation)[3] * FRICTION_SPREAD))
    varied = ContactProperties(
        contact.friction_static * factor, contact.friction_kinetic * factor, contact.restitution
    )
    return unmeasured.contact(varied, realisation)


def _normal(scene_id: str, realisation: int) -> NDArray[np.float64]:
    """Standard normal numbers (4,) of a realisation: for the centre of mass, and for friction."""
    seed = hashlib.sha256(f"{scene_id}:{realisation}".encode()).digest()[:8]
    return np.random.default_rng(int.from_bytes(seed, "little")).normal(size=4)


def identity(spec: JobSpec) -> dict[str, Any]:
    """Columns of a row that say which job it is of, whether it has an answer or not."""
    return {name: getattr(spec, field) for name, field in ASKED.items()}


def _drawn(spec: JobSpec, scene: Scene) -> dict[str, Any]:
    """Columns that say what the realisation drew."""
    stated = spec.friction_static
    return {
        "base": None if scene.unseen is None else scene.unseen.number_of(spec.realisation),
        "friction_factor": scene.contact.friction_static / stated if stated > 0.0 else 1.0,
    }


def outcome_of(result: ShakeResult) -> dict[str, Any]:
    """Columns of a row that the shake fills: what happened and what it cost."""
    columns = {field.name: getattr(result, field.name) for field in dataclasses.fields(result)}
    del columns["trajectory"]
    toward = columns["falls_toward_deg"]
    columns["falls_toward_bearing_deg"] = None if toward is None else float(compass_deg(toward))
    message = None if result.status == "ok" else f"{result.status}: ended by {result.ended_by}"
    return {**columns, "message": message}
