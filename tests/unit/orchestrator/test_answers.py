"""A worker's row counts only if it answers the job that was asked."""

import dataclasses
import math
import timeit
from datetime import UTC, datetime, timedelta

import numpy as np
import pyarrow as pa
import pytest
from reference.idealised import ricker

from toppling.models.hidden_base.draws import BaseDraw, UnseenBase
from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.record import Record
from toppling.models.scene import Scene
from toppling.orchestrator.answers import Asked
from toppling.orchestrator.campaign import Campaign
from toppling.orchestrator.plan import plan_of
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
    """Two records at two levels on two realisations of a rock whose base is drawn, with their genuine rows."""
    folder = tmp_path_factory.mktemp("answers")
    corners_m = np.array([[x, y, 0.0] for x in (-0.15, 0.15) for y in (-0.2, 0.2)])
    unseen = UnseenBase(0.1, tuple(BaseDraw(corners_m * share) for share in (0.9, 0.8)))
    scene = dataclasses.replace(Scene.block(0.15, 0.2, 0.6), unseen=unseen)
    records = [
        Record.of(name, ricker(hz, 0.8, 0.01), event=f"E{name}") for name, hz in (("P", 2.0), ("Q", 1.5))
    ]
    ensemble = Ensemble.write(folder / "ensemble", records)
    scene.save(folder / "scene")
    (folder / "campaign.toml").write_text(
        'scene = "scene"\nensemble = "ensemble"\npga_m_s2 = [1.0, 9.0]\nazimuth_deg = [0.0, 90.0]\nfriction = [0.9]\n'
        'realisations = 3\npreset = "fast"\n'
    )
    plan = plan_of(Campaign.read(folder / "campaign.toml"))
    specs = [plan.spec(row) for row in range(len(plan))]
    rows = [run_job(spec, Assets(scene, ensemble)) | OF_WORKER for spec in specs]
    return Asked(plan, folder), specs, rows


def pair(planned):
    """A job in which the rock topples on a drawn base, and another that differs in all that jobs differ in."""
    asked, specs, rows = planned
    toppled = next(n for n, row in enumerate(rows) if row["toppled"] and row["base"] is not None)
    other = next(
        n for n, row in enumerate(rows)
        if not row["toppled"]
        and all(row[name] != rows[toppled][name] for name in ("record_id", "base", "azimuth_deg"))
    )  # fmt: skip
    return asked, specs[toppled], rows[toppled], rows[other]


def problem(planned, row):
    asked, spec, _, _ = pair(planned)
    rows, wrong = asked.checked([spec], [row])
    assert len(rows) + len(wrong) == 1
    return wrong.get(0, "")


def test_genuine_rows_stay_as_they_are(planned):
    asked, specs, rows = planned
    assert {row["toppled"] for row in rows} == {True, False}
    assert asked.checked(specs, rows) == (rows, {})
    assert asked.checked(specs, rows[:2]) == (rows[:2], {})  # the time budget left no room for the others
    lost = [lost_row(spec, "failed", "why") | OF_WORKER for spec in specs]
    assert asked.checked(specs, lost) == (lost, {})


def test_a_tilt_that_is_not_a_number_is_null_where_the_shake_diverged(planned):
    _, _, row, _ = pair(planned)
    change = dict.fromkeys(("toppled", "outcome", "topple_time_s", "topple_azimuth_deg")) | {
        "max_tilt_deg": math.nan
    }
    assert problem(planned, row | change | {"status": "diverged"}) == ""
    assert "max_tilt_deg" in problem(planned, row | change | {"status": "undecided"})


def nonsense(field):
    """Values of another type, and beyond what the column holds."""
    low, high = LIMITS[field.name]
    if field.type == pa.string():
        return [1, 1.0, True, b"x", [], "x" * (high + 1)]
    if field.type == pa.bool_():
        return [1, 0.0, "true", np.True_]
    if pa.types.is_timestamp(field.type):
        without_zone = datetime(2026, 1, 1)
        return ["2026-01-01", 1.0, without_zone, low - timedelta(days=1), high + timedelta(days=1)]
    below, above = (low - 1, high + 1) if isinstance(low, int) else (low - 1e-3, 2.0 * high)
    return ["1", True, [], below, above, math.nan, math.inf, -math.inf]


