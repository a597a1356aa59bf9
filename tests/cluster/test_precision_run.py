"""On real workers: a run that ends with a statement does the jobs that one process would, however it went."""

from contextlib import nullcontext

import numpy as np
import pytest
from answers import sorted_answers
from small_campaigns import campaign_in

from toppling.models.motions.ensemble import Ensemble
from toppling.models.scene import Scene
from toppling.orchestrator.plan import plan_of
from toppling.orchestrator.run import run
from toppling.orchestrator.status import state_of
from toppling.results.precision.design import statements_of
from toppling.results.reader import open_run
from toppling.workers.job import Assets, run_job

pytestmark = pytest.mark.thorough
PRECISION = 0.15


def silent(progress):
    """Watch nothing."""


def stop_after(jobs):
    def watch(progress):
        if progress.done > jobs:
            raise KeyboardInterrupt

    return watch


@pytest.fixture(scope="module")
def asking(tmp_path_factory):
    """A campaign of 1,440 jobs of some hundredths of a second, few of which a statement needs."""
    axes = {
        "pga_m_s2": [1 + 0.5 * n for n in range(18)], "azimuth_deg": [0, 90, 180, 200], "preset": "fast",
        "audit": 0, "precision": PRECISION,
    }  # fmt: skip
    return campaign_in(tmp_path_factory.mktemp("asking"), np.geomspace(0.4, 1.6, 20), name="P{:02d}", **axes)


@pytest.fixture(scope="module")
def planned(asking):
    return plan_of(asking)


@pytest.fixture(scope="module")
def whole(asking, client, tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole") / "run"
    run(plan_of(asking), folder, nullcontext(client), silent)
    return folder


def test_a_precision_run_ends_early_with_rows_equal_to_those_of_a_single_process(whole, planned, asking):
    (result,) = statements_of(whole)
    rows = open_run(whole).table()
    assert result["ended"]
    assert result["reason"] == ""
    assert result["precision"] <= PRECISION
    assert result["jobs"] == len(rows) == sum(result["rounds"]) < len(planned) / 3
    assert result["low"] < result["value"] < result["high"]
    state = state_of(whole)
    assert (state["state"], state["jobs"], state["stored"]) == ("complete", len(rows), len(rows))
    assert open_run(whole).completeness().remark == ""
    rows = sorted_answers(rows)
    assets = Assets(Scene.load(asking.scene), Ensemble.load(asking.ensemble))
    places = {job_id: row for row, job_id in enumerate(planned.jobs["job_id"].to_pylist())}
    some = rows[:: max(len(rows) // 12, 1)]
    assert sorted_answers([run_job(planned.spec(places[row["job_id"]]), assets) for row in some]) == some


def test_a_run_that_is_stopped_goes_on_to_the_same_rows(asking, client, whole, tmp_path, faults):
    folder = tmp_path / "run"
    faults.set(every=0.05)
    for jobs in (10, 15):
        with pytest.raises(KeyboardInterrupt):
            run(plan_of(asking), folder, nullcontext(client), stop_after(jobs))
    assert state_of(folder)["state"] == "interrupted"
    run(plan_of(asking), folder, nullcontext(client), silent)
    assert sorted_answers(open_run(folder).table()) == sorted_answers(open_run(whole).table())
    assert statements_of(folder) == statements_of(whole)
