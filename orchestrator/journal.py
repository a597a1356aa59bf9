"""Log of a run's events, one JSON object per line of `run.log`.

Events are written by :func:`log_event`; warnings of the orchestrator and the store are included automatically.
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
from toppling.models.files.given import END_BYTES, open_given

LOG_FILE = "run.log"
_CHECKSUM = b', "crc32": "'

log = logging.getLogger(__name__)

_events = logging.getLogger("toppling.orchestrator.journal")
_events.propagate = False  # the terminal shows progress and warnings, but not every stored part
_events.setLevel(logging.INFO)


def log_event(event: str, **fields: Any) -> None:
    """Log an event with its fields."""
    _events.info(event, extra={"fields": fields})


@contextmanager
def journal(run: Path) -> Iterator[None]:
    """Write events and warnings to the run's log within the block."""
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
    """Newest entry of the given events near the end of a run's log; None if there is none."""
    try:
        with open_given(run / LOG_FILE, _no_log) as file:
            begin = file.seek(max(file.seek(0, os.SEEK_END) - END_BYTES, 0))
            lines = file.read().splitlines()
    except (InputError, OSError):
        return None
    for line in reversed(lines[1:] if begin else lines):  # the first line may be incomplete
        if not _is_whole(line):
            log.warning("a line of %s is cut or damaged, and left out", run / LOG_FILE)
        elif (entry := json.loads(line)).get("event") in events:
            return entry
    return None


def _with_checksum(line: bytes) -> bytes:
    """Add the checksum of a JSON object's text as its last member."""
    return line[:-1] + _CHECKSUM + b'%08x"}' % zlib.crc32(line[:-1])


def _is_whole(line: bytes) -> bool:
    """Whether a line has a valid checksum; a line truncated by a crash has none."""
    text, mark, end = line.rpartition(_CHECKSUM)
    return bool(mark) and end == b'%08x"}' % zlib.crc32(text)


class _JsonLines(logging.Handler):
    """Handler with a single write per line, so that a crash truncates at most the last one."""

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
        # A full disk is reported where rows are stored.
        with suppress(OSError):
            os.write(self._file, _with_checksum(json.dumps(event, default=str).encode()) + b"\n")

    def close(self) -> None:
        os.close(self._file)
        super().close()
