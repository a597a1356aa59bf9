"""The store keeps every row once, whatever is torn, repeated or foreign."""

import logging
import os
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from refusals import flip, refused
from seeded import row
from small_campaigns import run_in

from toppling.models.files.digest import write_table
from toppling.results import run_integrity, store
from toppling.results.schema import GROUPS, SCHEMA, describe
from toppling.results.store import attempts_with, compact, finished_ids, result_files, write_part


def test_every_column_has_a_meaning_and_a_unit_or_is_no_quantity():
    for field in SCHEMA:
        result = describe(field)
        assert result["group"] in GROUPS
        assert result["description"]
        quantity = pa.types.is_floating(field.type) or pa.types.is_integer(field.type)
        assert bool(result["unit"]) == (quantity or pa.types.is_timestamp(field.type)), field.name


def test_a_run_compacts_to_a_row_per_job_in_order(tmp_path):
    write_part(tmp_path, [row("c", level_pga_m_s2=3.0), row("a", level_pga_m_s2=1.0)])
    write_part(tmp_path, [row("b", level_pga_m_s2=2.0)])
    target = compact(tmp_path)
    table = pq.read_table(target)
    assert table.column("job_id").to_pylist() == ["a", "b", "c"]
    assert [path.name for path in result_files(tmp_path)] == ["results.parquet"]
    assert table.schema.field("pga_m_s2").metadata[b"unit"] == b"m/s2"


def test_however_many_parts_there_are_the_plan_is_looked_up_once(tmp_path, monkeypatch):
    write_table(pa.table({"job_id": [f"{n:024x}" for n in range(60)]}), tmp_path / "jobs.parquet")
    for part in range(20):
        write_part(tmp_path, [row(f"{3 * part + n:024x}") for n in range(3)])
    read, names = run_integrity.read_table, []
    monkeypatch.setattr(
        run_integrity, "read_table", lambda path, **asked: names.append(path.name) or read(path, **asked)
    )
    assert len(result_files(tmp_path)) == len(result_files(tmp_path)) == 20
    assert (names.count("jobs.parquet"), len(names)) == (1, 21)
    foreign = write_part(tmp_path, [row("b"), row(f"{3:024x}")])
    with refused("run.file_foreign") as refusal:
        result_files(tmp_path)
    assert refusal.value.where == str(foreign)


def test_a_run_whose_folder_vanished_stores_nothing_more(tmp_path):
    # Made anew, it would lack the rows stored before, and nobody would know.
    with pytest.raises(FileNotFoundError, match="gone"):
        write_part(tmp_path / "gone", [row("a")])
    assert not (tmp_path / "gone").exists()


def test_the_newest_attempt_counts_and_compacting_again_adds_what_came_later(tmp_path):
    write_part(tmp_path, [row("a", status="crashed"), row("b")])
    compact(tmp_path)
    write_part(tmp_path, [row("a", attempt=2, toppled=True), row("c")])
    assert finished_ids(tmp_path) == {"a", "b", "c"}
    table = pq.read_table(compact(tmp_path)).to_pylist()
    assert [(line["job_id"], line["attempt"]) for line in table] == [("a", 2), ("b", 1), ("c", 1)]


def test_a_job_to_be_done_again_is_finished_only_by_a_newer_attempt(tmp_path):
    write_part(tmp_path, [row("a", status="crashed", attempt=4), row("b"), row("c", status="failed")])
    write_part(tmp_path, [row("c", status="ok", attempt=2)])
    redo = attempts_with(tmp_path, {"crashed", "failed"})
    assert redo == {"a": 4}  # the newest row of c has an answer
    assert finished_ids(tmp_path, redo=redo) == {"b", "c"}
    write_part(tmp_path, [row("a", status="crashed", attempt=8)])
    assert finished_ids(tmp_path, redo=redo) == {"a", "b", "c"}
    compact(tmp_path)
    assert finished_ids(tmp_path, redo=redo) == {"a", "b", "c"}
    assert attempts_with(tmp_path, {"crashed", "failed"}) == {"a": 8}
    assert attempts_with(tmp_path, set()) == {}


