"""The page states no number that the run does not bear."""

import pytest
from click.testing import CliRunner
from refusals import refused
from seeded import THETA_M_S, row, rows

from toppling.orchestrator.cli import cli
from toppling.results.drawing.report.content import Content
from toppling.results.drawing.report.headline import first_screen
from toppling.results.drawing.report.page import SECTIONS, report_page
from toppling.results.drawing.templates import Document
from toppling.results.reader import open_run
from toppling.results.store import write_part


def test_fewer_than_ten_topplings_bear_no_curve_and_no_ranking(tmp_path):
    jobs = [
        job | {"toppled": number < 9}
        for number, job in enumerate(rows(records=12, levels=(4, 8), azimuths=(0.0,)))
    ]
    write_part(tmp_path, jobs)
    content, document = Content(open_run(tmp_path), 5), Document()
    (told,) = SECTIONS["Fits"](content, document)
    assert "Too few topplings: 9 of 24 jobs" in told
    assert (document.figures, document.tables) == (0, 0)
    assert content.statement is None


def test_a_run_without_answers_has_no_page(tmp_path):
    write_part(tmp_path, [row("a", status="crashed")])
    with refused("run.no_answers"):
        report_page(Content(open_run(tmp_path)))
    assert CliRunner().invoke(cli, ["report", str(tmp_path)]).exit_code == 1
    assert not (tmp_path / "report.html").exists()


@pytest.mark.thorough
@pytest.mark.parametrize(("share", "beyond"), [(0.8, True), (3.0, False)])
def test_the_first_sentence_states_a_median_only_within_what_was_shaken(tmp_path, share, beyond):
    told = rows(records=40, azimuths=(0.0, 90.0, 180.0))
    write_part(tmp_path, [one for one in told if one["pgv_m_s"] < share * THETA_M_S])
    content = Content(open_run(tmp_path), samples=5)
    curve = content.chief.headline
    said = " ".join(first_screen(content, Document())["answers"])
    assert (curve.median > curve.strongest_shaken) == beyond
    assert ("beyond what was run" in said) == beyond
    assert (f"{curve.median:.3g}" in said) != beyond
