"""Delivery of scenes and ensembles to hosts without access to the run's folder, addressed by content.

The client sends the files to one worker of each host, which caches them for the host's other workers. Cached files are
verified by their id whenever they are loaded.
"""

import os
import re
import shutil
import socket
import time
import uuid
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from toppling.models.files.folder import cache_folder

_PIECE_BYTES = 2**23
"""Size of the pieces in which files are sent, bytes: large enough to hide latency, small against a worker's memory."""

_ID = re.compile(r"[0-9a-f]{8,64}")
_CACHED_S = 7 * 86400.0
"""Time after the last use at which a host deletes delivered content, s."""


class NotDeliveredError(RuntimeError):
    """A host lacks a scene or ensemble, which the client must send.

    host: host and path of its cache, equal for all its workers.
    worker: address of the worker.
    """

    def __init__(self, host: str, worker: str | None) -> None:
        self.host, self.worker = host, worker
        super().__init__(host, worker)


class StorageError(RuntimeError):
    """A host cannot store delivered files."""


def pieces(folders: Mapping[str, Path]) -> Iterator[tuple[Any, ...]]:
    """Calls on a worker, each a function with its arguments, that store folders named by the ids of their contents."""
    for name, folder in folders.items():
        upload = f".{name}.{uuid.uuid4().hex}.tmp"
        for path in sorted(path for path in folder.iterdir() if path.is_file()):
            with path.open("rb") as source:
                while piece := source.read(_PIECE_BYTES):
                    yield _receive, upload, path.name, piece
        yield _complete, upload, name


def delivered(name: str, worker: str | None = None) -> Path:
    """Folder of delivered content on this host, by its id.

    Raises NotDeliveredError, with the worker's address, if it is absent, and StorageError if the cache is not writable.
    """
    if not _ID.fullmatch(name):
        raise StorageError(f"{name!r} is no id of a content")
    place = _place()
    try:
        place.mkdir(mode=0o700, parents=True, exist_ok=True)
        os.utime(place / name)
    except FileNotFoundError:
        if not os.access(place, os.W_OK):
            raise _storage_error("it cannot be written") from None
        raise NotDeliveredError(f"{socket.gethostname()}:{place}", worker) from None
    except OSError as error:
        raise _storage_error(error.strerror or error) from None
    return place / name


def forget(folder: Path) -> None:
    """Remove damaged content from this host's cache."""
    shutil.rmtree(folder, ignore_errors=True)


def _place() -> Path:
    return cache_folder() / "delivered"


def _storage_error(why: object) -> StorageError:
    return StorageError(f"files from the client cannot be stored in {_place()} ({why})")


def _receive(upload: str, file: str, piece: bytes) -> None:
    """Append to a file of an upload, on the worker's host."""
    try:
        folder = _place() / Path(upload).name
        folder.mkdir(exist_ok=True)
        with (folder / Path(file).name).open("ab") as target:
            target.write(piece)
    except OSError as error:
        raise _storage_error(error.strerror or error) from None


def _complete(upload: str, name: str) -> None:
    """Rename a complete upload, and remove content that was not used for long."""
    staging = _place() / Path(upload).name
    try:
        staging.rename(_place() / name)
    except OSError:  # another client delivered it first
        forget(staging)
    before = time.time() - _CACHED_S
    for other in _place().iterdir():
        if other.is_dir() and other.stat().st_mtime < before:
            forget(other)
