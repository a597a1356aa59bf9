"""From Python: each verb's function gives what the verb prints or writes, on one small run."""

import pytest
from refusals import refused

import toppling


def test_a_plan_has_the_jobs_of_the_run(inputs, whole):
    planned = toppling.plan(inputs / "campaign.toml")
    ids = toppling.query(whole.run, "select job_id from results order by all")["job_id"].to_pylist()
    assert sorted(planned.jobs["job_id"].to_pylist()) == ids
    assert (len(ids), whole.session.done, whole.session.failed) == (72, 72, 0)


def test_fragility_hands_back_its_files_and_fits(whole, tmp_path):
    drawn = toppling.fragility(
        whole.run, tmp_path, where="friction_static = 0.9", directions=4, fit=True, samples=20
    )
    assert len(drawn.jobs) == 36
    assert drawn.files
    assert all(path.is_relative_to(tmp_path) and path.exists() for path in drawn.files)
    (fits,) = drawn.fits.values()
    assert "pga_m_s2" in set(fits["measures"])


def test_constrain_states_what_it_writes(whole, tmp_path):
    stated = toppling.constrain(
        [whole.folder], where="friction_static = 0.9", age=["20000"], measure="pga_m_s2"
    )
    assert "95 %" in stated.text
    stated.write(tmp_path)
    assert (tmp_path / stated.page).exists()
    with refused("age.needed"):
        toppling.constrain([whole.folder], hazard=["curve.csv"])


@pytest.mark.thorough
def test_a_report_is_one_page(whole, tmp_path):
    written = toppling.report(whole.run, tmp_path / "report.html", samples=20)
    assert "</html>" in written.page.read_text("utf-8")
    assert written.pdf is None


def test_check_judges_every_seismogram_of_an_ensemble(inputs):
    checked = toppling.check(inputs / "scene", [inputs / "ensemble"], neighbours=1, preset="fast")
    assert checked.frame()["record_id"].tolist() == ["P0", "P1", "P2"]
    assert all(verdict.shaken == 3 for verdict in checked.verdicts)
