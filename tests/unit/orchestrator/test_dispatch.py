"""The laws of handing out, whatever comes back in whatever order."""

import heapq

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from toppling.orchestrator.dispatch import FIRST_JOBS, Dispatch, Limits
from toppling.orchestrator.execution import budget_s, room_for
from toppling.orchestrator.plan import balanced_order


@pytest.mark.parametrize(("jobs", "workers", "last"), [(1000, 2, 60), (100, 2, 20), (1000, 64, 200)])
def test_the_last_jobs_go_out_the_longest_records_first(jobs, workers, last):
    order, duration_s = np.random.default_rng(1).permutation(jobs), np.arange(float(jobs))
    dispatch, out = Dispatch(order, duration_s), []
    while batch := dispatch.next_batch(workers):
        out += batch.jobs
    head = next(number for number in range(jobs) if out[number:] == sorted(out[number:], reverse=True))
    assert out[:head] == order[:head].tolist()
    assert last - FIRST_JOBS // 4 <= jobs - head <= last
    assert sorted(out) == list(range(jobs))


def test_a_job_is_given_up_after_as_many_deaths_of_its_lone_workers_as_are_allowed():
    dispatch = Dispatch(np.arange(1), np.ones(1))
    dispatch.died(dispatch.next_batch(1))  # not alone: says nothing of this job
    assert [dispatch.died(dispatch.next_batch(1)) for _ in range(Limits.tries)] == [None, None, 0]


@settings(max_examples=60)
@given(jobs=st.integers(1, 300), killer=st.integers(0, 59), seed=st.integers(0, 2**32 - 1))
def test_under_any_course_of_events_every_job_ends_once_and_only_killers_are_given_up(jobs, killer, seed):
    dispatch = Dispatch(np.arange(jobs), np.ones(jobs))
    rng = np.random.default_rng(seed)
    done, given_up, flying = [], [], []
    while dispatch or flying:
        while len(flying) < 6 and (batch := dispatch.next_batch(2)):
            flying.append(batch)
        batch = flying.pop(rng.integers(len(flying)))
        if killer in batch.jobs:
            lost = dispatch.died(batch)
            given_up += [] if lost is None else [lost]
        elif not batch.alone and rng.random() < 0.2:
            dispatch.died(batch)  # a node was taken away
        else:
            count = int(rng.integers(1, len(batch.jobs) + 1))
            done += batch.jobs[:count]
            dispatch.came_back(batch, count)
    assert sorted(done + given_up) == list(range(jobs))
    assert given_up == ([killer] if killer < jobs else [])


def idle_fraction_at_the_end(cost_s, duration_s, workers):
    """Play a run against a clock, with the window of batches that the run keeps in flight."""
    dispatch, budget, room = Dispatch(np.arange(len(cost_s)), duration_s), budget_s(workers), FIRST_JOBS
    window, ended = [], np.zeros(workers)
    free = [(0.0, worker) for worker in range(workers)]
    while True:
        while len(window) < workers + 2 and (batch := dispatch.next_batch(workers, room)):
            window.append(batch)
        if not window:
            return 1 - ended.mean() / ended.max()
        batch, (now, worker) = window.pop(0), heapq.heappop(free)
        spent = np.cumsum(cost_s[list(batch.jobs)])
        done = min(int(np.searchsorted(spent, budget)) + 1, len(spent))
        dispatch.came_back(batch, done)
        room = room_for(done, spent[done - 1], budget)
        ended[worker] = now + spent[done - 1]
        heapq.heappush(free, (ended[worker], worker))


@pytest.mark.parametrize("workers", [1, 2, 16, 128])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_no_worker_idles_more_than_a_twentieth_of_a_study(workers, seed):
    # 140 records of 152 jobs, a tenth of a second each on average; jobs of one record differ by a factor of e.
    random = np.random.default_rng(seed)
    record_of = np.repeat(np.arange(140), 152)
    level, azimuth = np.divmod(np.tile(np.arange(152), 140), 8)
    order = balanced_order(record_of, level, azimuth, np.zeros_like(level))
    record_of = record_of[order]
    cost_s = np.geomspace(3.0, 0.3, 140)[record_of] * random.lognormal(0.0, 0.8, len(record_of))
    cost_s *= 0.1 / cost_s.mean()
    assert idle_fraction_at_the_end(cost_s, 140.0 - record_of, workers) <= 0.05
