"""What a run's folder tells of its state, without anything that runs, and its log: one JSON object a line."""

import errno
import fcntl
import json
import logging
import os
import threading
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime, timedelta

import pytest
from refusals import refused
from small_campaigns import VERSIONS, planned_in

from toppling.orchestrator.journal import LOG_FILE, journal, last, log_event
from toppling.orchestrator.run_folder import claimed, prepare, session
from toppling.orchestrator.status import level_counts, state_of
from toppling.orchestrator.task import lost_row
from toppling.results.store import write_part


@pytest.fixture
def planned(tmp_path):
    planned = planned_in(tmp_path, (0.6,), pga_m_s2=[1, 2, 3, 4, 5], azimuth_deg=[0, 90, 180])
    prepare(tmp_path / "run", planned, VERSIONS)
    return planned


def rows(planned, reasons):
    lost = (lost_row(planned.spec(job), *reason) for job, reason in enumerate(reasons))
    return [row | {"attempt": 1} for row in lost]


def test_the_same_failure_of_many_jobs_is_reported_once_with_their_number(planned, tmp_path):
    reasons = [("crashed", "died"), *[("failed", "it falls")] * 9, ("ok", ""), ("failed", "InputError: it")]
    stored = rows(planned, [*reasons, ("failed", "ended")])
    write_part(tmp_path / "run", [*stored[:-1], stored[-1] | {"ended_by": "left_ground"}])
    state = state_of(tmp_path / "run")
    counts = state["stored"], state["failed"], state["status"]
    assert counts == (13, 12, {"crashed": 1, "failed": 11, "ok": 1})
    result = [(reason["jobs"], reason["status"], reason["message"]) for reason in state["failures"]]
    assert result[0] == (9, "failed", "it falls")
    assert (1, "failed", "ended; the rock left the ground that is known: scan more of it") in result
    assert {row["job_id"] for row in state["failures"]} >= {planned.spec(job).job_id for job in (0, 12)}
    assert state["again"] == ["crashed", "failed"]


def test_the_rate_is_that_of_the_last_minute_of_stored_rows(planned, tmp_path):
    now = datetime.now(UTC)
    ages_s = [3600.0, 1800.0, *range(10)]
    finished = [{"finished_at": now - timedelta(seconds=age)} for age in ages_s]
    done = rows(planned, [("ok", "")] * len(ages_s))
    write_part(tmp_path / "run", [row | moment for row, moment in zip(done, finished, strict=True)])
    with session(tmp_path / "run"):
        state = state_of(tmp_path / "run")
    assert state["state"] == "running"
    assert state["rate_per_s"] == pytest.approx(10 / 9)
    assert state["left_s"] == pytest.approx((15 - 12) / state["rate_per_s"])


def test_workers_are_reported_while_the_session_goes_on_and_no_longer(planned, tmp_path):
    run = tmp_path / "run"
    write_part(run, rows(planned, [("crashed", "died")] * 4 + [("ok", "")] * 11))
    with session(run), journal(run):
        log_event("rows stored", workers=9, deaths=9)  # of an earlier session
        log_event("work began", workers=2, deaths=0)
        assert (state_of(run)["workers"], state_of(run)["deaths"]) == (2, 0)
    assert (state_of(run)["workers"], state_of(run)["state"]) == (None, "complete")


def test_reading_the_status_blocks_no_session_from_beginning(planned, tmp_path, monkeypatch):
    # The timer may be late on a busy machine.
    monkeypatch.setattr("toppling.orchestrator.run_folder._LOCK_PATIENCE_S", 30.0)
    # As long as state_of looks, it holds the lock, shared; here for longer, so that the session meets it.
    with (tmp_path / "run" / ".lock").open("a") as lock:
        fcntl.flock(lock, fcntl.LOCK_SH)
        looked = threading.Timer(0.2, fcntl.flock, (lock, fcntl.LOCK_UN))
        looked.start()
        with session(tmp_path / "run"):
            assert state_of(tmp_path / "run")["state"] == "running"
        looked.join()


