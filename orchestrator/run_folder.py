"""Folder of a run: everything needed to repeat it, created atomically, with one writer at a time."""

import contextlib
import fcntl
import os
import shutil
import socket
import time
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from contextvars import ContextVar
from datetime import UTC, datetime
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from toppling.models.errors import InputError
from toppling.models.files import digest
from toppling.models.files.digest import write_table
from toppling.models.files.documents import read_toml, shown
from toppling.models.files.folder import new_folder, rock_name
from toppling.models.files.stores import writer_of
from toppling.orchestrator.journal import LOG_FILE
from toppling.results import run_integrity
from toppling.results.store import PARTS_FOLDER, RESULTS_FILE, write_part
from toppling.results.weights import WEIGHTS_FILE

if TYPE_CHECKING:
    from toppling.orchestrator.plan import Plan

_ASKED = ("audit", "precision", "target")
"""Keys of a campaign that affect the number of jobs done but not the jobs: a run may be resumed with other values."""

KEY_FOLDERS = ".toppling-key-"
"""Prefix of the folders in which batch jobs find the session's key; a killed session leaves them."""

_RUNNING, _INTERRUPTED = "running", "interrupted"
"""State of a session in `run.json` during it, and after an interruption."""

_CLAIMED: ContextVar[frozenset[Path]] = ContextVar("claimed", default=frozenset())
"""Folders that this thread's calls have locked: a second lock of the same process would wait for the first."""

_LOCK_PATIENCE_S = 1.0
"""Time to wait for the lock, s: a writer holds it for its whole session, a reader only briefly."""


def prepare(run: Path, plan: "Plan", versions: dict[str, str]) -> None:
    """Create the folder of a run, or check that an existing one belongs to this plan.

    Rows of jobs on rocks that do not stand are written immediately.

    Raises InputError if the folder is of another campaign, of other versions, or not a run.
    """
    if not (run.exists() or run.is_symlink()):
        with contextlib.suppress(FileExistsError):  # another session was first, and holds the lock
            begin(run, plan, versions)
            return
    _check(run, plan, versions)


def begin(run: Path, plan: "Plan", versions: dict[str, str]) -> None:
    """Create the folder of a run."""
    from toppling.orchestrator.recorded import FOLDER, ensembles_in
    from toppling.orchestrator.rocks_of_run import (
        rows_without_stand,
        scene_entries,
        settlings_of,
        site_in_run,
    )
    from toppling.orchestrator.site_table import sites_text
    from toppling.workers.engines import ENGINES

    settlings = settlings_of(plan)
    entries, sites, without_stand = scene_entries(plan, settlings), "", []
    if plan.campaign.sites:
        sites = sites_text(map(site_in_run, plan.scenes))
        without_stand = list(rows_without_stand(plan, settlings))
    with new_folder(run) as staging:
        (staging / PARTS_FOLDER).mkdir()
        for scene in plan.scenes:
            _copy_known(scene.campaign.scene, staging / scene.scene_place, run_integrity.SCENE_FILES)
        for path, source in {scene.ensemble_place: scene.campaign.ensemble for scene in plan.scenes}.items():
            _copy_known(source, staging / path, run_integrity.ENSEMBLE_FILES)
        stood = []
        if plan.recorded:
            plan.recorded.write(staging / FOLDER)
            stood = [str(path.relative_to(staging)) for path in ensembles_in(staging / FOLDER)]
        target, hazard = plan.campaign.target, ""
        if target is not None and target.hazard is not None:
            hazard = f"hazard{target.hazard.suffix}"
            shutil.copyfile(target.hazard, staging / hazard)
        written = plan.campaign.to_toml(stood=stood, hazard=hazard)
        digest.write_sealed(written, staging / "campaign.toml")
        if sites:
            digest.write_sealed(sites, staging / run_integrity.SITES_FILE)
        write_table(plan.jobs, staging / "jobs.parquet")
        if without_stand:
            write_part(staging, without_stand)
        described = {
            "schema_version": run_integrity.SCHEMA_VERSION,
            "plan_id": plan.id,
            "jobs": len(plan),
            "rock": rock_name(plan.campaign.scene),
            "scene_id": plan.scene_id,
            "ensemble_id": plan.ensemble_id,
            "files": run_integrity.digests_of(staging),
            "versions": versions,
            "engine": ENGINES[plan.campaign.engine].citation,
            **entries,
            "created_at": _now(),
            "sessions": [],
        }
        digest.write_json(staging / "run.json", described)


