"""Real jobs on two real worker processes: the same rows whatever goes wrong."""

import json
import os
import signal
import threading
import time
from contextlib import nullcontext

import dask
import numpy as np
import pyarrow.parquet as pq
import pytest
from answers import answers_of
from conftest import STILLBORN_VARIABLE
from distributed.core import Status
from refusals import refused

from toppling.models.errors import InputError
from toppling.orchestrator import admission, execution
from toppling.orchestrator import run as running
from toppling.orchestrator.admission import check_workers
from toppling.orchestrator.campaign import Campaign
from toppling.orchestrator.cluster import local
from toppling.orchestrator.context import RunError
from toppling.orchestrator.dispatch import Limits
from toppling.orchestrator.plan import plan_of
from toppling.orchestrator.run import run
from toppling.orchestrator.status import state_of
from toppling.results.reader import open_run
from toppling.results.store import write_part


def test_two_workers_give_the_rows_of_one_process_bit_for_bit(carry_out, undisturbed, tmp_path):
    progress = carry_out(tmp_path / "run")
    assert answers_of(tmp_path / "run") == undisturbed
    assert (progress.done, progress.failed, progress.before) == (len(undisturbed), 0, 0)
    assert state_of(tmp_path / "run")["state"] == "complete"
    kept = json.loads(pq.read_schema(tmp_path / "run" / "results.parquet").metadata[b"run.json"])
    assert [(one["ended"], one["done"]) for one in kept["sessions"]] == [("complete", progress.done)]
    assert len({row["outcome"] for row in undisturbed}) > 1, "the ensemble must not be trivial"


@pytest.mark.slow
def test_the_same_command_again_does_nothing(carry_out, tmp_path):
    carry_out(tmp_path / "run")
    before = (tmp_path / "run" / "results.parquet").stat().st_mtime_ns
    assert carry_out(tmp_path / "run").done == 0
    assert (tmp_path / "run" / "results.parquet").stat().st_mtime_ns == before


def test_an_interrupted_run_goes_on_where_it_stopped(carry_out, undisturbed, tmp_path, faults):
    def stop_after_ten(progress):
        if progress.done >= 10:
            raise KeyboardInterrupt

    faults.set(every={"kind": "wait", "seconds": 0.05})
    with pytest.raises(KeyboardInterrupt):
        carry_out(tmp_path / "run", stop_after_ten)
    stored = state_of(tmp_path / "run")["stored"]
    assert state_of(tmp_path / "run")["state"] == "interrupted"
    assert 10 <= stored < len(undisturbed)
    faults.clear()
    progress = carry_out(tmp_path / "run")
    assert (progress.before, progress.done) == (stored, len(undisturbed) - stored)
    assert answers_of(tmp_path / "run") == undisturbed


def test_what_an_interrupted_run_has_is_a_balanced_sample_of_it(client, inputs, tmp_path, faults):
    axes = {"pga_m_s2": [2, 3, 4, 5, 6, 7], "azimuth_deg": [0, 50, 90, 130, 200, 300], "friction": [0.9]}
    campaign = Campaign.of({"scene": "scene", "ensemble": "ensemble", "preset": "fast", **axes}, inputs)

    def stop_after_a_third(progress):
        if progress.done >= 36:
            raise KeyboardInterrupt

    faults.set(every={"kind": "wait", "seconds": 0.05})
    with pytest.raises(KeyboardInterrupt):
        run(plan_of(campaign), tmp_path / "run", nullcontext(client), stop_after_a_third)
    frame = open_run(tmp_path / "run").frame()
    assert 36 <= len(frame) < 3 * 36
    batch = 14  # of the first that went out; two workers may end theirs in either order
    for column, count in (("record_id", 3), ("level_pga_m_s2", 6), ("azimuth_deg", 6)):
        there = frame[column].value_counts()
        assert len(there) == count
        assert abs(there - len(frame) / count).max() <= 2 + batch / count


