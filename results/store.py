"""Store of result rows: part files while a run is in progress, one compact sorted file when it is finished.

One writer (the client of the cluster), any number of readers. Files are written atomically and verified by their
digest when read. A part that is damaged, or is no part of a run, is logged and skipped: its jobs are repeated. One that
cannot be opened, or contains rows of another run (`results.run_integrity`), is refused. Where a job has several rows,
its newest attempt counts.
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
from toppling.models.files.digest import (
    DamagedError,
    check,
    check_bounds,
    damaged,
    read_table,
    unopened,
    write_table,
)
from toppling.results.run_integrity import ForeignError, check_files, check_rows
from toppling.results.schema import SCHEMA, SCHEMA_VERSION, SORT_ORDER

_log = logging.getLogger(__name__)

RESULTS_FILE = "results.parquet"
PARTS_FOLDER = "parts"
_PART_NAME = re.compile(r"part-[0-9]{20}-[0-9a-f]{8}\.parquet")
_ROWS_IN_GROUP = 20_000
"""Number of rows per Parquet row group, small enough that a query of one record skips most of a large run."""

PathLike = str | os.PathLike[str]
_Answer = TypeVar("_Answer")


def write_part(run_folder: PathLike, rows: pa.Table | Iterable[Mapping[str, Any]]) -> Path:
    """Append rows to a run as one new part file.

    rows: a table with `SCHEMA`, or mappings of column name to value; nullable columns may be left out, and NaN becomes
    null.
    Returns Path: the part file, which is on disk.
    Raises ValueError if there are no rows, or a row has an unknown column or lacks a required one.
    Raises FileNotFoundError if the folder does not exist: a folder deleted during a run is not created again, because
    its earlier rows are lost.
    """
    table = rows if isinstance(rows, pa.Table) else table_of(list(rows))
    folder = Path(run_folder) / PARTS_FOLDER
    folder.mkdir(exist_ok=True)
    # Names sort by time of writing; a random suffix prevents two concurrent writers from overwriting each other.
    target = folder / f"part-{time.time_ns():020d}-{uuid.uuid4().hex[:8]}.parquet"
    write_table(table, target, _ROWS_IN_GROUP)
    return target


def finished_ids(
    run_folder: PathLike, known: frozenset[str] | None = None, redo: Mapping[str, int] = MappingProxyType({})
) -> set[str]:
    """Ids of the jobs that have a row of any status.

    With `known` jobs, damaged parts are renamed to `_NAME`. A job in `redo` is finished only by an attempt above the
    given number.

    Raises InputError as :func:`result_files`, and if a file has rows of jobs that are not in `known`.
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
    """Attempt numbers, by job id, of the jobs whose newest row has one of the statuses."""
    names = ["job_id", "status", "attempt"]
    newest = read_steady([run_folder], lambda: newest_rows(result_files(run_folder), names))
    chosen = newest.filter(pc.is_in(newest["status"], pa.array(list(statuses), pa.string()))).drop_null()
    return dict(zip(chosen["job_id"].to_pylist(), chosen["attempt"].to_pylist(), strict=True))


def compact(run_folder: PathLike) -> Path:
    """Merge all parts into `results.parquet`, sorted, one row per job, and remove the merged parts.

    The file's metadata contains the schema's units and descriptions, and the text of `run.json` and `campaign.toml`
    where the run has them. A reader that finds both the file and its parts still sees every job once.

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
    """Verified Parquet files of a run's results: the compact file, and parts not yet merged.

    Damaged parts and files without results are logged and left out; damaged ones are also renamed to `_NAME` with
    `set_aside`, which only the run's writer may request.

    Raises InputError if the compact file is damaged, a file lacks a column of `SCHEMA` or cannot be opened, or a file
    belongs to another run.
    """
    run = Path(run_folder)
    check_files(run)
    files = []
    for path in _listed(run):
        with suppress(FileNotFoundError):  # merged and removed after the folder was listed
            if _is_ours(path, set_aside):
                files.append(path)
    check_rows(run, files)
    return files


def read_steady(run_folders: Iterable[PathLike], read: Callable[[], _Answer]) -> _Answer:
    """Call `read`, and again if files of the runs were removed or changed meanwhile.

    Such a reading fails with an exception of any library, or lacks rows of removed files. New files do not cause
    another reading: their rows may be included or not.
    """
    folders = [Path(folder) for folder in run_folders]
    before = _stamps(folders)
    try:
        answer = read()
    except DamagedError:
        pass  # the second reading skips a damaged part, or raises again
    except Exception:
        if before <= _stamps(folders):
            raise
    else:
        if before <= _stamps(folders):
            return answer
    return read()


def newest_rows(files: Sequence[Path], columns: list[str] | None = None) -> pa.Table:
    """Rows of some files with `SCHEMA`, one per job: the highest attempt, and among equal ones the last written."""
    if not files:
        return SCHEMA.empty_table()
    table = pa.concat_tables([read_table(path, columns=columns, schema=SCHEMA) for path in files])
    if pc.count_distinct(table.column("job_id")).as_py() == len(table):
        return table
    ranked = table.select(["job_id", "attempt"]).append_column("row", pa.array(range(len(table)), pa.int64()))
    order = ranked.sort_by([("attempt", "ascending"), ("row", "ascending")])
    # Nulls sort last: an attempt without a number counts as the newest.
    newest = order.group_by("job_id", use_threads=False).aggregate([("row", "last")])
    return table.take(newest.column("row_last").sort())


def table_of(rows: Sequence[Mapping[str, Any]]) -> pa.Table:
    """Table of rows with `SCHEMA`.

    Raises ValueError or TypeError if there are no rows, or a row has an unknown column, an invalid value, or lacks a
    required column.
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
    """Path, size and modification time of the runs' files, to detect changes."""
    stamps = set()
    for run in runs:
        for path in _listed(run):
            with suppress(FileNotFoundError):
                state = path.stat()
                stamps.add((path, state.st_ino, state.st_mtime_ns))
    return stamps


def _is_ours(path: Path, set_aside: bool) -> bool:
    try:
        check(path)
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
    # A file with results of another schema would silently be read as nulls.
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
    """Whether a file has a column of the declared type."""
    place = schema.get_field_index(field.name)
    return place >= 0 and schema.field(place).type == field.type
