"""A query has limits: what needs too much ends in a sentence, in a short time, and not with the machine's memory."""

import time

import pytest
from refusals import refused
from seeded import row

from toppling.results import queries
from toppling.results.reader import open_run
from toppling.results.store import write_part


@pytest.fixture
def run(tmp_path):
    write_part(tmp_path, [row("a", toppled=True), row("b", toppled=False)])
    return open_run(tmp_path)


@pytest.mark.parametrize(
    "query",
    [
        "select count(*) from range(100000000000) a, range(1000) b where a.range % 7 = b.range",
        "with recursive t(n) as (select 1 union all select n + 1 from t where n > 0) select max(n) from t",
        "select * from range(10000000000000)",
    ],
)
def test_a_query_that_takes_too_long_is_stopped(run, monkeypatch, query):
    monkeypatch.setattr(queries, "_TIME_S", 0.5)
    began = time.monotonic()
    with refused("query.too_large"):
        run.sql(query)
    assert time.monotonic() - began < 30.0


@pytest.mark.parametrize(
    "query",
    [
        "select list(range) from range(400000000)",
        "select string_agg(repeat('x', 1000000), '') from range(100000)",
        "select repeat('x', 100000) from range(100000)",
    ],
)
def test_a_query_that_needs_too_much_memory_is_refused(run, monkeypatch, query):
    monkeypatch.setattr(queries, "_MEMORY_BYTES", 64 << 20)
    with refused("query.too_large"):
        run.sql(query)


def test_an_answer_within_the_limits_is_whole(run):
    assert run.sql("select * from range(123456)").num_rows == 123456
    assert run.sql("select job_id from results where false").column_names == ["job_id"]
    assert len(run.frame("toppled")) == 1
