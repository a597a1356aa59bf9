"""What a run tells of itself while it goes on."""

import time

import pyarrow as pa
import pytest

from toppling.orchestrator.context import RunProgress
from toppling.orchestrator.task import COMPILING
from toppling.orchestrator.terminal import Advance, bar, duration, pace, pace_and_counts, watcher


@pytest.mark.parametrize(("done", "elapsed_s"), [(10, 2.0), (10, 400.0), (2000, 4.0)])
def test_the_time_left_agrees_with_the_rate_next_to_it(done, elapsed_s, monkeypatch):
    monkeypatch.setattr(time, "monotonic", lambda: elapsed_s)
    shown = Advance("shaking", 4320.0, 320.0 + done, before=320.0, began=0.0)
    run = RunProgress(total=4320, before=320, began=0.0)
    rows = {"status": ["ok"] * done, "toppled": [False] * done, "wall_s": [0.1] * done}
    run.count(pa.table(rows))
    assert run.rate == pytest.approx(done / elapsed_s)
    assert pace_and_counts(run) == f"{pace(run.rate)}  of {done} now 0 toppled  0 failed"
    assert shown.left == f"{duration((4000 - done) / run.rate)} left"


def test_an_activity_is_reported_as_it_begins(capsys):
    with watcher() as watch:
        for what in (COMPILING, COMPILING, "shaking"):
            watch(RunProgress(total=1288, before=0, what=what))
    lines = capsys.readouterr().err.splitlines()
    assert lines == [f"{COMPILING}: 0 of 1,288  0 s", "shaking: 0 of 1,288  0 s"]


def test_without_a_terminal_work_speaks_in_lines_even_while_no_part_ends(capsys):
    with bar("figures", total=4, first_line_s=0.05, line_every_s=0.05) as advance:
        advance(1, "maps")
        time.sleep(0.3)
    lines = capsys.readouterr().err.splitlines()
    assert 2 <= len(lines) <= 7
    assert all(line.startswith("figures: 1 of 4  maps  0 s") for line in lines)
