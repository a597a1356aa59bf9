"""Parquet files that carry a digest, and checksums of their pages."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from toppling.models.errors import InputError, refusals
from toppling.models.files.digest import BLANK, KEY, check, damaged, seal, stamp, unopened
from toppling.models.files.folder import new_file
from toppling.models.files.given import open_given

_LEAST_BOUND_BYTES, _BYTES_PER_BYTE = 64_000_000, 200
"""Memory that any file may take, and more for each of its bytes: results and records take at most 40 a byte."""
_LEAST_BOUND_ROWS = 10_000
_VALUE_BYTES = 8
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


def read_table(path: Path, *, required: bool = False, **how: Any) -> pa.Table:
    """Read a Parquet file that the program wrote, by the options of `pyarrow.parquet.read_table`.

    required: refuse a file without a digest.
    Raises InputError if it is damaged, or cannot be opened.
    Raises FileNotFoundError if there is no such file.
    """
    try:
        sealed = check(path, required=required)
        check_bounds(path)
        if not sealed and KEY.encode() in (pq.read_metadata(path).metadata or {}):
            raise damaged(path, "its digest is none")
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
    if footer.num_rows > max(state.st_size, _LEAST_BOUND_ROWS):
        what = f"counts {footer.num_rows:,} rows in {state.st_size:,} bytes"
        raise _unbounded("table.too_large", what, path)
    unpacked = decoded = 0
    repeated: set[int] = set()
    for group in range(footer.num_row_groups):
        for index in range(footer.num_columns):
            column = footer.row_group(group).column(index)
            unpacked += max(column.total_uncompressed_size, 0)
            decoded += _VALUE_BYTES * max(column.num_values, 0)
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
