"""The one door for files that people give: regular files of a bounded size, which nobody waits for.

What a file says is refused through the reader's own `refusals`, which know what it expected and what helps.
"""

import os
import re
import stat
from collections.abc import Callable
from typing import IO, Any

from toppling.models.errors import InputError

Refuse = Callable[[str, str, object], InputError]
"""Makes an error of what is wrong and where."""

LONGEST_LINE_BYTES = 1 << 20
"""Maximum length of a line of text, in any format."""
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
    """What a file is by its beginning, and what to give instead, where it holds no text or something more."""
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


def bytes_given(path: str | os.PathLike[str], refuse: Refuse, most_bytes: float) -> bytes:
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
