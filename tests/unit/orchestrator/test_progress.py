"""What a run tells of itself while it goes on."""

import importlib
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import pyarrow as pa
import pytest
from click.testing import CliRunner

sys.path.insert(0, str(Path(__file__).parents[1] / "results"))

from toppling.models.scene import Scene
from toppling.orchestrator import progress as progress_module
from toppling.orchestrator.cli import cli
from toppling.orchestrator.compiling import COMPILING
from toppling.orchestrator.context import RunProgress
from toppling.orchestrator.progress import bar, duration, each, pace, pace_and_counts, watcher


def rows_of(count):
    return pa.table({"status": ["ok"] * count, "toppled": [False] * count, "wall_s": [0.1] * count})


@pytest.mark.parametrize(("done", "elapsed_s"), [(10, 2.0), (10, 400.0), (2000, 4.0)])
def test_the_time_left_agrees_with_the_rate_beside_it(done, elapsed_s):
    progress = RunProgress(total=4320, before=320, began=0.0, ended=elapsed_s)
    assert "left" not in pace_and_counts(progress)
    progress.count(rows_of(done))
    rate, left = (4000 - done) / progress.left_s, duration(progress.left_s)
    assert rate == pytest.approx(done / elapsed_s)
    assert pace_and_counts(progress).startswith(f"{pace(rate)}  {left} left  of {done} now 0 toppled")


@pytest.mark.parametrize(
    ("tell", "number", "words"),
    [
        (pace, 1234.5, "1234/s"), (pace, 12.34, "12.3/s"), (pace, 0.24, "14.4/min"), (pace, 0.0021, "7.6/h"),
        (duration, 59.6, "1 min 00 s"), (duration, 3600, "1 h 00 min"), (duration, 3, "3 s"),
    ],
)  # fmt: skip
def test_rates_and_durations_are_told_in_the_unit_that_shows_their_digits(tell, number, words):
    assert tell(number) == words


def test_a_session_that_is_complete_says_so_once(capsys):
    progress = RunProgress(total=1, before=0)
    progress.count(rows_of(1))
    with watcher() as watch:
        watch(progress)
        watch(progress)
        progress.what = "auditing"
        watch(progress)
    first, second = capsys.readouterr().err.splitlines()
    assert first.startswith("1/1 jobs")
    assert second.startswith("auditing: 1/1 jobs")


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


def test_what_is_done_within_a_minute_says_nothing_in_a_log(capsys):
    assert list(each(range(3), "drawing", total=3)) == [0, 1, 2]
    assert capsys.readouterr().err == ""


def test_a_line_says_how_long_work_has_gone_on_and_by_its_parts_how_long_it_will():
    began = time.monotonic() - 60.0
    assert progress_module.Advance(total=None, began=began).line("shaking") == "shaking  1 min 00 s"
    advance = progress_module.Advance(total=4.0, began=began)
    advance(3)
    assert advance.line("drawing").endswith("1 min 00 s  20 s left")


def test_a_log_hears_soon_that_work_goes_on_and_then_once_a_minute(capsys):
    with bar("records", total=4, first_line_s=0.05) as advance:
        advance(1, "reading")
        time.sleep(0.3)
    assert [line[:27] for line in capsys.readouterr().err.splitlines()] == ["records: 1 of 4  reading  0"]


@pytest.fixture
def heard(monkeypatch):
    """What the bars of verbs are told, by their names."""
    found = {}

    @contextmanager
    def listening(what, total=None, **_):
        advance = progress_module.Advance(total)
        found[what] = (advance, spoken := [])

        def heard(parts=1, doing="", *, total=None):
            advance(parts, doing, total=total)
            spoken.append(doing)

        yield heard

    monkeypatch.setattr(progress_module, "bar", listening)
    for verb in ("fragility", "records"):
        monkeypatch.setattr(importlib.import_module(f"toppling.orchestrator.verbs.{verb}"), "bar", listening)
    return found


def test_showing_a_scene_says_what_it_does_to_the_end(heard, tmp_path):
    Scene.block(0.2, 0.2, 0.6).save(tmp_path / "scene")
    CliRunner().invoke(cli, ["scene", "show", str(tmp_path / "scene")], catch_exceptions=False)
    advance, spoken = heard["scene"]
    assert spoken == ["settling", "scene.png", "scene.html", "settling.png"]
    assert 0 < advance.done < advance.total