def test_killed_workers_cost_no_job(carry_out, client, undisturbed, tmp_path, faults):
    faults.set(every={"kind": "wait", "seconds": 0.2})
    killed = []

    def kill(progress):
        if len(killed) < 2 and progress.done >= 10 * (len(killed) + 1):
            pids = client.run(os.getpid, on_error="ignore").values()
            pid = next((each for each in pids if each not in killed), None)
            if pid is None:
                return  # the one that is left was told to die, and has not yet
            killed.append(pid)
            # In the middle of its next batch: rows come as one ends, and a worker between two loses nothing.
            threading.Timer(0.7, os.kill, (pid, signal.SIGKILL)).start()

    progress = carry_out(tmp_path / "run", kill)
    assert len(killed) == 2
    assert progress.deaths >= 1
    assert answers_of(tmp_path / "run") == undisturbed


def test_a_job_that_crashes_the_engine_is_the_only_one_lost(
    carry_out, undisturbed, planned, tmp_path, faults
):
    culprit = planned.spec(30).job_id
    faults.set(**{culprit: {"kind": "segfault"}})
    progress = carry_out(tmp_path / "run")
    rows = {row["job_id"]: row for row in answers_of(tmp_path / "run")}
    assert rows[culprit]["status"] == "crashed"
    assert rows[culprit]["toppled"] is None
    assert "died" in rows[culprit]["message"]
    assert progress.status == {"ok": len(undisturbed) - 1, "crashed": 1}
    assert [row for row in rows.values() if row["job_id"] != culprit] == [
        row for row in undisturbed if row["job_id"] != culprit
    ]


@pytest.mark.slow
def test_a_job_that_crashes_once_is_tried_again(carry_out, undisturbed, planned, tmp_path, faults):
    culprit = planned.spec(5).job_id
    faults.set(**{culprit: {"kind": "segfault", "times": 2}})
    carry_out(tmp_path / "run")
    assert answers_of(tmp_path / "run") == undisturbed
    attempts = open_run(tmp_path / "run").sql(f"select attempt from results where job_id = '{culprit}'")
    assert attempts["attempt"].to_pylist() == [3]


def test_a_job_whose_worker_answers_another_is_tried_again_and_fails_if_it_always_does(
    carry_out, undisturbed, planned, tmp_path, faults
):
    once, always = planned.spec(5).job_id, planned.spec(30).job_id
    wrong = {"kind": "lie", "changes": {"pgv_m_s": 0.5}}
    faults.set(**{once: wrong | {"times": 1}, always: wrong})
    progress = carry_out(tmp_path / "run")
    rows = {row["job_id"]: row for row in answers_of(tmp_path / "run")}
    assert progress.status == {"ok": len(undisturbed) - 1, "failed": 1}
    assert progress.deaths == 0
    assert rows[always]["status"] == "failed"
    assert "pgv_m_s is 0.5" in rows[always]["message"]
    assert [row for row in rows.values() if row["job_id"] != always] == [
        row for row in undisturbed if row["job_id"] != always
    ]


@pytest.mark.slow
def test_workers_that_die_before_their_start_is_complete_are_brought_back(
    carry_out, client, undisturbed, tmp_path, faults
):
    # Dask's own restart leaves out a worker that dies in this state, where a job that kills its worker at once can
    # meet it.
    faults.set(every={"kind": "wait", "seconds": 0.05})
    killed = []

    def kill(progress):
        if not killed and progress.done >= 5:
            for nanny in client.cluster.workers.values():
                nanny.status = Status.starting
                killed.append(nanny.pid)
                os.kill(nanny.pid, signal.SIGKILL)

    carry_out(tmp_path / "run", kill)
    assert len(killed) == 2
    assert answers_of(tmp_path / "run") == undisturbed


@pytest.mark.slow
def test_a_run_whose_workers_die_whenever_they_start_ends_and_says_so(
    campaign, undisturbed, tmp_path, faults_file, monkeypatch
):
    dask.config.refresh()
    with monkeypatch.context() as broken:
        broken.setenv(STILLBORN_VARIABLE, "1")
        broken.setattr(admission, "NOBODY_AFTER_S", 6.0)
        broken.setattr(admission, "REPLACE_AFTER_S", 2.0)
        with pytest.raises(RunError, match="every worker has died"):
            run(plan_of(campaign), tmp_path / "run", local(2), lambda progress: None)
    run(plan_of(campaign), tmp_path / "run", local(2), lambda progress: None)
    assert answers_of(tmp_path / "run") == undisturbed


