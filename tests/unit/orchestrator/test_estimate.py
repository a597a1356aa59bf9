"""Time told beforehand: which jobs are timed, and how near their mean comes to that of all."""

import numpy as np
import pytest
from small_campaigns import planned_in

from toppling.orchestrator.pilot import (
    sampled_rows,
    spread,
    timed_jobs,
)


@pytest.fixture(scope="module")
def planned(tmp_path_factory):
    periods_s, axes = np.arange(0.3, 1.45, 0.1), {"azimuth_deg": [0, 90, 180, 270], "preset": "fast"}
    return planned_in(tmp_path_factory.mktemp("estimate"), periods_s, pga_m_s2=list(range(1, 20)), **axes)


def test_every_beginning_of_the_order_is_spread():
    order = spread(1000, 64)
    assert len(set(order)) == 64
    for count in (8, 16, 64):
        assert np.diff(np.sort(order[:count])).max() <= 3 * 1000 / count


def test_the_mean_of_the_timed_jobs_is_within_a_factor_of_one_and_a_half(planned):
    """Costs as jobs have them: nearly none below a level, then by the record and with chance, little once it falls."""
    level = planned.jobs["pga_m_s2"].to_numpy()
    record = planned.jobs["record_id"].combine_chunks().indices.to_numpy()
    near = []
    for seed in range(200):
        random = np.random.default_rng(seed)
        starts, falls = random.uniform(2, 4, 12)[record], random.uniform(5, 18, 12)[record]
        cost = np.where(
            level < starts, 0.002, random.gamma(2.0, 0.1, len(level)) * random.lognormal(0, 0.5, 12)[record]
        )
        cost = np.where(level > falls, 0.3 * cost, cost)
        told = cost[sampled_rows(planned)].mean()
        near.append(1 / 1.5 < told / cost.mean() < 1.5)
    assert np.mean(near) > 0.95


@pytest.mark.parametrize(("jobs", "timed"), [(3, 3), (20, 6), (165, 20), (21280, 48)])
def test_of_every_plan_some_jobs_are_timed_and_of_a_small_one_few(jobs, timed):
    assert timed_jobs(jobs) == timed
