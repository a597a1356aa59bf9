"""Rows of several runs that answer different questions are not pooled unasked."""

import pytest
from refusals import refused
from seeded import rows

from toppling.results.queries import ask
from toppling.results.reader import open_run
from toppling.results.store import write_part

POOLED = (
    "select level_pga_m_s2, avg(toppled::int) p, count(toppled) n from results group by all -- engine, 'run'"
)


def made(folder, **values):
    folder.mkdir()
    jobs = rows(records=2, levels=(1, 2), azimuths=(0.0,))
    write_part(folder, [{**job, "physics_version": "15", **values} for job in jobs])
    return open_run(folder)


@pytest.mark.parametrize(
    ("column", "other"),
    [("engine", "mujoco"), ("preset", "fast"), ("scene_id", "another"), ("physics_version", "16")],
)
def test_rows_of_runs_that_differ_never_share_a_cell_unasked(tmp_path, column, other):
    runs = [made(tmp_path / "a"), made(tmp_path / "b", **{column: other})]
    with refused("query.runs_differ", column, other):
        ask(runs, POOLED)
    for name in (column, column.upper(), "run"):
        assert len(ask(runs, f"select {name}, level_pga_m_s2 l, count(*) n from results group by all")) == 4
    assert len(ask(runs, f"select count(*) n from results where {column} = '{other}'")) == 1
    assert len(ask(runs, "select * from results")) == 8


def test_runs_that_differ_in_two_columns_are_told_apart_by_both(tmp_path):
    runs = [
        made(tmp_path / "a"), made(tmp_path / "b", engine="mujoco"),
        made(tmp_path / "c", engine="mujoco", preset="fast"),
    ]  # fmt: skip
    with refused("query.runs_differ"):
        ask(runs, "select engine, count(*) n from results group by all")
    assert len(ask(runs, "select engine, preset, count(*) n from results group by all")) == 3


def test_runs_that_do_not_differ_and_other_tables_are_pooled(tmp_path):
    assert ask([made(tmp_path / "a"), made(tmp_path / "b")], POOLED)["n"].to_pylist() == [4, 4]
    runs = [open_run(tmp_path / "a"), made(tmp_path / "c", engine="mujoco")]
    assert ask(runs, "select 1 one").to_pylist() == [{"one": 1}]
    with refused("query.runs_differ"):
        ask(runs, POOLED, trusted=True)