def test_an_exception_in_a_job_is_a_row(carry_out, undisturbed, planned, tmp_path, faults):
    culprit = planned.spec(7).job_id
    faults.set(**{culprit: {"kind": "raise"}})
    progress = carry_out(tmp_path / "run")
    assert progress.status == {"ok": len(undisturbed) - 1, "failed": 1}
    assert "ZeroDivisionError" in state_of(tmp_path / "run")["failures"][0]["message"]


def test_failed_jobs_are_done_again_and_an_interruption_meanwhile_loses_nothing(
    carry_out, finished, undisturbed, planned, tmp_path, faults, monkeypatch
):
    monkeypatch.setattr(execution, "_FLUSH_S", (0.0, 0.0))
    culprits = [planned.spec(job).job_id for job in (5, 6, 40)]
    run = finished(dict.fromkeys((5, 6, 40), ("failed", 1)))
    before = rows_of(run)

    def stop_at_two(progress):
        assert state_of(run)["again"] == progress.again == len(culprits) - progress.stored
        if progress.stored >= 2:
            raise KeyboardInterrupt

    faults.set(**{culprits[1]: {"kind": "raise"}, culprits[2]: {"kind": "wait", "seconds": 3.0}})
    with pytest.raises(KeyboardInterrupt):
        carry_out(run, stop_at_two, again={"failed"})
    halfway = rows_of(run)
    assert halfway.keys() == before.keys()
    assert before.items() - halfway.items() <= {(culprit, ("failed", 1)) for culprit in culprits}
    failed = sum(status == "failed" for status, _ in halfway.values())
    assert failed in (1, 2)  # of three, one of which fails again, two or three have a new row

    faults.clear()
    progress = carry_out(run, again={"failed"})
    assert (progress.before, progress.done) == (len(planned) - failed, failed)
    assert answers_of(run) == undisturbed
    assert all(rows_of(run)[culprit][1] > 1 for culprit in culprits)
    assert carry_out(run, again={"failed"}).done == 0


def rows_of(run):
    """Status and attempt of every job."""
    found = open_run(run).sql("select job_id, status, attempt from results").to_pylist()
    return {row["job_id"]: (row["status"], row["attempt"]) for row in found}


def test_a_row_that_is_lost_while_its_job_is_done_again_is_made_up_for(
    carry_out, finished, planned, undisturbed, tmp_path, faults, monkeypatch, caplog
):
    monkeypatch.setattr(execution, "_FLUSH_S", (0.0, 0.0))
    run, culprit = finished({3: ("crashed", 4)}), planned.spec(3).job_id
    faults.set(**{culprit: {"kind": "raise", "times": 1}})
    torn = []

    def tear(progress):
        if progress.stored and not torn:
            torn.append(max((run / "parts").glob("part-*")))
            torn[0].write_bytes(torn[0].read_bytes()[:50])

    progress = carry_out(run, tear, again={"crashed"})
    assert progress.status == {"failed": 1, "ok": 1}
    assert "1 rows were lost after they were stored" in caplog.text
    assert rows_of(run)[culprit] == ("ok", 5)
    assert answers_of(run) == undisturbed


def test_a_job_that_crashes_again_is_a_newer_row_and_does_not_hold_the_session_up(
    carry_out, finished, planned, faults
):
    run, culprit = finished({3: ("crashed", 4)}), planned.spec(3).job_id
    faults.set(**{culprit: {"kind": "segfault"}})
    progress = carry_out(run, limits=Limits(tries=1), again={"crashed"})
    assert progress.status == {"crashed": 1}
    # In a batch of its own it died as attempt 5, and alone as 6.
    assert rows_of(run)[culprit] == ("crashed", 6)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["hang", "freeze"])
