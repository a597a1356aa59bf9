"""Jobs on their way through a cluster that is none: what is done again, given up, sent away, stored."""

import json
import sys
from collections import Counter
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from fake_cluster import FakeCluster
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from small_campaigns import planned_in

from toppling.orchestrator import execution
from toppling.orchestrator.context import RunError, RunProgress, Work
from toppling.orchestrator.dispatch import Limits
from toppling.orchestrator.execution import Asked, Execution, work_off
from toppling.orchestrator.journal import journal
from toppling.results.store import finished_ids, newest_rows, result_files

sys.path.insert(0, str(Path(__file__).parents[3] / "benchmarks"))
from scaling import pretended_rows


@pytest.fixture(scope="module")
def planned(tmp_path_factory):
    folder = tmp_path_factory.mktemp("inputs")
    plan = planned_in(folder, (0.6, 1.0, 1.4), pga_m_s2=[2, 4, 6, 8], azimuth_deg=[0, 90])
    return plan, pretended_rows(Asked(plan, folder), np.arange(len(plan)), 0.1), folder


class Session:
    def __init__(self, planned, folder, monkeypatch, **cluster):
        self.plan, self.table, inputs = planned
        self.folder, self.cluster = folder, FakeCluster(self.table, **cluster)
        folder.mkdir(exist_ok=True)
        with suppress(FileExistsError):
            (folder / "ensemble").symlink_to(inputs / "ensemble")
        monkeypatch.setattr(execution, "time", SimpleNamespace(monotonic=self.cluster.monotonic))

    def __call__(self, watch=lambda progress: None, limits=None, redo=None):
        pending = self.plan.pending(finished_ids(self.folder, redo=redo or {}))
        self.progress = RunProgress(len(self.plan), 0, began=0.0)
        work = Work(self.plan, self.folder, (), None, watch, self.progress, limits or Limits(), redo or {})
        with journal(self.folder):
            Execution(work, pending, cluster=self.cluster)()
        return self.progress

    @property
    def rows(self):
        return {row["job_id"]: row for row in newest_rows(result_files(self.folder)).to_pylist()}

    @property
    def log(self):
        return [json.loads(line) for line in (self.folder / "run.log").read_text().splitlines()]


@pytest.fixture
def session(planned, tmp_path, monkeypatch):
    return lambda **cluster: Session(planned, tmp_path / "run", monkeypatch, **cluster)


def job_of(planned, number):
    return planned[0].jobs["job_id"][number].as_py()


def statuses(session):
    return Counter(row["status"] for row in session.rows.values())


def test_every_job_is_stored_once_as_its_worker_gave_it(planned, session):
    case = session()
    progress = case()
    assert (progress.done, progress.stored, progress.deaths, progress.failed) == (24, 24, 0, 0)
    stored = newest_rows(result_files(case.folder)).sort_by("job_id")
    assert stored.drop_columns("attempt") == planned[1].sort_by("job_id").drop_columns("attempt")
    assert set(stored["attempt"].to_pylist()) == {1}


def test_workers_that_leave_cost_no_try_and_are_no_deaths(session):
    case = session(faults=lambda job, begun: "left" if begun <= 4 else None, jobs_at_once=1)
    progress = case(limits=Limits(tries=1))
    assert (progress.deaths, statuses(case)) == (0, {"ok": 24})
    assert {row["attempt"] for row in case.rows.values()} == {1}
    assert any(entry["event"] == "worker left" for entry in case.log)


def test_a_row_that_does_not_answer_its_job_is_tried_again_and_fails_if_none_does(planned, session):
    once, always = job_of(planned, 3), job_of(planned, 17)
    case = session(faults=lambda job, begun: "lie" if job == always or (job == once and begun == 1) else None)
    progress = case()
    assert statuses(case) == {"ok": 23, "failed": 1}
    assert case.rows[always]["status"] == "failed"
    assert "pgv_m_s is 0.5" in case.rows[always]["message"]
    assert case.rows[once]["pgv_m_s"] != 0.5
    assert progress.deaths == 0


def test_a_host_that_cannot_store_what_it_is_sent_is_dismissed(session):
    case = session(
        faults=lambda job, begun: "undelivered" if case.cluster.workers == 2 else None, full_hosts=True
    )
    case()
    assert case.cluster.requests.count(("dismiss", "worker 0")) == 1
    assert statuses(case) == {"ok": 24}


