"""Order of jobs in blocks that are balanced samples, so that an interrupted run is a smaller valid run.

A block contains the same number of jobs of each record, evenly distributed over levels and azimuths. Records take their
levels and azimuths along diagonals of the grid: neighbouring cells differ in both, and any stretch of a diagonal
contains every level, and every azimuth, equally often up to one. Where a campaign has several scenes (contacts,
realisations) a block has a single one; successive blocks cycle through them. Realisations are distributed over the jobs
of each record along such a diagonal too. With more scenes than a worker caches, blocks are larger, because preparing a
scene costs as much as several jobs.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

_SEED = 2017
"""Seed of the order, which is arbitrary but equal on all machines."""
_RECORDS_TOGETHER = 64
"""Number of records per block, as many as a worker caches."""
_JOBS_OF_A_RECORD = 4
"""Number of jobs per record in a block if there are more records than that: loading one takes a few milliseconds."""
_SCENES_CACHED = 8
"""Number of scenes that a worker caches."""
JOBS_OF_A_SCENE = 128
"""Number of successive jobs of a scene if there are more scenes than that: preparing one takes a third of a second."""
JOBS_OF_A_ROCK = 256
"""Number of successive jobs of a rock of an atlas, after which a batch ends: a batch has a single rock."""

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
    groups = 1 if scenes == 1 else math.ceil(records / _RECORDS_TOGETHER)
    if scenes > _SCENES_CACHED:
        jobs = math.ceil(JOBS_OF_A_SCENE * groups / records)
    else:
        jobs = _JOBS_OF_A_RECORD if records / groups > _RECORDS_TOGETHER else 1
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
    these each realisation has one stretch. A point has more than one job only where a record has fewer points than
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
    """Interleave several orders by stretches, so that every prefix has about equally many jobs of each.

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
    """Position of each job's level and azimuth on the diagonal of its record and scene."""
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
    """`count` numbers below `size`: successive random permutations."""
    turns = [random.permutation(size) for _ in range(math.ceil(count / size))]
    return np.concatenate(turns)[:count]
