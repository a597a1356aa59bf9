"""Text files of strangers: encodings and ends of lines of any system, lines by their numbers, rows of tables."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn, Self

from toppling.models.errors import InputError, refusals
from toppling.models.files.documents import csv_rows
from toppling.models.files.given import Refuse, bytes_given

HEAD_BYTES = 4000
LARGEST_TABLE_BYTES, _LARGEST_LIST_BYTES = 100_000_000, 1_000_000
_FILLING = re.compile(rb"(?<![\0\x1a])[\0\x1a]++(?=[\r\n]|\Z)|(?<=[\r\n])[\0\x1a]++")
"""DOS' end of file, and zeros that fill a line or a block: never inside of a line, where they are damage.

Each run is looked at once: binary files have long ones."""
_FILLED_UP = b"\0\x1a \t\r\n"
_LINE_END = re.compile(r"\r*\n|\r")
_NO_LINE_ENDS = str.maketrans(dict.fromkeys("\x0b\x0c\x1c\x1d\x1e\x85\u2028\u2029", " "))
"""Where Python splits lines and no file of numbers does: form feeds of listings, bytes of other encodings."""
_AS_ASCII = str.maketrans({"\u2212": "-", "\u00a0": " "})
"""A minus and a blank of word processors."""
_UTF_16_SHARE = 0.9


def text_of(content: bytes) -> str | None:
    """Text of a file with lines that end in a newline, None if it is binary.

    UTF-8 and UTF-16 are recognised; what is neither is in the encoding of western Windows, which has that of Latin-1
    for every letter and sign of a unit.
    """
    encoding = _utf_16(content)
    if encoding:
        text = content.decode(encoding, errors="replace").lstrip("\ufeff").rstrip(_FILLED_UP.decode())
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


def lines_of_list(path: Path, refuse: Refuse) -> list[str]:
    """Lines of a short list that a person made, such as of control points; raises as :func:`text_given`."""
    return text_given(path, refuse, _LARGEST_LIST_BYTES).splitlines()


def encoding_of(head: bytes) -> str | None:
    """Encoding of a text by its first lines, for a file too large to be decoded at once; None if it is binary."""
    if encoding := _utf_16(head):
        return encoding
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


def _utf_16(content: bytes) -> str | None:
    """Name of the encoding where every other byte of the beginning is zero, or the mark of the order stands there."""
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    head = content[: HEAD_BYTES // 2 * 2]
    if len(head) < 100:
        return None
    even, odd = head[::2].count(0) / (len(head) / 2), head[1::2].count(0) / (len(head) / 2)
    if max(even, odd) < _UTF_16_SHARE or min(even, odd) > 1 - _UTF_16_SHARE:
        return None
    return "utf-16-le" if odd > even else "utf-16-be"


no_table = refusals(expected="a CSV table", remedy="save the table again")


@dataclass(frozen=True)
class TextFile:
    """Lines of a file, or of a part of it, by their places from 0; errors number them in the file, from 1."""

    path: Path
    lines: Sequence[str]
    above: int = 0  # lines of the file before these

    @classmethod
    def of_table(cls, path: Path) -> Self:
        """A whole table, in any encoding that :func:`text_of` knows.

        Raises InputError if it is larger than any table, or holds a zero: with the line.
        """
        content = bytes_given(path, no_table, LARGEST_TABLE_BYTES)
        text = text_of(content)
        if text is None or "\0" in text:
            before = content.partition(b"\0")[0] if text is None else text.partition("\0")[0].encode()
            cls(path, ()).refuse("file.holds_zeros", before.count(b"\n"), "a zero byte", "a CSV table",
                "save the table again")  # fmt: skip
        return cls(path, text.splitlines())

    def where(self, at: int) -> str:
        """File and line, as an error names them."""
        return f"{self.path}:{self.above + at + 1}"

    def refuse(
        self, code: str, at: int, what: str, expected: str, remedy: str = "fetch the file again"
    ) -> NoReturn:
        """Refuse the file for what is wrong at a line."""
        raise InputError(code, what, where=self.where(at), expected=expected, remedy=remedy)

    def rows(self, separator: str, start: int = 0) -> Iterator[tuple[int, list[str]]]:
        """Rows of a table from a line on, its header too, each with the place of its line."""
        ended = (f"{line}\n" for line in self.lines[start:])  # which a quoted cell may hold
        for number, row in csv_rows(ended, self.path, separator):
            yield start + number - 1, row
