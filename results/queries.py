"""SQL over one or several runs: tables, refusal to pool different experiments, limits of memory and time.

An untrusted query can read nothing but the tables of the runs.
"""

import contextlib
import re
import threading
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import duckdb
import pyarrow as pa

from toppling.models.errors import InputError
from toppling.results.store import newest_rows, read_steady, result_files

if TYPE_CHECKING:
    import pyarrow.dataset as ds

_APART = ("engine", "preset", "scene_id", "physics_version")
"""Columns of `results` whose values must not be pooled over runs unasked."""

_TEXT_OR_REMARK = re.compile(r"'(?:[^']|'')*'|--[^\n]*|/\*.*?\*/", re.DOTALL)


class _Readable(Protocol):
    """Interface of a run that queries need (`results.reader.Run`)."""

    @property
    def name(self) -> str: ...
    @property
    def rocks(self) -> tuple[Any, ...]: ...
    @property
    def root(self) -> Path: ...
    def dataset(self) -> "ds.Dataset": ...


_MEMORY_BYTES = 2 << 30
"""Memory limit of an untrusted query and of its answer; sums and joins of a million jobs take a tenth of it."""
_TIME_S = 120.0
"""Time limit of an untrusted query, s."""
_BATCH_ROWS = 2_048
"""Number of rows of an answer that are fetched between checks of its size."""

_LOCKED = {
    "enable_external_access": "false",
    "autoinstall_known_extensions": "false",
    "autoload_known_extensions": "false",
    "python_enable_replacements": "false",
    "temp_directory": "",
}
"""DuckDB settings that restrict an untrusted query to the given tables."""


def ask(runs: Sequence[_Readable], query: str, *, trusted: bool = False) -> pa.Table:
    """Answer a DuckDB query over one or several runs.

    The tables `results`, `motions` and `scene` contain the rows of all runs, distinguished by the column `run`. Where
    the bases of a rock have different weights, `bases` contains them. Where the runs differ in engine, preset, scene or
    physics version, a query over `results` must name the run or that column, so that different experiments are not
    pooled by accident.

    query: one SELECT, which reads nothing but these tables.
    trusted: allow all that DuckDB can do: read and write files, load extensions.
    Raises InputError if DuckDB refuses the query, two runs have the same name, or the query would pool different
    experiments.
    """

    def answer() -> pa.Table:
        with _tables_of(runs, trusted) as connection:
            kinds = [] if trusted else [statement.type for statement in connection.extract_statements(query)]
            if not trusted and kinds != [duckdb.StatementType.SELECT]:
                held = ", ".join(kind.name for kind in kinds) or "nothing"
                raise _refused(f"the query holds {held}")
            relation = connection.sql(query)
            table = _collected(relation, trusted) if relation is not None else pa.table({})
            if len(runs) > 1 or any(run.rocks for run in runs):
                _refuse_pooling(connection, query, table.column_names)
            return table

    return read_steady([run.root for run in runs], answer)


def rows_where(run: _Readable, where: str, trusted: bool) -> pa.Table:
    """Rows of `results` that satisfy an SQL condition; InputError if DuckDB refuses it."""

    def answer() -> pa.Table:
        with _tables_of([run], trusted) as connection:
            # A parsed expression, because text within a statement could inject SQL.
            return connection.table("results").filter(duckdb.SQLExpression(where)).to_arrow_table()

    return read_steady([run.root], answer)


@contextlib.contextmanager
def _tables_of(runs: Sequence[_Readable], trusted: bool) -> Iterator[duckdb.DuckDBPyConnection]:
    """Connection with the current tables of some runs, within limits; DuckDB's errors become InputError."""
    with _connect(runs, trusted) as connection:
        try:
            with _time_limit(connection, trusted):
                yield connection
        except duckdb.PermissionException as error:
            raise _refused(str(error)) from error
        except duckdb.Error as error:
            if isinstance(error, duckdb.InvalidInputException):  # perhaps a damaged file, which this names
                for run in runs:
                    newest_rows(result_files(run.root))
            raise InputError(
                "query.failed",
                str(error),
                where="SQL",
                expected="DuckDB's SQL over the tables results, motions, scene",
                remedy="write toppled::int to count or average it"
                if "BOOLEAN" in str(error)
                else "'toppling query RUN --describe' names every column, and texts stand between single quotes",
            ) from error


