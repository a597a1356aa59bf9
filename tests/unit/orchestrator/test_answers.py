"""A worker's row counts only if it answers the job that was asked."""

import dataclasses
import math
from datetime import UTC, datetime, timedelta

import numpy as np
import pyarrow as pa
import pytest
from small_campaigns import planned_in

from toppling.models.hidden_base.unseen_base import BaseDraw, UnseenBase
from toppling.models.motions.ensemble import Ensemble
from toppling.models.scene import Scene
from toppling.orchestrator.execution import Asked
from toppling.orchestrator.task import lost_row
from toppling.results.schema import LIMITS, SCHEMA
from toppling.results.store import table_of
from toppling.workers.job import Assets, run_job

OF_WORKER = {
    "worker": "host:1", "cpu": "a processor", "kernels": "some", "finished_at": datetime(2026, 1, 1, tzinfo=UTC),
}  # fmt: skip
"""What a worker adds to each row (`task.shake_batch`)."""


@pytest.fixture(scope="module")
def planned(tmp_path_factory):
    """Two records at two levels and azimuths on three realisations each of a drawn base, with their genuine rows."""
    folder = tmp_path_factory.mktemp("answers")
    corners_m = np.array([[x, y, 0.0] for x in (-0.15, 0.15) for y in (-0.2, 0.2)])
    unseen = UnseenBase(0.1, tuple(BaseDraw(corners_m * share) for share in (0.9, 0.8)))
    scene = dataclasses.replace(Scene.block(0.15, 0.2, 0.6), unseen=unseen)
    axes = {"pga_m_s2": [1.0, 9.0], "azimuth_deg": [0, 45, 90, 135], "realisations": 3, "preset": "fast"}
    plan = planned_in(folder, (0.8, 1.0), scene, **axes)
    ensemble = Ensemble.load(folder / "ensemble")
    rows = [run_job(plan.spec(row), Assets(scene, ensemble)) | OF_WORKER for row in range(len(plan))]
    return Asked(plan, folder), plan, rows


def pair(planned):
    """Number of a job in which the rock topples on a drawn base, its row, and another that differs in all else."""
    _, _, rows = planned
    toppled = next(n for n, row in enumerate(rows) if row["toppled"] and row["base"] is not None)
    other = next(
        n for n, row in enumerate(rows)
        if not row["toppled"]
        and all(row[name] != rows[toppled][name] for name in ("record_id", "base", "azimuth_deg"))
    )  # fmt: skip
    return toppled, rows[toppled], rows[other]


def problem(planned, row):
    asked, (job, _, _) = planned[0], pair(planned)
    rows, wrong = asked.checked(np.array([job]), table_of([row]))
    assert len(rows) + len(wrong) == 1
    return wrong.get(0, "")


def test_genuine_rows_stay_as_they_are(planned):
    asked, plan, rows = planned
    assert {row["toppled"] for row in rows} == {True, False}
    jobs, table = np.arange(len(plan)), table_of(rows)
    assert asked.checked(jobs, table) == (table, {})
    assert asked.checked(jobs, table[:2]) == (table[:2], {})  # the time budget left no room for the others
    lost = table_of([lost_row(plan.spec(job), "failed", "why") | OF_WORKER for job in jobs])
    assert asked.checked(jobs, lost) == (lost, {})


def test_a_tilt_that_is_not_a_number_is_null_where_the_shake_diverged(planned):
    _, row, _ = pair(planned)
    change = dict.fromkeys(
        ("toppled", "outcome", "topple_time_s", "falls_toward_deg", "falls_toward_bearing_deg")
    ) | {"max_tilt_deg": math.nan}
    assert problem(planned, row | change | {"status": "diverged"}) == ""
    assert problem(planned, row | change | {"status": "undecided"}).startswith("max_tilt_deg is ")


def nonsense(field):
    low, high = LIMITS[field.name]
    if field.type == pa.string():
        return ["x" * (high + 1)]
    if field.type == pa.bool_():
        return []
    if pa.types.is_timestamp(field.type):
        return [low - timedelta(days=1), high + timedelta(days=1)]
    if pa.types.is_integer(field.type):
        return [low - 1] + ([2 * high] if field.type == pa.int64() else [])
    return [low - 1e-3, 2.0 * high, math.inf, -math.inf]


BY_THE_CLIENT = {"rock": "x", "attempt": 1}
"""What a worker may not even give."""


@pytest.mark.parametrize("name", SCHEMA.names)
def test_nonsense_in_any_column_is_no_answer(planned, name):
    _, row, _ = pair(planned)
    for value in [BY_THE_CLIENT[name]] if name in BY_THE_CLIENT else nonsense(SCHEMA.field(name)):
        assert problem(planned, row | {name: value}).startswith(f"{name} is "), value


