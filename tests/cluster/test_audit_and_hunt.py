"""On real workers: a run that chooses its levels shakes those that one process would, and a run audits itself."""

import dataclasses
import json
from contextlib import nullcontext

import pytest
from answers import ANSWERS, sorted_answers
from click.testing import CliRunner

from toppling.models.motions.ensemble import Ensemble
from toppling.models.scene import Scene
from toppling.orchestrator.audit import AFTERWARDS, audit, due
from toppling.orchestrator.cli import cli
from toppling.orchestrator.hunting import hunt_of
from toppling.orchestrator.plan import plan
from toppling.orchestrator.run import run
from toppling.orchestrator.status import state_of
from toppling.orchestrator.task import Order, versions
from toppling.results.hunted import SKIPPED
from toppling.results.run import open_run
from toppling.results.store import RESULTS_FILE

MARKS = {"choice_probability", "expected_toppled"}


def silent(tally):
    """Watch nothing."""


@pytest.fixture
def hunted(campaign):
    return dataclasses.replace(campaign, levels="hunt")


def test_two_workers_hunt_the_levels_that_one_process_would(hunted, client, undisturbed, tmp_path):
    run(hunted, tmp_path / "run", nullcontext(client), silent)
    rows = {row["job_id"]: row for row in open_run(tmp_path / "run").table().to_pylist()}
    whole = {row["job_id"]: row for row in undisturbed}
    assert set(rows) == set(whole)
    planned = plan(hunted, Scene.load(hunted.scene), Ensemble.load(hunted.ensemble))
    ids = planned.jobs["job_id"].to_pylist()
    hunt, known = hunt_of(planned), {}
    while chosen := hunt.next_rows(known)[0]:
        known |= {ids[row]: bool(whole[ids[row]]["toppled"]) for row in chosen}
    shaken = {job_id for job_id, row in rows.items() if row["status"] != SKIPPED}
    assert shaken == set(known)
    assert 0 < len(shaken) < len(rows)
    for job_id in shaken:
        assert all(rows[job_id][name] == whole[job_id][name] for name in ANSWERS if name not in MARKS)
    for job_id in set(rows) - shaken:  # what is known of a motion without shaking is there
        assert rows[job_id]["pgv_m_s"] == whole[job_id]["pgv_m_s"]
        assert rows[job_id]["choice_probability"] > 0
    state = state_of(tmp_path / "run")
    assert (state["state"], state["failed"]) == ("complete", 0)


def test_a_hunt_that_is_stopped_goes_on_to_the_same_rows(hunted, client, tmp_path):
    class StoppedError(Exception):
        """As Ctrl-C would."""

    def stop(tally):
        if tally.done > 8:
            raise StoppedError

    run(hunted, tmp_path / "whole", nullcontext(client), silent)
    with pytest.raises(StoppedError):
        run(hunted, tmp_path / "cut", nullcontext(client), stop)
    assert not (tmp_path / "cut" / RESULTS_FILE).exists()
    run(hunted, tmp_path / "cut", nullcontext(client), silent)
    cut, whole = (sorted_answers(open_run(tmp_path / name).table()) for name in ("cut", "whole"))
    assert cut == whole


def test_a_run_audits_itself_and_its_rows_stay_what_they_are(campaign, client, undisturbed, tmp_path):
    audited = dataclasses.replace(campaign, audit=24)
    folder = tmp_path / "run"
    run(audited, folder, nullcontext(client), silent, afterwards=AFTERWARDS)
    assert sorted_answers(open_run(folder).table()) == undisturbed
    state = state_of(folder)
    assert state["audit"]["jobs"] == 24
    assert state["audit"]["engines"]["mujoco"]["jobs"] == 24
    assert "24 of 72 jobs done again with reference" in state["audit_sentences"][0]
    planned = plan(audited, Scene.load(audited.scene), Ensemble.load(audited.ensemble))
    assert due(planned, folder) == 0
    # More jobs add to those that were done.
    order = Order(str(folder), planned.scene_id, planned.ensemble_id, versions())
    tallies = audit(planned, folder, client, order, silent, 30)
    assert [(tally.before, tally.done) for tally in tallies] == [(24, 6)] * len(tallies)
    told = CliRunner().invoke(cli, ["status", str(folder), "--json"])
    assert json.loads(told.stdout)["audit"]["jobs"] == 30