def _connect(runs: Sequence[_Readable], trusted: bool = False) -> duckdb.DuckDBPyConnection:
    """DuckDB connection with the current views `results`, `motions`, `scene` and `bases` of some runs.

    An untrusted connection cannot access files, extensions or Python variables, and its configuration is locked.
    """
    names = [run.name for run in runs]
    if len(set(names)) < len(names):
        what = f"two of the runs {', '.join(names)} have the same name"
        raise InputError(
            "run.names_repeated",
            what,
            where="query",
            expected="folders of different names",
            remedy="rename one of the folders",
        )
    config: dict[str, Any] = {} if trusted else {**_LOCKED, "memory_limit": f"{_MEMORY_BYTES >> 20}MiB"}
    connection = duckdb.connect(config=config)
    for view in ("results", "motions", "scene", "bases"):
        parts = []
        for number, run in enumerate(runs):
            source = run.dataset() if view == "results" else getattr(run, view)()
            if source is not None:
                connection.register(f"{view}_{number}", source)
                quoted = run.name.replace("'", "''")
                parts.append(f"select '{quoted}' as run, * from {view}_{number}")
        if parts:
            connection.execute(f"create view {view} as {' union all by name '.join(parts)}")
    if not trusted:
        connection.execute("set lock_configuration = true")
    return connection


def _refuse_pooling(connection: duckdb.DuckDBPyConnection, query: str, answered: Iterable[str]) -> None:
    """Refuse a query that neither names nor returns the columns in which its runs differ."""
    words = {word.lower() for word in re.findall(r"\w+", _TEXT_OR_REMARK.sub(" ", query))}
    if "results" not in words:
        return
    named = words | set(answered)
    if "rock" in named:
        named.add("scene_id")
    kinds = connection.execute(
        f"select distinct run, rock, {', '.join(_APART)} from results where physics_version is not null order by run"
    ).fetch_df()
    differing = [name for name in _APART if kinds[name].nunique() > 1]
    named_columns = [name for name in ("run", *differing) if name in named]
    groups = kinds.groupby(named_columns) if named_columns else [((), kinds)]
    if not any(of[name].nunique() > 1 for _, of in groups for name in differing):
        return
    pooled = [name for name in differing if name not in named_columns]
    of_atlas = kinds["rock"].notna().all()
    columns = ", ".join("rock" if name == "scene_id" and of_atlas else name for name in pooled)
    values = "; ".join(f"{name}: {', '.join(str(kind) for kind in kinds[name].unique())}" for name in pooled)
    raise InputError(
        "query.runs_differ",
        f"these runs differ in {values}, and the query pools their rows",
        where="SQL",
        expected=f"{columns.replace(', ', ' and ')}, or run, in its select, group by or where",
        remedy=f'add it, such as "select {columns}, avg(toppled::int) p from results group by all"',
    )


def _refused(what: str) -> InputError:
    return InputError(
        "query.not_allowed",
        what,
        where="SQL",
        expected="one SELECT over the tables results, motions, scene, which reads no file and changes nothing",
        remedy="--trusted lets a query that you know do all that DuckDB can, such as join your own files",
    )


@contextlib.contextmanager
def _time_limit(connection: duckdb.DuckDBPyConnection, trusted: bool) -> Iterator[None]:
    """Stop an untrusted query that takes too long; InputError if it was stopped, or needed too much memory."""
    watch = threading.Timer(_TIME_S, connection.interrupt)
    watch.daemon = True
    if not trusted:
        watch.start()
    try:
        yield
    except (duckdb.InterruptException, duckdb.OutOfMemoryException, OSError, pa.ArrowException) as error:
        if trusted:  # interrupted by the user, such as by Ctrl-C
            raise
        reason = str(error).partition("\n")[0]
        # Errors while the answer is fetched come through Arrow, and are recognised by their message.
        if isinstance(error, duckdb.InterruptException) or "INTERRUPT Error" in reason:
            raise _too_much(f"the query took more than {_TIME_S:g} s and was stopped") from error
        raise _too_much(f"the query cannot be answered ({reason})") from error
    finally:
        watch.cancel()


def _collected(answer: duckdb.DuckDBPyRelation, trusted: bool) -> pa.Table:
    """All rows of an answer; InputError if an untrusted query's answer exceeds the memory limit."""
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
    return InputError(
        "query.too_large",
        what,
        where="SQL",
        expected=f"a query of at most {_MEMORY_BYTES / 1e9:.1f} GB and {_TIME_S:g} s",
        remedy="ask for less at once (where, group by, limit); --trusted lifts the limits for a query that you know",
    )
