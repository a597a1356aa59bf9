"""Text files of strangers: encodings and ends of lines of any system, lines by their numbers."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from toppling.models.errors import InputError
from toppling.models.files.given import Refuse, bytes_given

HEAD_BYTES = 4000
LARGEST_TABLE_BYTES = 100_000_000
_FILLING = re.compile(rb"(?<![\0\x1a])[\0\x1a]++(?=[\r\n]|\Z)|(?<=[\r\n])[\0\x1a]++")
"""DOS' end of file, and zeros that fill a line or a block: never inside of a line, where they are damage.

Each run is looked at once: binary files have long ones."""
_FILLED_UP = b"\0\x1a \t\r\n"
_LINE_END = re.compile(r"\r*\n|\r")
_NO_LINE_ENDS = str.maketrans(dict.fromkeys("\x0b\x0c\x1c\x1d\x1e\x85\u2028\u2029", " "))
"""Where Python splits lines and no file of numbers does: form feeds of listings, bytes of other encodings."""
_AS_ASCII = str.maketrans({"\u2212": "-", "\u00a0": " "})
"""A minus and a blank of word processors."""
_UTF_16 = (b"\xff\xfe", b"\xfe\xff")
"""Marks with which UTF-16 begins."""


def text_of(content: bytes) -> str | None:
    """Text of a file with lines that end in a newline, None if it is binary.

    UTF-8, and UTF-16 by its mark, are recognised; what is neither is in the encoding of western Windows, which has that
    of Latin-1 for every letter and sign of a unit.
    """
    if content.startswith(_UTF_16):
        text = content.decode("utf-16", errors="replace").rstrip(_FILLED_UP.decode())
    else:
        content = _FILLING.sub(b"", content.rstrip(_FILLED_UP))
        if b"\0" in content[:HEAD_BYTES]:
            return None
        text = _decoded(content)
    return _LINE_END.sub("\n", text).translate(_NO_LINE_ENDS | _AS_ASCII) + "\n"


def text_given(path: Path, refuse: Refuse, most_bytes: int = LARGEST_TABLE_BYTES) -> str:
    """Text of a file that somebody gave.

    Raises InputError as :func:`~toppling.models.files.given.open_given`, or if it is no text.
    """
    text = text_of(bytes_given(path, refuse, most_bytes))
    if text is None:
        raise refuse("file.not_text", "is no text", path)
    return text


def encoding_of(head: bytes) -> str | None:
    """Encoding of a text by its first lines, for a file too large to be decoded at once; None if it is binary."""
    if head.startswith(_UTF_16):
        return "utf-16"
    if b"\0" in head:
        return None
    try:
        head.decode()
    except UnicodeDecodeError:
        return "latin-1"
    return "utf-8-sig"


def _decoded(content: bytes) -> str:
    content = content.removeprefix(b"\xef\xbb\xbf")  # some programs put it before text of Windows
    for encoding in ("utf-8", "cp1252"):
        try:
            return content.decode(encoding)
        except UnicodeDecodeError:
            continue
    return content.decode("latin-1")


@dataclass(frozen=True)
class TextFile:
    """Lines of a file, or of a part of it, by their places from 0; errors number them in the file, from 1."""

    path: Path
    lines: Sequence[str]
    above: int = 0  # lines of the file before these

    def where(self, at: int) -> str:
        """File and line, as an error names them."""
        return f"{self.path}:{self.above + at + 1}"

    def refuse(
        self, code: str, at: int, what: str, expected: str, remedy: str = "fetch the file again"
    ) -> NoReturn:
        """Refuse the file for what is wrong at a line."""
        raise InputError(code, what, where=self.where(at), expected=expected, remedy=remedy)