def test_a_claimed_folder_is_called_running_takes_the_session_of_its_thread_and_refuses_others(
    planned, tmp_path
):
    run = tmp_path / "run"
    with claimed(run), ThreadPoolExecutor() as other:
        assert state_of(run)["state"] == "running"
        with session(run), refused("run.locked", os.getpid()):
            other.submit(session(run).__enter__).result()


@pytest.mark.parametrize("code", ["ENOTSUP", "EOPNOTSUPP", "ENOLCK", "ENOSYS"])
def test_a_file_system_without_locks_is_not_taken_for_another_process(planned, tmp_path, monkeypatch, code):
    def refuse(file, kind):
        raise OSError(getattr(errno, code), os.strerror(getattr(errno, code)))

    monkeypatch.setattr(fcntl, "flock", refuse)
    with refused("run.not_lockable"), session(tmp_path / "run"):
        pass
    assert state_of(tmp_path / "run")["state"] == "interrupted"


def test_a_live_session_is_called_running_and_a_killed_session_interrupted(planned, tmp_path):
    run = tmp_path / "run"
    with session(run):
        state = state_of(run)
        assert (state["state"], state["sessions"][-1]["ended"]) == ("running", "running")
        killed = (run / "run.json").read_bytes()
    assert state_of(run)["sessions"][-1]["ended"] == "interrupted"
    (run / "run.json").write_bytes(killed)  # as a killed session leaves it
    assert state_of(run)["sessions"][-1]["ended"] == "interrupted"
    with session(run):
        assert [entry["ended"] for entry in state_of(run)["sessions"]] == ["interrupted", "running"]


def test_an_audit_of_too_few_jobs_is_reported(planned, tmp_path):
    (tmp_path / "run" / "audit").mkdir()
    assert "Fewer than 40 jobs" in state_of(tmp_path / "run")["audit_sentences"][0]


def test_the_toppled_fractions_of_a_run_count_answered_jobs_by_level(planned, tmp_path):
    done = rows(planned, [("ok", ""), ("ok", ""), ("crashed", "died")])
    answered = [row | {"toppled": n == 0} for n, row in enumerate(done[:2])]
    write_part(tmp_path / "run", [*answered, done[2]])
    (share,) = level_counts(tmp_path / "run")
    assert (share.level_m_s2, share.jobs, share.toppled) == (5.0, 2, 1)


def test_events_and_warnings_are_lines_with_time_level_and_fields(tmp_path):
    with journal(tmp_path):
        log_event("rows stored", done=3)
        named = {"fields": {"worker": "w1"}}
        logging.getLogger("toppling.orchestrator.execution").warning("a worker %s", "died", extra=named)
    stored, died = map(json.loads, (tmp_path / LOG_FILE).read_text().splitlines())
    assert (stored["event"], stored["level"], stored["done"]) == ("rows stored", "info", 3)
    assert (died["event"], died["level"], died["worker"]) == ("a worker died", "warning", "w1")
    assert stored["time"] <= died["time"]


def test_a_line_that_a_crash_cut_spoils_no_other(tmp_path):
    with journal(tmp_path):
        log_event("rows stored", done=1)
    with (tmp_path / LOG_FILE).open("a") as file:
        file.write('{"event": "rows sto')
    with journal(tmp_path):
        log_event("session began")
    lines = (tmp_path / LOG_FILE).read_text().splitlines()
    assert json.loads(lines[-1])["event"] == "session began"
    assert last(tmp_path, "rows stored")["done"] == 1


def test_a_log_that_leads_elsewhere_is_not_followed(tmp_path):
    (tmp_path / "elsewhere").write_text("mine")
    (tmp_path / LOG_FILE).symlink_to(tmp_path / "elsewhere")
    with pytest.raises(OSError, match="symbolic links"), journal(tmp_path):
        log_event("session began")
    assert (tmp_path / "elsewhere").read_text() == "mine"
