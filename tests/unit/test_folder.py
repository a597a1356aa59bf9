"""Files and folders appear complete or not at all."""

import errno
import os
import resource

import pyarrow as pa
import pytest

from toppling.models.files import folder
from toppling.models.files.digest import write_table
from toppling.models.files.folder import FullDiskError, named_beside, new_file, new_folder


def test_a_folder_has_its_name_only_when_all_is_written(tmp_path):
    target = tmp_path / "deep" / "scene"
    with new_folder(target) as staging:
        (staging / "a").write_text("1")
        assert not target.exists()
    assert [path.name for path in target.iterdir()] == ["a"]
    assert list(target.parent.iterdir()) == [target]


def test_what_fails_leaves_nothing(tmp_path):
    with pytest.raises(FileNotFoundError), new_folder(tmp_path / "scene") as staging:
        (staging / "no folder" / "a").write_text("1")
    assert list(tmp_path.iterdir()) == []


def test_what_a_full_disk_has_left_is_looked_up_before_anything_is_removed(tmp_path, monkeypatch):
    monkeypatch.setattr(folder, "room_left", lambda _: str([path.name for path in tmp_path.iterdir()]))
    with pytest.raises(FullDiskError) as told, new_folder(tmp_path / "run"):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    assert told.value.left.startswith("['.run.")
    assert (told.value.filename, list(tmp_path.iterdir())) == (str(tmp_path / "run"), [])


def test_a_name_that_is_taken_is_refused_even_by_a_link_to_nothing(tmp_path):
    (tmp_path / "scene").symlink_to(tmp_path / "gone")
    with pytest.raises(FileExistsError, match="choose another name"), new_folder(tmp_path / "scene"):
        pytest.fail("there is nothing to write into")


def test_a_file_takes_the_place_of_a_former_one_only_when_all_is_written(tmp_path):
    target = tmp_path / "deep" / "table.csv"
    with new_file(target) as hidden:
        hidden.write_text("1")
        assert not target.exists()
    with pytest.raises(UnicodeEncodeError), new_file(target) as hidden:
        hidden.write_text("2\ud800", encoding="utf-8")  # which no encoding has: half of it is written
    assert target.read_text() == "1"
    assert list(target.parent.iterdir()) == [target]


def test_a_name_in_a_table_is_found_whether_or_not_its_accents_stand_apart(tmp_path):
    apart, together = "Zu\u0308rich", "Z\u00fcrich"
    (tmp_path / apart).mkdir()
    (tmp_path / apart / "a\u0308.csv").write_text("")
    assert named_beside(tmp_path, f"{together}/\u00e4.csv").exists()
    assert named_beside(tmp_path, f"{together}/none.csv") == tmp_path / apart / "none.csv"
    assert named_beside(tmp_path, "nowhere/\u00e4.csv") == tmp_path / "nowhere/\u00e4.csv"


def _text(target):
    with new_file(target) as hidden:
        hidden.write_text("a" * 10_000)


def _table(target):
    write_table(pa.table({"a": [0.1 * each for each in range(10_000)]}), target)


@pytest.mark.parametrize("write", [_text, _table])
def test_a_file_that_grows_beyond_what_may_be_written_is_named_and_nothing_is_left_of_it(write, tmp_path):
    target, most = tmp_path / "table", resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, most[1]))  # Python ignores the signal
    try:
        with pytest.raises(OSError, match=os.strerror(errno.EFBIG)) as told:
            write(target)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, most)
    assert (told.value.errno, told.value.filename) == (errno.EFBIG, str(target))
    assert list(tmp_path.iterdir()) == []
