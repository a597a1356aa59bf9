"""A digest inside every file that the program writes and reads again, Parquet files among them."""

import hashlib
import io
import json
import os
import time
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from toppling.models.errors import InputError, refusals
from toppling.models.files import documents
from toppling.models.files.folder import new_file
from toppling.models.files.given import END_BYTES, HEAD_BYTES, open_given

KEY = "digest"
"""Name of the digest where a format has names."""

_MARK = "toppling-sha256:"
BLANK = f"{_MARK}{'0' * 64}"
"""Placeholder that a writer puts where the digest will be."""

_LFS = b"version https://git-lfs"
_UNSETTLED_S = 2.0
"""A file changed so recently may change again without another time: it is not remembered."""

_PathLike = str | os.PathLike[str]

_verified: dict[str, tuple[tuple[int, ...], bool]] = {}
"""State of each verified file, by path, and whether it had a digest."""


_no_file = refusals(
    expected="a file as the program wrote it",
    remedy="look where it comes from; put the file itself in its place",
)


def seal(path: Path) -> None:
    """Put the digest of a file that was just written into its blank."""
    with path.open("r+b") as file:
        size = os.fstat(file.fileno()).st_size
        place = _place(file, size)
        assert place is not None  # the writer has left room for it
        digest = _digest(file, place)
        file.seek(place)
        file.write(digest)


def seal_archive(path: Path) -> None:
    """Put the digest of a zip archive that was just written into its comment."""
    with zipfile.ZipFile(path, "a") as archive:
        archive.comment = BLANK.encode()
    seal(path)


def stamp(state: os.stat_result) -> tuple[int, ...]:
    """State of a file that changes with its content: inode, size and times."""
    return state.st_dev, state.st_ino, state.st_size, state.st_mtime_ns, state.st_ctime_ns


def check(path: _PathLike) -> bool:
    """Verify a file by its digest; once, as long as its size and times stay.

    Returns whether it carries a digest: JSON need not, from which whoever edits it removes the digest's line.
    Raises InputError if its bytes are not those that were written, or another file carries no digest.
    Raises FileNotFoundError if there is no such file.
    """
    name = os.path.abspath(path)  # noqa: PTH100  (a link that leads elsewhere is another file)
    with open_given(path, _no_file) as file:
        state = os.fstat(file.fileno())
        seen, sealed = _verified.get(name, ((), False))
        if seen != stamp(state):
            place = _place(file, state.st_size)
            sealed = place is not None
            if place is not None and _bytes_at(file, place) != _digest(file, place):
                raise damaged(path, "its bytes do not have its digest")
            if time.time_ns() - max(state.st_mtime_ns, state.st_ctime_ns) > _UNSETTLED_S * 1e9:
                _verified[name] = stamp(state), sealed
    if not sealed and Path(path).suffix != ".json":
        raise damaged(path, _why_none(Path(path)))
    return sealed


def _why_none(path: Path) -> str:
    """Why a file has no digest, as far as its beginning shows."""
    with open_given(path, _no_file) as file:
        head = file.read(len(_LFS))
    if not head:
        return "it is empty"
    if head == _LFS:
        return "it is a pointer of Git LFS, fetched by 'git lfs pull'"
    return "it carries no digest: another program saved it again"


def stated(path: _PathLike) -> str | None:
    """Digest that a file carries, in hexadecimal, not verified; None where it carries none.

    Raises as :func:`~toppling.models.files.given.open_given`.
    """
    with open_given(path, _no_file) as file:
        place = _place(file, os.fstat(file.fileno()).st_size)
        return None if place is None else _bytes_at(file, place).decode("ascii", "replace")


class DamagedError(InputError):
    """A file that is not as the program wrote it."""


def damaged(path: _PathLike, why: object) -> DamagedError:
    """Say that a file is not as the program wrote it."""
    what = f"is damaged ({str(why).partition(chr(10))[0]})"
    remedy = "copy it again from where it was made, or make it anew"
    if Path(path).suffix == ".json":
        remedy += "; if you or Git changed it, such as its ends of lines, remove its line 'digest'"
    return DamagedError(
        "file.damaged", what, where=str(path), expected="the file as it was written", remedy=remedy
    )


