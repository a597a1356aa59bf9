"""What a run tells of itself while it goes on."""

import time

import pytest

from orchestrator.progress import duration, told
from orchestrator.run import Tally


def test_the_time_left_counts_what_is_left_of_the_records_not_of_the_jobs():
    tally = Tally(total=2, before=0, motion_s=120.0, began=time.monotonic() - 100.0)
    assert "left" not in told(tally)
    tally.count([{"record_id": "long", "status": "ok"}], {"long": 80.0, "brief": 40.0})
    assert tally.left_s == pytest.approx(50.0, abs=1.0)  # the test's own time
    assert told(tally).startswith("0.0/s  50 s left  0 toppled")


def test_a_session_that_is_complete_has_no_time_left():
    tally = Tally(total=1, before=0, motion_s=80.0)
    tally.count([{"record_id": "long", "status": "ok"}], {"long": 80.0})
    assert "left" not in told(tally)


@pytest.mark.parametrize(("seconds", "words"), [(59.6, "1 min 00 s"), (3600, "1 h 00 min"), (3, "3 s")])
def test_durations_are_told_as_a_person_reads_them(seconds, words):
    assert duration(seconds) == words
