"""Scenes and ensembles reach workers that do not see the run's folder: by content, once a host.

The client puts the files at the scheduler, whichever it is; a worker that needs them asks its scheduler, in pieces, and
keeps them where the other workers of its account and host find them. What is kept is verified by its id whenever it is
loaded, as a shared folder is.
"""

import fcntl
import os
import re
import shutil
import time
import uuid
from collections.abc import Callable, Collection, Mapping
from contextvars import ContextVar
from pathlib import Path
from typing import Any

from distributed import Client, get_worker
from distributed.utils import sync

from toppling.models.files.folder import cache_folder, new_folder

_PIECE_BYTES = 2**23
"""What is sent at once: large beside a round trip, small beside a worker's memory."""

_SHELF = "toppling_asset"
"""The scheduler's handler that answers workers."""

_ID = re.compile(r"[0-9a-f]{8,64}")
_KEPT_S = 7 * 86400.0
"""A host keeps what it was sent for as long after its last use."""


WORKER: ContextVar[Any] = ContextVar("worker")
"""Whose scheduler is asked outside of a task, as where all workers are called at once."""


class NotDeliveredError(RuntimeError):
    """A scene or ensemble that this host has not, and the scheduler neither: the client is to offer it."""


class NotKeptError(RuntimeError):
    """A host that cannot keep what it is sent."""


class _Shelf:
    """What clients have put at a scheduler for its workers."""

    def __init__(self) -> None:
        self._kept: dict[str, dict[str, bytearray]] = {}
        self._uploads: dict[str, dict[str, bytearray]] = {}
        self._holders: dict[str, set[str]] = {}

    @staticmethod
    def of(scheduler: Any) -> "_Shelf":
        """A scheduler's, made if it has none."""
        if _SHELF not in scheduler.handlers:
            scheduler.handlers[_SHELF] = _Shelf().ask
        return scheduler.handlers[_SHELF].__self__

    def ask(self, name: str, file: str = "", offset: int = 0, size: int = 0) -> dict[str, int] | bytes:
        """Answer a worker: sizes of the files of a name, or a piece of one file; nothing if it is not there."""
        files = self._kept.get(name, {})
        if file:
            return bytes(files.get(file, b"")[offset : offset + size])
        return {each: len(content) for each, content in files.items()}

    def keep_for(self, connected: Collection[str]) -> None:
        """Forget what is of no connected client."""
        for known in [each for each, who in self._holders.items() if not who.intersection(connected)]:
            del self._kept[known], self._holders[known]

    def holds(self, name: str, client: str) -> bool:
        """Whether a name is there, now for this client too."""
        if name in self._kept:
            self._holders[name].add(client)
        return name in self._kept

    def add(self, upload: str, file: str, piece: bytes) -> None:
        """Add to a file of an upload."""
        self._uploads.setdefault(upload, {}).setdefault(file, bytearray()).extend(piece)

    def complete(self, upload: str, name: str, client: str) -> None:
        """Give an upload its name."""
        self._kept[name] = self._uploads.pop(upload, {})
        self._holders.setdefault(name, set()).add(client)


def offer(client: Client, folders: Mapping[str, Path]) -> None:
    """Put folders of few files at the scheduler, where workers can ask for them as long as the client is connected.

    folders: folder by the id of its content; what the scheduler has already is not sent again.
    """
    for name, folder in folders.items():
        if client.run_on_scheduler(_shelf, _Shelf.holds, name, client.id):
            continue
        upload = uuid.uuid4().hex
        for path in sorted(each for each in folder.iterdir() if each.is_file()):
            with path.open("rb") as source:
                while piece := source.read(_PIECE_BYTES):
                    client.run_on_scheduler(_shelf, _Shelf.add, upload, path.name, piece)
        client.run_on_scheduler(_shelf, _Shelf.complete, upload, name, client.id)


def _shelf(method: Callable[..., Any], *given: Any, dask_scheduler: Any = None) -> Any:
    """Call a method of the scheduler's shelf, there."""
    shelf = _Shelf.of(dask_scheduler)
    shelf.keep_for(dask_scheduler.clients)
    return method(shelf, *given)


def delivered(name: str) -> Path:
    """Folder in which this host keeps what it was sent, asked for at the scheduler where it is not there yet.

    name: id of its content.
    Raises NotDeliveredError if the scheduler has not got it.
    Raises NotKeptError if no place here can be written.
    """
    if not _ID.fullmatch(name):
        raise NotKeptError(f"{name!r} is no id of a content")
    kept_in = cache_folder() / "delivered"
    folder = kept_in / name
    try:
        kept_in.mkdir(mode=0o700, parents=True, exist_ok=True)
        with (kept_in / f".{name}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)  # workers of one host ask once
            if not folder.is_dir():
                _fetch(name, folder)
                before = time.time() - _KEPT_S
                for other in kept_in.iterdir():
                    if other.is_dir() and other.stat().st_mtime < before:
                        forget(other)
            os.utime(folder)
    except OSError as error:
        raise NotKeptError(
            f"what the client sends cannot be kept in {kept_in} ({error.strerror or error})"
        ) from None
    return folder


def forget(folder: Path) -> None:
    """Remove what this host keeps, as it is damaged."""
    shutil.rmtree(folder, ignore_errors=True)


def _fetch(name: str, folder: Path) -> None:
    sizes = _ask(name=name)
    if not sizes:
        raise NotDeliveredError("the client has not sent it")
    with new_folder(folder) as staging:
        for file, size in sizes.items():
            if Path(file).name != file:
                raise NotKeptError(f"{file!r} is no name of a file")
            with (staging / file).open("wb") as target:
                for offset in range(0, size, _PIECE_BYTES):
                    piece = _ask(name=name, file=file, offset=offset, size=_PIECE_BYTES)
                    if not piece:
                        raise NotDeliveredError(f"the scheduler lost {file} while it was sent")
                    target.write(piece)


def _ask(**question: Any) -> Any:
    """Ask the scheduler's shelf, from the thread of a task; nothing where it is not known or gives no answer."""
    try:
        worker = WORKER.get(None) or get_worker()
    except ValueError:  # not on a worker
        return None

    async def asked() -> Any:
        try:
            return await getattr(worker.scheduler, _SHELF)(**question)
        except (AttributeError, OSError):  # so Dask says that a scheduler knows no such question, or is gone
            return None

    return sync(worker.loop, asked)