def unopened(path: _PathLike, error: OSError) -> InputError:
    """Say that a file cannot be opened, which is no damage: it may be whole."""
    return InputError(
        "file.not_opened",
        f"cannot be opened ({error.strerror or error})",
        where=str(path),
        expected="a file that this account may read, on a disk that answers",
        remedy="give the right to read it, or mount its disk again; it stays as it is",
    )


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Write a JSON file whose first line is its digest; it is whole or as it was before."""
    with new_file(path) as hidden:
        text = json.dumps({KEY: BLANK, **content}, indent=1, allow_nan=False)
        hidden.write_text(f"{text}\n", encoding="utf-8")
        seal(hidden)


def read_json(path: Path) -> Any:
    """Content of a JSON file, verified, without its digest.

    Raises InputError if it is damaged.
    Raises FileNotFoundError if there is no such file.
    """
    sealed = check(path)
    content = documents.read_json(path)
    if content.pop(KEY, None) is not None and not sealed:
        raise damaged(path, "its digest is none")
    return content


def write_sealed(text: str, path: Path) -> None:
    """Write a text with its digest in a comment that goes before."""
    path.write_text(f"# {BLANK}\n{text}", encoding="utf-8")
    seal(path)


def _place(file: IO[bytes], size: int) -> int | None:
    """Where the digest stands: after the last mark near the end (in Parquet: in the footer), or near the beginning."""
    file.seek(max(size - 8, 0))
    end = file.read(8)
    footer = int.from_bytes(end[:4], "little") + 8 if end.endswith(b"PAR1") else 0
    tail = min(max(END_BYTES, footer), size)
    for begin, length in ((size - tail, tail), (0, HEAD_BYTES)):
        file.seek(begin)
        found = file.read(length).rfind(_MARK.encode())
        if found >= 0:
            return begin + found + len(_MARK)
    return None


def _bytes_at(file: IO[bytes], place: int) -> bytes:
    file.seek(place)
    return file.read(64)


def _digest(file: IO[bytes], place: int) -> bytes:
    """Hexadecimal SHA-256 of a file with zeros where its digest stands."""
    digest = hashlib.sha256()
    file.seek(0)
    digest.update(file.read(place))
    digest.update(b"0" * len(file.read(64)))
    while chunk := file.read(io.DEFAULT_BUFFER_SIZE):
        digest.update(chunk)
    return digest.hexdigest().encode()


_LEAST_BOUND_BYTES = 64_000_000
"""Memory that any table may take."""
_BYTES_PER_BYTE = 200
"""Memory that it may take for each byte of its file besides: results and records take at most 40."""
_BOUNDED: dict[str, tuple[int, ...]] = {}
"""State of the files that were found to keep within."""


_unbounded = refusals(
    expected=f"a table of at most {_LEAST_BOUND_BYTES / 1e6:.0f} MB and {_BYTES_PER_BYTE} bytes for each of the file",
    remedy="look where the file comes from: no table that this program makes is packed so densely",
)


@contextmanager
def table_writer(path: Path, schema: pa.Schema, **options: Any) -> Iterator[pq.ParquetWriter]:
    """Write a Parquet file table by table; it gets its digest at the end."""
    with pq.ParquetWriter(path, schema, compression="zstd", write_page_checksum=True, **options) as writer:
        yield writer
        writer.add_key_value_metadata({KEY: BLANK})
    seal(path)


def write_table(table: pa.Table, path: Path, rows_in_group: int | None = None, **options: Any) -> None:
    """Write a table as a Parquet file with its digest, which appears complete or not at all."""
    with new_file(path) as hidden, table_writer(hidden, table.schema, **options) as writer:
        writer.write_table(table, row_group_size=rows_in_group)


def read_table(path: Path, **how: Any) -> pa.Table:
    """Read a Parquet file that the program wrote, by the options of `pyarrow.parquet.read_table`.

    Raises InputError if it is damaged, carries no digest, or cannot be opened.
    Raises FileNotFoundError if there is no such file.
    """
    try:
        check(path)
        check_bounds(path)
        if how:
            return pq.read_table(path, page_checksum_verification=True, **how)
        # Arrow's data sets, which take columns and schemas, bring pandas along: 45 MB of a worker.
        with pq.ParquetFile(path, page_checksum_verification=True) as file:
            return file.read().replace_schema_metadata(file.schema_arrow.metadata)
    except (FileNotFoundError, InputError):
        raise  # such as a part that was merged meanwhile
    except (pa.ArrowException, OSError, ValueError) as error:
        if isinstance(error, OSError) and error.errno is not None:
            raise unopened(path, error) from error
        raise damaged(path, error) from error


def check_bounds(path: Path) -> None:
    """Refuse a Parquet file that would take much more memory than a file of its size holds, before it is read.

    By its footer: bytes after decompression, values after decoding, and texts that a dictionary repeats.

    Raises InputError if it would.
    Raises FileNotFoundError, pyarrow.ArrowException if there is no such file, or it is no Parquet.
    """
    with open_given(path, _unbounded) as file:
        state = os.fstat(file.fileno())
    if _BOUNDED.get(str(path)) == stamp(state):
        return
    footer = pq.read_metadata(path)
    most = _LEAST_BOUND_BYTES + _BYTES_PER_BYTE * state.st_size
    unpacked, decoded = 0, pa.float64().byte_width * footer.num_rows
    repeated: set[int] = set()
    for group in range(footer.num_row_groups):
        for index in range(footer.num_columns):
            column = footer.row_group(group).column(index)
            unpacked += max(column.total_uncompressed_size, 0)
            decoded += pa.float64().byte_width * max(column.num_values, 0)
            repeats = column.physical_type == "BYTE_ARRAY" and column.has_dictionary_page
            if repeats and column.num_values * column.total_uncompressed_size > most:
                repeated.add(index)
    if max(unpacked, decoded) > most:
        what = f"would take {max(unpacked, decoded) / 1e6:,.0f} MB of memory"
        raise _unbounded("table.too_large", what, path)
    for index in sorted(repeated):
        _check_repeated(path, footer.schema.column(index).path, most)
    _BOUNDED[str(path)] = stamp(state)


def _check_repeated(path: Path, name: str, most: int) -> None:
    """Refuse texts of a column that take more memory, each written out, than the file may."""
    file = pq.ParquetFile(path, read_dictionary=[name])
    size = 0
    for group in range(file.num_row_groups):
        for column in file.read_row_group(group, columns=[name]).flatten():
            for chunk in column.chunks:
                values = chunk.flatten() if pa.types.is_nested(chunk.type) else chunk
                if pa.types.is_dictionary(values.type):
                    lengths = pc.binary_length(values.dictionary)
                    size += pc.sum(pc.take(lengths, values.indices)).as_py() or 0
                if size > most:
                    what = f"repeats texts of more than {most / 1e6:,.0f} MB in column {name}"
                    raise _unbounded("table.too_large", what, path)
