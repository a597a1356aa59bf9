"""One writer at a time to a run in a store, whichever machine it is on.

Stores have no locks, and few write an object only where there is none. So each writer puts an object of its own below
the run, and looks only then for those of others: of two that come at once, one at least sees the other, and who sees
another steps back. A writer renews its object as long as it writes. One that does not is dead, and its place is taken;
if it was only asleep it finds its object gone, and stops.
"""

import contextlib
import fcntl
import io
import logging
import os
import random
import shutil
import socket
import threading
import time
import uuid
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import IO, Any

from toppling.models.errors import InputError

log = logging.getLogger(__name__)

WRITERS = ".writers"
_RENEW_S = 5.0
_GONE_AFTER_S = 30.0
"""Without a renewal. Clocks of machines and stores differ: whoever comes watches this long himself."""

_PAUSE_S = (0.2, 1.5)
"""Between two tries: at random, so that two that came at once do not come at once again."""

_OBJECTS = ("s3", "gcs", "abfs")
"""Types of Arrow's file systems that have no folders to be made, and show what is written whole or not at all."""


def put(store: Any, target: str, source: IO[bytes]) -> None:
    """Write a file that appears whole or not at all, as objects do by themselves."""
    hidden = target
    if store.type_name not in _OBJECTS:
        place = PurePosixPath(target)
        store.create_dir(str(place.parent))
        hidden = str(place.with_name(f".{place.name}.tmp"))
    with store.open_output_stream(hidden) as sink:
        shutil.copyfileobj(source, sink, 2**20)
    if hidden != target:
        handler = getattr(store, "handler", None)  # of fsspec: Arrow's call of it asks for more than some can
        move = store.move if handler is None else handler.fs.mv
        try:
            move(hidden, target)
        except Exception:  # some rename only to what is not there, and each has errors of its own
            store.delete_file(target)
            move(hidden, target)


