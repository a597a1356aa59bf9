"""From Python: what the guide does not show of each verb's function, on one small run."""

import pytest
from refusals import refused

import toppling


def test_a_plan_has_the_jobs_of_the_run(inputs, whole):
    planned = toppling.plan(inputs / "campaign.toml")
    ids = toppling.query(whole, "select job_id from results order by all")["job_id"].to_pylist()
    assert sorted(planned.jobs["job_id"].to_pylist()) == ids
    assert (len(ids), whole.session.done, whole.session.failed) == (72, 72, 0)


def test_a_hazard_without_an_age_is_refused(whole):
    with refused("age.needed"):
        toppling.constrain([whole.path], hazard=["curve.csv"])


@pytest.mark.thorough
def test_a_report_is_one_page(whole, tmp_path):
    written = toppling.report(whole, tmp_path / "report.html", samples=20)
    assert "</html>" in written.page.read_text("utf-8")
    assert written.pdf is None


def test_check_judges_every_seismogram_of_an_ensemble(inputs):
    checked = toppling.check(inputs / "scene", [inputs / "ensemble"], neighbours=1, preset="fast")
    assert checked.frame()["record_id"].tolist() == ["P0", "P1", "P2"]
    assert all(verdict.shaken == 3 for verdict in checked.verdicts)
