"""In which order jobs go out: in blocks that are balanced samples, so that an interrupted run is a smaller run.

A block holds of each record the same number of jobs, at levels and azimuths that its records share out evenly. Records
take their levels and azimuths along diagonals of the grid: neighbouring cells differ in both, and any stretch of a
diagonal holds every level, and every azimuth, equally often but for one. Where a campaign has several scenes (contacts,
realisations) a block is of one of them; blocks go round the scenes. Realisations are spread over the jobs of each
record along such a diagonal too. Of more scenes than a worker keeps ready, blocks
are larger, as making one ready costs as much as several jobs.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

_SEED = 2017
"""Any number would do: the order is random with regard to the answers, and the same on every machine."""

_RECORDS_TOGETHER = 64
"""Records that share a block, as many as a worker keeps in memory."""

_JOBS_OF_A_RECORD = 4
"""In a block of more records than that: reading one costs a few milliseconds."""

_SCENES_KEPT = 8
"""By a worker."""

JOBS_OF_A_SCENE = 128
"""Of more scenes so many jobs go out with one before the next: making it ready costs a third of a second."""

JOBS_OF_A_ROCK = 256
"""Of an atlas so many jobs go out with one rock before the next, and a batch, which is of one rock, ends there."""

_Codes = NDArray[np.integer]


def diagonal(*sizes: int) -> NDArray[np.int64]:
    """Cells of a grid, each once, so that every stretch holds each value of an axis equally often, but for one or two.

    *sizes: of the axes.
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
        # At each return to its corner the diagonal moves on to the next one.
        turned = (place + place // math.lcm(count, size)) % size
        cells = np.column_stack([cells[place % count], turned])
    return cells


def _along_diagonal(*sizes: int) -> NDArray[np.int64]:
    """For each cell of a grid its place on that diagonal."""
    places = np.empty(sizes, np.int64)
    places[tuple(diagonal(*sizes).T)] = np.arange(places.size)
    return places


def block_jobs(records: int, levels: int, azimuths: int, scenes: int) -> tuple[int, int]:
    """Groups that records are divided into, and jobs of a record in a block."""
    groups = 1 if scenes == 1 else math.ceil(records / _RECORDS_TOGETHER)
    if scenes > _SCENES_KEPT:
        jobs = math.ceil(JOBS_OF_A_SCENE * groups / records)
    else:
        jobs = _JOBS_OF_A_RECORD if records / groups > _RECORDS_TOGETHER else 1
    return groups, min(jobs, levels * azimuths)


def balanced_order(
    record: _Codes, level: _Codes, azimuth: _Codes, scene: _Codes, scene_sizes: tuple[int, ...] = ()
) -> NDArray[np.int64]:
    """Order of some jobs of a campaign, of which every beginning is balanced up to one block.

    record, level, azimuth, scene: (n,), for each job the numbers of these, from 0; no two jobs have all four in
    common.
    scene_sizes: of the axes that scenes are numbered along, the last the fastest; one axis unless given.
    Returns (n,) int array: places of the jobs, the first to go out first.
    """
    if not len(record):
        return np.zeros(0, np.int64)
    records, levels, azimuths, scenes = (int(codes.max()) + 1 for codes in (record, level, azimuth, scene))
    sizes = scene_sizes or (scenes,)
    scenes = math.prod(sizes)
    random = np.random.default_rng(_SEED)
    groups, jobs = block_jobs(records, levels, azimuths, scenes)
    turn = random.permutation(records)[record]  # a record's place among records
    group = turn * groups // records
    cell = _cells(random, turn, level, azimuth, scene, scenes)
    rank = _rank_within(turn * scenes + scene, cell)
    visit, within = np.divmod(rank, jobs)
    # The round of scenes goes along a diagonal of their axes, whose values are shuffled.
    shuffled = np.ix_(*(np.argsort(random.permutation(size)) for size in sizes))
    place = _along_diagonal(*sizes)[shuffled].ravel()[scene]
    # A group of records is at the scene after that of the group before it.
    step = visit * scenes + (place - group) % scenes
    return np.lexsort((within, turn, group, step))


def _rank_within(groups: _Codes, values: _Codes) -> NDArray[np.int64]:
    """For each value its place, from 0, among those of its group."""
    ordered = np.lexsort((values, groups))
    first = np.r_[True, np.diff(groups[ordered]) != 0]
    places, rank = np.arange(len(ordered)), np.empty(len(ordered), np.int64)
    rank[ordered] = places - np.maximum.accumulate(np.where(first, places, 0))
    return rank


def realisations_spread(records: int, levels: int, azimuths: int, count: int) -> NDArray[np.int64]:
    """Numbers from 0 of the realisations that jobs take, (records, levels, azimuths, jobs of such a point).

    Each record meets all realisations, equally often but for one, at levels and azimuths of its own: along a diagonal
    of these a realisation has the next stretch. A point has more than one job only where a record has fewer points than
    there are realisations.
    """
    random = np.random.default_rng(_SEED)
    along = _along_diagonal(levels, azimuths)
    shifts = [_shared_out(random, records, size)[:, None] for size in (levels, azimuths)]
    level, azimuth = (
        (np.arange(size) + shift) % size for size, shift in zip(along.shape, shifts, strict=True)
    )
    jobs = math.ceil(count / along.size)
    place = along[level[:, :, None], azimuth[:, None, :], None] * jobs + np.arange(jobs)
    return place * count // (along.size * jobs)


def taking_turns(orders: Sequence[NDArray[np.int64]]) -> NDArray[np.int64]:
    """Several orders as one: a stretch of each in turn, so that every beginning holds about as much of each.

    Examples
    --------
    >>> taking_turns([np.arange(300), np.arange(300, 310)])[[0, 255, 256, 265, 266]].tolist()
    [0, 255, 300, 309, 256]
    """
    if len(orders) == 1:
        return orders[0]
    turn = np.concatenate([np.arange(len(order)) // JOBS_OF_A_ROCK for order in orders])
    return np.concatenate(orders)[np.argsort(turn, kind="stable")]


def _cells(
    random: np.random.Generator, turn: _Codes, level: _Codes, azimuth: _Codes, scene: _Codes, scenes: int
) -> NDArray[np.int64]:
    """For each job the place of its level and azimuth on its record's diagonal in its scene."""
    records, levels, azimuths = (int(codes.max()) + 1 for codes in (turn, level, azimuth))
    along = _along_diagonal(levels, azimuths)
    starts = []
    for size, codes in ((levels, level), (azimuths, azimuth)):
        shuffled = random.permutation(size)[codes]
        of_record = _shared_out(random, records, size)[turn]
        of_scene = random.integers(size, size=scenes)[scene]
        starts.append((shuffled - of_record - of_scene) % size)
    return along[starts[0], starts[1]]


def _shared_out(random: np.random.Generator, count: int, size: int) -> NDArray[np.int64]:
    """Numbers below `size`, every one once in each stretch of so many, in random order."""
    turns = [random.permutation(size) for _ in range(math.ceil(count / size))]
    return np.concatenate(turns)[:count]