@contextlib.contextmanager
def repeated(action: Callable[[], None], pause_s: float) -> Iterator[None]:
    """Have something done again and again beside what goes on, with a pause before each time."""
    over = threading.Event()

    def keep_up() -> None:
        while not over.wait(pause_s):
            action()

    thread = threading.Thread(target=keep_up, daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


@dataclass
class Lease:
    """The right to write to a run."""

    address: str  # of the run, for people
    store: Any
    folder: str  # of the writers' objects, in the store
    notes: Path  # file of this machine in which its writer's object is named
    lost: bool = field(init=False, default=False)
    _name: str = field(init=False, default="")
    _owner: str = field(init=False, default="")
    _renewals: int = field(init=False, default=0)
    _renewed_s: float = field(init=False, default=0.0)

    @contextlib.contextmanager
    def held(self) -> Iterator[None]:
        """Be the only writer until this ends.

        Raises InputError if another process writes to the run.
        Raises OSError if the store does not answer.
        """
        with self._alone_here() as notes:
            self._take(notes)
            try:
                with repeated(self._keep, _RENEW_S):
                    yield
            finally:
                with contextlib.suppress(Exception):  # else the next writer finds it dead
                    self._remove(self._name)
                self._name = ""

    def check(self) -> None:
        """Refuse to go on where another process is known to have taken this one's place.

        Raises InputError if it has.
        """
        if self.lost:
            raise self._refused(
                f"this process gave no sign for {_GONE_AFTER_S:g} s, and another took its place",
                remedy="let that one go on, or stop it and give the same command again",
            )

    def make_sure(self) -> None:
        """Have a sign in the store so young that this process cannot have been taken for dead.

        Raises InputError as `check`.
        Raises OSError if the store does not answer.
        """
        # The clock on the wall goes on while a machine sleeps.
        if self._name and not self.lost and time.time() - self._renewed_s > _GONE_AFTER_S:
            self._renew()
        self.check()

    def writers(self) -> dict[str, str]:
        """Who holds the run or asks for it, by the name of each one's object."""
        from pyarrow.fs import FileSelector, FileType

        found = {}
        for info in self.store.get_file_info(FileSelector(self.folder, allow_not_found=True)):
            if info.type == FileType.File and info.base_name.endswith(".txt"):
                with (
                    contextlib.suppress(FileNotFoundError),
                    self.store.open_input_stream(info.path) as source,
                ):
                    found[info.base_name] = source.read(1000).decode(errors="replace")
        return found

    def is_held_elsewhere(self) -> bool:
        """Whether another machine writes to the run, by signs that are young by this machine's clock."""
        from pyarrow.fs import FileSelector

        ours = self.notes.read_text().split() if self.notes.exists() else []
        signs = self.store.get_file_info(FileSelector(self.folder, allow_not_found=True))
        return any(
            info.mtime_ns and time.time_ns() - info.mtime_ns < 2e9 * _GONE_AFTER_S
            for info in signs
            if info.base_name.endswith(".txt") and info.base_name not in ours
        )

    @contextlib.contextmanager
    def _alone_here(self) -> Iterator[IO[str]]:
        self.notes.parent.mkdir(parents=True, exist_ok=True)
        with self.notes.open("a+") as notes:
            try:
                fcntl.flock(notes, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                what = f"another process of this machine writes to this run{self._who()}"
                raise self._refused(what) from None
            notes.seek(0)
            for left in notes.read().split():  # by a process that was killed, since it has the lock no more
                self._remove(left)
            yield notes
            notes.truncate(0)

    def _take(self, notes: IO[str]) -> None:
        self._name, self._renewals, self.lost = f"{uuid.uuid4().hex}.txt", 0, False
        since = time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime())
        self._owner = f"{socket.gethostname()}:{os.getpid()} since {since}"
        notes.truncate(0)
        notes.write(self._name)
        notes.flush()
        seen: dict[str, tuple[str, float]] = {}
        waited_for: set[str] = set()
        while True:
            self._put()
            others = self._others()
            if not others:
                return
            self._remove(self._name)
            seen = {name: seen.get(name, (said, time.monotonic())) for name, said in others.items()}
            for name, said in others.items():
                first, since_s = seen[name]
                if name not in waited_for and time.monotonic() - since_s > 2 * _RENEW_S:
                    waited_for.add(name)
                    told = "%s: %s has not said that it ended; if it gives no sign for %g s, its run goes on here"
                    log.warning(told, self.address, _owner(said), _GONE_AFTER_S)
                if said != first:
                    raise self._refused(f"another machine writes to this run{self._who()}")
                if time.monotonic() - since_s > _GONE_AFTER_S:
                    told = "%s: %s gives no sign any more: its run goes on here"
                    log.warning(told, self.address, _owner(said))
                    self._remove(name)
            time.sleep(random.uniform(*_PAUSE_S))

    def _keep(self) -> None:
        if not self.lost:
            with contextlib.suppress(Exception):  # the store may answer next time
                self._renew()

    def _renew(self) -> None:
        from pyarrow.fs import FileType

        there = self.store.get_file_info(self._path(self._name)).type == FileType.File
        if not there or any(_renewals(said) for said in self._others().values()):
            self.lost = True
        else:
            self._renewals += 1
            self._put()

    def _put(self) -> None:
        said, now_s = f"{self._owner}\nrenewed {self._renewals} times\n", time.time()
        put(self.store, self._path(self._name), io.BytesIO(said.encode()))
        self._renewed_s = now_s

    def _others(self) -> dict[str, str]:
        return {name: said for name, said in self.writers().items() if name != self._name}

    def _remove(self, name: str) -> None:
        with contextlib.suppress(FileNotFoundError):
            self.store.delete_file(self._path(name))

    def _path(self, name: str) -> str:
        return f"{self.folder}/{name}"

    def _who(self) -> str:
        return "".join(f", {_owner(said)}" for said in self._others().values())

    def _refused(self, what: str, remedy: str = "wait for it, or stop it first") -> InputError:
        return InputError(
            what,
            where=self.address,
            expected="one 'toppling run' for a folder at a time, on whichever machine",
            remedy=remedy,
        )


def _owner(said: str) -> str:
    return said.partition("\n")[0]


def _renewals(said: str) -> int:
    digits = "".join(filter(str.isdigit, said.partition("\n")[2]))
    return int(digits or 0)
