"""Queries answer with what the run has now, within limits, and pool nothing that differs unasked."""

import json
import time

import pyarrow as pa
import pytest
from click.testing import CliRunner
from refusals import refused
from seeded import row, rows
from small_campaigns import run_in

import toppling.orchestrator.status
import toppling.results.queries
import toppling.results.reader
import toppling.results.store
from toppling.models.errors import InputError
from toppling.models.files.digest import write_table
from toppling.models.scene import Scene
from toppling.orchestrator.cli import cli
from toppling.orchestrator.status import state_of
from toppling.results.queries import ask
from toppling.results.reader import open_run
from toppling.results.store import compact, read_steady, write_part


@pytest.fixture
def run_folder(tmp_path):
    folder = tmp_path / "run"
    Scene.block(0.2, 0.2, 0.6).save(folder / "scene")
    (folder / "ensemble").mkdir()
    catalogue = pa.table({"record_id": ["R000", "R001", "R002"], "magnitude": [6.5, 7.0, 7.5]})
    write_table(catalogue, folder / "ensemble" / "catalog.parquet")
    run_in(folder, rows(records=3, levels=(1, 2), azimuths=(0.0,)))
    return folder


def test_a_running_run_shows_every_job_once(run_folder):
    run = open_run(run_folder)
    assert run.sql("select count(*) n from results").to_pylist() == [{"n": 6}]
    write_part(run_folder, [row("new"), row("R000-0-1-1", attempt=2)])
    assert run.sql("select count(*) n from results").to_pylist() == [{"n": 7}]
    assert len(run.table()) == len(run.frame()) == run.dataset().count_rows() == 7
    compact(run_folder)
    assert run.sql("select count(*) n from results").to_pylist() == [{"n": 7}]


READERS = {
    "sql": (toppling.results.reader, lambda run: run.sql("select count(*) n from results")["n"][0].as_py()),
    "table": (toppling.results.reader, lambda run: len(run.table())),
    "status": (toppling.orchestrator.status, lambda run: state_of(run.path)["stored"]),
}


@pytest.mark.parametrize(
    ("reader", "module", "step", "before"),
    [
        *((name, module, "result_files", False) for name, (module, _) in READERS.items()),
        *((name, toppling.results.store, "_is_ours", True) for name in READERS),
        ("sql", toppling.results.queries, "_connect", False),  # under a lazy query
    ],
)
def test_parts_that_are_merged_around_a_step_of_a_reading_neither_stop_it_nor_are_missed(
    run_folder, monkeypatch, reader, module, step, before
):
    """Merged for real, once, where a run's end may fall."""
    write_part(run_folder, [row("late")])
    taken = getattr(module, step)

    def merging(*arguments):
        monkeypatch.setattr(module, step, taken)  # before it merges, which takes the same steps
        if before:
            compact(run_folder)
            return taken(*arguments)
        answer = taken(*arguments)
        compact(run_folder)
        return answer

    monkeypatch.setattr(module, step, merging)
    assert READERS[reader][1](open_run(run_folder)) == 7
    assert getattr(module, step) is taken, "nothing was merged"


def test_a_reading_that_fails_by_itself_is_not_tried_again(run_folder):
    tries = []

    def read():
        tries.append(write_part(run_folder, [row("new")]))
        raise ValueError("by itself")

    with pytest.raises(ValueError, match="by itself"):
        read_steady([run_folder], read)
    assert len(tries) == 1


def test_a_run_without_rows_yet_answers_with_none(tmp_path):
    assert run_in(tmp_path, []).sql("select count(*) n from results").to_pylist() == [{"n": 0}]


def test_results_join_their_records_and_their_scene(run_folder):
    joined = open_run(run_folder).sql(
        "select magnitude, least_quasi_static_m_s2 a from results join motions using (record_id), scene"
    )
    assert set(joined.column("magnitude").to_pylist()) == {6.5, 7.0, 7.5}
    # A block of half width 0.2 and half height 0.6 topples at a third of gravity.
    assert joined.column("a")[0].as_py() == pytest.approx(9.81 / 3)


def test_several_runs_are_distinguished_by_their_folder(run_folder, tmp_path):
    other = run_in(tmp_path / "other", rows(records=2, levels=(1,), azimuths=(0.0,), friction=0.6))
    sql = "select run, count(*) n from results group by run order by run"
    counts = ask([open_run(run_folder), other], sql)
    assert counts.to_pylist() == [{"run": "other", "n": 2}, {"run": "run", "n": 6}]
    with refused("run.names_repeated"):
        ask([other, other], "select 1")


def test_a_folder_that_is_no_run_and_a_query_that_is_no_sql_are_refused(run_folder, tmp_path):
    with refused("run.absent"):
        open_run(tmp_path)
    with refused("run.absent"):
        open_run(tmp_path / "nowhere")
    with refused("query.failed"):
        open_run(run_folder).sql("select nonsense from results")


def test_counts_stay_whole_numbers_and_json_holds_no_infinity(run_folder):
    sql = (
        "select level_pga_m_s2::int l, sum(1) n, 1 / 0.0 odds, [1.5::decimal(3, 1)] d, "
        "case when level_pga_m_s2 > 1 then 7 end k from results group by all order by l"
    )

    def asked(form):
        return CliRunner().invoke(cli, ["query", str(run_folder), sql, form], catch_exceptions=False).output

    assert json.loads(asked("--json")) == [
        {"l": 1, "n": 3, "odds": None, "d": [1.5], "k": None},
        {"l": 2, "n": 3, "odds": None, "d": [1.5], "k": 7},
    ]
    assert [line.rpartition(",")[2] for line in asked("--csv").splitlines()] == ["k", "", "7"]