def test_a_worker_that_hangs_is_replaced_while_the_others_go_on(
    carry_out, undisturbed, planned, tmp_path, faults, kind
):
    culprit = planned.spec(20).job_id
    faults.set(**{culprit: {"kind": kind, "times": 1}}, every={"kind": "wait", "seconds": 0.2})
    seen = []
    progress = carry_out(
        tmp_path / "run", lambda progress: seen.append(time.monotonic()), limits=Limits(job_s=3.0)
    )
    assert progress.deaths >= 1
    # Dask waits for four seconds before it kills a worker that hangs: the run must not.
    assert max(np.diff(seen)) < 3.0
    assert answers_of(tmp_path / "run") == undisturbed


@pytest.mark.slow
def test_torn_and_foreign_files_in_the_run_are_passed_over(carry_out, undisturbed, tmp_path, faults, caplog):
    def stop(progress):
        if progress.done >= 10:
            raise KeyboardInterrupt

    faults.set(every={"kind": "wait", "seconds": 0.05})
    with pytest.raises(KeyboardInterrupt):
        carry_out(tmp_path / "run", stop)
    faults.clear()
    parts = tmp_path / "run" / "parts"
    part = next(parts.glob("part-*.parquet"))
    lost = len(pq.read_table(part))
    part.write_bytes(part.read_bytes()[:-100])
    (parts / "notes.parquet").write_text("not Parquet")
    pq.write_table(pq.read_table(tmp_path / "run" / "jobs.parquet"), parts / "part-foreign.parquet")
    assert lost >= 1
    carry_out(tmp_path / "run")
    assert "torn" in caplog.text
    assert answers_of(tmp_path / "run") == undisturbed


def test_a_part_that_is_lost_while_the_run_goes_on_is_done_again(
    carry_out, undisturbed, tmp_path, faults, monkeypatch, caplog
):
    monkeypatch.setattr(execution, "_FLUSH_S", (0.2, 0.2))
    faults.set(every={"kind": "wait", "seconds": 0.02})
    torn = []

    def tear(progress):
        if progress.stored and not torn:
            torn.append(next((tmp_path / "run" / "parts").glob("part-*")))
            torn[0].write_bytes(torn[0].read_bytes()[:50])

    carry_out(tmp_path / "run", tear)
    assert "rows were lost after they were stored" in caplog.text
    assert answers_of(tmp_path / "run") == undisturbed


def test_a_part_that_is_lost_as_the_parts_are_merged_is_done_again(
    carry_out, undisturbed, tmp_path, monkeypatch, caplog
):
    merge, torn = running.compact, []

    def tear_and_merge(run):
        if not torn:  # after its rows were counted
            torn.append(next((run / "parts").glob("part-*")))
            torn[0].write_bytes(torn[0].read_bytes()[:50])
        return merge(run)

    monkeypatch.setattr(running, "compact", tear_and_merge)
    carry_out(tmp_path / "run")
    assert "rows were lost after they were stored" in caplog.text
    assert answers_of(tmp_path / "run") == undisturbed
    assert json.loads((tmp_path / "run" / "run.json").read_text())["sessions"][-1]["ended"] == "complete"


def test_rows_of_another_run_are_refused_and_stay_where_they_are(carry_out, undisturbed, tmp_path, faults):
    def stop(progress):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        carry_out(tmp_path / "run", stop)
    foreign = write_part(tmp_path / "run", [{**undisturbed[0], "job_id": "0" * 24, "attempt": 1}])
    with refused("run.file_foreign", foreign):
        carry_out(tmp_path / "run")
    foreign.unlink()  # as the message says
    carry_out(tmp_path / "run")
    assert answers_of(tmp_path / "run") == undisturbed


