"""Whether the files of a run's folder are that run's: whole files of another run are refused by name, not believed.

`run.json` states the digest of every file that the run was begun with, the ids of scene and ensemble, and the plan's.
Rows are compared with the jobs of the plan. Runs of earlier versions, which state no digests, are compared by ids.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from toppling.models.errors import InputError
from toppling.models.files.digest import check, read_json, stamp, stated, unopened
from toppling.models.files.run_document import check_run_document
from toppling.models.files.scene_document import BASES, read_scene_document
from toppling.models.files.tables import read_table, write_table
from toppling.models.motions.catalogue import CATALOG, MOTIONS, ensemble_id

CAMPAIGN_FILE, _JOBS_FILE, _RUN_FILE = "campaign.toml", "jobs.parquet", "run.json"
SITES_FILE, SCENES = "sites.csv", "scenes"
"""Table of the rocks of an atlas, and the folder with one for each of them."""
SCENE_FILES = ("scene.json", "rock.ply", "pedestal.ply", BASES)
ENSEMBLE_FILES = (CATALOG, MOTIONS)
_RECORDED_ENSEMBLES = ("stood/as_recorded/ensemble", "stood/from_all_sides/ensemble")
"""Of motions that the rock is known to have stood."""

_WRITTEN_ONCE = (
    CAMPAIGN_FILE,
    _JOBS_FILE,
    SITES_FILE,
    *(f"scene/{name}" for name in SCENE_FILES),
    *(f"{place}/{name}" for place in ("ensemble", *_RECORDED_ENSEMBLES) for name in ENSEMBLE_FILES),
)

NEEDED = tuple(
    name for name in _WRITTEN_ONCE if not name.endswith((BASES, SITES_FILE)) and not name.startswith("stood/")
)
"""What every run of one rock is begun with."""

_CHECKED: dict[str, tuple[object, ...]] = {}
"""What was compared already, by what it is, with the state of the files then."""


class ForeignError(InputError):
    """A whole file of another run."""

    def __init__(self, what: str, where: Path) -> None:
        super().__init__(
            "run.file_foreign",
            what,
            where=str(where),
            expected="files of one run, as 'toppling run' wrote them into its folder",
            remedy="put the run's own file back from where the folder was copied, or take the foreign one out",
        )


def written_once(run: Path) -> list[str]:
    """Files that are there of those that a run may be begun with."""
    own = [*(f"scene/{name}" for name in SCENE_FILES), *(f"ensemble/{name}" for name in ENSEMBLE_FILES)]
    rocks = sorted(path.name for path in (run / SCENES).glob("*"))
    names = (*_WRITTEN_ONCE, *(f"{SCENES}/{rock}/{name}" for rock in rocks for name in own))
    return [name for name in names if (run / name).exists()]


def digests_of(run: Path) -> dict[str, str | None]:
    """Digest of each file of a run that was written at its beginning and is there; None for one without a digest."""
    return {name: _opened(run / name, stated) for name in written_once(run)}


def check_files(run: Path) -> None:
    """Compare the files of a run that were written once with what its `run.json` says of them.

    Missing files are no matter of this check, and neither is a folder without a `run.json`.

    Raises InputError if one is of another run, by its name, or damaged.
    """
    if not (run / _RUN_FILE).exists():
        return
    there = [run / name for name in (_RUN_FILE, *written_once(run))]
    _once(f"files {run.absolute()}", there, lambda: _compare(run))


def check_rows(run: Path, path: Path) -> None:
    """Compare the rows of a file of results with the jobs of the run.

    run: folder with the plan (`jobs.parquet`); without one there is nothing to compare with but the scene.
    path: verified Parquet file with columns of the schema of results.
    Raises InputError if it holds rows of other jobs.
    """
    known = [one for one in (run / _RUN_FILE, run / _JOBS_FILE) if one.exists()]
    if known:
        _once(f"rows {path.absolute()}", [path, *known], lambda: _compare_rows(run, path))


def check_plan_id(run: Path, path: Path, plan_id: object) -> None:
    """Compare the id of the plan that a file states with that of the run whose folder it lies in.

    Raises InputError if it is another.
    """
    expected = _document(run).get("plan_id") if (run / _RUN_FILE).exists() else None
    if plan_id is not None and expected is not None and plan_id != expected:
        raise ForeignError(f"is of another run (plan {plan_id}, {run / _RUN_FILE} says {expected})", path)


def _once(key: str, files: list[Path], compare: Callable[[], None]) -> None:
    """Compare, unless that was done with the same state of the files."""
    stamps = tuple((str(path), stamp(path.stat())) for path in files)
    if _CHECKED.get(key) != stamps:
        compare()
        _CHECKED[key] = stamps


def _document(run: Path) -> dict[str, Any]:
    path = run / _RUN_FILE
    return check_run_document(_opened(path, read_json), path, whole_document=False)


def _opened(path: Path, read: Callable[[Path], Any]) -> Any:
    try:
        return read(path)
    except OSError as error:
        raise unopened(path, error) from error


def _compare(run: Path) -> None:
    document = _document(run)
    recorded = document.get("files") or {}
    here = digests_of(run)
    for name in recorded.keys() & here.keys():
        if here[name] != recorded[name]:
            check(run / name, required=recorded[name] is not None)  # a damaged one is no foreign one
    other = [name for name in here if name in recorded and here[name] != recorded[name]]
    other += [name for name in here if recorded and name not in recorded]
    if other:
        names, several = ", ".join(other), len(other) > 1
        what = "are not those" if several else "is not the one"
        culprit = f"{_RUN_FILE} or they are" if several else "it is"
        place = run if several else run / other[0]
        raise ForeignError(f"{names} {what} that the run was begun with: {culprit} of another run", place)
    for name, key, found in _ids(run, document, recorded):
        if found != document[key]:
            raise ForeignError(
                f"is of another run ({key} {found}, {_RUN_FILE} says {document[key]})", run / name
            )


def _ids(
    run: Path, document: Mapping[str, Any], recorded: Mapping[str, Any]
) -> list[tuple[str, str, object]]:
    """What files without a recorded digest say of themselves: name, key of `run.json`, value."""
    readers: tuple[tuple[str, str, Callable[[Path], object]], ...] = (
        ("scene/scene.json", "scene_id", lambda path: read_scene_document(path)["id"]),
        (f"ensemble/{CATALOG}", "ensemble_id", _ensemble_id),
        (_JOBS_FILE, "jobs", lambda path: pq.read_metadata(path).num_rows if check(path) else None),
    )
    return [
        (name, key, read(run / name))
        for name, key, read in readers
        if not recorded.get(name) and key in document and (run / name).exists()
    ]


def _ensemble_id(path: Path) -> str:
    catalog = read_table(path, columns=["record_id", "sha"])
    return ensemble_id(zip(*(catalog[name].to_pylist() for name in ("record_id", "sha")), strict=True))


def _compare_rows(run: Path, path: Path) -> None:
    rows = read_table(path, columns=["job_id", "scene_id"])
    if (run / _JOBS_FILE).exists():
        jobs = read_table(run / _JOBS_FILE, columns=["job_id"])["job_id"]
        known = pc.is_in(rows["job_id"], value_set=jobs.combine_chunks())
        foreign = len(rows) - (pc.sum(known).as_py() or 0)
        if foreign:
            raise ForeignError(
                f"holds rows of another run ({foreign} of {len(rows)} are of no job in {_JOBS_FILE})", path
            )
    document = _document(run) if (run / _RUN_FILE).exists() else {}
    if (scene_id := document.get("scene_id")) is not None:
        known_ids = {one["scene_id"] for one in document.get("scenes") or [document]}
        if other := [one for one in pc.unique(rows["scene_id"]).to_pylist() if one not in known_ids]:
            raise ForeignError(f"holds rows of another scene ({other[0]}, the run's is {scene_id})", path)


AUDIT_FOLDER = "audit"
"""In a run's folder; each engine that did jobs again has a folder of its own there, laid out as a run's results."""

DRAWN_FILE = "drawn.json"
"""In each of these: from which jobs the sample was drawn."""

REFERENCE = "reference"
"""Name of the audit by the same engine's finest preset."""