@pytest.fixture
def own(tmp_path):
    path = tmp_path / "mine.csv"
    path.write_text("record_id,site\nR000,A\nR001,B\n")
    return path


BEYOND = {
    "reads a file": "select * from '{own}'", "reads a file by a function": "select * from read_csv('{own}')",
    "reads any bytes": "select * from read_text('{own}')", "lists files": "select * from glob('{own}')",
    "writes a file": "copy results to '{written}'", "exports": "export database '{written}'",
    "opens a database": "attach '{written}'", "loads an extension": "install httpfs",
    "unlocks": "set enable_external_access = true", "asks twice": "select 1; select 2",
    "hides a second one": "select 1; copy results to '{written}'",
    "makes a table": "create table x as select 1", "drops": "drop view results",
    "calls": "call pragma_version()", "explains by running": "explain analyze select 1",
    "sees variables of the program": "select * from table_of_the_program", "nothing": "",
}  # fmt: skip


@pytest.mark.parametrize("kind", BEYOND)
def test_a_query_only_reads_the_tables_of_its_runs(run_folder, own, tmp_path, kind):
    table_of_the_program = pa.table({"a": [1]})
    assert len(table_of_the_program) == 1
    written = tmp_path / "written"
    with pytest.raises(InputError):
        open_run(run_folder).sql(BEYOND[kind].format(own=own, written=written))
    assert not written.exists()


@pytest.mark.parametrize(
    "where",
    [
        "true; copy results to '{written}'", "true limit 1", "true group by all",
        "true) union all (select * from results", "exists (select * from read_text('{own}'))", "true, false",
        "count(*) > 1",
    ],
)  # fmt: skip
def test_a_condition_is_a_single_expression_over_the_tables_of_its_run(run_folder, own, tmp_path, where):
    written = tmp_path / "written"
    with pytest.raises(InputError):
        open_run(run_folder).frame(where.format(own=own, written=written))
    assert not written.exists()


def test_a_condition_may_ask_the_other_tables_and_own_files_if_trusted(run_folder, own):
    run = open_run(run_folder)
    magnitude = "record_id in (select record_id from motions where magnitude > 6.9) and level_pga_m_s2 = 1"
    assert set(run.frame(magnitude)["record_id"]) == {"R001", "R002"}
    mine = f"record_id in (select record_id from '{own}' where site = 'A')"
    assert set(run.frame(mine, trusted=True)["record_id"]) == {"R000"}


@pytest.fixture
def run(tmp_path):
    return run_in(tmp_path, [row("a", toppled=True), row("b", toppled=False)])


@pytest.mark.parametrize(
    "query",
    [
        "select count(*) from range(100000000000) a, range(1000) b where a.range % 7 = b.range",
        "with recursive t(n) as (select 1 union all select n + 1 from t where n > 0) select max(n) from t",
        "select * from range(10000000000000)",
    ],
)
def test_a_query_that_takes_too_long_is_stopped(run, monkeypatch, query):
    monkeypatch.setattr(toppling.results.queries, "_TIME_S", 0.5)
    began = time.monotonic()
    with refused("query.too_large"):
        run.sql(query)
    assert time.monotonic() - began < 30.0


@pytest.mark.parametrize(
    "query",
    [
        "select list(range) from range(400000000)", "select string_agg(repeat('x', 1000000), '') from range(100000)",
        "select repeat('x', 100000) from range(100000)",
    ],
)  # fmt: skip
def test_a_query_that_needs_too_much_memory_is_refused(run, monkeypatch, query):
    monkeypatch.setattr(toppling.results.queries, "_MEMORY_BYTES", 64 << 20)
    with refused("query.too_large"):
        run.sql(query)


POOLED = (
    "select level_pga_m_s2, avg(toppled::int) p, count(toppled) n from results group by all -- engine, 'run'"
)


def made(folder, **values):
    jobs = rows(records=2, levels=(1, 2), azimuths=(0.0,))
    scene_id = values.get("scene_id", "scene")
    return run_in(folder, [{**job, "physics_version": "15", **values} for job in jobs], scene_id=scene_id)


@pytest.mark.parametrize(
    ("column", "other"),
    [("engine", "mujoco"), ("preset", "fast"), ("scene_id", "another"), ("physics_version", "16")],
)
def test_rows_of_runs_that_differ_are_never_pooled_unasked(tmp_path, column, other):
    runs = [made(tmp_path / "a"), made(tmp_path / "b", **{column: other})]
    with refused("query.runs_differ", column, other):
        ask(runs, POOLED)
    for name in (column, column.upper(), "run"):
        assert len(ask(runs, f"select {name}, level_pga_m_s2 l, count(*) n from results group by all")) == 4
    assert len(ask(runs, f"select count(*) n from results where {column} = '{other}'")) == 1
    assert len(ask(runs, "select * from results")) == 8


def test_runs_that_do_not_differ_and_other_tables_are_pooled(tmp_path):
    assert ask([made(tmp_path / "a"), made(tmp_path / "b")], POOLED)["n"].to_pylist() == [4, 4]
    runs = [open_run(tmp_path / "a"), made(tmp_path / "c", engine="mujoco")]
    assert ask(runs, "select 1 one").to_pylist() == [{"one": 1}]
    with refused("query.runs_differ"):
        ask(runs, POOLED, trusted=True)
