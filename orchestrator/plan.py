"""From a campaign to its jobs: one table, which holds a million; specifications only as they are needed."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from toppling.models.contact import ContactProperties
from toppling.models.errors import InputError
from toppling.models.motions.above_band import HIGHEST_CORNER
from toppling.models.motions.ensemble import Ensemble
from toppling.models.scene import Scene
from toppling.models.settling import Settling
from toppling.models.spelling import did_you_mean
from toppling.orchestrator.campaign import Campaign, hash_of
from toppling.orchestrator.order import balanced_order
from toppling.orchestrator.stood import Recorded, check_weighable, read_recorded
from toppling.results.schema import SCHEMA
from toppling.workers.job import AXES, JobSpec
from toppling.workers.seating import settled

COLUMNS = pa.schema(
    [
        ("job_id", pa.string()),
        ("record_id", pa.dictionary(pa.int32(), pa.string())),
        *((name, SCHEMA.field(name if name in SCHEMA.names else f"level_{name}").type) for name in AXES),
    ]
)
"""Of the table of jobs: of each its axes, of the types that they have in the results."""

EQUAL_SHARE_S = 40.0
"""A job is expected to cost as its record's duration and so much more: many shakes end before a long coda does."""


def expected_s(motion_s: float, jobs: int) -> float:
    """Tell what jobs are expected to cost, in a unit of its own, from their records' durations together."""
    return motion_s + EQUAL_SHARE_S * jobs


@dataclass(frozen=True, eq=False)
class Plan:
    """The jobs of a campaign on one scene and one ensemble.

    Parameters
    ----------
    campaign : Campaign
    scene_id, ensemble_id : str
    record_sha : dict
        Hash of every record in use.
    duration_s : dict
        Duration of every record in use.
    jobs : pyarrow.Table
        One row a job: record after record, the longest first; where records keep their own levels and azimuths, scene
        after scene, since each then shakes a scene once.
    recorded : Recorded or None
        What the rock is known to have stood.
    """

    campaign: Campaign
    scene_id: str
    ensemble_id: str
    record_sha: dict[str, str]
    duration_s: dict[str, float]
    jobs: pa.Table
    recorded: Recorded | None = None

    def __len__(self) -> int:
        return len(self.jobs)

    @cached_property
    def id(self) -> str:
        """Hash of all jobs."""
        stood = self.recorded.identity if self.recorded else ()  # jobs are the same, what they say is not
        return hash_of([*self.jobs.column("job_id").to_pylist(), *stood])

    @cached_property
    def ids(self) -> frozenset[str]:
        """Ids of all jobs."""
        return frozenset(self.jobs.column("job_id").to_pylist())

    @cached_property
    def record_of(self) -> NDArray[np.int32]:
        """For every job the number of its record, (n,)."""
        return self.jobs.column("record_id").combine_chunks().indices.to_numpy()

    @cached_property
    def order(self) -> NDArray[np.int64]:
        """Rows in the order to start them (`orchestrator.order`), (n,)."""
        scenes = [self._codes(name) for name in ("friction_static", "friction_kinetic")]
        static, kinetic = (codes.max(initial=0) + 1 for codes in scenes)
        friction = np.unique(np.ravel_multi_index(scenes, (static, kinetic)), return_inverse=True)[1]
        axes = [friction, self._codes("restitution"), self._codes("realisation")]
        sizes = tuple(int(codes.max(initial=0)) + 1 for codes in axes)
        none = np.zeros(len(self), np.int64)  # of records as they are each has a level of its own
        level = self._codes("pga_m_s2") if self.campaign.pga_m_s2 else none
        azimuth = self._codes("azimuth_deg") if self.campaign.azimuth_deg else none
        return balanced_order(self.record_of, level, azimuth, np.ravel_multi_index(axes, sizes), sizes)

    def _codes(self, column: str) -> NDArray[np.int64]:
        """For each job the number of its value among those of a column."""
        return np.unique(self.jobs.column(column).to_numpy(), return_inverse=True)[1]

    @cached_property
    def _records(self) -> list[str]:
        return self.jobs.column("record_id").combine_chunks().dictionary.to_pylist()

    @cached_property
    def _columns(self) -> list[NDArray]:
        """Columns after the record's, as arrays: a job's specification is made when it goes out, often again."""
        return [self.jobs.column(name).to_numpy() for name in COLUMNS.names[2:]]

    def motion_s(self, rows: NDArray[np.int64]) -> float:
        """Durations of the records of some jobs together."""
        return float(self.durations_s[rows].sum())

    def pending(self, finished: set[str]) -> NDArray[np.int64]:
        """Rows of the jobs without a result, in the order to start them."""
        done = pc.is_in(self.jobs.column("job_id"), value_set=pa.array(sorted(finished), pa.string()))
        left = ~done.combine_chunks().to_numpy(zero_copy_only=False)
        return self.order[left[self.order]]

    @cached_property
    def durations_s(self) -> NDArray[np.float64]:
        """For every job the duration of its record, (n,)."""
        return np.array([self.duration_s[record] for record in self._records])[self.record_of]

    def spec(self, row: int) -> JobSpec:
        """Specification of one job."""
        record_id = self._records[self.record_of[row]]
        values = (column[row].item() for column in self._columns)
        return _spec(self.campaign, self.scene_id, self.record_sha[record_id], record_id, values)


