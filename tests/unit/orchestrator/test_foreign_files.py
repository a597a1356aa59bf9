"""A run's files belong to it: whole, intact files of another run are refused by name in every verb that reads them."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from refusals import refused
from small_campaigns import NEEDED, planned_in

from toppling.models.files.digest import write_json
from toppling.models.motions.ensemble import Ensemble
from toppling.models.scene import Scene
from toppling.orchestrator.cli import cli
from toppling.orchestrator.run_folder import prepare
from toppling.orchestrator.studies.audit import AUDITORS
from toppling.orchestrator.task import versions
from toppling.results.reader import open_run
from toppling.results.run_integrity import AUDIT_FOLDER, DRAWN_FILE, REFERENCE, write_jobs
from toppling.results.store import compact, finished_ids, write_part
from toppling.results.weights import WEIGHTS_FILE, Weights
from toppling.workers.job import Assets, run_job

AUDIT = f"{AUDIT_FOLDER}/{REFERENCE}"
VERBS = {
    "query": ["query", "RUN", "select count(*) n from results"],
    "query --describe": ["query", "RUN", "--describe"],
    "fragility": ["fragility", "RUN"],
    "constrain": ["constrain", "RUN", "--age", "10000"],
    "status": ["status", "RUN"],
    "report": ["report", "RUN"],
    "replay": ["replay", "RUN", "JOB"],
    "audit": ["audit", "RUN", "--jobs", "40"],
    "resume": ["run", "CAMPAIGN", "--out", "RUN"],
}


def finished_run(folder, width_m):
    """A run of a block of some width, complete, with an audit and with weights of bases."""
    folder.mkdir()
    periods_s, levels = (0.6 + width_m, 1.0 + width_m), [*(0.5 * step for step in range(1, 10)), 50 * width_m]
    block = Scene.block(width_m, 0.2, 0.6)
    planned = planned_in(folder, periods_s, block, pga_m_s2=levels, preset="fast", audit=0)
    run = folder / "run"
    prepare(run, planned, dict(versions()))
    assets = Assets(block, Ensemble.load(folder / "ensemble"))
    write_part(run, [run_job(planned.spec(job), assets) | {"attempt": 1} for job in range(len(planned))])
    compact(run)
    place = run / AUDIT
    (place / "parts").mkdir(parents=True)
    part = AUDITORS[0].plan(planned, list(range(len(planned))))
    write_json(place / DRAWN_FILE, {"plan_id": planned.id, "until": None, "of_jobs": len(planned)})
    write_jobs(place, part.jobs, planned.id)
    write_part(place, [run_job(part.spec(job), assets) | {"attempt": 1} for job in range(len(part))])
    compact(place)
    Weights({(0.9, 0.9, 0.0): np.ones(1)}, "the rock stood K").write(run, planned.id)
    return run


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("foreign")
    return finished_run(folder / "mine", 0.15), finished_run(folder / "other", 0.18)


@pytest.fixture
def swap(runs, tmp_path):
    mine, other = runs

    def make(name):
        run = shutil.copytree(mine, tmp_path / "run")
        shutil.copyfile(other / name, run / name)
        return run

    return make


def call(words, run, mine):
    job = open_run(mine).table()["job_id"][0].as_py()
    filled = {"RUN": str(run), "JOB": job, "CAMPAIGN": str(mine.parent / "campaign.toml")}
    return CliRunner().invoke(cli, [filled.get(word, word) for word in words])


ALWAYS_READ = [name for name in NEEDED if name not in ("scene/pedestal.ply",)]  # both stand on one plane
IN_AUDITS = [f"{AUDIT}/{name}" for name in (DRAWN_FILE, "jobs.parquet", "results.parquet")]
CASES = [
    *((name, "status") for name in [*ALWAYS_READ, "results.parquet", *IN_AUDITS]),
    *(("run.json", verb) for verb in VERBS), *(("results.parquet", verb) for verb in ("resume", "replay", "audit")),
    *((WEIGHTS_FILE, verb) for verb in ("query", "fragility", "constrain", "status", "report")),
]  # fmt: skip
"""Every file is read by a verb, and every verb reads a file."""


@pytest.mark.parametrize(("name", "verb"), CASES)
def test_a_file_of_another_run_is_refused_by_name(swap, runs, name, verb):
    done = call(VERBS[verb], swap(name), runs[0])
    assert done.exception.code in ("run.file_foreign", "run.weights_unreadable"), done.output
    assert Path(name).name in str(done.exception)


def test_a_part_of_another_run_is_refused_and_stays_where_it_is(runs, tmp_path):
    run = shutil.copytree(runs[0], tmp_path / "run")
    part = write_part(run, open_run(runs[1]).table().to_pylist())
    for read in (open_run(run).table, lambda: finished_ids(run, frozenset({"a"}))):
        with refused("run.file_foreign") as refusal:
            read()
        assert refusal.value.where == str(part)
    assert part.exists()


@pytest.mark.parametrize("verb", ["query", "status", "resume"])
def test_a_part_that_cannot_be_opened_is_an_error_and_stays_where_it_is(runs, tmp_path, verb):
    run = shutil.copytree(runs[0], tmp_path / "run")
    part = run / "parts" / f"part-{'0' * 20}-{'a' * 8}.parquet"
    part.symlink_to("/proc/self/mem")  # opens, and answers with EIO
    done = call(VERBS[verb], run, runs[0])
    assert done.exception.code == "file.not_opened", done.output
    assert part.name in str(done.exception)
    assert part.is_symlink()
