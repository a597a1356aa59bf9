"""SQL over one or several runs: the tables that it is asked of, and what it may not pool."""

import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, Protocol

import duckdb
import pyarrow as pa
import pyarrow.dataset as ds

from toppling.models.errors import InputError
from toppling.results.sandbox import collected, opened, time_limit
from toppling.results.store import newest_rows, read_steady, result_files

_APART = ("engine", "preset", "scene_id", "physics_version")
"""Columns of `results` in which runs may differ, so that their rows answer different questions."""

_TEXT_OR_REMARK = re.compile(r"'(?:[^']|'')*'|--[^\n]*|/\*.*?\*/", re.DOTALL)


class Readable(Protocol):
    """What a query asks of a run (`results.reader.Run`)."""

    @property
    def name(self) -> str:
        """Tells runs apart."""

    @property
    def rocks(self) -> tuple[Any, ...]:
        """Runs of its rocks, if it has many."""

    @property
    def root(self) -> Path:
        """The folder with its rows."""

    def dataset(self) -> ds.Dataset:
        """Its rows."""


_Question = Callable[[duckdb.DuckDBPyConnection], pa.Table]


def ask(runs: Sequence[Readable], query: str, *, trusted: bool = False) -> pa.Table:
    """Answer of a DuckDB query over one or several runs.

    The tables `results`, `motions` and `scene` hold the rows of all, and a column `run` tells them apart. Where the
    bases of a rock weigh unlike, `bases` holds their weights. Where the runs
    differ in engine, preset, scene or physics version, a query over `results` has to name the run or that column: rows
    that answer different questions are not pooled unasked.

    Parameters
    ----------
    query : str
        One SELECT, which reads nothing but these tables.
    trusted : bool
        Let the query do all that DuckDB can: read and write files, load extensions.

    Raises
    ------
    InputError
        If DuckDB refuses the query, two runs have the same name, or the query would pool rows of different questions.
    """

    def answer(connection: duckdb.DuckDBPyConnection) -> pa.Table:
        table = _answer(connection, query, trusted)
        if len(runs) > 1 or any(run.rocks for run in runs):
            _refuse_pooling(connection, query, table.column_names)
        return table

    return answered(runs, answer, trusted)


def _connect(runs: Sequence[Readable], trusted: bool = False) -> duckdb.DuckDBPyConnection:
    """DuckDB connection with the views `results`, `motions`, `scene` and `bases` over some runs as they are now.

    Unless it is trusted, it reads and writes no file, loads no extension, sees no variable of this program, and its
    configuration is locked.
    """
    names = [run.name for run in runs]
    if len(set(names)) < len(names):
        what = f"two of the runs {', '.join(names)} have the same name"
        raise InputError(
            what,
            where="query",
            expected="folders of different names",
            remedy="rename one of the folders",
        )
    connection = opened(trusted)
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


def answered(runs: Sequence[Readable], question: _Question, trusted: bool) -> pa.Table:
    """Answer of a question to the tables of some runs, asked again where a run is merged meanwhile.

    Raises InputError if DuckDB refuses it.
    """
    return read_steady([run.root for run in runs], lambda: _asked_once(runs, question, trusted))


def _asked_once(runs: Sequence[Readable], question: _Question, trusted: bool) -> pa.Table:
    with _connect(runs, trusted) as connection:
        try:
            with time_limit(connection, trusted):
                return question(connection)
        except duckdb.PermissionException as error:
            raise _refused(str(error)) from error
        except duckdb.Error as error:
            if isinstance(error, duckdb.InvalidInputException):  # as of a damaged file, which this names
                for run in runs:
                    newest_rows(result_files(run.root))
            raise InputError(
                str(error),
                where="SQL",
                expected="DuckDB's SQL over the tables results, motions, scene",
                remedy="write toppled::int to count or average it"
                if "BOOLEAN" in str(error)
                else "'toppling query RUN --describe' names every column, and texts stand between single quotes",
            ) from error


def _answer(connection: duckdb.DuckDBPyConnection, query: str, trusted: bool) -> pa.Table:
    if not trusted:
        kinds = [statement.type for statement in connection.extract_statements(query)]
        if kinds != [duckdb.StatementType.SELECT]:
            named_columns = ", ".join(kind.name for kind in kinds) or "nothing"
            raise _refused(f"the query holds {named_columns}")
    answer = connection.sql(query)
    return collected(answer, trusted) if answer is not None else pa.table({})


def _refuse_pooling(connection: duckdb.DuckDBPyConnection, query: str, answered: Iterable[str]) -> None:
    """Refuse a query that says nothing of what tells the rows of its runs apart, in its text or its answer."""
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
    values = "; ".join(f"{name}: {', '.join(str(one) for one in kinds[name].unique())}" for name in pooled)
    raise InputError(
        f"these runs differ in {values}, and the query pools their rows",
        where="SQL",
        expected=f"{columns.replace(', ', ' and ')}, or run, in its select, group by or where",
        remedy=f'add it, such as "select {columns}, avg(toppled::int) p from results group by all"',
    )


def rows_where(connection: duckdb.DuckDBPyConnection, where: str) -> pa.Table:
    """Rows of `results` for which a condition holds."""
    # As an expression of its own, not as text in a statement, from which it could break out.
    return connection.table("results").filter(duckdb.SQLExpression(where)).to_arrow_table()


def _refused(what: str) -> InputError:
    return InputError(
        what,
        where="SQL",
        expected="one SELECT over the tables results, motions, scene, which reads no file and changes nothing",
        remedy="--trusted lets a query that you know do all that DuckDB can, such as join your own files",
    )