def plan(campaign: Campaign, scene: Scene, ensemble: Ensemble) -> Plan:
    """Expand a campaign to its jobs.

    Raises
    ------
    InputError
        If the campaign names a record that the ensemble lacks, or the ensemble is empty, or a motion that the rock
        stood cannot be read or tells nothing of it, or a record is sampled too coarsely for the band that it is said
        to have.
    """
    duration_s = _durations_s(campaign, ensemble)
    records = list(duration_s)
    campaign.check_jobs(len(records))
    _check_band(campaign, ensemble, records)
    recorded = None
    if campaign.stood:
        check_weighable(scene, campaign.first_realisation + campaign.realisations - 1, str(campaign.scene))
        recorded = read_recorded(campaign.stood)
    sha = {record: ensemble.sha(record) for record in records}
    axes = list(_axes(campaign))
    scene_id = scene.id
    per_record = [np.tile(np.array(column), len(records)) for column in zip(*axes, strict=True)]
    for column, name, given in (
        (0, "pga_m_s2", campaign.pga_m_s2), (1, "strong_azimuth_deg", campaign.azimuth_deg),
    ):  # fmt: skip
        if not given:
            own = dict(zip(ensemble.record_ids, ensemble.catalog[name].to_pylist(), strict=True))
            per_record[column] = np.repeat([own[record] for record in records], len(axes))
    named = np.repeat(records, len(axes)).tolist()
    rows = zip(named, *(column.tolist() for column in per_record), strict=True)
    ids = pa.array(
        (_spec(campaign, scene_id, sha[record], record, axis).job_id for record, *axis in rows), pa.string()
    )
    codes = np.repeat(np.arange(len(records), dtype=np.int32), len(axes))
    jobs = pa.Table.from_arrays(
        [ids, pa.DictionaryArray.from_arrays(codes, pa.array(records)), *map(pa.array, per_record)],
        names=COLUMNS.names,
    ).cast(COLUMNS)
    if _scene_by_scene(campaign):
        jobs = jobs.take(np.arange(len(jobs)).reshape(len(records), len(axes)).T.ravel())
    return Plan(campaign, scene_id, ensemble.id, sha, duration_s, jobs, recorded)


def check_stands(campaign: Campaign, scene: Scene) -> Settling:
    """Make sure that the rock stands by itself with every friction of the campaign, and say how far it settles.

    Otherwise every job would find it out anew. Where the campaign has realisations, only the nominal one is looked at.

    Returns
    -------
    Settling
        With the friction with which it tilts most.

    Raises
    ------
    InputError
        If it does not.
    """
    found = []
    for static, kinetic in sorted(set(campaign.friction)):
        try:
            found.append(settling(scene.with_contact(ContactProperties.of((static, kinetic)))))
        except InputError as error:
            raise InputError(
                f"with friction {static:g}: {error.what}",
                where=str(campaign.scene),
                expected=error.expected,
                remedy=error.remedy,
            ) from None
    return max(found, key=lambda one: one.tilt_deg)


