"""Files that people give: regular files of a bounded size; text of any encoding, lines by their numbers."""

import os
import re
import stat
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, NoReturn

from toppling.models.errors import InputError

Refuse = Callable[[str, str, object], InputError]
"""Makes an error of what is wrong and where."""

LONGEST_LINE_BYTES = 1 << 20
"""Maximum length of a line of text, in any format."""
LONGEST_NAME = 300
"""Maximum number of characters of a name, a value or a remark that are parsed: patterns are slow in endless text."""
LARGEST_BYTES = 100_000_000
"""Maximum size of a table or a document, which is parsed whole, bytes."""
LARGEST_DATA_BYTES = 800_000_000
"""Maximum size of a mesh or a file of records: sixteen million triangles of an STL."""
_OPEN_AT_ONCE = os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC
"""A pipe would wait for its writer, and a terminal would become the program's."""
_LINE_END = re.compile(rb"[\n\r]")


_NO_TEXTS = (
    (rb"PK\x03\x04(?=[\s\S]{0,4000}(?:xl/|Content_Types))", "a spreadsheet", "save its sheet as CSV"),
    (rb"PK\x03\x04|\x1f\x8b|BZh|\xfd7zXZ|7z\xbc\xaf|Rar!", "a packed archive", "unpack it first"),
    (
        rb"\x89HDF|MATLAB|\x93NUMPY|PAR1|ARROW1|#ASDF",
        "a file of arrays",
        "export it as text, in named columns",
    ),
    (rb"%PDF|\xff\xd8\xff|\x89PNG", "a document or picture", "give its numbers as text"),
)
"""Beginnings of files that hold no text: what they are, and what to give instead."""


def other_kind(head: bytes, more: tuple[tuple[bytes, str, str], ...] = ()) -> tuple[str, str] | None:
    """Kind of a file without text, or one of `more`, by its beginning, and what to give instead; None for others."""
    kinds = (kind for kind in (*_NO_TEXTS, *more) if re.match(kind[0], head, re.IGNORECASE))
    return next(((what, remedy) for _, what, remedy in kinds), None)


class UnopenedError(InputError, OSError):
    """A file that the system does not open, which is no fault of what it holds; with the system's errno."""

    __str__ = BaseException.__str__  # not the system's words alone


class AbsentError(UnopenedError, FileNotFoundError):
    """There is no such file."""


def open_given(path: str | os.PathLike[str], refuse: Refuse, most_bytes: float | None = None) -> IO[bytes]:
    """Open a file that somebody gave; links to files are followed.

    most_bytes: size of the largest file of its kind.
    Raises AbsentError if there is none, UnopenedError if the system does not open it, InputError if it is a folder, a
    pipe, a device, or larger.
    """
    try:
        number = os.open(path, _OPEN_AT_ONCE)
    except ValueError as error:  # a zero in the name
        raise refuse("file.name_unusable", f"is no name of a file ({error})", repr(path)) from None
    except (FileNotFoundError, NotADirectoryError) as error:
        raise _unopened(AbsentError, refuse("file.absent", "does not exist", path), error) from None
    except OSError as error:
        why = refuse("file.not_opened", f"cannot be opened ({error.strerror})", path)
        raise _unopened(UnopenedError, why, error) from None
    try:
        state = os.fstat(number)
        if stat.S_ISDIR(state.st_mode):
            raise refuse("file.is_folder", "is a folder", path)
        if not stat.S_ISREG(state.st_mode):
            raise refuse("file.not_regular", "is no file: a pipe or a device", path)
        if most_bytes is not None and state.st_size > most_bytes:
            raise refuse(
                "file.too_large",
                f"has {state.st_size / 1e6:,.3g} MB, more than the {most_bytes / 1e6:,.3g} MB of any such file",
                path,
            )
    except BaseException:
        os.close(number)
        raise
    return os.fdopen(number, "rb")


def _unopened(kind: type[UnopenedError], why: InputError, error: OSError) -> UnopenedError:
    unopened = kind(why.code, why.what, where=why.where, expected=why.expected, remedy=why.remedy)
    unopened.errno, unopened.strerror = error.errno, error.strerror
    return unopened


def bytes_given(path: str | os.PathLike[str], refuse: Refuse, most_bytes: float = LARGEST_BYTES) -> bytes:
    """Content of a file that somebody gave; raises as :func:`open_given`."""
    with open_given(path, refuse, most_bytes) as file:
        return file.read()


def check_lines(file: IO[bytes], path: Any, refuse: Refuse) -> None:
    """Refuse an open text with an endless line, which would be taken into memory whole; the file is at its beginning.

    Raises InputError if a line may have more than `LONGEST_LINE_BYTES`.
    """
    file.seek(0)
    while len(chunk := file.read(LONGEST_LINE_BYTES)) == LONGEST_LINE_BYTES:
        if not _LINE_END.search(chunk):
            raise refuse("file.line_too_long", f"has a line of more than {LONGEST_LINE_BYTES:,} bytes", path)
    file.seek(0)


HEAD_BYTES = 4000
"""Length of the beginning of a file that shows what it is."""
END_BYTES = 65_536
"""Length of the beginning of a file that is searched for its header, and of the end for its last entry."""
_FILLING = re.compile(rb"(?<![\0\x1a])[\0\x1a]++(?=[\r\n]|\Z)|(?<=[\r\n])[\0\x1a]++")
"""DOS' end of file, and zeros that fill a line or a block: never inside of a line, where they are damage.

Each run is looked at once: binary files have long ones."""
_FILLED_UP = b"\0\x1a \t\r\n"
_TEXT_LINE_END = re.compile(r"\r*\n|\r")
_NO_LINE_ENDS = str.maketrans(dict.fromkeys("\x0b\x0c\x1c\x1d\x1e\x85\u2028\u2029", " "))
"""Characters at which Python splits lines and files of numbers do not: form feeds, bytes of other encodings."""
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
    return _TEXT_LINE_END.sub("\n", text).translate(_NO_LINE_ENDS | _AS_ASCII) + "\n"


def text_given(path: Path, refuse: Refuse) -> str:
    """Text of a file that somebody gave.

    Raises InputError as :func:`~toppling.models.files.given.open_given`, or if it is no text.
    """
    text = text_of(bytes_given(path, refuse))
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
