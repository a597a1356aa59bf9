"""Whatever is done of a campaign when it is interrupted, or timed beforehand, is a balanced sample of it."""

import math
from itertools import pairwise, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from toppling.orchestrator.pilot import timed_jobs
from toppling.orchestrator.plan import JOBS_OF_A_SCENE, balanced_order, block_jobs

RECORD, SCENE, LEVEL, AZIMUTH = range(4)


def ordered(records, levels, azimuths, scenes=(1,)):
    """Record, scene, level and azimuth of each job, in the order in which they go out, (n, 4)."""
    sizes = (records, math.prod(scenes), levels, azimuths)
    grid = np.array(list(product(*map(range, sizes))))
    order = balanced_order(*(grid[:, axis] for axis in (RECORD, LEVEL, AZIMUTH, SCENE)), scenes)
    assert np.array_equal(np.sort(order), np.arange(len(grid)))
    return grid[order]


def largest_deviation(values):
    """By how many jobs a value's number differs most, over all beginnings, from an even share."""
    each = values[:, None] == np.arange(values.max() + 1)
    even = np.arange(1, len(values) + 1)[:, None] / each.shape[1]
    return float(np.abs(np.cumsum(each, axis=0) - even).max())


@settings(max_examples=40)
@given(records=st.integers(1, 80), levels=st.integers(1, 12), azimuths=st.integers(1, 12))
def test_in_every_beginning_records_levels_and_azimuths_are_balanced_up_to_a_block(records, levels, azimuths):
    jobs = ordered(records, levels, azimuths)
    of_a_record = block_jobs(records, levels, azimuths, 1)[1]
    assert largest_deviation(jobs[:, RECORD]) < of_a_record
    for axis, size in ((LEVEL, levels), (AZIMUTH, azimuths)):
        assert largest_deviation(jobs[:, axis]) <= of_a_record + size / 4 + 2


def test_after_a_quarter_of_a_run_each_record_level_and_azimuth_has_had_its_quarter():
    jobs = ordered(30, 12, 12)[: int(0.26 * 4320)]
    assert set(np.bincount(jobs[:, RECORD], minlength=30)) == {37, 38}
    assert np.ptp(np.bincount(jobs[:, LEVEL], minlength=12)) <= 2
    assert np.ptp(np.bincount(jobs[:, AZIMUTH], minlength=12)) <= 2
    # Levels do not go with azimuths, nor with records: no table of the two is less filled than chance would have it.
    for pair in ([LEVEL, AZIMUTH], [RECORD, LEVEL], [RECORD, AZIMUTH]):
        assert len(np.unique(jobs[:, pair], axis=0)) > 0.95 * np.prod(jobs[:, pair].max(axis=0) + 1)


def test_scenes_change_seldom_and_come_round_evenly():
    scenes, records = (2, 1, 10), 30
    jobs = ordered(records, 12, 12, scenes)
    changes = 1 + sum(one != other for one, other in pairwise(jobs[:, SCENE].tolist()))
    assert len(jobs) / changes >= JOBS_OF_A_SCENE * 0.9
    of_block = records * block_jobs(records, 12, 12, 20)[1]
    assert largest_deviation(jobs[:, SCENE]) <= of_block
    friction = jobs[:, SCENE] // 10
    assert largest_deviation(friction) <= of_block


@pytest.mark.parametrize(("jobs", "timed"), [(3, 1), (20, 4), (165, 12), (21280, 48)])
def test_of_every_plan_some_jobs_are_timed_and_of_a_small_one_few(jobs, timed):
    assert timed_jobs(jobs) == timed
