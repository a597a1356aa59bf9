"""Real jobs on two real worker processes: the same rows whatever goes wrong, and a run that audits itself."""

import dataclasses
import json
import os
import signal
import threading
import time
from contextlib import nullcontext

import dask
import pyarrow.parquet as pq
import pytest
from answers import answers_of, sorted_answers
from click.testing import CliRunner
from conftest import STILLBORN_VARIABLE
from refusals import refused

from toppling.models.motions.ensemble import Ensemble
from toppling.models.scene import Scene
from toppling.orchestrator.cli import cli
from toppling.orchestrator.cluster import local
from toppling.orchestrator.context import RunError, RunProgress, Work
from toppling.orchestrator.dask_cluster import check_workers
from toppling.orchestrator.dispatch import Limits
from toppling.orchestrator.plan import plan, plan_of
from toppling.orchestrator.run import run
from toppling.orchestrator.status import state_of
from toppling.orchestrator.studies.audit import audit, audit_due
from toppling.orchestrator.task import RunKey, versions
from toppling.results.reader import open_run


def test_two_workers_give_the_rows_of_a_single_process_bit_for_bit(whole, undisturbed):
    assert answers_of(whole.path) == undisturbed
    session = whole.session
    assert (session.done, session.failed, session.before) == (len(undisturbed), 0, 0)
    assert state_of(whole.path)["state"] == "complete"
    remaining = json.loads(pq.read_schema(whole.path / "results.parquet").metadata[b"run.json"])
    assert [(item["ended"], item["done"]) for item in remaining["sessions"]] == [("complete", session.done)]
    document = [json.loads(line) for line in (whole.path / "run.log").read_text().splitlines()]
    assert (document[0]["event"], document[0]["jobs"]) == ("session began", len(undisturbed))
    ended = ("session ended", "complete", len(undisturbed))
    assert (document[-1]["event"], document[-1]["how"], document[-1]["done"]) == ended
    assert any(entry["event"] == "rows stored" for entry in document)
    assert len({row["outcome"] for row in undisturbed}) > 1, "the ensemble must not be trivial"


def test_a_run_that_is_stopped_goes_on_where_it_was_and_killed_workers_cost_it_no_job(
    execute, client, undisturbed, tmp_path, faults
):
    def stop_after_ten(progress):
        if progress.done >= 10:
            raise KeyboardInterrupt

    faults.set(every=0.2)
    with pytest.raises(KeyboardInterrupt):
        execute(tmp_path / "run", stop_after_ten)
    stored = state_of(tmp_path / "run")["stored"]
    assert state_of(tmp_path / "run")["state"] == "interrupted"
    assert 10 <= stored < len(undisturbed)
    killed = []

    def kill(progress):
        if len(killed) < 2 and progress.done >= 10 * (len(killed) + 1):
            pids = client.run(os.getpid, on_error="ignore").values()
            pid = next((value for value in pids if value not in killed), None)
            if pid is None:
                return  # the one that is left was told to die, and has not yet
            killed.append(pid)
            # In the middle of its next batch: rows come as one ends, and a worker between two loses nothing.
            threading.Timer(0.7, os.kill, (pid, signal.SIGKILL)).start()

    progress = execute(tmp_path / "run", kill)
    assert len(killed) == 2
    assert progress.deaths >= 1
    assert (progress.before, progress.done) == (stored, len(undisturbed) - stored)
    assert answers_of(tmp_path / "run") == undisturbed


@pytest.mark.thorough
def test_a_worker_whose_job_hangs_ends_itself_the_job_is_given_up_and_the_others_are_answered(
    execute, undisturbed, tmp_path, faults
):
    hangs = undisturbed[5]["job_id"]
    faults.set(**{hangs: 100.0})
    progress = execute(tmp_path / "run", limits=Limits(job_s=1.0, tries=1))
    assert progress.deaths == 2  # in its batch, and alone
    assert progress.status == {"ok": len(undisturbed) - 1, "crashed": 1}
    (lost,) = [row for row in open_run(tmp_path / "run").table().to_pylist() if row["status"] == "crashed"]
    assert (lost["job_id"], lost["attempt"]) == (hangs, 2)
    document = [json.loads(line) for line in (tmp_path / "run" / "run.log").read_text().splitlines()]
    assert any("Timeout (" in entry["why"] for entry in document if entry["event"] == "worker process died")


def test_a_run_whose_workers_die_at_their_start_ends_soon_with_the_reason(
    campaign, undisturbed, tmp_path, faults_file, monkeypatch
):
    dask.config.refresh()
    with monkeypatch.context() as broken:
        broken.setenv(STILLBORN_VARIABLE, "1")
        began = time.monotonic()
        with pytest.raises(RunError, match="SIGKILL"):
            run(plan_of(campaign), tmp_path / "run", local(2), lambda progress: None)
        assert time.monotonic() - began < 20.0
    document = [json.loads(line) for line in (tmp_path / "run" / "run.log").read_text().splitlines()]
    deaths = [entry for entry in document if entry["event"] == "worker process died"]
    assert len(deaths) >= 2
    assert all("SIGKILL" in death["why"] and not death["joined"] for death in deaths)
    run(plan_of(campaign), tmp_path / "run", local(2), lambda progress: None)
    assert answers_of(tmp_path / "run") == undisturbed


@pytest.mark.parametrize("other", ["version", "scene"])
def test_workers_of_another_version_or_that_see_another_scene_are_refused_before_any_job(
    other, client, planned, inputs
):
    scene_id, installed = planned.scene_id, versions()
    if other == "scene":
        scene_id, named = "0" * 20, (planned.scene_id, "0000")
    else:
        installed, named = (
            tuple((name, "0.0") for name, _ in versions()),
            (dict(versions())["pybullet"], "0.0"),
        )
    with refused("cluster.workers_unfit", *named):
        check_workers(client, RunKey(str(inputs), scene_id, planned.ensemble_id, installed))


@pytest.mark.thorough
def test_a_run_audits_itself_and_its_rows_stay_what_they_are(campaign, client, undisturbed, tmp_path):
    audited = dataclasses.replace(campaign, audit=40)
    folder = tmp_path / "run"
    run(plan_of(audited), folder, nullcontext(client), lambda progress: None)
    assert sorted_answers(open_run(folder).table()) == undisturbed
    state = state_of(folder)
    assert state["audit"]["jobs"] == 40
    assert state["audit"]["engines"]["mujoco"]["jobs"] == 40
    planned = plan(audited, Scene.load(audited.scene), Ensemble.load(audited.ensemble))
    assert audit_due(planned, folder) == 0
    # More jobs add to those that were done.
    # Deaths are those of the whole session, before and in its audits.
    work = Work(planned, folder, versions(), client, lambda progress: None, RunProgress(46, 0, deaths=1))
    found = [(progress.before, progress.done, progress.deaths) for progress in audit(work, 46)]
    assert found == [(40, 6, 1)] * len(found)
    completed = CliRunner().invoke(cli, ["status", str(folder), "--json"])
    assert json.loads(completed.stdout)["audit"]["jobs"] == 46