def test_the_log_tells_the_session_from_begin_to_end(carry_out, undisturbed, tmp_path):
    carry_out(tmp_path / "run")
    told = [json.loads(line) for line in (tmp_path / "run" / "run.log").read_text().splitlines()]
    assert told[0]["event"] == "session began"
    assert told[0]["jobs"] == len(undisturbed)
    assert (told[-1]["event"], told[-1]["how"], told[-1]["done"]) == (
        "session ended",
        "complete",
        len(undisturbed),
    )
    assert sum(entry["event"] == "rows stored" for entry in told) >= 1


@pytest.mark.slow
def test_a_part_that_cannot_be_written_stops_the_run_and_nothing_is_lost(
    carry_out, undisturbed, tmp_path, monkeypatch
):
    def full(folder, rows):
        raise OSError(28, "No space left on device", str(folder))

    with monkeypatch.context() as patched:
        patched.setattr(execution, "write_part", full)
        with pytest.raises(OSError, match="No space left"):
            carry_out(tmp_path / "run")
    carry_out(tmp_path / "run")
    assert answers_of(tmp_path / "run") == undisturbed


@pytest.mark.slow
def test_a_second_writer_is_refused(carry_out, tmp_path, faults):
    faults.set(every={"kind": "wait", "seconds": 0.05})
    refused = []

    def another(progress):
        if not refused:
            thread = threading.Thread(target=lambda: refused.append(_error_of(carry_out, tmp_path / "run")))
            thread.start()
            thread.join()

    carry_out(tmp_path / "run", another)
    assert refused[0].code == "run.locked"


def _error_of(carry_out, folder):
    try:
        carry_out(folder)
    except InputError as error:
        return error
    return None


def test_a_run_whose_folder_is_gone_is_refused_before_any_job(client, planned, tmp_path):
    from toppling.orchestrator.task import RunKey, versions

    run_key = RunKey(str(tmp_path / "absent"), planned.scene_id, planned.ensemble_id, versions())
    with pytest.raises(RunError, match=r"absent/scene is gone: was the run's folder removed or renamed"):
        check_workers(client, run_key)


def test_workers_of_another_version_are_refused_before_any_job(client, planned, inputs):
    from toppling.orchestrator.task import RunKey, versions

    other = tuple((name, "0.0" if name == "pybullet" else version) for name, version in versions())
    run_key = RunKey(str(inputs), planned.scene_id, planned.ensemble_id, other)
    with refused("cluster.workers_unfit", "pybullet 3.2.7", "0.0"):
        check_workers(client, run_key)


def test_workers_that_see_another_scene_are_refused(client, planned, inputs):
    from toppling.orchestrator.task import RunKey, versions

    run_key = RunKey(str(inputs), "0" * 20, planned.ensemble_id, versions())
    with refused("cluster.workers_unfit", planned.scene_id, "0000"):
        check_workers(client, run_key)


@pytest.mark.slow
def test_rows_are_readable_while_the_run_goes_on(carry_out, tmp_path, faults, monkeypatch):
    monkeypatch.setattr(execution, "_FLUSH_S", (0.2, 0.2))
    faults.set(every={"kind": "wait", "seconds": 0.05})
    seen = []

    def look(progress):
        if progress.stored and not seen:
            counted = open_run(tmp_path / "run").sql("select count(*) n from results")["n"][0].as_py()
            seen.append((state_of(tmp_path / "run"), counted, progress.stored))

    carry_out(tmp_path / "run", look)
    state, counted, stored = seen[0]
    assert state["state"] == "running"
    assert state["stored"] == counted == stored


@pytest.mark.slow
def test_a_stored_row_is_not_computed_again(carry_out, planned, tmp_path, faults, undisturbed):
    def stop(progress):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        carry_out(tmp_path / "run", stop)
    spec = planned.spec(0)
    row = {
        **next(row for row in undisturbed if row["job_id"] == spec.job_id),
        "attempt": 1,
        "max_tilt_deg": 77.0,
    }
    for part in (tmp_path / "run" / "parts").iterdir():
        part.unlink()
    write_part(tmp_path / "run", [row])
    carry_out(tmp_path / "run")
    again = {row["job_id"]: row for row in answers_of(tmp_path / "run")}
    assert again[spec.job_id]["max_tilt_deg"] == 77.0
