"""Where the audits of a run lie, and whether they are its own: read without statistics, as by the status of a run."""

from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from toppling.models.files.digest import check, read_json
from toppling.models.files.folder import new_file
from toppling.models.files.tables import read_table, write_table
from toppling.results.run_integrity import JOBS_FILE, check_plan_id

AUDIT_FOLDER = "audit"
"""In a run's folder; each engine that did jobs again has a folder of its own there, laid out as a run's results."""

DRAWN_FILE = "drawn.json"
"""In each of these: from which jobs the sample was drawn."""

REFERENCE = "reference"
"""Name of the audit by the same engine's finest preset."""

_PLAN_ID = b"plan_id"
"""Key of the metadata of an audit's `jobs.parquet`."""

LEAST_JOBS = 10
"""Of fewer no statement is made."""

LEAST_TELLING = 40
"""Of fewer jobs none on a shift: even without a single answer that differs a tenth of them may."""


def check_place(run: Path, folder: Path) -> None:
    """Make sure that an audit's folder is of the run in whose folder it lies.

    Raises
    ------
    InputError
        If one of its files is of another run, or damaged.
    """
    drawn, jobs = folder / DRAWN_FILE, folder / JOBS_FILE
    if drawn.exists():
        check_plan_id(run, drawn, read_json(drawn).get("plan_id"))
    if jobs.exists() and check(jobs):
        stated = pq.read_schema(jobs).metadata or {}
        check_plan_id(run, jobs, stated[_PLAN_ID].decode() if _PLAN_ID in stated else None)


def check_audits(run: Path) -> None:
    """Make sure that all audits in a run's folder are of this run, as :func:`check_place` does."""
    for folder in sorted((run / AUDIT_FOLDER).glob("*")):
        if folder.is_dir():
            check_place(run, folder)


def write_jobs(folder: Path, jobs: pa.Table, plan_id: str) -> None:
    """Write which jobs an audit may hold rows of: those that are given, and those that were there before."""
    path = folder / JOBS_FILE
    if path.exists():
        before = read_table(path, schema=jobs.schema)
        fresh = pc.is_in(before["job_id"], value_set=jobs["job_id"].combine_chunks())
        jobs = pa.concat_tables([jobs, before.filter(pc.invert(fresh))], promote_options="permissive")
    with new_file(path) as hidden:
        write_table(jobs.replace_schema_metadata({_PLAN_ID: plan_id}), hidden)