BY_THE_CLIENT = {"rock", "attempt"}
"""What a worker may not even give."""


@pytest.mark.parametrize("name", SCHEMA.names)
def test_nonsense_in_any_column_is_no_answer(planned, name):
    _, _, row, _ = pair(planned)
    for value in nonsense(SCHEMA.field(name)):
        assert name in problem(planned, row | {name: value}), value
    for value in (1, "x") if name in BY_THE_CLIENT else ():
        assert name in problem(planned, row | {name: value})


UNKNOWABLE = {
    "topple_time_s", "topple_azimuth_deg", "max_tilt_deg", "residual_tilt_deg", "residual_yaw_deg", "slip_m",
    "penetration_m", "ended_by", "message", "steps", "engine_steps", "simulated_s", "skipped_s", "wall_s",
    "time_step_s", "worker", "cpu", "kernels", "finished_at",
}  # fmt: skip
"""Columns that the worker alone can fill: within their limits the client believes them."""

OF_THE_ANSWER = {"status", "outcome", "toppled"}
"""Believed if they agree with each other."""


@pytest.mark.parametrize("name", sorted(set(SCHEMA.names) - UNKNOWABLE - OF_THE_ANSWER - BY_THE_CLIENT))
def test_what_the_client_knows_of_a_job_is_compared(planned, name):
    _, _, row, other = pair(planned)
    values = [None]
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
    _, _, row, _ = pair(planned)
    high = LIMITS[name][1]
    value = "x" * high if isinstance(row[name], str | None) else high
    assert problem(planned, row | {name: value}) == ""


@pytest.mark.parametrize(
    "change",
    [
        {"toppled": None}, {"outcome": None}, {"outcome": "stands"}, {"outcome": "fallen"}, {"toppled": False},
        {"toppled": False, "outcome": "stands"}, {"toppled": None, "outcome": None},
        {"toppled": None, "outcome": None, "topple_time_s": None, "topple_azimuth_deg": None}, {"status": "diverged"},
        {"status": "crashed"}, {"status": "fine"}, {"status": None}, {"topple_time_s": None}, {"steps": None},
        {"slip_m": None}, {"worse": 1},
    ], ids=str,
)  # fmt: skip
def test_a_row_that_contradicts_itself_or_says_less_than_a_shake_is_no_answer(planned, change):
    _, _, row, _ = pair(planned)
    assert problem(planned, row | change) != ""


def test_rows_exchanged_within_a_batch_are_no_answers_and_the_others_are(planned):
    asked, specs, rows = planned
    sound, wrong = asked.checked(specs, [rows[1], rows[0], *rows[2:]])
    assert sorted(wrong) == [0, 1]
    assert sound == rows[2:]
    table_of(sound)


@pytest.mark.parametrize("result", [None, [], {}, "rows", [None], [7] * 500, np.zeros(3)], ids=str)
def test_what_is_no_list_of_rows_costs_the_first_job_and_not_the_run(planned, result):
    asked, specs, _ = planned
    rows, wrong = asked.checked(specs, result)
    assert rows == []
    assert list(wrong) == [0]


def test_holding_the_displacement_may_take_pga_but_adds_none(planned):
    asked, spec, row, _ = pair(planned)
    held = dataclasses.replace(spec, peak_displacement_m=1e-3)
    row = row | {"job_id": held.job_id}
    assert asked.checked([held], [row | {"pga_m_s2": 0.7, "pgv_m_s": 0.1}])[1] == {}
    assert "pga_m_s2" in asked.checked([held], [row | {"pga_m_s2": spec.pga_m_s2 * 1.1}])[1][0]


def test_checking_a_row_costs_little(planned):
    """Beside the quarter of a millisecond that a client takes for a job; a table made of each row would take more."""
    asked, specs, rows = planned
    assert min(timeit.repeat(lambda: asked.checked(specs, rows), number=5, repeat=10)) / 5 / len(rows) < 1e-4
