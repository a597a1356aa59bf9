"""Parquet files that carry a digest, and checksums of their pages."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from toppling.models.digest import BLANK, KEY, check, damaged, seal, unopened
from toppling.models.errors import InputError


@contextmanager
def table_writer(path: Path, schema: pa.Schema, **options: Any) -> Iterator[pq.ParquetWriter]:
    """Write a Parquet file table by table; it gets its digest at the end."""
    with pq.ParquetWriter(path, schema, compression="zstd", write_page_checksum=True, **options) as writer:
        yield writer
        writer.add_key_value_metadata({KEY: BLANK})
    seal(path)


def write_table(table: pa.Table, path: Path, rows_in_group: int | None = None, **options: Any) -> None:
    """Write a table as a Parquet file with its digest."""
    with table_writer(path, table.schema, **options) as writer:
        writer.write_table(table, row_group_size=rows_in_group)


def read_table(path: Path, *, required: bool = False, **how: Any) -> pa.Table:
    """Read a Parquet file that the program wrote, by the options of `pyarrow.parquet.read_table`.

    Parameters
    ----------
    path : Path
    required : bool
        Refuse a file without a digest.
    how
        Passed on.

    Raises
    ------
    InputError
        If it is damaged, or cannot be opened.
    FileNotFoundError
        If there is no such file.
    """
    try:
        sealed = check(path, required=required)
        if not sealed and KEY.encode() in (pq.read_metadata(path).metadata or {}):
            raise damaged(path, "its digest is none")
        return pq.read_table(path, page_checksum_verification=True, **how)
    except (FileNotFoundError, InputError):
        raise  # such as a part that was merged meanwhile
    except (pa.ArrowException, OSError, ValueError) as error:
        if isinstance(error, OSError) and error.errno is not None:
            raise unopened(path, error) from error
        raise damaged(path, error) from error
