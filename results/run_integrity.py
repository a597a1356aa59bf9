"""Integrity of a run's folder: intact files that belong to another run are refused by name.

`run.json` records the digest of every initial file of the run, and the ids of scene, ensemble and plan. Rows are
compared with the jobs of the plan.
"""

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from toppling.models.errors import InputError
from toppling.models.files.digest import check, read_json, read_table, stamp, stated, unopened, write_table
from toppling.models.files.folder import instead
from toppling.models.files.schemas import BASES, check_run_document
from toppling.models.motions.measures import CATALOG, MOTIONS

CAMPAIGN_FILE, _JOBS_FILE, _RUN_FILE = "campaign.toml", "jobs.parquet", "run.json"
SITES_FILE, SCENES = "sites.csv", "scenes"
"""Table of the rocks of an atlas, and the parent folder of their scenes."""
SCENE_FILES = ("scene.json", "rock.ply", "pedestal.ply", BASES)
ENSEMBLE_FILES = (CATALOG, MOTIONS)
_RECORDED_ENSEMBLES = ("stood/as_recorded/ensemble", "stood/from_all_sides/ensemble")
"""Ensembles of motions that the rock is known to have survived."""

_WRITTEN_ONCE = (
    CAMPAIGN_FILE,
    _JOBS_FILE,
    SITES_FILE,
    *(f"scene/{name}" for name in SCENE_FILES),
    *(f"{place}/{name}" for place in ("ensemble", *_RECORDED_ENSEMBLES) for name in ENSEMBLE_FILES),
)

SCHEMA_VERSION = 1
"""Version of the layout of `run.json`."""

_CHECKED: dict[Path, tuple[object, ...]] = {}
"""Finished comparisons, with the state of the files at that time."""


class ForeignError(InputError):
    """An intact file belongs to another run."""

    def __init__(self, what: str, where: Path) -> None:
        super().__init__(
            "run.file_foreign",
            what,
            where=str(where),
            expected="files of one run, as 'toppling run' wrote them into its folder",
            remedy="put the run's own file back from where the folder was copied, or take the foreign one out",
        )


def written_once(run: Path) -> list[str]:
    """Existing initial files of a run, which are written once."""
    own = [*(f"scene/{name}" for name in SCENE_FILES), *(f"ensemble/{name}" for name in ENSEMBLE_FILES)]
    rocks = sorted(path.name for path in (run / SCENES).glob("*"))
    names = (*_WRITTEN_ONCE, *(f"{SCENES}/{rock}/{name}" for rock in rocks for name in own))
    return [name for name in names if (run / name).exists()]


def digests_of(run: Path) -> dict[str, str | None]:
    """Digest of each existing initial file of a run; None where it carries none any more."""
    return {name: _opened(run / name, stated) for name in written_once(run)}


def check_files(run: Path) -> None:
    """Compare the initial files of a run with their digests and ids in its `run.json`.

    Missing files are not checked, nor is the folder of an audit, which has no `run.json`.

    Raises InputError if a file is damaged or belongs to another run.
    """
    if not (run / _RUN_FILE).exists():
        return
    stamps = _stamps([run / name for name in (_RUN_FILE, *written_once(run))])
    if _CHECKED.get(run.absolute()) != stamps:
        _compare(run)
        _CHECKED[run.absolute()] = stamps


def check_rows(run: Path, paths: Iterable[Path]) -> None:
    """Compare the rows of files of results with the jobs of the run, where that was not done for their present state.

    run: folder with the plan (`jobs.parquet`); without a plan only the scene is compared.
    paths: verified Parquet files with columns of the schema of results.
    Raises InputError if one contains rows of other jobs.
    """
    if known := [path for path in (run / _RUN_FILE, run / _JOBS_FILE) if path.exists()]:
        stamps = {path.absolute(): _stamps([path, *known]) for path in paths}
        new = {path: stamp for path, stamp in stamps.items() if _CHECKED.get(path) != stamp}
        if new:
            _compare_rows(run, [*new])
            _CHECKED.update(new)


def check_plan_id(run: Path, path: Path, plan_id: object) -> None:
    """Raise InputError if a file's plan id differs from that of the run in whose folder it lies."""
    if plan_id != (expected := run_document(run)["plan_id"]):
        raise ForeignError(f"is of another run (plan {plan_id}, {run / _RUN_FILE} says {expected})", path)


def _stamps(files: Iterable[Path]) -> tuple[object, ...]:
    return tuple((str(path), stamp(path.stat())) for path in files)