def test_a_table_with_other_columns_or_types_is_no_answer(planned):
    asked, _, rows = planned
    table = table_of(rows[:1])
    for other in (
        table.drop_columns("toppled"),
        table.append_column("worse", pa.array([1])),
        table.set_column(0, "job_id", pa.array([b"x"])),
        table.to_pylist(),
    ):
        found, wrong = asked.checked(np.array([0]), other)
        assert (len(found), list(wrong)) == (0, [0])


UNKNOWABLE = {
    "topple_time_s", "falls_toward_deg", "falls_toward_bearing_deg", "max_tilt_deg", "residual_tilt_deg",
    "residual_yaw_deg", "slip_m", "penetration_m", "ended_by", "message", "steps", "engine_steps", "simulated_s",
    "skipped_s", "wall_s", "time_step_s", "worker", "cpu", "kernels", "finished_at",
}  # fmt: skip
"""Columns that the worker alone can fill: within their limits the client believes them."""

OF_THE_ANSWER = {"status", "outcome", "toppled"}
"""Believed if they agree with each other."""


@pytest.mark.parametrize("name", sorted(set(SCHEMA.names) - UNKNOWABLE - OF_THE_ANSWER - set(BY_THE_CLIENT)))
def test_what_the_client_knows_of_a_job_is_compared(planned, name):
    _, row, other = pair(planned)
    values = [None] if SCHEMA.field(name).nullable else []
    if isinstance(row[name], float):
        values += [row[name] + 1e-6 * (row[name] or 1.0), 0.123]
        values += [] if math.isclose(row[name], other[name]) else [other[name]]
    elif isinstance(row[name], int):
        values += [row[name] + 1, other[name]]
    else:
        values += ["another", *({other[name]} - {row[name]})]
    for value in values:
        assert problem(planned, row | {name: value}).startswith(f"{name} is "), value


@pytest.mark.parametrize("name", sorted(UNKNOWABLE))
def test_what_only_the_worker_knows_is_believed_within_its_limits(planned, name):
    _, row, _ = pair(planned)
    high = LIMITS[name][1]
    value = "x" * high if isinstance(row[name], str | None) else high
    assert problem(planned, row | {name: value}) == ""


@pytest.mark.parametrize(
    "change",
    [
        {"toppled": None}, {"outcome": None}, {"outcome": "stands"}, {"outcome": "fallen"}, {"toppled": False},
        {"toppled": False, "outcome": "stands"}, {"toppled": None, "outcome": None},
        {"toppled": None, "outcome": None, "topple_time_s": None, "falls_toward_deg": None}, {"status": "diverged"},
        {"status": "crashed"}, {"status": "fine"}, {"topple_time_s": None}, {"steps": None},
        {"slip_m": None},
    ], ids=str,
)  # fmt: skip
def test_a_contradictory_or_incomplete_row_is_no_answer(planned, change):
    _, row, _ = pair(planned)
    assert problem(planned, row | change) != ""


def test_rows_exchanged_within_a_batch_are_no_answers_and_the_others_are(planned):
    asked, plan, rows = planned
    sound, wrong = asked.checked(np.arange(len(plan)), table_of([rows[1], rows[0], *rows[2:]]))
    assert sorted(wrong) == [0, 1]
    assert sound == table_of(rows[2:])


@pytest.mark.parametrize("rows", [0, 500])
def test_as_many_rows_as_no_jobs_or_more_jobs_cost_the_first_job_and_not_the_run(planned, rows):
    asked, plan, there = planned
    answer = table_of(there).take([0] * rows) if rows else SCHEMA.empty_table()
    found, wrong = asked.checked(np.arange(len(plan)), answer)
    assert (len(found), list(wrong)) == (0, [0])


def test_holding_the_displacement_may_take_pga_but_adds_none(planned):
    asked, plan, _ = planned
    job, row, _ = pair(planned)
    campaign = dataclasses.replace(plan.campaign, peak_displacement_m=1e-3)
    held = dataclasses.replace(plan, campaign=campaign).with_ids()
    asked = Asked(held, asked.folder)
    row = row | {"job_id": held.spec(job).job_id, "pgv_m_s": 0.1}
    level = held.spec(job).pga_m_s2
    assert asked.checked(np.array([job]), table_of([row | {"pga_m_s2": 0.7}]))[1] == {}
    assert "pga_m_s2" in asked.checked(np.array([job]), table_of([row | {"pga_m_s2": level * 1.1}]))[1][0]
