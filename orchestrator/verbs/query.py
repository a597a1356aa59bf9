"""`toppling query`: SQL over runs."""

import json
from decimal import Decimal
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import pyarrow as pa

from toppling.models.files.documents import finite
from toppling.models.files.table import plain_frame
from toppling.orchestrator.verbs.shared_options import of, option
from toppling.results.reader import open_run

if TYPE_CHECKING:
    import pandas as pd


@click.command()
@click.argument("runs", nargs=-1, required=True, metavar="RUN... [SQL]")
@option("--csv", "form", flag_value="csv", help="Print CSV.")
@option("--json", "form", flag_value="json", help="Print a JSON array of rows.")
@of("public.reporting.query", "--trusted")
@option("--describe", is_flag=True, help="Print every column with its unit and meaning.")
def query(runs: tuple[str, ...], form: str | None, trusted: bool, describe: bool) -> None:
    """Query one or several runs in SQL (DuckDB), also during the run.

    The tables are results (one row per job), motions (one row per record) and scene (one row); if the campaign names
    motions that the rock survived, also bases (with their weights). With several runs each table holds the rows of
    all, distinguished by the column run; if these differ in engine, preset, scene or physics version, the query must
    name that column or run. A query is one SELECT and reads nothing else; --trusted lets it join your files.

    \b
    toppling query runs/first --describe
    toppling query runs/first "select level_pga_m_s2, avg(toppled::int) p, count(toppled) n
                               from results group by all order by all"
    """
    # SQL has at least two words.
    queries = [text for text in runs if len(text.split()) > 1 and not Path(text).is_dir()]
    runs = tuple(text for text in runs if text not in queries)
    if not runs or (len(queries) != 1 and not describe):
        wrong = "these are several queries" if runs and queries else "the query in SQL is missing"
        raise click.UsageError(
            f"{wrong if runs else 'a run is missing'}: give one run or more and one query, such as "
            f"toppling query {' '.join(runs) or 'RUN'} "
            '"select run, level_pga_m_s2, avg(toppled::int) p from results group by all", or --describe'
        )
    if describe:
        table = pa.Table.from_pylist(open_run(runs[0]).describe())
    else:
        from toppling.orchestrator.public.reporting import query as answer_of

        table = answer_of(runs, queries[0], trusted=trusted)
        for run in runs:
            if remark := open_run(run).completeness().remark:
                click.echo(f"{run} is unfinished: {remark}", err=True)
    if form == "csv":
        click.echo(plain_frame(_frame(table)).to_csv(index=False), nl=False)
    elif form == "json":
        click.echo(json.dumps(finite(table.to_pylist()), indent=1, allow_nan=False, default=_plain))
    else:
        click.echo(_readable(table))


def _frame(table: pa.Table) -> "pd.DataFrame":
    """Rows as a pandas frame in which integers with nulls stay integers."""
    return table.to_pandas(integer_object_nulls=True)


def _plain(value: Any) -> Any:
    """Convert values for JSON: DuckDB's decimals to numbers, integers where possible, and other types to text."""
    if isinstance(value, Decimal):
        return int(value) if value == int(value) else float(value)
    return str(value)


def _readable(table: pa.Table) -> str:
    if not len(table):
        return f"no rows; the columns are {', '.join(table.column_names)}"
    import pandas as pd

    most = pd.get_option("display.max_rows")
    shown = _frame(table.slice(0, most)).to_string(index=False, na_rep="", max_colwidth=None)
    left = len(table) - most
    return f"{shown}\n({left} more rows: --csv or --json gives all)" if left > 0 else shown
