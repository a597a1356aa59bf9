"""Files and folders appear complete or not at all, under paths of this machine, and are verified by their digest."""

import errno
import os
import resource

import numpy as np
import pyarrow as pa
import pytest
from refusals import flip, refused

from toppling.models.files import digest
from toppling.models.files.digest import read_table, write_table
from toppling.models.files.folder import local, new_file, new_folder
from toppling.models.files.stores import is_store
from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.motion import Motion
from toppling.models.scene import Scene
from toppling.orchestrator.campaign import Campaign
from toppling.results.reader import open_run
from toppling.workers.shaking import shake


def test_a_folder_has_its_name_only_when_all_is_written(tmp_path):
    target = tmp_path / "deep" / "scene"
    with new_folder(target) as staging:
        (staging / "a").write_text("1")
        assert not target.exists()
    assert [path.name for path in target.iterdir()] == ["a"]
    assert list(target.parent.iterdir()) == [target]


def test_a_name_that_is_taken_is_refused_even_by_a_link_to_nothing(tmp_path):
    (tmp_path / "scene").symlink_to(tmp_path / "gone")
    with pytest.raises(FileExistsError, match="choose another name"), new_folder(tmp_path / "scene"):
        pytest.fail("there is nothing to write into")


def test_a_file_replaces_a_former_file_only_when_all_is_written(tmp_path):
    target = tmp_path / "deep" / "table.csv"
    with new_file(target) as hidden:
        hidden.write_text("1")
        assert not target.exists()
    with pytest.raises(UnicodeEncodeError), new_file(target) as hidden:
        hidden.write_text("2\ud800", encoding="utf-8")  # which no encoding has: half of it is written
    assert target.read_text() == "1"
    assert list(target.parent.iterdir()) == [target]


def _text(target):
    with new_file(target) as hidden:
        hidden.write_text("a" * 10_000)


def _table(target):
    write_table(pa.table({"a": [0.1 * value for value in range(10_000)]}), target)


@pytest.mark.parametrize("write", [_text, _table])
def test_a_file_that_grows_beyond_what_may_be_written_is_named_and_nothing_is_left_of_it(write, tmp_path):
    target, most = tmp_path / "table", resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, most[1]))  # Python ignores the signal
    try:
        with pytest.raises(OSError, match=os.strerror(errno.EFBIG)) as raised:
            write(target)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, most)
    assert (raised.value.errno, raised.value.filename) == (errno.EFBIG, str(target))
    assert list(tmp_path.iterdir()) == []


ADDRESSES = [
    "s3://bucket/run", "gs://bucket/run", "S3://BUCKET/x", "az://c/x", "https://host/run", "file://host/x", "memory://x",
    "s4://bucket/run", "any+thing://x",
]  # fmt: skip


@pytest.mark.parametrize("address", ADDRESSES)
def test_addresses_are_refused_as_folders_and_nothing_is_made(address, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for use in (
        local,
        Scene.load,
        Ensemble.load,
        Scene.block(0.2, 0.2, 0.6).save,
        lambda path: new_folder(local(path)).__enter__(),
        lambda path: new_file(local(path)).__enter__(),
    ):
        with refused("file.is_address"):
            use(address)
    if not is_store(address):  # whose runs are brought here
        with refused("file.is_address"):
            open_run(address)
    (tmp_path / "campaign.toml").write_text(
        f'scene = "{address}"\nensemble = "e"\npga_m_s2 = [1]\nazimuth_deg = [0]\nfriction = [1]\n'
    )
    with refused("file.is_address"):
        Campaign.read(tmp_path / "campaign.toml")
    assert [path.name for path in tmp_path.iterdir()] == ["campaign.toml"]


@pytest.mark.parametrize("path", ["runs/first", "/data/x:y/run", "../s3/run", "c/a:b", "s3:run"])
def test_paths_with_colons_are_paths(path):
    assert str(local(path)) == path


def test_what_is_no_scene_or_no_motion_is_refused_by_its_kind():
    block, still = Scene.block(0.2, 0.2, 0.6), Motion(np.zeros((10, 3)), 0.01)
    for scene, motion in ((block, np.zeros((10, 3))), (block, None), ("scenes/rock", still), (still, block)):
        with refused("shake.kind_unusable"):
            shake(scene, motion)


@pytest.fixture
def table_file(tmp_path):
    path = tmp_path / "table.parquet"
    write_table(pa.table({"a": [1, 2, 3]}), path)
    return path


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
    assert digest.check(outer)
    assert read_table(outer).schema.metadata[b"zz"] == inner.read_bytes()


@pytest.mark.parametrize("suffix", [".ply", ".parquet", ".json", ".toml"])
def test_every_byte_of_a_file_is_covered(tmp_path, suffix, monkeypatch):
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
            digest.read_json(path) if suffix == ".json" else digest.check(path)


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
        digest.check(path)
