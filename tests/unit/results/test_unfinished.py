"""A run that stopped early says so first, to whoever reads it; one of few records says that they are few."""

import json
import shutil

import pytest
from click.testing import CliRunner
from reference.idealised import ricker
from seeded import rows

from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.record import Record
from toppling.models.scene import Scene
from toppling.orchestrator.campaign import Campaign
from toppling.orchestrator.cli import cli
from toppling.orchestrator.plan import plan
from toppling.orchestrator.run_folder import prepare
from toppling.orchestrator.status import state_of
from toppling.results.analysis.exchange import read_curves
from toppling.results.drawing.report.content import Content
from toppling.results.drawing.report.headline import first_screen
from toppling.results.drawing.report.page import methods
from toppling.results.drawing.templates import Document
from toppling.results.reader import open_run
from toppling.results.store import write_part

LEVELS = (4, 8, 12)
REMARK = "9 of 36 jobs have not run"


@pytest.fixture(scope="module")
def unfinished(tmp_path_factory):
    """A run of 12 records at three levels, of which three records have not run."""
    folder = tmp_path_factory.mktemp("unfinished")
    Scene.block(0.15, 0.2, 0.6).save(folder / "scene")
    pulses = [Record.of(f"R{n:03d}", ricker(2.0, 0.5 + 0.02 * n, 0.01)) for n in range(12)]
    Ensemble.write(folder / "ensemble", pulses)
    axes = {"pga_m_s2": list(LEVELS), "azimuth_deg": [0], "friction": [1.0]}
    campaign = Campaign.of({"scene": "scene", "ensemble": "ensemble", **axes}, folder)
    planned = plan(campaign, Scene.load(campaign.scene), Ensemble.load(campaign.ensemble))
    prepare(folder / "run", planned, {})
    specs = {(spec.record_id, spec.pga_m_s2): spec for spec in map(planned.spec, range(len(planned)))}
    told = []
    for values in rows(records=9, levels=LEVELS, azimuths=(0.0,)):
        spec = specs[values["record_id"], values["level_pga_m_s2"]]
        told.append({**values, "job_id": spec.job_id, "scene_id": spec.scene_id})
    write_part(folder / "run", told)
    return folder / "run"


def test_the_report_its_methods_and_its_figures_say_it_first(unfinished):
    content = Content(open_run(unfinished), samples=2)
    assert methods(content).startswith(f"The ensemble was not completed: {REMARK}.")
    first = first_screen(content, Document(content.completeness.remark))
    assert REMARK in first["unfinished"]


@pytest.mark.thorough
def test_fragility_says_it_first_and_its_curves_keep_it(unfinished, drawn_alone, tmp_path):
    drawn_alone("pga_pgv", "directions", "fits")
    asked = ["fragility", str(unfinished), "--fit", "--samples", "4", "--out", str(tmp_path)]
    said = CliRunner().invoke(cli, asked, catch_exceptions=False).stdout
    assert said.startswith(f"{unfinished} is unfinished: {REMARK}\n")
    assert said.count("\n") < 25, "the figures are counted, not listed"
    assert "NaN" not in said
    for suffix in (".csv", ".json", ".xml"):
        curve = read_curves(tmp_path / "fits" / f"curves{suffix}")["pgv_m_s"]
        assert (curve.basis.jobs_planned, curve.basis.jobs_done, curve.basis.records) == (36, 27, 9)
        assert curve.basis.unfinished == REMARK
        assert curve.median_interval[0] < curve.median < curve.median_interval[1]
    for figure in ("pga_pgv", "directions", "fits/fits"):
        assert REMARK in (tmp_path / f"{figure}.svg").read_text()


def test_rows_that_were_stored_and_are_not_there_are_said_to_be_lost(unfinished, tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(unfinished, copy)
    for part in (copy / "parts").iterdir():
        part.unlink()
    assert open_run(copy).completeness().remark == "36 of 36 jobs have not run"
    document = json.loads((copy / "run.json").read_text())
    document.pop("digest")
    document["sessions"] = [{"ended": "interrupted", "done": 27}]
    (copy / "run.json").write_text(json.dumps(document))
    told = "36 of 36 jobs have no row here, and 27 were stored"
    assert open_run(copy).completeness().remark.startswith(told)
    assert state_of(copy)["unfinished"].startswith(told)
    answer = CliRunner().invoke(cli, ["constrain", str(copy)])
    assert answer.exception.code == "run.no_answers"


@pytest.mark.slow
@pytest.mark.parametrize("verb", [["fragility", "--fit"], ["report"]])
@pytest.mark.parametrize("records", [1, 2, 4])
def test_every_reader_reads_a_run_of_few_records(tmp_path, records, verb):
    (tmp_path / "run").mkdir()
    write_part(tmp_path / "run", rows(records=records, levels=range(2, 19, 2), azimuths=(0.0, 45.0)))
    asked = [verb[0], str(tmp_path / "run"), *verb[1:], "--samples", "2"]
    assert CliRunner().invoke(cli, asked, catch_exceptions=False).exit_code == 0
