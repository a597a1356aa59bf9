"""What happened in a run, a JSON object a line in `run.log`: for programs, and for the morning after.

Events are told with :func:`tell`; warnings of the orchestrator and the store come along by themselves.
"""

import json
import logging
import os
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from toppling.models.errors import InputError, refusals
from toppling.models.files.given import open_given

LOG_FILE = "run.log"
_TAIL_BYTES = 65_536
_CHECKSUM = b', "crc32": "'

log = logging.getLogger(__name__)

_events = logging.getLogger("toppling.orchestrator.journal")
_events.propagate = False  # a terminal shows progress and warnings, not every part that is stored
_events.setLevel(logging.INFO)


def tell(event: str, **fields: Any) -> None:
    """Note an event with what belongs to it."""
    _events.info(event, extra={"fields": fields})


@contextmanager
def journal(run: Path) -> Iterator[None]:
    """Write events and warnings to the run's log while the block runs."""
    handler = _JsonLines(run / LOG_FILE)
    loggers = [_events, logging.getLogger("toppling.orchestrator"), logging.getLogger("toppling.results")]
    for logger in loggers:
        logger.addHandler(handler)
    try:
        yield
    finally:
        for logger in loggers:
            logger.removeHandler(handler)
        handler.close()


_no_log = refusals(expected="the log of a run", remedy="remove it: no result rests on it")


def last(run: Path, *events: str) -> dict[str, Any] | None:
    """Find the newest entry of some kinds near the end of a run's log."""
    try:
        with open_given(run / LOG_FILE, _no_log) as file:
            begin = file.seek(max(file.seek(0, os.SEEK_END) - _TAIL_BYTES, 0))
            lines = file.read().splitlines()
    except (InputError, OSError):
        return None
    for line in reversed(lines[1:] if begin else lines):  # the first is cut by where the reading began
        if not _is_whole(line):
            log.warning("a line of %s is cut or damaged, and left out", run / LOG_FILE)
        elif (entry := json.loads(line)).get("event") in events:
            return entry
    return None


def _with_checksum(line: bytes) -> bytes:
    """A JSON object with the checksum of its text as the last member."""
    return line[:-1] + _CHECKSUM + b'%08x"}' % zlib.crc32(line[:-1])


def _is_whole(line: bytes) -> bool:
    """Whether a line has its checksum; one that a crash has cut has none."""
    text, mark, end = line.rpartition(_CHECKSUM)
    return bool(mark) and end == b'%08x"}' % zlib.crc32(text)


class _JsonLines(logging.Handler):
    """One write a line, so that a crash cuts at most the last one."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        flags = os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW
        self._file = os.open(path, flags, 0o666)
        size = os.fstat(self._file).st_size
        if size and os.pread(self._file, 1, size - 1) != b"\n":
            with suppress(OSError):
                os.write(self._file, b"\n")

    def emit(self, record: logging.LogRecord) -> None:
        event = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "event": record.getMessage(),
            **getattr(record, "fields", {}),
        }
        # A full disk stops the run where rows are stored, and says so there.
        with suppress(OSError):
            os.write(self._file, _with_checksum(json.dumps(event, default=str).encode()) + b"\n")

    def close(self) -> None:
        os.close(self._file)
        super().close()
