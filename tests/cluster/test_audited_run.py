"""On real workers: a run audits itself."""

import dataclasses
import json
from contextlib import nullcontext

import pytest
from answers import sorted_answers
from click.testing import CliRunner

from toppling.models.motions.ensemble import Ensemble
from toppling.models.scene import Scene
from toppling.orchestrator.cli import cli
from toppling.orchestrator.context import RunProgress, Work
from toppling.orchestrator.plan import plan, plan_of
from toppling.orchestrator.run import run
from toppling.orchestrator.status import state_of
from toppling.orchestrator.studies.audit import Auditing, audit
from toppling.orchestrator.task import versions
from toppling.results.reader import open_run


def silent(progress):
    """Watch nothing."""


@pytest.mark.thorough
def test_a_run_audits_itself_and_its_rows_stay_what_they_are(campaign, client, undisturbed, tmp_path):
    audited = dataclasses.replace(campaign, audit=40)
    folder = tmp_path / "run"
    run(plan_of(audited), folder, nullcontext(client), silent, stages=[Auditing()])
    assert sorted_answers(open_run(folder).table()) == undisturbed
    state = state_of(folder)
    assert state["audit"]["jobs"] == 40
    assert state["audit"]["engines"]["mujoco"]["jobs"] == 40
    assert "40 of 72 jobs done again with reference" in state["audit_sentences"][0]
    planned = plan(audited, Scene.load(audited.scene), Ensemble.load(audited.ensemble))
    assert Auditing().due(planned, folder) == 0
    # More jobs add to those that were done.
    progresses = audit(Work(planned, folder, versions(), client, silent, RunProgress(46, 0)), 46)
    assert [(progress.before, progress.done) for progress in progresses] == [(40, 6)] * len(progresses)
    told = CliRunner().invoke(cli, ["status", str(folder), "--json"])
    assert json.loads(told.stdout)["audit"]["jobs"] == 46
