"""Removal of escape sequences and control characters of files and names from terminal output.

They could move the cursor, hide lines, change the window's title, or make the terminal send input.
"""

import io
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, TextIO

_CONTROL = re.compile(
    r"\x1b\[[0-?]*[ -/]*[@-~]|\x9b[0-?]*[ -/]*[@-~]"  # control sequences: colours, cursor positions
    r"|(?:\x1b[]PX^_]|[\x90\x98\x9d-\x9f])[^\x07\x1b\x9c\n]*(?:\x07|\x1b\\|\x9c)"  # a string, such as a title
    r"|\x1b[ -/]*[0-~]"
    r"|\r(?!\n)|[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f]"
)
"""Pattern of ECMA-48 escape sequences, control strings, and single control characters."""


def plain_text(text: str) -> str:
    """Remove escape sequences, and control characters other than tabs and line ends.

    Examples
    --------
    >>> plain_text("\\x1b]0;title\\x07a \\x1b[31mred\\x1b[0m\\tname\\x9b2J\\x08\\n")
    'a red\\tname\\n'
    """
    return _CONTROL.sub("", text)


_HELD: list[TextIO] = []
"""Wrapped streams, kept alive for log handlers: a collected wrapper would close the terminal's stream."""


class _Plain(io.TextIOWrapper):
    """Stream that filters its text; progress bars, which move the cursor, use the underlying `terminal`."""

    terminal: TextIO

    def write(self, text: str) -> int:
        super().write(plain_text(text))
        return len(text)


@contextmanager
def plain_streams() -> Iterator[None]:
    """Filter all output, logs and warnings within the block."""
    before = {name: getattr(sys, name) for name in ("stdout", "stderr")}
    for name, stream in before.items():
        if isinstance(stream, io.TextIOWrapper):
            plain = _Plain(
                stream.buffer, stream.encoding, stream.errors, line_buffering=stream.line_buffering
            )
            plain.terminal = stream
            setattr(sys, name, plain)
            _HELD.append(plain)
    try:
        yield
    finally:
        after = [getattr(sys, name) for name in before]
        for name, stream in before.items():
            setattr(sys, name, stream)
        for plain in after:
            plain.flush()


def terminal_of(stream: Any) -> Any:
    """Underlying terminal of a filtered stream; any other stream unchanged."""
    return getattr(stream, "terminal", stream)
