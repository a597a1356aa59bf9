"""The page states no number that the run does not bear, and first that a run stopped early or has few records."""

import json
import shutil

import pandas as pd
import pytest
from click.testing import CliRunner
from refusals import refused
from seeded import THETA_M_S, row, rows
from small_campaigns import VERSIONS, planned_in, run_in

from toppling.orchestrator.cli import cli
from toppling.orchestrator.run_folder import prepare
from toppling.orchestrator.status import state_of
from toppling.results.analysis.exchange import read_curves
from toppling.results.analysis.fits import answered, headline
from toppling.results.analysis.lognormal import fit
from toppling.results.drawing.report.content import Content
from toppling.results.drawing.report.headline import first_screen
from toppling.results.drawing.report.page import SECTIONS, methods, methods_section, report_page
from toppling.results.drawing.templates import Document
from toppling.results.reader import open_run
from toppling.results.schema import SCHEMA
from toppling.results.store import write_part
from toppling.workers.engines import ENGINES


def test_fewer_than_ten_topplings_bear_no_curve_and_no_ranking(tmp_path):
    jobs = [
        job | {"toppled": number < 9}
        for number, job in enumerate(rows(records=12, levels=(4, 8), azimuths=(0.0,)))
    ]
    content, document = Content(run_in(tmp_path, jobs), 5), Document()
    (result,) = SECTIONS["Fits"](content, document)
    assert "Too few topplings: 9 of 24 jobs" in result
    assert (document.figures, document.tables) == (0, 0)
    assert content.statement is None


def test_the_first_sentence_says_which_of_several_frictions_it_is_of(tmp_path):
    jobs = rows(records=12, levels=(4, 8), azimuths=(0.0,))
    weak = {"friction_static": 0.3, "friction_kinetic": 0.3}
    also = [job | weak | {"job_id": f"{number:024x}"} for number, job in enumerate(jobs)]
    first = first_screen(Content(run_in(tmp_path, [*jobs, *also]), 5), Document())["answers"][0]
    assert "the highest of 2 frictions" in first


def test_a_run_without_answers_has_no_page(tmp_path):
    run = run_in(tmp_path, [row("a", status="crashed")])
    with refused("run.no_answers"):
        report_page(Content(run))
    assert CliRunner().invoke(cli, ["report", str(tmp_path)]).exit_code == 1
    assert not (tmp_path / "report.html").exists()


@pytest.mark.thorough
@pytest.mark.parametrize(("share", "beyond"), [(0.8, True), (3.0, False)])
def test_the_first_sentence_states_a_median_only_within_what_was_shaken(tmp_path, share, beyond):
    result = rows(records=40, azimuths=(0.0, 90.0, 180.0))
    weak = [entry for entry in result if entry["pgv_m_s"] < share * THETA_M_S]
    content = Content(run_in(tmp_path, weak), samples=5)
    curve = content.chief.headline
    text = " ".join(first_screen(content, Document())["answers"])
    assert (curve.median > curve.strongest_shaken) == beyond
    assert ("beyond what was run" in text) == beyond
    assert (f"{curve.median:.3g}" in text) != beyond


@pytest.fixture(scope="module")
def jobs():
    frame = answered(pd.DataFrame(rows(records=20, azimuths=(0.0,)), columns=SCHEMA.names))
    return frame.assign(pga_vertical_m_s2=frame["pgv_m_s"])


def test_a_curve_over_vertical_pga_never_stands_for_a_run(jobs):
    vertical, level = (fit(jobs, [name]) for name in ("pga_vertical_m_s2", "pga_m_s2"))
    assert vertical.lognormal is not None
    assert headline([vertical, level]) is level
    assert headline([vertical]) is None


@pytest.mark.parametrize(("engine", "other"), [("pybullet", "Todorov"), ("mujoco", "Coumans")])
def test_methods_name_and_cite_the_engine_that_shook_and_no_other(tmp_path, engine, other):
    jobs = [row | {"engine": engine} for row in rows(records=3, azimuths=(0.0,))]
    run = run_in(tmp_path, jobs, engine=ENGINES[engine].citation)
    methods, _, cited = methods_section(Content(run), Document())
    written = " ".join([methods["text"], *cited["texts"]])
    assert f"on {ENGINES[engine].title} ({ENGINES[engine].authors}), following" in written
    assert other not in written


