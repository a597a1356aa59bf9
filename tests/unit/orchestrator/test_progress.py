"""What a run tells of itself while it goes on."""

import time

import pyarrow as pa
import pytest

from toppling.orchestrator.compiling import COMPILING
from toppling.orchestrator.context import RunProgress
from toppling.orchestrator.progress import bar, duration, pace, pace_and_counts, watcher


@pytest.mark.parametrize(("done", "elapsed_s"), [(10, 2.0), (10, 400.0), (2000, 4.0)])
def test_the_time_left_agrees_with_the_rate_beside_it(done, elapsed_s):
    progress = RunProgress(total=4320, before=320, began=0.0, ended=elapsed_s)
    assert "left" not in pace_and_counts(progress)
    rows = {"status": ["ok"] * done, "toppled": [False] * done, "wall_s": [0.1] * done}
    progress.count(pa.table(rows))
    rate, left = (4000 - done) / progress.left_s, duration(progress.left_s)
    assert rate == pytest.approx(done / elapsed_s)
    assert pace_and_counts(progress).startswith(f"{pace(rate)}  {left} left  of {done} now 0 toppled")


def test_an_activity_before_the_jobs_is_told_as_it_begins(capsys):
    with watcher() as watch:
        for what in (COMPILING, COMPILING, "shaking"):
            watch(RunProgress(total=288, before=0, what=what))
    assert capsys.readouterr().err.splitlines() == [f"{COMPILING}: 0/288 jobs"]


def test_without_a_terminal_work_speaks_in_lines_even_while_no_part_ends(capsys):
    with bar("figures", total=4, first_line_s=0.05, line_every_s=0.05) as advance:
        advance(1, "maps")
        time.sleep(0.3)
    lines = capsys.readouterr().err.splitlines()
    assert 2 <= len(lines) <= 7
    assert all(line.startswith("figures: 1 of 4  maps  0 s") for line in lines)
