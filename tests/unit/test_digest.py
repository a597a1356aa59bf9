"""A file is verified whole, once, by the digest that it carries."""

import os

import pyarrow as pa
import pytest
from refusals import flip, refused

from toppling.models.files import digest
from toppling.models.files.digest import read_table, write_table
from toppling.models.scene import Scene


@pytest.fixture
def table_file(tmp_path):
    path = tmp_path / "table.parquet"
    write_table(pa.table({"a": [1, 2, 3]}), path)
    return path


def test_a_file_is_read_whole_once_and_again_only_when_it_changed(table_file, monkeypatch):
    hashed = []
    genuine = digest._digest
    monkeypatch.setattr(digest, "_digest", lambda file, place: hashed.append(1) or genuine(file, place))
    monkeypatch.setattr(digest, "_UNSETTLED_S", 0.0)
    for _ in range(3):
        assert digest.check(table_file)
    assert len(hashed) == 1
    flip(table_file, 20)
    with refused("file.damaged"):
        digest.check(table_file)
    assert len(hashed) == 2


def test_a_file_of_this_moment_is_not_remembered_as_its_time_may_stay_when_it_changes(table_file):
    state = table_file.stat()
    assert digest.check(table_file)
    flip(table_file, 20)
    os.utime(table_file, ns=(state.st_atime_ns, state.st_mtime_ns))
    with refused("file.damaged"):
        digest.check(table_file)


def test_the_digest_of_a_text_inside_does_not_stand_for_the_file(tmp_path):
    inner = tmp_path / "inner.json"
    digest.write_json(inner, {"a": 1})
    outer = tmp_path / "outer.parquet"
    table = pa.table({"a": [1]}).replace_schema_metadata({"zz": inner.read_bytes(), "aa": "x" * 200_000})
    write_table(table, outer)
    assert digest.check(outer, required=True)
    assert read_table(outer).schema.metadata[b"zz"] == inner.read_bytes()


@pytest.mark.parametrize("suffix", [".ply", ".parquet", ".json", ".toml"])
def test_each_byte_of_a_file_is_covered(tmp_path, suffix, monkeypatch):
    path = tmp_path / f"file{suffix}"
    if suffix == ".ply":
        path = Scene.block(0.2, 0.2, 0.6).save(tmp_path / "scene") / "rock.ply"
    elif suffix == ".parquet":
        write_table(pa.table({"a": [1]}), path)
    elif suffix == ".json":
        digest.write_json(path, {"a": 1})
    else:
        digest.write_sealed("a = 1\n", path)
    content = path.read_bytes()
    for at in range(len(content)):
        path.write_bytes(content[:at] + bytes([content[at] ^ 1]) + content[at + 1 :])
        with refused("file.damaged"):
            digest.check(path, required=True)


@pytest.mark.parametrize("changed", [False, True])
def test_a_json_is_whole_whatever_ends_its_lines_and_damaged_by_anything_else(tmp_path, changed):
    path = tmp_path / "run.json"
    digest.write_json(path, {"jobs": 96, "rock": "Échö"})
    content = path.read_bytes().replace(b"\n", b"\r\n")
    path.write_bytes(content.replace(b"96", b"97") if changed else content)
    if changed:
        with refused("file.damaged", path):
            digest.read_json(path)
    else:
        assert digest.read_json(path) == {"jobs": 96, "rock": "Échö"}


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (b"", "it is empty"),
        (b"version https://git-lfs.github.com/spec/v1\n", "git lfs pull"),
        (b"PAR1 of somebody else", "another program saved it again"),
    ],
)
def test_a_file_without_a_digest_is_refused_with_what_it_looks_like(content, why, tmp_path):
    path = tmp_path / "results.parquet"
    path.write_bytes(content)
    with refused("file.damaged", why):
        digest.check(path, required=True)