_PLAN_ID = b"plan_id"
"""Key of the metadata of an audit's `jobs.parquet`."""

LEAST_JOBS = 40
"""Of fewer no statement is made: even without a single answer that differs a tenth of them may."""


def check_audit(run: Path, folder: Path) -> None:
    """Make sure that an audit's folder is of the run in whose folder it lies.

    Raises InputError if one of its files is of another run, or damaged.
    """
    drawn, jobs = folder / DRAWN_FILE, folder / _JOBS_FILE
    if drawn.exists():
        check_plan_id(run, drawn, read_json(drawn).get("plan_id"))
    if jobs.exists() and check(jobs):
        metadata = pq.read_schema(jobs).metadata or {}
        check_plan_id(run, jobs, metadata[_PLAN_ID].decode() if _PLAN_ID in metadata else None)


def check_audits(run: Path) -> None:
    """Make sure that all audits in a run's folder are of this run, as :func:`check_audit` does."""
    for folder in sorted((run / AUDIT_FOLDER).glob("*")):
        if folder.is_dir():
            check_audit(run, folder)


def write_jobs(folder: Path, jobs: pa.Table, plan_id: str) -> None:
    """Write which jobs an audit may hold rows of: those that are given, and those that were there before."""
    path = folder / _JOBS_FILE
    if path.exists():
        before = read_table(path, schema=jobs.schema)
        fresh = pc.is_in(before["job_id"], value_set=jobs["job_id"].combine_chunks())
        jobs = pa.concat_tables([jobs, before.filter(pc.invert(fresh))], promote_options="permissive")
    write_table(jobs.replace_schema_metadata({_PLAN_ID: plan_id}), path)