def remarks(run: Path) -> list[tuple[str, dict[str, Any]]]:
    """Remarks on a run's rocks before its jobs: sentences with the entries that they are based on."""
    content = run_integrity.run_document(run)
    found = [(f"{rock['rock']} is left out: {rock['why']}", rock) for rock in content.get("left_out") or ()]
    for scene in content.get("scenes") or [{"settling": content["settling"]}]:
        name = f"{scene['rock']}: " if "rock" in scene else ""
        if scene.get("problem"):
            found.append((f"{name}{scene['problem']}", {"rock": scene["rock"]}))
        settles = dict(scene["settling"] or {})
        if sentence := settles.pop("sentence", None):
            found.append((f"{name}{sentence}", settles))
    return found


@contextlib.contextmanager
def claimed(run: Path) -> Iterator[None]:
    """Lock a run's folder for writing, unless there is none yet, or the caller has locked it.

    Raises InputError if another process writes to the run, or its file system does not support locks.
    """
    if run in _CLAIMED.get() or not (run / "run.json").is_file():
        yield
        return
    _refuse_links(run, [run / ".lock"])
    with (run / ".lock").open("a+") as lock:
        try:
            _take(lock)
        except BlockingIOError:
            lock.seek(0)
            raise _error(
                "run.locked",
                run,
                f"another process writes to this run ({lock.read().strip() or 'unknown'})",
                expected="one 'toppling run' for a folder at a time",
                remedy="wait for it, or stop it first",
            ) from None
        except OSError as error:
            raise _error(
                "run.not_lockable",
                run,
                f"files cannot be locked on this file system ({error.strerror})",
                expected="a file system with flock, so that one 'toppling run' at a time writes to a folder",
                remedy="give --out on another one, or have it mounted with locks (Lustre: -o flock)",
            ) from None
        lock.truncate(0)
        lock.write(f"{socket.gethostname()}:{os.getpid()}\n")
        lock.flush()
        before = _CLAIMED.set(_CLAIMED.get() | {run})
        try:
            yield
        finally:
            _CLAIMED.reset(before)


@contextlib.contextmanager
def session(run: Path) -> Iterator[dict[str, Any]]:
    """Lock the folder as `claimed`; the session's notes, to which the block may add, are written to `run.json`."""
    with claimed(run):
        _sweep(run)
        notes = {"started_at": _now(), "host": socket.gethostname(), "ended": _RUNNING}
        note(run, notes, new=True)
        try:
            yield notes
        finally:
            if notes["ended"] == _RUNNING:
                notes["ended"] = _INTERRUPTED
            note(run, notes)


def note(run: Path, notes: dict[str, Any], *, new: bool = False) -> None:
    """Write a session's notes to `run.json`, with the current time unless they are new."""
    if not new:
        notes["ended_at"] = _now()
    content = run_integrity.run_document(run)
    sessions = [ended(session) for session in content["sessions"]] if new else content["sessions"][:-1]
    content["sessions"] = [*sessions, notes]
    digest.write_json(run / "run.json", content)


def set_jobs(run: Path, jobs: int) -> None:
    """Write the planned number of jobs, if it has changed."""
    content = run_integrity.run_document(run)
    if content["jobs"] != jobs:
        digest.write_json(run / "run.json", content | {"jobs": jobs})


def ended(notes: dict[str, Any]) -> dict[str, Any]:
    """Notes of a past session, which is marked as interrupted if it did not end by itself."""
    return notes | {"ended": _INTERRUPTED} if notes.get("ended") == _RUNNING else notes


def place_in(run: Path, name: str) -> Path:
    """Path in a run's folder for a command's output; InputError if it contains links: a run may be untrusted."""
    path = run / name
    above = [folder for folder in path.parents if run in folder.parents]
    _refuse_links(run, [path, *above, *path.rglob("*"), *run.glob(".*")])
    return path


def is_running(run: Path) -> bool:
    """Whether a process is writing to the run, or has claimed it in an object store."""
    try:
        with (run / ".lock").open() as lock:
            fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        pass
    return bool(writer_of(run))