def test_torn_and_foreign_files_are_named_and_skipped(tmp_path, caplog):
    remaining = write_part(tmp_path, [row("a")])
    torn = remaining.with_name("part-torn.parquet")
    torn.write_bytes(remaining.read_bytes()[:-100])
    foreign = remaining.with_name("part-foreign.parquet")
    pq.write_table(pa.table({"job_id": [1]}), foreign)
    remaining.with_name(".part-unfinished.parquet.1.tmp").write_bytes(b"")
    with caplog.at_level(logging.WARNING):
        assert finished_ids(tmp_path) == {"a"}
    assert str(torn) in caplog.text
    assert str(foreign) in caplog.text
    assert "unfinished" not in caplog.text
    compact(tmp_path)
    assert torn.exists()  # not ours to delete
    assert foreign.exists()


def cut(path):
    path.write_bytes(path.read_bytes()[:50])


def flip_on_the_disk(path):
    """Flip a bit: neither the file's size nor its time tells."""
    before = path.stat()
    flip(path, at=before.st_size - 300)
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))


@pytest.mark.parametrize("read", [finished_ids, compact, lambda run: attempts_with(run, {"ok"})])
@pytest.mark.parametrize("damage", [cut, flip_on_the_disk])
def test_a_part_that_is_damaged_between_two_reads_is_omitted_as_if_damaged_before(
    tmp_path, monkeypatch, caplog, damage, read
):
    first, second = (write_part(tmp_path, [row(name)]) for name in "ab")
    read_table, damages = store.read_table, iter([damage])

    def damage_and_read(path, **how):
        next(damages, lambda _: None)(second)
        return read_table(path, **how)

    monkeypatch.setattr(store, "read_table", damage_and_read)
    with caplog.at_level(logging.WARNING):
        read(tmp_path)
    monkeypatch.undo()
    assert str(second) in caplog.text
    assert finished_ids(tmp_path) == {"a"}
    assert first.exists() != (read is compact)


@pytest.mark.parametrize("compacted", [False, True])
def test_results_without_a_column_of_the_schema_are_refused_not_read_as_null(tmp_path, compacted):
    run = run_in(tmp_path, [row("a", toppled=True)])
    (path,) = (tmp_path / "parts").iterdir()
    if compacted:
        path = compact(tmp_path)
    write_table(pq.read_table(path).drop_columns(["toppled"]), path)
    with refused("run.columns_other"):
        run.table()


def test_a_damaged_part_is_skipped_and_the_writer_sets_it_aside(tmp_path, caplog):
    victim, remaining = write_part(tmp_path, [row("a")]), write_part(tmp_path, [row("b")])
    flip(victim, at=victim.stat().st_size - 300)
    with caplog.at_level(logging.WARNING):
        assert finished_ids(tmp_path) == {"b"}
        assert victim.exists()  # who only reads renames nothing
        assert finished_ids(tmp_path, frozenset("ab")) == {"b"}
    assert caplog.text.count("its bytes do not have its digest") == 2
    assert sorted(path.name for path in (tmp_path / "parts").iterdir()) == [f"_{victim.name}", remaining.name]
    write_part(tmp_path, [row("a")])
    assert finished_ids(tmp_path) == {"a", "b"}


def test_a_part_without_a_digest_is_named_and_skipped(tmp_path, caplog):
    part = write_part(tmp_path, [row("a")])
    pq.write_table(pq.read_table(part), part)
    with caplog.at_level(logging.WARNING):
        assert finished_ids(tmp_path) == set()
    assert "carries no digest" in caplog.text


@pytest.mark.parametrize(
    ("rows", "complaint"),
    [
        ([], "no rows"), ([row("a", tilt=1.0)], "tilt"),
        ([{key: value for key, value in row("a").items() if key != "status"}], "status"),
    ],
)  # fmt: skip
def test_rows_outside_the_schema_are_refused_before_anything_is_written(tmp_path, rows, complaint):
    with pytest.raises(ValueError, match=complaint):
        write_part(tmp_path, rows)
    assert list(Path(tmp_path).iterdir()) == []