def settling(scene: Scene) -> Settling:
    """How far the rock of a scene settles.

    Raises
    ------
    InputError
        If it does not stand by itself.
    """
    return Settling.between(scene.rock, settled(scene).rock, scene.pedestal.normal)


def _axes(campaign: Campaign) -> Iterator[tuple[float, float, float, float, float, int]]:
    """One record's points: those of one scene together, and of them the strongest shaking, the longest, first."""
    levels = sorted(campaign.pga_m_s2, reverse=True) or [np.nan]  # of records as they are, each has its own
    azimuths = campaign.azimuth_deg or (np.nan,)
    first = campaign.first_realisation
    numbers = range(first, first + campaign.realisations)
    for (static, kinetic), restitution, realisation, pga, azimuth in product(
        campaign.friction, campaign.restitution, numbers, levels, azimuths
    ):
        yield pga, azimuth, static, kinetic, restitution, realisation


def _scene_by_scene(campaign: Campaign) -> bool:
    """Whether a record shakes a scene once: making many scenes ready would cost more than reading many records."""
    return len(campaign.pga_m_s2) <= 1 and len(campaign.azimuth_deg) <= 1


def _spec(campaign: Campaign, scene_id: str, record_sha: str, record_id: str, axes: Iterable[Any]) -> JobSpec:
    """Specification of the job at some values of `AXES`."""
    return JobSpec(
        scene_id=scene_id,
        record_id=record_id,
        record_sha=record_sha,
        **dict(zip(AXES, axes, strict=True)),
        preset=campaign.preset,
        engine=campaign.engine,
        peak_displacement_m=campaign.peak_displacement_m,
        unmeasured=campaign.unmeasured,
    )


def _check_band(campaign: Campaign, ensemble: Ensemble, records: list[str]) -> None:
    """Refuse before any job what :func:`models.motions.above_band.with_motion_above` would refuse in each."""
    band_hz = campaign.unmeasured and campaign.unmeasured.band_hz
    if not band_hz:
        return
    step_s = dict(zip(ensemble.record_ids, ensemble.catalog["time_step_s"].to_pylist(), strict=True))
    coarsest = max(records, key=lambda record: step_s[record])
    highest_hz = HIGHEST_CORNER / step_s[coarsest]
    if band_hz > highest_hz:
        raise InputError(
            f"unmeasured.band_hz is {band_hz:g}, but record {coarsest} has a step of {step_s[coarsest]:g} s",
            where=str(campaign.ensemble),
            expected=f"at most {highest_hz:g} Hz: what is added is as strong as the octave below",
            remedy="give a smaller band_hz, or name finer records",
        )


def _durations_s(campaign: Campaign, ensemble: Ensemble) -> dict[str, float]:
    """Durations of the records to use by their ids, the longest motion first."""
    known = ensemble.record_ids
    there = set(known)
    missing = [name for name in campaign.records or () if name not in there]
    if missing:
        raise InputError(
            f"records {', '.join(missing[:10])} are not in the ensemble"
            + (" ..." if len(missing) > 10 else ""),
            where=str(campaign.ensemble),
            expected=f"ids of its {len(known)} records, such as {', '.join(known[:5])}",
            remedy=did_you_mean(
                missing[0],
                known,
                "correct 'records' in the campaign, or import the records into the ensemble",
            ),
        )
    chosen = list(campaign.records or known)
    if not chosen:
        what = "the ensemble holds no records, so there are no jobs"
        raise InputError(
            what,
            where=str(campaign.ensemble),
            expected="at least one record",
            remedy="import some with 'toppling records import'",
        )
    catalog = ensemble.catalog
    duration = dict(zip(catalog["record_id"].to_pylist(), catalog["duration_s"].to_pylist(), strict=True))
    return {name: duration[name] for name in sorted(chosen, key=lambda name: (-duration[name], name))}
