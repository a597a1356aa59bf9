"""Files and folders that appear complete or not at all."""

import errno
import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from toppling.models.errors import InputError

FULL = (errno.ENOSPC, errno.EDQUOT)
_OF_DISKS = (*FULL, errno.EFBIG, errno.EIO, errno.EROFS)
_CACHE_VARIABLE = "TOPPLING_CACHE"
"""Names the folder of this account for what can be made again."""

_SCHEMES = (
    "s3[an]?|gs|gcs|az|abfs|abfss|adl|wasb|wasbs|r2|oss|dbfs|hdfs|webhdfs|https?|ftp|sftp|ssh|smb|file|memory"
)
_REMOTE = re.compile(rf"(?:^[a-z][a-z0-9+.-]+|(?:^|/)(?:{_SCHEMES})):/", re.IGNORECASE)


def local(path: str | os.PathLike[str]) -> Path:
    """A path, if it is one of a file system: an address of an object store would become a folder of that name here.

    Raises InputError if it is an address of elsewhere.
    """
    text = os.fspath(path)
    if found := _REMOTE.search(text):
        raise InputError(
            "file.is_address",
            f"is an address ({found[0].strip('/')}//), no path",
            where=text,
            expected="a folder or file of this machine; of a run's folder also the address of a store "
            "(s3://, gs://, abfs://, sftp://, ...)",
            remedy="check how the address begins, copy the folder here, or mount the store and give that path",
        )
    return Path(path)


def path_named_in(folder: Path, text: str) -> Path:
    """Path that a file in a folder names; one of Windows, parted by backslashes, is read where only so it is there."""
    path = Path.home() / text[2:] if text.startswith("~/") else folder / text
    windows = "\\" in text and not os.access(path, os.F_OK)
    return folder / text.replace("\\", "/") if windows else path


_KINDS = {"scene.json": "a scene", "catalog.parquet": "an ensemble", "run.json": "a run"}
"""Kinds of folders by a file that they hold."""


def instead(path: Path) -> str:
    """End of an error that names the known kind of a path given for another; empty for unknown kinds."""
    folder = path.parent if path.is_file() else path
    kind = next((kind for mark, kind in _KINDS.items() if (folder / mark).is_file()), "")
    if path.is_file():
        return f": this is a file of the folder {folder}, {kind}" if kind else ": this is a file"
    return f": this is {kind}" if kind else ""


def refuse_existing(target: Path) -> None:
    """Say so, before work is done that could not be written.

    Raises FileExistsError if something has the name already.
    """
    if target.exists() or target.is_symlink():
        raise FileExistsError(f"{target} exists already: choose another name, or remove it first")


@contextmanager
def _naming(target: Path) -> Iterator[None]:
    """Name what a disk has no room for: neither Arrow nor a write to an open file do."""
    try:
        yield
    except OSError as error:
        if isinstance(error, FullDiskError) or (error.errno not in (FULL if error.filename else _OF_DISKS)):
            raise
        named = error.filename2 or error.filename or str(target)  # a copy names its source first
        kind = FullDiskError if error.errno in FULL else OSError
        raise kind(error.errno, os.strerror(error.errno or 0), named) from error


class FullDiskError(OSError):
    """A disk has no room; `left` is what was free when that was found, before anything is removed."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.left = room_left(self.filename or ".")


def room_left(path: str | os.PathLike[str]) -> str:
    """Free bytes and files of a path's disk: either may be exhausted."""
    disk = os.statvfs(next(parent for parent in Path(path).absolute().parents if parent.exists()))
    files = f"{disk.f_favail:,} of {disk.f_files:,} files (inodes)"
    return f"{disk.f_bavail * disk.f_frsize / 1e6:.0f} MB and {files} free"


@contextmanager
def new_folder(target: Path) -> Iterator[Path]:
    """A folder to write into, which gets its name when all is written; nothing is left of it if that fails.

    Raises FileExistsError if something has the name already.
    """
    target = local(target)
    refuse_existing(target)
    target.parent.mkdir(parents=True, exist_ok=True)
    staging = target.with_name(f".{target.name}.{os.getpid()}.tmp")
    shutil.rmtree(staging, ignore_errors=True)
    staging.mkdir()
    try:
        with _naming(target):
            yield staging
        staging.rename(target)
    except BaseException:
        shutil.rmtree(staging, ignore_errors=True)
        raise


@contextmanager
def replaced_folder(target: Path) -> Iterator[Path]:
    """A folder to write into, which takes the place of another one when all is written."""
    former = target.with_name(f".{target.name}.{os.getpid()}.former")
    fresh = target.with_name(f".{target.name}.{os.getpid()}.new")
    with new_folder(fresh) as staging:
        yield staging
    try:
        target.rename(former)
        fresh.rename(target)
    finally:
        if not target.exists() and former.exists():
            former.rename(target)
        shutil.rmtree(former, ignore_errors=True)
        shutil.rmtree(fresh, ignore_errors=True)


@contextmanager
def new_file(target: Path) -> Iterator[Path]:
    """A path to write a file to, which takes its name, and the place of a former one, when all is on the disk.

    It ends in '.tmp', whatever the file is; nothing is left of it if writing fails.
    """
    target = local(target)
    target.parent.mkdir(parents=True, exist_ok=True)
    hidden = target.with_name(f".{target.name}.{os.getpid()}.tmp")
    try:
        with _naming(target):
            yield hidden
            with hidden.open("rb") as file:
                os.fsync(file.fileno())
        hidden.replace(target)
        folder = os.open(target.parent, os.O_RDONLY)
        try:
            os.fsync(folder)  # the new name itself must outlive a power cut
        finally:
            os.close(folder)
    finally:
        hidden.unlink(missing_ok=True)


def write_text(text: str, target: Path) -> Path:
    """Write a text in UTF-8; the file appears complete or not at all."""
    with new_file(target) as hidden:
        hidden.write_text(text, encoding="utf-8")
    return target


def cache_folder() -> Path:
    """Folder of this account for what can be made again: compiled code, what workers are sent, copies of stores."""
    named = os.environ.get(_CACHE_VARIABLE)
    if named:
        return Path(named).expanduser()
    return Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache").expanduser() / "toppling"


def rock_name(folder: str | Path) -> str:
    """Name of a rock for people: its scene's folder, or where that is called no more than scene, the folder around."""
    place = Path(folder).resolve()
    return place.parent.name if place.name == "scene" and place.parent.name else place.name