def test_an_unfit_worker_is_dismissed_and_without_a_fit_worker_the_run_ends(session):
    case = session(faults=lambda job, begun: "unfit" if case.cluster.workers == 2 else None)
    case()
    assert statuses(case) == {"ok": 24}
    none = session(faults=lambda job, begun: "unfit", workers=1)
    (none.folder / "parts").rename(none.folder / "before")
    with pytest.raises(RunError, match="no fit worker is left"):
        none()


def test_what_was_in_flight_when_the_scheduler_was_lost_goes_out_again(planned, session):
    fatal = {job_of(planned, 2): 1, job_of(planned, 11): 2}
    case = session(
        faults=lambda job, begun: "lost" if fatal.get(job) == begun else "left" if begun == 1 else None
    )
    progress = case()
    assert (progress.deaths, statuses(case)) == (0, {"ok": 24})
    assert [v for v, _ in case.cluster.requests].count("rejoin") >= 1
    events = [entry["event"] for entry in case.log]
    assert events.count("scheduler lost") == events.count("scheduler came back") >= 1


def test_a_task_that_no_worker_can_do_ends_the_run_and_what_is_stored_stays(planned, session):
    case = session(faults=lambda job, begun: "error" if job == job_of(planned, 23) else None, jobs_at_once=1)
    with pytest.raises(RunError, match="the cluster cannot do a task"):
        case()
    assert 0 < len(case.rows) < 24
    assert case.cluster.requests[-1][0] == "cancel"


def test_an_interruption_stores_what_has_come_and_gives_up_what_is_handed_out(session):
    def stop(progress):
        if progress.done >= 10:
            raise KeyboardInterrupt

    case = session()
    with pytest.raises(KeyboardInterrupt):
        case(stop)
    assert 10 <= len(case.rows) < 24
    assert case.cluster.requests[-1][0] == "cancel"
    before = len(case.rows)
    assert case().done == 24 - before
    assert statuses(case) == {"ok": 24}


def test_jobs_that_are_done_again_have_a_newer_attempt_and_the_newest_counts(planned, session):
    culprit = job_of(planned, 3)
    case = session(faults=lambda job, begun: "died" if job == culprit else None)
    case(limits=Limits(tries=1))
    assert (case.rows[culprit]["status"], case.rows[culprit]["attempt"]) == ("crashed", 2)
    again = session()
    progress = again(redo={culprit: 2})
    assert progress.done == 1
    assert (again.rows[culprit]["status"], again.rows[culprit]["attempt"]) == ("ok", 3)


def test_parts_that_are_lost_are_done_again_and_if_that_goes_on_the_disk_is_blamed(
    planned, session, monkeypatch
):
    first, lose = session(), []

    def run(work, pending):
        execution_of = Execution(work, pending, cluster=first.cluster)
        return lambda: (execution_of(), lose and lose.pop() and result_files(first.folder)[0].unlink())

    monkeypatch.setattr(execution, "Execution", run)
    work = Work(first.plan, first.folder, (), None, lambda progress: None, RunProgress(24, 0, began=0.0))

    def merge():
        return finished_ids(first.folder, first.plan.ids)

    lose += [True]
    work_off(first.plan, work, merge)
    assert statuses(first) == {"ok": 24}
    for part in result_files(first.folder):
        part.unlink()
    lose += [True] * 9
    with pytest.raises(RunError, match="rows are lost after they are stored"):
        work_off(first.plan, work, merge)


@settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 2**32 - 1), killer=st.integers(0, 30), workers=st.integers(1, 40))
def test_whatever_befalls_workers_every_job_has_a_row_and_only_fatal_jobs_lack_an_answer(
    planned, tmp_path_factory, monkeypatch, seed, killer, workers
):
    random = np.random.default_rng(seed)
    culprit = job_of(planned, killer) if killer < 24 else ""

    def faults(job, begun):
        if job == culprit:
            return "died"
        kinds = ("died", "left", "undelivered", "cancelled", "lost", "lie")
        return kinds[random.integers(len(kinds))] if begun == 1 and random.random() < 0.3 else None

    case = Session(planned, tmp_path_factory.mktemp("run"), monkeypatch, faults=faults, workers=workers)
    case()
    assert statuses(case) == ({"ok": 23, "crashed": 1} if culprit else {"ok": 24})
