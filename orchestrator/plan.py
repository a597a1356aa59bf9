"""Expansion of a campaign to a table of jobs, of up to millions, in blocks that are balanced samples."""

import dataclasses
import hashlib
import itertools
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from toppling.models import caching
from toppling.models.errors import InputError, did_you_mean
from toppling.models.files.schemas import MOST_JOBS
from toppling.models.motions.ensemble import RECORDS_IN_MEMORY, Ensemble
from toppling.models.motions.imposing import check_step
from toppling.models.scene import Scene
from toppling.orchestrator.campaign import Campaign, hash_of
from toppling.orchestrator.recorded import Recorded, check_weighable, read_recorded
from toppling.orchestrator.site_table import Site
from toppling.results.schema import SCHEMA
from toppling.workers.job import AXES, JobSpec
from toppling.workers.options import PHYSICS_VERSION

_SEED = 2017
"""Seed of the order, which is arbitrary but equal on all machines."""
_JOBS_OF_A_RECORD = 4
"""Number of jobs per record in a block if there are more records than that: loading one takes a few milliseconds."""
JOBS_OF_A_SCENE = 128
"""Number of successive jobs of a rock of an atlas, and of a scene if there are more: preparing one takes .3 s."""

_Codes = NDArray[np.integer]


def diagonal(*sizes: int) -> NDArray[np.int64]:
    """Permutation of a grid's cells of which every stretch has each value of an axis equally often, up to one or two.

    *sizes: sizes of the axes.
    Returns (product of sizes, number of axes) int array: indices of the cells.

    Examples
    --------
    >>> diagonal(2, 3).tolist()
    [[0, 0], [1, 1], [0, 2], [1, 0], [0, 1], [1, 2]]
    >>> diagonal(2, 2).tolist()
    [[0, 0], [1, 1], [0, 1], [1, 0]]
    """
    cells = np.zeros((1, 0), np.int64)
    for size in sizes:
        count = len(cells)
        place = np.arange(count * size)
        # At each return to the corner, shift to the next diagonal.
        turned = (place + place // math.lcm(count, size)) % size
        cells = np.column_stack([cells[place % count], turned])
    return cells


def _along_diagonal(*sizes: int) -> NDArray[np.int64]:
    """Position of each cell of a grid on its `diagonal`."""
    places = np.empty(sizes, np.int64)
    places[tuple(diagonal(*sizes).T)] = np.arange(places.size)
    return places


def block_jobs(records: int, levels: int, azimuths: int, scenes: int) -> tuple[int, int]:
    """Number of groups that records are divided into, and number of jobs of a record in a block."""
    groups = 1 if scenes == 1 else math.ceil(records / RECORDS_IN_MEMORY)
    if scenes > caching.MOST:
        jobs = math.ceil(JOBS_OF_A_SCENE * groups / records)
    else:
        jobs = _JOBS_OF_A_RECORD if records / groups > RECORDS_IN_MEMORY else 1
    return groups, min(jobs, levels * azimuths)


def balanced_order(
    record: _Codes, level: _Codes, azimuth: _Codes, scene: _Codes, scene_sizes: tuple[int, ...] = ()
) -> NDArray[np.int64]:
    """Order of jobs of a campaign of which every prefix is balanced up to one block.

    record, level, azimuth, scene: (n,), indices of these for each job, from 0; no two jobs have equal tuples.
    scene_sizes: sizes of the axes that scenes are numbered along, the last the fastest; one axis unless given.
    Returns (n,) int array: indices of the jobs in the order to start them.
    """
    if not len(record):
        return np.zeros(0, np.int64)
    records, levels, azimuths, scenes = (int(codes.max()) + 1 for codes in (record, level, azimuth, scene))
    sizes = scene_sizes or (scenes,)
    scenes = math.prod(sizes)
    random = np.random.default_rng(_SEED)
    groups, jobs = block_jobs(records, levels, azimuths, scenes)
    turn = random.permutation(records)[record]  # rank of the job's record
    group = turn * groups // records
    cell = _cells(random, turn, level, azimuth, scene, scenes)
    diagonals, rank = turn * scenes + scene, np.empty(len(cell), np.int64)
    along = np.lexsort((cell, diagonals))
    rank[along] = np.arange(len(cell)) - np.searchsorted(diagonals[along], diagonals[along])
    visit, within = np.divmod(rank, jobs)
    # Scenes are visited along a diagonal of their axes, whose values are shuffled.
    shuffled = np.ix_(*(np.argsort(random.permutation(size)) for size in sizes))
    place = _along_diagonal(*sizes)[shuffled].ravel()[scene]
    # Each group of records is one scene ahead of the group before it.
    step = visit * scenes + (place - group) % scenes
    return np.lexsort((within, turn, group, step))


def realisations_spread(records: int, levels: int, azimuths: int, count: int) -> NDArray[np.int64]:
    """Indices from 0 of the realisations of jobs, (records, levels, azimuths, jobs per point).

    Each record has all realisations, equally often up to one, at different levels and azimuths: along a diagonal of
    these each realisation has one stretch. A point has several jobs, of distinct realisations, only where a record has
    fewer points than there are realisations.
    """
    random = np.random.default_rng(_SEED)
    along = _along_diagonal(levels, azimuths)
    shifts = [_permuted(random, records, size)[:, None] for size in (levels, azimuths)]
    level, azimuth = (
        (np.arange(size) + shift) % size for size, shift in zip(along.shape, shifts, strict=True)
    )
    jobs = math.ceil(count / along.size)
    place = along[level[:, :, None], azimuth[:, None, :], None] + along.size * np.arange(jobs)
    return place * count // (along.size * jobs)


def taking_turns(orders: Sequence[NDArray[np.int64]]) -> NDArray[np.int64]:
    """Interleave several orders by stretches, so that every prefix has about equally many jobs of each.

    Examples
    --------
    >>> taking_turns([np.arange(300), np.arange(300, 310)])[[0, 127, 128, 137, 138]].tolist()
    [0, 127, 300, 309, 128]
    """
    if len(orders) == 1:
        return orders[0]
    turn = np.concatenate([np.arange(len(order)) // JOBS_OF_A_SCENE for order in orders])
    return np.concatenate(orders)[np.argsort(turn, kind="stable")]


def _cells(
    random: np.random.Generator, turn: _Codes, level: _Codes, azimuth: _Codes, scene: _Codes, scenes: int
) -> NDArray[np.int64]:
    """Position of each job's level and azimuth on the diagonal of its record and scene."""
    records, levels, azimuths = (int(codes.max()) + 1 for codes in (turn, level, azimuth))
    along = _along_diagonal(levels, azimuths)
    starts = []
    for size, codes in ((levels, level), (azimuths, azimuth)):
        shuffled = random.permutation(size)[codes]
        of_record = _permuted(random, records, size)[turn]
        of_scene = random.integers(size, size=scenes)[scene]
        starts.append((shuffled - of_record - of_scene) % size)
    return along[starts[0], starts[1]]


def _permuted(random: np.random.Generator, count: int, size: int) -> NDArray[np.int64]:
    """`count` numbers below `size`: successive random permutations."""
    turns = [random.permutation(size) for _ in range(math.ceil(count / size))]
    return np.concatenate(turns)[:count]


_COLUMNS = pa.schema(
    [
        ("job_id", pa.string()),
        ("scene_id", pa.dictionary(pa.int32(), pa.string())),
        ("record_id", pa.dictionary(pa.int32(), pa.string())),
        *((name, SCHEMA.field(name if name in SCHEMA.names else f"level_{name}").type) for name in AXES),
    ]
)
"""Schema of the table of jobs, whose axes have their types in the results."""

Rows = NDArray[np.int64]
"""Indices of rows of the table of jobs, (n,)."""

_BLOCK = 10_000
"""Number of jobs whose ids are Python's strings at the same time."""

_ID_LETTERS = 24
"""Number of letters of a job's id, as `JobSpec.job_id` cuts its hash."""

_ADDED_S = 40.0
"""Duration added to a record's in the expected cost of a job, s: many shakes end before a long coda does."""


def expected_s(motion_s: float, jobs: int) -> float:
    """Expected relative cost of jobs, from the sum of the durations of their records."""
    return motion_s + _ADDED_S * jobs


@dataclass(frozen=True, eq=False)
class PlannedScene:
    """Common data of the jobs of a plan on the same rock."""

    campaign: Campaign  # campaign of this rock alone
    scene_id: str
    ensemble_id: str
    record_sha: dict[str, str]  # hash of every record in use
    duration_s: dict[str, float]  # duration of every record in use
    site: Site | None = None  # site of a rock of an atlas
    # Paths of scene and ensemble in the run's folder.
    scene_place: str = "scene"
    ensemble_place: str = "ensemble"
    bases: int = 0  # number of drawn bases that realisations use

    def among_others(self, site: Site) -> "PlannedScene":
        """Planned scene as part of an atlas."""
        scene, own = f"scenes/{site.rock}/scene", site.ensemble or site.seismograms
        ensemble = f"scenes/{site.rock}/ensemble" if own else "ensemble"
        return dataclasses.replace(self, site=site, scene_place=scene, ensemble_place=ensemble)

    @property
    def rock(self) -> str | None:
        """Name of a rock of an atlas; None for a single rock."""
        return None if self.site is None else self.site.rock


@dataclass(frozen=True, eq=False)
class Plan:
    """The jobs of a campaign."""

    campaign: Campaign
    scenes: tuple[PlannedScene, ...]  # a single one, or those of an atlas
    # One row per job: rock after rock, record after record, the longest first; for unscaled and unrotated records
    # contact after contact, because each record then shakes a rock once.
    jobs: pa.Table
    recorded: Recorded | None = None  # motions that the rock survived
    left_out: tuple[tuple[str, str], ...] = ()  # unreadable rocks of an atlas, with the reasons
    what = "shaking"  # current activity (`context.JobSelection`)

    @property
    def scene_id(self) -> str:
        """Hash of the scene, or of all scenes of an atlas."""
        return _joint([scene.scene_id for scene in self.scenes])

    @property
    def ensemble_id(self) -> str:
        """Hash of the ensemble, or of all ensembles."""
        return _joint([scene.ensemble_id for scene in self.scenes])

    def __len__(self) -> int:
        return len(self.jobs)

    @cached_property
    def id(self) -> str:
        """Hash of all jobs."""
        stood = self.recorded.identity if self.recorded else ()  # changes the weights, but not the jobs
        column = self.jobs.column("job_id")
        blocks = (column.slice(first, _BLOCK).to_pylist() for first in range(0, len(self), _BLOCK))
        return hash_of(itertools.chain(itertools.chain.from_iterable(blocks), stood))

    @cached_property
    def ids(self) -> frozenset[str]:
        """Ids of all jobs."""
        return frozenset(self.jobs.column("job_id").to_pylist())

    @cached_property
    def columns(self) -> dict[str, NDArray]:
        """Table of jobs as arrays (n,): indices of records and `scenes`, axes, durations of records."""
        record, scene = (self.jobs.column(name).combine_chunks() for name in ("record_id", "scene_id"))
        number = {scene.scene_id: number for number, scene in enumerate(self.scenes)}
        scenes = np.array([number[name] for name in scene.dictionary.to_pylist()], np.int32)[scene.indices]
        records = record.indices.to_numpy()
        known = [[scene.duration_s.get(name, np.nan) for name in self.records] for scene in self.scenes]
        axes = {name: self.jobs.column(name).to_numpy() for name in AXES}
        duration_s = np.array(known)[scenes, records]
        return {"record_id": records, "scene_id": scenes, **axes, "duration_s": duration_s}

    @cached_property
    def records(self) -> tuple[str, ...]:
        """Ids of records, by their indices in `columns`."""
        return tuple(self.jobs.column("record_id").combine_chunks().dictionary.to_pylist())

    @cached_property
    def order(self) -> NDArray[np.int64]:
        """Rows in the order to start them (`orchestrator.order`), (n,); rocks take turns."""
        orders = []
        for number in range(len(self.scenes)):
            rows = np.flatnonzero(self.columns["scene_id"] == number)
            codes = {name: _numbered(self.columns[name][rows]) for name in ("record_id", *AXES)}
            static, kinetic = codes["friction_static"], codes["friction_kinetic"]
            friction = _numbered(static * (kinetic.max(initial=0) + 1) + kinetic)
            axes = [friction, codes["restitution"], codes["realisation"]]
            sizes = tuple(int(of_axis.max(initial=0)) + 1 for of_axis in axes)
            none = np.zeros(len(rows), np.int64)  # unscaled records have no common levels
            level = codes["pga_m_s2"] if self.campaign.pga_m_s2 else none
            azimuth = codes["azimuth_deg"] if self.campaign.azimuth_deg else none
            scene = np.ravel_multi_index(axes, sizes)
            orders.append(rows[balanced_order(codes["record_id"], level, azimuth, scene, sizes)])
        return taking_turns(orders)

    def pending(self, finished: set[str]) -> Rows:
        """Rows of the jobs without a result, in the order to start them."""
        done = pc.is_in(self.jobs.column("job_id"), value_set=pa.array(sorted(finished), pa.string()))
        left = ~done.combine_chunks().to_numpy(zero_copy_only=False)
        return self.order[left[self.order]]

    def spec(self, row: int) -> JobSpec:
        """Specification of one job."""
        record, number, *axes, _ = (column[row].item() for column in self.columns.values())
        record_id, scene = self.records[record], self.scenes[number]
        return JobSpec(
            scene_id=scene.scene_id,
            record_id=record_id,
            record_sha=scene.record_sha[record_id],
            **dict(zip(AXES, axes, strict=True)),
            **self.campaign.settings,
        )

    def batch(self, rows: Rows) -> pa.Table:
        """Table of jobs for a worker: ids, records and axes."""
        chosen = self.jobs.select(["job_id", "record_id", *AXES]).take(rows)
        return chosen.set_column(1, "record_id", chosen["record_id"].cast(pa.string()))

    def with_ids(self) -> "Plan":
        """Plan with job ids computed from the specifications."""
        letters = np.empty((len(self), _ID_LETTERS), np.uint8)
        for number in range(len(self.scenes)):
            rows = np.flatnonzero(self.columns["scene_id"] == number)
            for block in (rows[first : first + _BLOCK] for first in range(0, len(rows), _BLOCK)):
                letters[block] = np.frombuffer(self._ids(block), np.uint8).reshape(-1, _ID_LETTERS)
        ends = np.arange(0, letters.size + 1, _ID_LETTERS, dtype=np.int32)
        column = pa.StringArray.from_buffers(len(self), pa.py_buffer(ends), pa.py_buffer(letters))
        return dataclasses.replace(self, jobs=self.jobs.set_column(0, _COLUMNS.field("job_id"), column))

    def _ids(self, rows: Rows) -> bytes:
        """Ids of jobs of one scene, as `JobSpec.job_id`, from a common text in which only a few values differ."""
        names = ("record_id", "record_sha", *AXES)
        content = dataclasses.asdict(self.spec(int(rows[0]))) | {name: f"<{name}>" for name in names}
        text = json.dumps({**content, "physics_version": PHYSICS_VERSION}, sort_keys=True).replace("%", "%%")
        sha = self.scenes[self.columns["scene_id"][rows[0]]].record_sha
        records = [(json.dumps(name), json.dumps(sha.get(name))) for name in self.records]
        used = [records[number] for number in self.columns["record_id"][rows].tolist()]
        texts: dict[str, Sequence[str]] = dict(zip(names, zip(*used, strict=True), strict=False))
        texts |= {name: [*map(repr, self.columns[name][rows].tolist())] for name in AXES}
        places = sorted(names, key=lambda name: text.index(f'"<{name}>"'))
        for name in names:
            text = text.replace(f'"<{name}>"', "%s")
        differing = zip(*(texts[name] for name in places), strict=True)
        ids = (hashlib.sha256((text % values).encode()).hexdigest()[:_ID_LETTERS] for values in differing)
        return "".join(ids).encode()


def _numbered(values: NDArray) -> NDArray[np.int64]:
    """Index of each value among the distinct values."""
    return np.unique(values, return_inverse=True)[1]


def plan_of(campaign: Campaign) -> Plan:
    """Expand a campaign to its jobs, loading its scenes and ensembles one at a time.

    Raises InputError as `plan`; for an atlas, if no rock can be read, or two are the same.
    """
    if not campaign.sites:
        return plan(campaign, Scene.load(campaign.scene), Ensemble.load(campaign.ensemble))
    parts: list[Plan] = []
    left_out: list[tuple[str, str]] = []
    for site in campaign.sites:
        try:
            scene = Scene.load(site.scene)
        except InputError as error:
            left_out.append((site.rock, str(error)))
            continue
        alone = campaign.of_site(site)
        (planned,) = (part := plan(alone, scene, Ensemble.load(alone.ensemble))).scenes
        parts.append(dataclasses.replace(part, scenes=(planned.among_others(site),)))
        _check_atlas(parts)
    if not parts:
        what = f"none of {len(left_out)} rocks can be read; {left_out[0][0]}: {left_out[0][1]}"
        raise InputError(
            "rocks.none_readable",
            what,
            where=str(campaign.scene),
            expected="scenes",
            remedy="make them again",
        )
    jobs = pa.concat_tables([part.jobs for part in parts]).unify_dictionaries().combine_chunks()
    return Plan(campaign, tuple(part.scenes[0] for part in parts), jobs, left_out=tuple(left_out))


def _check_atlas(parts: Sequence[Plan]) -> None:
    """Refuse duplicate rocks, and too many jobs."""
    last = parts[-1].scenes[0]
    for other in (part.scenes[0] for part in parts[:-1]):
        if other.scene_id == last.scene_id:
            raise InputError(
                "rock.given_twice",
                f"the rocks {other.rock} and {last.rock} are one (scene {last.scene_id})",
                where=str(last.campaign.scene),
                expected="each rock once",
                remedy="leave one out, or give it a campaign of its own",
            )
    if (jobs := sum(map(len, parts))) > MOST_JOBS:
        what = f"{jobs:.3g} jobs of the first {len(parts)} rocks"
        raise InputError(
            "campaign.too_many_jobs",
            what,
            where="campaign",
            expected=f"at most {MOST_JOBS} jobs",
            remedy="divide it into several",
        )


def _joint(ids: Sequence[str]) -> str:
    """Common id of several, or hash of all ids."""
    return ids[0] if len(set(ids)) == 1 else hash_of(ids)


def plan(campaign: Campaign, scene: Scene, ensemble: Ensemble) -> Plan:
    """Expand a campaign of one rock to its jobs.

    Raises InputError if the campaign names a record that the ensemble lacks, the ensemble is empty, a survived motion
    cannot be read or used, or a record is sampled too coarsely for its stated band.
    """
    duration_s = _durations_s(ensemble, campaign.records, str(campaign.ensemble))
    records = list(duration_s)
    campaign.check_jobs(len(records))
    if campaign.unmeasured and campaign.unmeasured.band_hz:
        _check_band(campaign.unmeasured.band_hz, ensemble, records, str(campaign.ensemble))
    recorded = None
    if campaign.stood:
        check_weighable(scene, campaign.first_realisation + campaign.realisations - 1, str(campaign.scene))
        recorded = read_recorded(campaign.stood)
    sha = {record: ensemble.sha(record) for record in records}
    own = dict(zip(ensemble.record_ids, ensemble.catalog.to_pylist(), strict=True))
    levels = sorted(campaign.pga_m_s2, reverse=True) or [np.nan]  # NaN for unscaled records
    azimuths = sorted(campaign.azimuth_deg) or [np.nan]
    numbers = campaign.first_realisation + realisations_spread(
        len(records), len(levels), len(azimuths), campaign.realisations
    ).astype(np.int32)
    shape = len(campaign.friction), len(campaign.restitution), *numbers.shape
    often = numbers[0].size > campaign.realisations
    codes, level, azimuth, friction, restitution, realisation = _ordered(shape, numbers, often=often)
    static, kinetic = np.array(campaign.friction).T
    axes = [
        np.array(levels)[level], np.array(azimuths)[azimuth], static[friction], kinetic[friction],
        np.array(campaign.restitution)[restitution], realisation,
    ]  # fmt: skip
    for column, name, stated in (
        (0, "pga_m_s2", campaign.pga_m_s2), (1, "strong_azimuth_deg", campaign.azimuth_deg),
    ):  # fmt: skip
        if not stated:
            axes[column] = np.array([own[record][name] for record in records])[codes]
    scene_id = scene.id
    of_scene = pa.DictionaryArray.from_arrays(np.zeros(len(codes), np.int32), pa.array([scene_id]))
    of_record = pa.DictionaryArray.from_arrays(codes, pa.array(records))
    columns = [pa.nulls(len(codes)), of_scene, of_record, *map(pa.array, axes)]
    jobs = pa.Table.from_arrays(columns, names=_COLUMNS.names).cast(_COLUMNS)
    del level, azimuth, friction, restitution, axes, columns  # while ids are made
    bases = 0 if scene.unseen is None else len(scene.unseen)
    scenes = (PlannedScene(campaign, scene_id, ensemble.id, sha, duration_s, bases=bases),)
    return Plan(campaign, scenes, jobs, recorded).with_ids()


def _ordered(shape: tuple[int, ...], realisation: NDArray[np.int32], *, often: bool) -> list[NDArray]:
    """Indices of record, level, azimuth, friction, restitution, and the realisation of each job, in the plan's order.

    One record's points: those of one scene together, and of them the strongest shaking, the longest, first. Where a
    record shakes a scene once, making many scenes ready would cost more than reading many records.

    shape: numbers of frictions, restitutions, records, levels, azimuths, and jobs per point.
    often: whether a record shakes a scene more than once.
    """
    friction, restitution, record, level, azimuth, _ = np.indices(shape, np.int32).reshape(len(shape), -1)
    realisation = np.broadcast_to(realisation, shape).ravel()
    scene_keys = azimuth, level, realisation, restitution, friction
    order = np.lexsort((*scene_keys, record) if often else (record, *scene_keys))
    return [values[order] for values in (record, level, azimuth, friction, restitution, realisation)]


def _check_band(band_hz: float, ensemble: Ensemble, records: list[str], where: str) -> None:
    """Refuse in advance what :func:`models.motions.above_band.with_motion_above` would refuse in each job."""
    step_s = dict(zip(ensemble.record_ids, ensemble.catalog["time_step_s"].to_pylist(), strict=True))
    coarsest = max(records, key=lambda record: step_s[record])
    check_step(step_s[coarsest], band_hz, f"{where}: record {coarsest}")


def _durations_s(ensemble: Ensemble, asked: Sequence[str] | None, where: str) -> dict[str, float]:
    """Durations of the records to use, by id, the longest first."""
    catalog, known = ensemble.catalog, ensemble.record_ids
    duration = dict(zip(catalog["record_id"].to_pylist(), catalog["duration_s"].to_pylist(), strict=True))
    if missing := [name for name in asked or () if name not in duration]:
        more = " ..." if len(missing) > 10 else ""
        remedy = "correct 'records' in the campaign, or import the records into the ensemble"
        raise InputError(
            "ensemble.record_unknown",
            f"records {', '.join(missing[:10])} are not in the ensemble{more}",
            where=where,
            expected=f"ids of its {len(known)} records, such as {', '.join(known[:5])}",
            remedy=did_you_mean(missing[0], known, remedy),
        )
    if not duration:
        raise InputError(
            "ensemble.empty",
            "the ensemble holds no records, so there are no jobs",
            where=where,
            expected="at least one record",
            remedy="import some with 'toppling records import'",
        )
    return {name: duration[name] for name in sorted(asked or known, key=lambda name: (-duration[name], name))}
