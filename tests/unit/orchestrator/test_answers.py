"""A worker's row counts only if it answers the job that was asked."""

import dataclasses
import math

import numpy as np
import pytest
from reference.idealised import ricker

from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.record import Record
from toppling.models.scene import Scene
from toppling.orchestrator.execution import checked
from toppling.results.store import table_of
from toppling.workers.job import Assets, JobSpec, run_job


@pytest.fixture(scope="module")
def batch(tmp_path_factory):
    """Jobs that end differently, and their genuine rows."""
    folder = tmp_path_factory.mktemp("answers")
    scene = Scene.block(0.15, 0.2, 0.6)
    ensemble = Ensemble.write(folder / "ensemble", [Record.of("P", ricker(2.0, 0.8, 0.01), event="E")])
    specs = [
        JobSpec(scene.id, "P", ensemble.sha("P"), pga, azimuth, 0.9, 0.9, 0.0, 0, "fast")
        for pga in (1.0, 9.0)
        for azimuth in (0.0, 90.0)
    ]
    return specs, [run_job(spec, Assets(scene, ensemble)) for spec in specs]


def test_genuine_rows_stay_as_they_are(batch):
    specs, rows = batch
    assert {row["toppled"] for row in rows} == {True, False}
    assert checked(specs, rows) == rows
    assert checked(specs, rows[:2]) == rows[:2]  # the time budget left no room for the others


def exchanged(rows, *names):
    """Rows of which two exchanged some columns."""
    first, *middle, last = (dict(row) for row in rows)
    for name in names:
        first[name], last[name] = last[name], first[name]
    return [first, *middle, last]


@pytest.mark.parametrize(
    "names",
    [
        ("job_id",),
        ("level_pga_m_s2", "azimuth_deg"),
        ("job_id", "level_pga_m_s2", "azimuth_deg"),
        ("pga_m_s2",),
    ],
)
def test_jobs_exchanged_within_a_batch_fail(batch, names):
    specs, rows = batch
    answers = checked(specs, exchanged(rows, *names))
    assert [row["status"] for row in answers] == ["failed", "ok", "ok", "failed"]
    assert [row["job_id"] for row in answers] == [spec.job_id for spec in specs]
    assert names[0] in answers[0]["message"]
    table_of(answers)


@pytest.mark.parametrize(
    "change",
    [
        {"toppled": None},
        {"outcome": None},
        {"outcome": "toppled", "toppled": False},
        {"outcome": "lodged", "toppled": False},
        {"toppled": "no"},
        {"toppled": None, "outcome": None},
        {"status": "diverged"},
        {"status": "fine"},
        {"status": None},
        {"pga_m_s2": None},
        {"pga_m_s2": 1.1},
        {"wall_s": math.nan},
        {"wall_s": "long"},
        {"worse": 1},
        {"scene_id": "another"},
        {"engine": "mujoco"},
        {"realisation": 1},
    ],
    ids=str,
)
def test_a_row_that_answers_nothing_or_something_else_fails(batch, change):
    specs, rows = batch
    answers = checked(specs, [rows[0] | change, *rows[1:]])
    assert answers[0]["status"] == "failed"
    assert "no answer to it" in answers[0]["message"]
    assert answers[1:] == rows[1:]
    table_of(answers)


@pytest.mark.parametrize("result", [None, [], {}, "rows", [None], [7] * 5, np.zeros(3)], ids=str)
def test_what_is_no_list_of_rows_costs_the_first_job_and_not_the_run(batch, result):
    specs, _ = batch
    answers = checked(specs, result)
    assert answers[0]["status"] == "failed"
    assert answers[0]["job_id"] == specs[0].job_id


def test_holding_the_displacement_may_take_pga_but_adds_none(batch):
    specs, rows = batch
    spec = dataclasses.replace(specs[0], peak_displacement_m=0.1)
    row = rows[0] | {"job_id": spec.job_id}
    assert checked([spec], [row | {"pga_m_s2": 0.7}])[0]["status"] == "ok"
    assert checked([spec], [row | {"pga_m_s2": 1.2}])[0]["status"] == "failed"


def test_one_row_that_cannot_be_stored_fails_alone(batch):
    specs, rows = batch
    changed = [*rows[:2], {**rows[2], "no_column": 1.0}, *rows[3:]]
    answers = checked(specs, changed)
    assert [row["status"] for row in answers] == ["ok", "ok", "failed", "ok"]
    assert "no_column" in answers[2]["message"]