def run_document(run: Path) -> dict[str, Any]:
    """Content of a run's `run.json`.

    Raises InputError if the folder is not a run, or the file is damaged, incomplete or of another version.
    """
    path = run / _RUN_FILE
    try:
        content = read_json(path)
    except (FileNotFoundError, NotADirectoryError):
        raise InputError(
            "run.absent",
            f"is not a run, there is no {_RUN_FILE}{instead(run)}" if run.exists() else "does not exist",
            where=str(run),
            expected=f"the folder of a run, with {_RUN_FILE}",
            remedy="give the folder that was named with --out, or make one: 'toppling run CAMPAIGN --out FOLDER'",
        ) from None
    except OSError as error:
        raise unopened(path, error) from None
    if content.get("schema_version") != SCHEMA_VERSION:
        raise InputError(
            "document.schema_version",
            f"{_RUN_FILE} is of another layout",
            where=str(run),
            expected=f"schema version {SCHEMA_VERSION}",
            remedy="start a new run with another --out",
        )
    return check_run_document(content, path)


def _opened(path: Path, read: Callable[[Path], Any]) -> Any:
    try:
        return read(path)
    except OSError as error:
        raise unopened(path, error) from error


def _compare(run: Path) -> None:
    recorded, here = run_document(run)["files"], digests_of(run)
    other = [name for name in here if here[name] != recorded.get(name)]
    for name in other:
        check(run / name)  # distinguishes damaged from foreign files
    if other:
        names, several = ", ".join(other), len(other) > 1
        what = "are not those" if several else "is not the one"
        culprit = f"{_RUN_FILE} or they are" if several else "it is"
        place = run if several else run / other[0]
        raise ForeignError(f"{names} {what} that the run was begun with: {culprit} of another run", place)


def _compare_rows(run: Path, paths: Sequence[Path]) -> None:
    tables = [read_table(path, columns=["job_id", "scene_id"]) for path in paths]
    of_audit = not (run / _RUN_FILE).exists()
    document = {} if of_audit else run_document(run)
    known_ids = {scene["scene_id"] for scene in document.get("scenes") or [document] if not of_audit}
    ids = jobs = pa.concat_tables(tables)["job_id"]
    if (run / _JOBS_FILE).exists():
        jobs = read_table(run / _JOBS_FILE, columns=["job_id"])["job_id"]
    planned = pc.is_in(
        ids, value_set=jobs.combine_chunks()
    )  # of all at once: all jobs of the plan are hashed for it
    for path, rows in zip(paths, tables, strict=True):
        foreign = len(rows) - (pc.sum(planned[: len(rows)]).as_py() or 0)
        planned = planned[len(rows) :]
        if foreign:
            raise ForeignError(
                f"holds rows of another run ({foreign} of {len(rows)} are of no job in {_JOBS_FILE})", path
            )
        other = [name for name in pc.unique(rows["scene_id"]).to_pylist() if name not in known_ids]
        if other and not of_audit:
            own = document["scene_id"]
            raise ForeignError(f"holds rows of another scene ({other[0]}, the run's is {own})", path)


AUDIT_FOLDER = "audit"
"""Subfolder of a run with a folder per auditing engine, each laid out as a run's results."""

DRAWN_FILE = "drawn.json"
"""File of an audit's folder that states which jobs the sample was drawn from."""

REFERENCE = "reference"
"""Name of the audit by the same engine's finest preset."""

_PLAN_ID = b"plan_id"
"""Key of the plan's id in the metadata of an audit's `jobs.parquet`."""

LEAST_JOBS = 40
"""Minimum number of audited jobs: of fewer, a tenth of all answers may differ although none in the sample does."""


def check_audit(run: Path, folder: Path) -> None:
    """Raise InputError if a file of an audit's folder is damaged or belongs to another run."""
    drawn, jobs = folder / DRAWN_FILE, folder / _JOBS_FILE
    if drawn.exists():
        check_plan_id(run, drawn, read_json(drawn).get("plan_id"))
    if jobs.exists():
        check(jobs)
        check_plan_id(run, jobs, (pq.read_schema(jobs).metadata or {}).get(_PLAN_ID, b"").decode())


def check_audits(run: Path) -> None:
    """Apply :func:`check_audit` to all audits of a run."""
    for folder in sorted((run / AUDIT_FOLDER).glob("*")):
        if folder.is_dir():
            check_audit(run, folder)


def write_jobs(folder: Path, jobs: pa.Table, plan_id: str) -> None:
    """Add jobs to the list of those that an audit may contain rows of."""
    path = folder / _JOBS_FILE
    if path.exists():
        before = read_table(path, schema=jobs.schema)
        fresh = pc.is_in(before["job_id"], value_set=jobs["job_id"].combine_chunks())
        jobs = pa.concat_tables([jobs, before.filter(pc.invert(fresh))], promote_options="permissive")
    write_table(jobs.replace_schema_metadata({_PLAN_ID: plan_id}), path)