def _now() -> str:
    """Current UTC time to the second."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def _take(lock: IO[str]) -> None:
    """Lock for writing; waits for readers that hold the lock briefly to test whether the run is in progress."""
    end = time.monotonic() + _LOCK_PATIENCE_S
    while True:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            if time.monotonic() > end:
                raise
            time.sleep(0.01)
        else:
            return


def _sweep(run: Path) -> None:
    """Remove incomplete files of a killed writer; requires the lock."""
    for left in (*run.glob(".*.tmp"), *(run / PARTS_FOLDER).glob(".*.tmp")):
        left.unlink(missing_ok=True)
    for left in run.glob(f"{KEY_FOLDERS}*"):
        shutil.rmtree(left, ignore_errors=True)


def _check(run: Path, plan: "Plan", versions: dict[str, str]) -> None:
    content = run_integrity.run_document(run)
    from toppling.orchestrator.recorded import FOLDER

    folders = (FOLDER, run_integrity.SCENES)
    files = (PARTS_FOLDER, "scene", "ensemble", "run.json", LOG_FILE, RESULTS_FILE, ".lock", WEIGHTS_FILE)
    below = [path for name in folders for path in (run / name).rglob("*")]
    _refuse_links(run, [*(run / name for name in (*files, *folders)), *below])
    run_integrity.check_files(run)
    # A changed campaign is reported first: versions may differ only because of its engine.
    difference = _campaign_differs(run, plan, content) if content["plan_id"] != plan.id else ""
    there = content["versions"]
    differing = [
        f"{name} {there.get(name)}, now {version}"
        for name, version in versions.items()
        if there.get(name) != version
    ]
    if differing and not difference:
        raise _error(
            "run.versions_differ",
            run,
            f"the run was begun with {'; '.join(differing)}",
            expected="the same versions to the end, so that all rows are comparable",
            remedy="go on with the old environment, or start a new run with another --out",
        )
    if content["plan_id"] != plan.id:
        raise _error(
            "run.of_another_campaign",
            run,
            f"the folder holds the run of another campaign ({content.get('jobs')} jobs, here {len(plan)}){difference}",
            expected="the same campaign, scene and ensemble as when the run was begun",
            remedy="give another --out, or go on with the one that lies in the folder",
        )
    lacking = [name for name in sorted(content["files"]) if not (run / name).exists()]
    if lacking:
        raise _error(
            "run.file_gone",
            run,
            f"{', '.join(lacking)} of this run is gone",
            expected="all that the run was begun with",
            remedy="put it back from where the folder was copied, or start a new run with another --out",
        )
    for name in run_integrity.written_once(run):
        digest.check(run / name)


def _copy_known(source: Path, target: Path, names: Iterable[str]) -> None:
    """Copy a scene's or an ensemble's own files into a run; links may lead to endless or confidential ones."""
    target.mkdir(parents=True)
    for name in names:
        path = source / name
        if path.is_symlink() or (path.exists() and not path.is_file()):
            raise InputError(
                "file.not_regular",
                "is a link" if path.is_symlink() else "is no regular file",
                where=str(path),
                expected="the file itself: links inside a scene or an ensemble are not followed into a run",
                remedy="put a copy of what it leads to in its place (cp -L)",
            )
        if path.exists():
            shutil.copyfile(path, target / name)


def _campaign_differs(run: Path, plan: "Plan", described: Mapping[str, Any]) -> str:
    """Differences between a campaign and that of the run; empty if there are none, or the run's is unreadable."""
    try:
        there = read_toml(run / "campaign.toml")
    except (OSError, InputError):
        return ""
    here = tomllib.loads(plan.campaign.to_toml(stood=there.get("stood", [])))
    differing = "".join(
        f"; its {name}: {shown(there.get(name, 'not given'))}, here {shown(here.get(name, 'not given'))}"
        for name in {**there, **here}
        if there.get(name) != here.get(name) and name not in _ASKED
    )
    content = {"scene": plan.scene_id, "ensemble": plan.ensemble_id}
    other = [name for name, own in content.items() if described.get(f"{name}_id", own) != own]
    return differing + (f"; its {' and '.join(other)} had another content" if other else "")


def _refuse_links(run: Path, places: Iterable[Path]) -> None:
    for path in places:
        if path.is_symlink():
            raise _error(
                "run.link_elsewhere",
                run,
                f"{path.relative_to(run)} is a link that leads elsewhere",
                expected="a folder with its own content",
                remedy="do not write to a run whose origin you do not know; give another --out",
            )


def _error(code: str, run: Path, what: str, expected: str, remedy: str) -> InputError:
    return InputError(code, what, where=str(run), expected=expected, remedy=remedy)
