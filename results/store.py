"""The store: part files as a run goes on, one compact sorted file when it is done.

One writer (the client of the cluster), any number of readers. A file appears complete or not at all, and is
verified whole by its digest before it is believed. A part that is damaged, or is not a run's, is named in the log
and skipped: its jobs are done again. One that cannot be opened, or holds rows of another run
(`results.run_integrity`), is refused. Where a job has several rows, its newest attempt counts.
"""

import logging
import os
import re
import time
import uuid
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from toppling.models.errors import InputError
from toppling.models.files.digest import DamagedError, check, damaged, unopened
from toppling.models.files.tables import check_bounds, read_table, write_table
from toppling.results.run_integrity import ForeignError, check_files, check_rows
from toppling.results.schema import ADDED_LATER, SCHEMA, SCHEMA_VERSION, SORT_ORDER

_log = logging.getLogger(__name__)

RESULTS_FILE = "results.parquet"
PARTS_FOLDER = "parts"
_PART_NAME = re.compile(r"part-[0-9]{20}-[0-9a-f]{8}\.parquet")
_ROWS_IN_GROUP = 20_000
"""Rows in a row group: small enough that a query of one record skips most of a large run."""

PathLike = str | os.PathLike[str]
_Answer = TypeVar("_Answer")


def write_part(run_folder: PathLike, rows: pa.Table | Iterable[Mapping[str, Any]]) -> Path:
    """Append rows to a run as one new part file.

    rows: a table under `SCHEMA`, or column name to value; a nullable column may be left out, and NaN is kept as null.
    Returns Path: the part file, on disk when this returns.
    Raises ValueError if there are no rows, a row has a column that the schema does not know, or lacks a required one.
    Raises FileNotFoundError if there is no such folder: one that vanished under a run is not made again, its earlier
    rows are gone.
    """
    table = rows if isinstance(rows, pa.Table) else table_of(list(rows))
    folder = Path(run_folder) / PARTS_FOLDER
    folder.mkdir(exist_ok=True)
    # Names sort by time of writing; the random tail keeps two writers by mistake from overwriting each other.
    target = folder / f"part-{time.time_ns():020d}-{uuid.uuid4().hex[:8]}.parquet"
    write_table(table, target, _ROWS_IN_GROUP)
    return target


def finished_ids(
    run_folder: PathLike, known: frozenset[str] | None = None, redo: Mapping[str, int] = MappingProxyType({})
) -> set[str]:
    """Ids of the jobs that have a row, whatever its status.

    Where the run's jobs are `known`, a damaged part is set aside as `_NAME`, not merged. A job to `redo` counts only
    with an attempt above the one that stands there.

    Raises InputError as :func:`result_files`, and if a file has rows of others than the `known` jobs.
    """
    return read_steady([run_folder], lambda: _finished_ids(run_folder, known, redo))


def _finished_ids(run_folder: PathLike, known: frozenset[str] | None, redo: Mapping[str, int]) -> set[str]:
    finished: set[str] = set()
    for path in result_files(run_folder, set_aside=known is not None):
        table = read_table(path, columns=["job_id", "attempt"], schema=SCHEMA)
        ids = table["job_id"].to_pylist()
        if known is not None and not known.issuperset(ids):
            raise ForeignError(f"holds rows of another run, such as of job {min(set(ids) - known)}", path)
        rows = zip(ids, table["attempt"].to_pylist(), strict=True)
        finished.update(job for job, attempt in rows if job not in redo or (attempt or 0) > redo[job])
    return finished


def attempts_with(run_folder: PathLike, statuses: Collection[str]) -> dict[str, int]:
    """Jobs whose newest row has one of some statuses, each with the number of that attempt."""
    names = ["job_id", "status", "attempt"]
    newest = read_steady([run_folder], lambda: newest_rows(result_files(run_folder), names))
    chosen = newest.filter(pc.is_in(newest["status"], pa.array(list(statuses), pa.string()))).drop_null()
    return dict(zip(chosen["job_id"].to_pylist(), chosen["attempt"].to_pylist(), strict=True))


def compact(run_folder: PathLike) -> Path:
    """Merge all parts into `results.parquet`, sorted, one row a job, and remove the parts that went into it.

    The file's metadata carries the schema's units and descriptions, and `run.json` and `campaign.toml` as
    text where the run has them. A reader that meets both the file and its parts sees every job once.

    Raises FileNotFoundError if the run has no readable results.
    """
    run = Path(run_folder)
    files, table = read_steady([run], lambda: (files := result_files(run), newest_rows(files)))
    if not files:
        raise FileNotFoundError(f"{run} holds no results: 'toppling run' writes them")
    table = table.sort_by([(name, "ascending") for name in SORT_ORDER])
    metadata = {}
    for path in (run / "run.json", run / "campaign.toml"):
        if path.exists():
            check(path)
            metadata[path.name.encode()] = path.read_bytes()
    table = table.replace_schema_metadata({**(SCHEMA.metadata or {}), **metadata})
    target = run / RESULTS_FILE
    write_table(table, target, _ROWS_IN_GROUP)
    for path in files:
        if path != target:
            path.unlink(missing_ok=True)
    return target