LEVELS = (4, 8, 12)
REMARK = "9 of 36 jobs have not run"


@pytest.fixture(scope="module")
def unfinished(tmp_path_factory):
    """A run of 12 records at three levels, of which three records have not run."""
    folder = tmp_path_factory.mktemp("unfinished")
    axes = {"pga_m_s2": list(LEVELS), "azimuth_deg": [0], "friction": [1.0]}
    planned = planned_in(folder, [0.5 + 0.02 * n for n in range(12)], name="R{:03d}", **axes)
    prepare(folder / "run", planned, VERSIONS)
    specs = {(spec.record_id, spec.pga_m_s2): spec for spec in map(planned.spec, range(len(planned)))}
    result = []
    for values in rows(records=9, levels=LEVELS, azimuths=(0.0,)):
        spec = specs[values["record_id"], values["level_pga_m_s2"]]
        result.append({**values, "job_id": spec.job_id, "scene_id": spec.scene_id})
    write_part(folder / "run", result)
    return folder / "run"


def test_the_report_its_methods_and_its_figures_state_it_first(unfinished):
    content = Content(open_run(unfinished), samples=2)
    assert methods(content).startswith(f"The ensemble was not completed: {REMARK}.")
    first = first_screen(content, Document(content.completeness.remark))
    assert REMARK in first["unfinished"]


@pytest.mark.thorough
def test_fragility_states_it_first_and_its_curves_record_it(unfinished, drawn_alone, tmp_path):
    drawn_alone("pga_pgv", "directions", "fits")
    asked = ["fragility", str(unfinished), "--fit", "--samples", "4", "--out", str(tmp_path)]
    text = CliRunner().invoke(cli, asked, catch_exceptions=False).stdout
    assert text.startswith(f"{unfinished} is unfinished: {REMARK}\n")
    assert text.count("\n") < 25, "the figures are counted, not listed"
    assert "NaN" not in text
    for suffix in (".csv", ".json", ".xml"):
        curve = read_curves(tmp_path / "fits" / f"curves{suffix}")["pgv_m_s"]
        assert (curve.basis.jobs_planned, curve.basis.jobs_done, curve.basis.records) == (36, 27, 9)
        assert curve.basis.unfinished == REMARK
        assert curve.median_interval[0] < curve.median < curve.median_interval[1]
    for figure in ("pga_pgv", "directions", "fits/fits"):
        assert REMARK in (tmp_path / f"{figure}.svg").read_text()


def test_rows_that_were_stored_and_are_not_there_are_stated_to_be_lost(unfinished, tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(unfinished, copy)
    for part in (copy / "parts").iterdir():
        part.unlink()
    assert open_run(copy).completeness().remark == "36 of 36 jobs have not run"
    document = json.loads((copy / "run.json").read_text())
    document.pop("digest")
    document["sessions"] = [{"ended": "interrupted", "done": 27}]
    (copy / "run.json").write_text(json.dumps(document))
    result = "36 of 36 jobs have no row here, and 27 were stored"
    assert open_run(copy).completeness().remark.startswith(result)
    assert state_of(copy)["unfinished"].startswith(result)
    answer = CliRunner().invoke(cli, ["constrain", str(copy)])
    assert answer.exception.code == "run.no_answers"


@pytest.mark.slow
@pytest.mark.parametrize("verb", [["fragility", "--fit"], ["report"]])
@pytest.mark.parametrize("records", [1, 2, 4])
def test_every_reader_reads_a_run_of_few_records(tmp_path, records, verb):
    run_in(tmp_path / "run", rows(records=records, levels=range(2, 19, 2), azimuths=(0.0, 45.0)))
    asked = [verb[0], str(tmp_path / "run"), *verb[1:], "--samples", "2"]
    assert CliRunner().invoke(cli, asked, catch_exceptions=False).exit_code == 0
