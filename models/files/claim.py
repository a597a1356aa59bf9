"""One writer at a time to a folder in a store: the process whose name stands in one object of it.

The claim is created only where there is none, and has no clock: a writer that was killed leaves it, and only the user
can know that. Who is told to takes it over; the former writer finds another's name before the next object it puts.
"""

import contextlib
import logging
import os
import socket
import time
import uuid
from dataclasses import dataclass, field

from toppling.models.errors import InputError
from toppling.models.files.store_access import Store

log = logging.getLogger(__name__)

CLAIM = ".writer"
"""Name of the object."""


@dataclass
class Claim:
    """The right of this process to write to a folder in a store."""

    store: Store
    loss: InputError | None = field(init=False, default=None)
    """Why this process may not write any more."""
    _text: bytes = field(init=False, default=b"")
    """What the object holds as long as this process may write; empty while it has not claimed the folder."""

    def take(self, *, over: bool = False) -> None:
        """Claim the folder.

        over: although another process has claimed it.

        Raises InputError if another process has.
        """
        since = time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime())
        text = f"{socket.gethostname()}:{os.getpid()} since {since}\n{uuid.uuid4().hex}\n".encode()
        former = self.writer()
        if over and former:
            log.warning("%s: taken over from %s", self.store.address, former)
            self.store.remove(CLAIM)
        self.store.create(CLAIM, text)
        # Whose it is counts: a put that was answered too late has been carried out, and some stores know no condition.
        if self.store.read(CLAIM) != text:
            raise self._error(
                "store.written_by_another",
                f"is written to by {self.writer()}",
                "wait for it or stop it; if it was killed, add --take-over (in Python take_over=True)",
            )
        self.loss, self._text = None, text

    def check(self) -> None:
        """Refuse to write where another process has claimed the folder, or taken it over from this one.

        Raises InputError if one has.
        """
        there = self.store.read(CLAIM)
        if there == self._text:
            return
        by = _first_line(there) or "a process that has ended"
        if not self._text:
            raise self._error(
                "store.written_by_another",
                f"is written to by {by}",
                "give the same command again once that has ended; if it was killed, go on with the run by --take-over",
            )
        self.loss = self._error("store.taken_over", f"was taken over by {by}",
            "let that one go on, or stop it and give the same command again")  # fmt: skip
        raise self.loss

    def release(self) -> None:
        """Give the folder free, if this process has claimed it and it was not taken over."""
        with contextlib.suppress(Exception):  # the store may be gone: the next writer then takes over
            if self._text and self.store.read(CLAIM) == self._text:
                self.store.remove(CLAIM)
        self._text = b""

    def writer(self) -> str:
        """Who has claimed the folder: host, process and time; empty if none has."""
        return _first_line(self.store.read(CLAIM))

    def _error(self, code: str, what: str, remedy: str) -> InputError:
        return InputError(
            code,
            what,
            where=self.store.address,
            expected="one process that writes to a folder in a store, on whichever machine",
            remedy=remedy,
        )


def _first_line(text: bytes) -> str:
    return text.decode(errors="replace").partition("\n")[0]
