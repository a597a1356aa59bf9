"""What a worker does: load the run's scene and ensemble once, then shake one job after another."""

import asyncio
import logging
import os
import platform
import socket
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import pyarrow as pa
from distributed import get_worker

from toppling.models.errors import InputError
from toppling.models.motions.ensemble import Ensemble
from toppling.models.scene import Scene
from toppling.orchestrator.code_identity import code
from toppling.orchestrator.delivery import NotKeptError, delivered, forget
from toppling.orchestrator.leaving import LEAVING
from toppling.orchestrator.processor import one_blas_thread, processor
from toppling.results.store import table_of
from toppling.workers.engines import DEFAULT, ENGINES
from toppling.workers.job import Assets, JobSpec, identity, run_job
from toppling.workers.options import PHYSICS_VERSION
from toppling.workers.shake import compile_once

log = logging.getLogger(__name__)

_ONE_AT_A_TIME = threading.Lock()
"""The engine is one per process; on a cluster whose workers have several threads, jobs must queue for it."""

Row = dict[str, Any]


class UnfitWorkerError(RuntimeError):
    """A worker of another version, or one that has no way to the run's scene and ensemble.

    what: why.
    worker: the worker's address in the cluster.
    """

    def __init__(self, what: str, worker: str | None = None) -> None:
        self.worker = worker
        super().__init__(what, worker)

    def __str__(self) -> str:
        return str(self.args[0])


@dataclass(frozen=True)
class RunKey:
    """What a worker must find before it does jobs of a run."""

    # The run's folder; a host that does not see it is sent what it needs (`orchestrator.delivery`).
    folder: str
    # Hashes of what must lie in it.
    scene_id: str
    ensemble_id: str
    versions: tuple[tuple[str, str], ...]  # as `versions` gives them on the client
    # Where they lie in it.
    scene_place: str = "scene"
    ensemble_place: str = "ensemble"


def versions(*engines: str) -> tuple[tuple[str, str], ...]:
    """Versions of all that decides an answer, on this machine; of more engines than the default one if named."""
    names = dict.fromkeys(["toppling", DEFAULT, "numpy", "numba", "scipy", "trimesh", *engines])
    packages = tuple((name, _version(name)) for name in names)
    return (
        *packages,
        ("physics", PHYSICS_VERSION),
        ("code", code()),
        ("python", ".".join(platform.python_version_tuple()[:2])),
    )


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"


ROCKS_KEPT = 2
"""By a worker of an atlas: the one at hand, and the one before it, of which a batch may come back."""


@lru_cache(maxsize=ROCKS_KEPT)
def _assets_of(run_key: RunKey) -> Assets:
    """Load a scene and its ensemble, verified by their hashes, once as long as the process shakes that rock.

    Raises UnfitWorkerError if the versions differ, or the folder cannot be read or holds something else.
    Raises NotDeliveredError if this host sees no such folder, and the client has not offered it.
    """
    _check_versions(run_key.versions)
    folder = Path(run_key.folder)
    scene = _loaded("scene", Scene.load, run_key.scene_id, folder / run_key.scene_place)
    return Assets(scene, _ensemble(run_key.ensemble_id, folder / run_key.ensemble_place))


@lru_cache(maxsize=1)
def _check_versions(there: tuple[tuple[str, str], ...]) -> None:
    here = dict(versions(*ENGINES))
    differing = [
        f"{name} {here.get(name)}, the client has {other}" for name, other in there if here.get(name) != other
    ]
    if differing:
        raise _unfit("; ".join(differing))
    compile_once()


@lru_cache(maxsize=1)
def _ensemble(content_id: str, folder: Path) -> Ensemble:
    """Rocks of an atlas mostly share one, whose last records stay in memory."""
    return _loaded("ensemble", Ensemble.load, content_id, folder)


def _loaded(what: str, load: Callable[[Path], Any], content_id: str, shared: Path) -> Any:
    """A run's scene or ensemble: as this host sees it on the client's disk, or else as the client sends it."""
    found, why = _tried(what, load, content_id, shared)
    if found is not None:
        return found
    try:
        folder = delivered(content_id, _address())
    except NotKeptError as error:
        raise _unfit(f"{why}; {error}") from None
    found, why = _tried(what, load, content_id, folder)
    if found is None:
        forget(folder)
        raise _unfit(why)
    return found


def _tried(what: str, load: Callable[[Path], Any], content_id: str, folder: Path) -> tuple[Any, str]:
    """What a folder holds, or why it is not what has that id."""
    try:
        found = load(folder)
    except (InputError, OSError) as error:
        why = f"{error.where}: {error.brief}" if isinstance(error, InputError) else str(error)
        return None, f"cannot read the run's {what}: {why}"
    if found.id != content_id:
        return None, f"{folder} holds {what} {found.id}, not {content_id}"
    return found, ""


def shake_batch(run_key: RunKey, settings: Mapping[str, Any], jobs: pa.Table, budget_s: float) -> pa.Table:
    """Rows of the first jobs of a batch: of one at least, of more until the time is used up.

    Time decides only how many jobs are done in this go, never an answer; the rest goes back to the client.

    settings: what the specifications of all jobs have in common (`Campaign.settings`).
    jobs: as `Plan.batch`.
    Returns pa.Table: under `SCHEMA`.
    Raises UnfitWorkerError if the machine refuses it a file, or the worker makes other ids of the jobs.
    Raises as :func:`_assets_of`.
    """
    assets = _assets_of(run_key)
    end = time.perf_counter() + budget_s
    rows: list[Row] = []
    for job in jobs.to_pylist():
        job_id, sha = job.pop("job_id"), assets.ensemble.sha(job["record_id"])
        spec = JobSpec(scene_id=run_key.scene_id, record_sha=sha, **job, **settings)
        if spec.job_id != job_id:
            raise _unfit(f"job {job_id} is {spec.job_id} here")
        with _ONE_AT_A_TIME:
            try:
                row = run_job(spec, assets)
            except OSError as error:  # its disk or a limit: another worker may have an answer
                raise _unfit(f"cannot work ({error})") from None
            except Exception as error:  # a job's failure is a row, never a lost run
                log.exception("job %s failed", spec.job_id)
                row = lost_row(spec, "failed", f"{type(error).__name__}: {error}")
        rows.append({**row, **processor(), "worker": _name(), "finished_at": datetime.now(UTC)})
        if time.perf_counter() >= end or LEAVING.is_set():
            break
    return table_of(rows)


async def check(run_key: RunKey) -> str:
    """Load the run's assets, or say why that cannot be done here; returns the kernels that compute here.

    In a thread of its own: a worker that compiles, or waits for what is sent to it, stays in touch with its scheduler.

    Raises
    ------
    UnfitWorkerError, NotDeliveredError
        As :func:`_assets_of`.
    """
    one_blas_thread()
    pa.set_memory_pool(pa.system_memory_pool())  # Arrow's own keeps 50 MB of what reading records took
    await asyncio.to_thread(_assets_of, run_key)
    return processor()["kernels"]


def lost_row(spec: JobSpec, status: str, message: str) -> Row:
    """Row of a job that has no answer."""
    return {**identity(spec), "status": status, "message": message}


def _unfit(what: str) -> UnfitWorkerError:
    return UnfitWorkerError(f"worker {_name()}: {what}", _address())


def _address() -> str | None:
    """Of the worker whose task this is; None outside of one."""
    try:
        return get_worker().address
    except ValueError:
        return None


def _name() -> str:
    return f"{socket.gethostname()}:{os.getpid()}"