def result_files(run_folder: PathLike, *, set_aside: bool = False) -> list[Path]:
    """Parquet files of a run's results, verified: the compact one, and the parts not yet merged into it.

    Damaged parts and files that hold no results are named in the log and left out; damaged ones are also renamed to
    `_NAME` where the caller, the run's writer, says so.

    Raises InputError if the compact file is damaged, a file lacks a column of `SCHEMA` or cannot be opened, or a file
    of the run is of another run.
    """
    run = Path(run_folder)
    required = has_digests(run)
    check_files(run)
    files = []
    for path in _listed(run):
        with suppress(FileNotFoundError):  # merged and removed since the folder was listed
            if _is_ours(path, required, set_aside):
                check_rows(run, path)
                files.append(path)
    return files


def has_digests(run: Path) -> bool:
    """Whether all files of a run carry digests, as its `run.json` does; older runs and loose results need not.

    Raises InputError if `run.json` is damaged.
    """
    return (run / "run.json").exists() and check(run / "run.json")


def read_steady(run_folders: Iterable[PathLike], read: Callable[[], _Answer]) -> _Answer:
    """Answer of a reading, which is done again if files of the runs were merged away, cut or damaged meanwhile.

    Such a reading fails, in each library's own way, or lacks the rows of files that were gone before it came to
    them. New files are no reason to read again: their rows may count or not.
    """
    folders = [Path(folder) for folder in run_folders]
    before = _stamps(folders)
    try:
        answer = read()
    except DamagedError:
        pass  # the second reading leaves a damaged part out, or refuses again
    except Exception:
        if before <= _stamps(folders):
            raise
    else:
        if before <= _stamps(folders):
            return answer
    return read()


def newest_rows(files: Sequence[Path], columns: list[str] | None = None) -> pa.Table:
    """Rows of some files under `SCHEMA`, one a job: the highest attempt, and of equal ones the last written."""
    if not files:
        return SCHEMA.empty_table()
    table = pa.concat_tables([read_table(path, columns=columns, schema=SCHEMA) for path in files])
    if pc.count_distinct(table.column("job_id")).as_py() == len(table):
        return table
    ranked = table.select(["job_id", "attempt"]).append_column("row", pa.array(range(len(table)), pa.int64()))
    order = ranked.sort_by([("attempt", "ascending"), ("row", "ascending")])
    # Nulls sort last, so an attempt that was not numbered counts as the newest.
    newest = order.group_by("job_id", use_threads=False).aggregate([("row", "last")])
    return table.take(newest.column("row_last").sort())


def table_of(rows: Sequence[Mapping[str, Any]]) -> pa.Table:
    """Rows under `SCHEMA`.

    Raises ValueError, TypeError if there are none, or a row has a column or a value that the schema does not know, or
    lacks a required one.
    """
    if not rows:
        raise ValueError("no rows to write")
    unknown = set().union(*rows) - set(SCHEMA.names)
    if unknown:
        raise ValueError(f"columns {sorted(unknown)} are not in the schema of results")
    # from_pandas: NaN becomes null
    values = {
        field: pa.array([row.get(field.name) for row in rows], field.type, from_pandas=True)
        for field in SCHEMA
    }
    lacking = [field.name for field, array in values.items() if array.null_count and not field.nullable]
    if lacking:
        raise ValueError(f"a row lacks the required columns {lacking}")
    return pa.Table.from_arrays(list(values.values()), schema=SCHEMA)


def _listed(run: Path) -> list[Path]:
    found = [run / RESULTS_FILE, *sorted((run / PARTS_FOLDER).glob("*"))]
    return [path for path in found if not path.name.startswith(("_", "."))]


def _stamps(runs: Iterable[Path]) -> set[tuple[Path, int, int]]:
    """Tell the files of some runs apart from those of any other moment, whatever their names."""
    stamps = set()
    for run in runs:
        for path in _listed(run):
            with suppress(FileNotFoundError):
                state = path.stat()
                stamps.add((path, state.st_ino, state.st_mtime_ns))
    return stamps


def _is_ours(path: Path, required: bool, set_aside: bool) -> bool:
    try:
        check(path, required=required)
        check_bounds(path)
        schema = pq.read_schema(path)
    except FileNotFoundError:
        raise
    except (InputError, pa.ArrowException, OSError) as error:
        if isinstance(error, OSError) and error.errno is not None:
            raise unopened(path, error) from error
        if path.name == RESULTS_FILE:
            raise error if isinstance(error, InputError) else damaged(path, error) from error
        reason = error.what if isinstance(error, InputError) else str(error).splitlines()[0]
        if set_aside and _PART_NAME.fullmatch(path.name):
            aside = path.rename(path.with_name(f"_{path.name}"))
            _log.warning("%s is torn or changed (%s): set aside as %s", path, reason, aside.name)
        else:
            _log.warning("%s is torn, or no Parquet file of a run: skipped (%s)", path, reason)
        return False
    wrong = [field.name for field in SCHEMA if not _is_as_declared(schema, field)]
    if not wrong:
        return True
    # A file that says it holds results would, where a column is not as declared, answer with nulls.
    if b"schema_version" in (schema.metadata or {}):
        raise InputError(
            "run.columns_other",
            f"the columns {', '.join(wrong)} are missing or of another type",
            where=str(path),
            expected=f"results of schema version {SCHEMA_VERSION}",
            remedy="read the run with the program that wrote it (versions in run.json), or start it again",
        )
    _log.warning("%s holds no results of a run (column %s), skipped", path, wrong[0])
    return False


def _is_as_declared(schema: pa.Schema, field: pa.Field) -> bool:
    """Whether a file has a column, or may lack it."""
    place = schema.get_field_index(field.name)
    return field.name in ADDED_LATER if place < 0 else schema.field(place).type == field.type
