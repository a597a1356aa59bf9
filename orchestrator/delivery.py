"""Scenes and ensembles reach workers that do not see the run's folder: by content, once a host.

The client sends the files to one worker of each host that lacks them, which keeps them for the others there. What is
kept is verified by its id whenever it is loaded.
"""

import os
import re
import shutil
import socket
import time
import uuid
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from toppling.models.files.folder import cache_folder

_PIECE_BYTES = 2**23
"""What is sent at once: large beside a round trip, small beside a worker's memory."""

_ID = re.compile(r"[0-9a-f]{8,64}")
_KEPT_S = 7 * 86400.0
"""A host keeps what it was sent for as long after its last use."""


class NotDeliveredError(RuntimeError):
    """A scene or ensemble that a host has not: the client is to send it.

    host: names where the host keeps what it is sent, alike for its workers.
    worker: the worker's address.
    """

    def __init__(self, host: str, worker: str | None) -> None:
        self.host, self.worker = host, worker
        super().__init__(host, worker)


class NotKeptError(RuntimeError):
    """A host that cannot keep what it is sent."""


def send(call: Callable[..., Any], lacking: Iterable[NotDeliveredError], folders: Mapping[str, Path]) -> None:
    """Send folders of few files, by the ids of their contents, to one worker of each host that lacks them.

    call: calls a function with arguments on the worker of an address, and raises what it raises there.
    """
    for worker in {one.host: one.worker for one in lacking}.values():
        for name, folder in folders.items():
            upload = f".{name}.{uuid.uuid4().hex}.tmp"
            for path in sorted(one for one in folder.iterdir() if one.is_file()):
                with path.open("rb") as source:
                    while piece := source.read(_PIECE_BYTES):
                        call(worker, _receive, upload, path.name, piece)
            call(worker, _complete, upload, name)


def delivered(name: str, worker: str | None = None) -> Path:
    """Folder in which this host keeps what it was sent, by the id of its content, for the worker of an address.

    Raises NotDeliveredError if it is not there, and NotKeptError if no place here can be written.
    """
    if not _ID.fullmatch(name):
        raise NotKeptError(f"{name!r} is no id of a content")
    place = _place()
    try:
        place.mkdir(mode=0o700, parents=True, exist_ok=True)
        os.utime(place / name)
    except FileNotFoundError:
        if not os.access(place, os.W_OK):
            raise _not_kept("it cannot be written") from None
        raise NotDeliveredError(f"{socket.gethostname()}:{place}", worker) from None
    except OSError as error:
        raise _not_kept(error.strerror or error) from None
    return place / name


def forget(folder: Path) -> None:
    """Remove what this host keeps, as it is damaged."""
    shutil.rmtree(folder, ignore_errors=True)


def _place() -> Path:
    return cache_folder() / "delivered"


def _not_kept(why: object) -> NotKeptError:
    return NotKeptError(f"what the client sends cannot be kept in {_place()} ({why})")


def _receive(upload: str, file: str, piece: bytes) -> None:
    """Add to a file of an upload, on the worker's host."""
    try:
        folder = _place() / Path(upload).name
        folder.mkdir(exist_ok=True)
        with (folder / Path(file).name).open("ab") as target:
            target.write(piece)
    except OSError as error:
        raise _not_kept(error.strerror or error) from None


def _complete(upload: str, name: str) -> None:
    """Give an upload its name, and forget what nobody has used for long."""
    staging = _place() / Path(upload).name
    try:
        staging.rename(_place() / name)
    except OSError:  # another client was first
        forget(staging)
    before = time.time() - _KEPT_S
    for other in _place().iterdir():
        if other.is_dir() and other.stat().st_mtime < before:
            forget(other)
