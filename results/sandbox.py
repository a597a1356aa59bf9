"""SQL of whoever asks: it reads the tables that it is given and nothing else, within limits of memory and time."""

import contextlib
import threading
from collections.abc import Iterator
from typing import Any

import duckdb
import pyarrow as pa

from toppling.models.errors import InputError

_MEMORY_BYTES = 2 << 30
"""Of a query at work, and of its answer: the sums and joins of a million jobs take a tenth of it."""
_TIME_S = 120.0
_BATCH_ROWS = 2_048
"""Of an answer that are made at once, before its size is looked at."""

_LOCKED = {
    "enable_external_access": "false",
    "autoinstall_known_extensions": "false",
    "autoload_known_extensions": "false",
    "python_enable_replacements": "false",
    "temp_directory": "",
}
"""What keeps a query from everything but the tables that it is given."""


def opened(trusted: bool) -> duckdb.DuckDBPyConnection:
    """Connection for a query; unless it is trusted, one that reads and writes no file and has limits."""
    config: dict[str, Any] = {} if trusted else {**_LOCKED, "memory_limit": f"{_MEMORY_BYTES >> 20}MiB"}
    return duckdb.connect(config=config)


@contextlib.contextmanager
def time_limit(connection: duckdb.DuckDBPyConnection, trusted: bool) -> Iterator[None]:
    """Stop a query of this block that takes too long, unless it is trusted.

    Raises InputError if it was stopped, or needed too much memory.
    """
    watch = threading.Timer(_TIME_S, connection.interrupt)
    watch.daemon = True
    if not trusted:
        watch.start()
    try:
        yield
    except (duckdb.InterruptException, duckdb.OutOfMemoryException, OSError, pa.ArrowException) as error:
        if trusted:  # then it was somebody else who stopped it, as by Ctrl-C
            raise
        reason = str(error).partition("\n")[0]
        # What fails while the answer is fetched comes through Arrow, by its message.
        if isinstance(error, duckdb.InterruptException) or "INTERRUPT Error" in reason:
            raise _too_much(f"the query took more than {_TIME_S:g} s and was stopped") from error
        raise _too_much(f"the query cannot be answered ({reason})") from error
    finally:
        watch.cancel()


def collected(answer: duckdb.DuckDBPyRelation, trusted: bool) -> pa.Table:
    """All rows of an answer.

    Raises InputError if they take more memory than an answer may, unless the query is trusted.
    """
    if trusted:
        return answer.to_arrow_table()
    reader, batches, size = answer.to_arrow_reader(_BATCH_ROWS), [], 0
    for batch in reader:
        batches.append(batch)
        size += batch.nbytes
        if size > _MEMORY_BYTES:
            raise _too_much(f"the answer has more than {_MEMORY_BYTES / 1e9:.1f} GB")
    return pa.Table.from_batches(batches, reader.schema)


def _too_much(what: str) -> InputError:
    """Say that a query needs more than it gets."""
    return InputError(
        what,
        where="SQL",
        expected=f"a query of at most {_MEMORY_BYTES / 1e9:.1f} GB and {_TIME_S:g} s",
        remedy="ask for less at once (where, group by, limit); --trusted lifts the limits for a query that you know",
    )
