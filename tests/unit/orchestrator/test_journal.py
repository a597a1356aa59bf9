"""The run's log: one JSON object a line, whatever happened before."""

import json
import logging

import pytest

from toppling.orchestrator.journal import LOG_FILE, journal, last, log_event


def entries(run):
    return [json.loads(line) for line in (run / LOG_FILE).read_text().splitlines()]


def test_events_and_warnings_are_lines_with_time_level_and_fields(tmp_path):
    with journal(tmp_path):
        log_event("rows stored", done=3)
        logging.getLogger("toppling.orchestrator.execution").warning(
            "a worker %s", "died", extra={"fields": {"worker": "w1"}}
        )
    stored, died = entries(tmp_path)
    assert (stored["event"], stored["level"], stored["done"]) == ("rows stored", "info", 3)
    assert (died["event"], died["level"], died["worker"]) == ("a worker died", "warning", "w1")
    assert stored["time"] <= died["time"]


def test_nothing_is_written_outside_a_session(tmp_path):
    with journal(tmp_path):
        log_event("one")
    log_event("two")
    assert [entry["event"] for entry in entries(tmp_path)] == ["one"]


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
