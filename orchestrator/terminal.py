"""What reaches a terminal: text without the escape sequences and control characters that files and names may hold.

They would move the cursor, hide a line, change the window's title, or have the terminal answer as if typed.
"""

import io
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, TextIO

_CONTROL = re.compile(
    r"\x1b\[[0-?]*[ -/]*[@-~]|\x9b[0-?]*[ -/]*[@-~]"  # a sequence with numbers: colours, places of the cursor
    r"|(?:\x1b[]PX^_]|[\x90\x98\x9d-\x9f])[^\x07\x1b\x9c\n]*(?:\x07|\x1b\\|\x9c)"  # a string, such as a title
    r"|\x1b[ -/]*[0-~]"
    r"|\r(?!\n)|[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f]"
)
"""ECMA-48: sequences, control strings, and what is left of either."""


def plain_text(text: str) -> str:
    """Text without escape sequences and control characters other than tabs and ends of lines.

    Examples
    --------
    >>> plain_text("\\x1b]0;title\\x07a \\x1b[31mred\\x1b[0m\\tname\\x9b2J\\x08\\n")
    'a red\\tname\\n'
    """
    return _CONTROL.sub("", text)


_HELD: list[TextIO] = []
"""Streams that log handlers may write to until the end; one that is given up closes the terminal's own."""


class _Plain(io.TextIOWrapper):
    """A stream of plain text; a bar of progress, which moves the cursor, is drawn on `terminal`."""

    terminal: TextIO

    def write(self, text: str) -> int:
        super().write(plain_text(text))
        return len(text)


@contextmanager
def plain_streams() -> Iterator[None]:
    """Have all that is printed, logged or warned of while the block runs be plain text."""
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
    """The terminal itself below a stream of plain text; any other stream as it is."""
    return getattr(stream, "terminal", stream)
