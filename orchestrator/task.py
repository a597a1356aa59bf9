"""Tasks of a worker: compile, load a run's scene and ensemble once, then shake job after job.

Their answers depend on the code, which has a hash, and in the last bit on the processor, which is identified.
"""

import asyncio
import faulthandler
import hashlib
import logging
import math
import os
import platform
import socket
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cache, lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import llvmlite.binding
import numpy as np
import pyarrow as pa
import scipy.linalg  # noqa: F401  (loads SciPy's own BLAS, whose threads are counted too)
from distributed import get_worker
from threadpoolctl import threadpool_info, threadpool_limits

import toppling.models
import toppling.workers
from toppling.models.compiled import COMPLETE, FOLDER
from toppling.models.errors import InputError
from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.motion import Motion
from toppling.models.scene import Scene
from toppling.orchestrator.delivery import StorageError, delivered, forget
from toppling.orchestrator.leaving import LEAVING
from toppling.results.store import table_of
from toppling.workers.engines import DEFAULT, ENGINES
from toppling.workers.job import Assets, JobSpec, identity, run_job
from toppling.workers.options import PHYSICS_VERSION
from toppling.workers.shaking import compile_once, shake

_ROOMS = tuple(Path(room.__path__[0]) for room in (toppling.models, toppling.workers))
_NOT_OF_SHAKES = ("scan", "motions/formats")
"""Folders of `models` that only make scenes and records, which have their own hashes."""

SOURCES = {
    f"{room.name}/{path.relative_to(room)}": path.read_bytes()
    for room in _ROOMS
    for path in room.rglob("*.py")
    if not any(path.is_relative_to(room / folder) for folder in _NOT_OF_SHAKES)
}
"""Sources at the start of this process: files edited later differ from the loaded code."""


@cache
def code() -> str:
    """Hash of all code that determines results."""
    digest = hashlib.blake2b(digest_size=8)
    for name, source in sorted(SOURCES.items()):
        digest.update(name.encode() + hashlib.blake2b(source).digest())
    return digest.hexdigest()


KERNEL_VARIABLES = ("OPENBLAS_CORETYPE", "NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES")
"""Environment variables that select kernels; set before the program starts, they apply to all its child processes."""


@cache
def processor() -> dict[str, str]:
    """Columns of a row that identify the processor's model and the kernels of BLAS and LLVM."""
    llvm = os.environ.get("NUMBA_CPU_NAME") or llvmlite.binding.get_host_cpu_name()
    return {"cpu": _model(), "kernels": f"BLAS {_blas_kernel()}, LLVM {llvm}"}


def _model() -> str:
    with suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines():
            name, _, value = line.partition(":")
            if name.strip() == "model name":
                return value.strip()
    return platform.processor() or platform.machine()


def single_blas_thread() -> None:
    """Limit BLAS to one thread in this process: several may sum in a different order."""
    threadpool_limits(1, user_api="blas")


def _blas_kernel() -> str:
    """Kernel selected by NumPy's OpenBLAS, or the name of another BLAS library."""
    loaded = [library for library in threadpool_info() if library["user_api"] == "blas"]
    for library in sorted(loaded, key=lambda library: "numpy.libs" not in library["filepath"]):
        return str(library.get("architecture") or library["internal_api"])
    with suppress(KeyError, TypeError):  # a library unknown to threadpoolctl, such as Apple's
        return str(np.show_config(mode="dicts")["Build Dependencies"]["blas"]["name"])
    return "unknown"


log = logging.getLogger(__name__)

COMPILING = "compiling, once for this machine"
"""Description of the activity for progress displays."""


def is_compiled() -> bool:
    """Whether the compiled code is in the cache of this machine."""
    return FOLDER is not None and (FOLDER / COMPLETE).exists()


def shake_a_block() -> None:
    """Load the compiled code into this process; where it cannot be cached, compile it."""
    shake(Scene.block(0.2, 0.2, 0.6), Motion(np.sin(np.mgrid[0:99, 0:3][0]), 0.01))


def warn_of_no_cache() -> None:
    """Warn that each process compiles, where there is no folder for compiled code."""
    if FOLDER is None:
        log.warning(
            "compiled code cannot be cached: each process compiles first. TOPPLING_CACHE names a folder for the cache"
        )


_ENGINE_LOCK = threading.Lock()
"""Lock of the engine, which is single per process: jobs of workers with several threads must wait for it."""

Row = dict[str, Any]


class UnfitWorkerError(RuntimeError):
    """A worker has other versions, or no access to the run's scene and ensemble.

    what: reason.
    worker: address of the worker in the cluster.
    """

    def __init__(self, what: str, worker: str | None = None) -> None:
        self.worker = worker
        super().__init__(what, worker)

    def __str__(self) -> str:
        return str(self.args[0])


@dataclass(frozen=True)
class RunKey:
    """Assets and versions that a worker must have before it does jobs of a run."""

    # The run's folder; hosts without access to it receive its content (`orchestrator.delivery`).
    folder: str
    # Hashes of the required content.
    scene_id: str
    ensemble_id: str
    versions: tuple[tuple[str, str], ...]  # result of `versions` on the client
    # Paths of scene and ensemble in the run's folder.
    scene_place: str = "scene"
    ensemble_place: str = "ensemble"
    client: str = ""  # host and process of the client
    limit_s: float = math.inf  # wall time of a job after which its worker counts as hanging


def versions(*engines: str) -> tuple[tuple[str, str], ...]:
    """Versions of all that determines results on this machine, including engines given besides the default one."""
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


ROCKS_CACHED = 2
"""Number of rocks of an atlas that a worker caches: the current one, and the previous one for late batches."""


@lru_cache(maxsize=ROCKS_CACHED)
def _assets_of(run_key: RunKey) -> Assets:
    """Load a scene and its ensemble, verified by their hashes and cached while the process shakes that rock."""
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
    if not is_compiled():  # it cannot be cached
        shake_a_block()


@lru_cache(maxsize=1)
def _ensemble(content_id: str, folder: Path) -> Ensemble:
    """Load an ensemble; rocks of an atlas mostly have a common one, whose last records stay cached."""
    return _loaded("ensemble", Ensemble.load, content_id, folder)


def _loaded(what: str, load: Callable[[Path], Any], content_id: str, shared: Path) -> Any:
    """Load a run's scene or ensemble from the shared folder, or else from delivered content."""
    found, why = _tried(what, load, content_id, shared)
    if found is not None:
        return found
    try:
        folder = delivered(content_id, _address())
    except StorageError as error:
        raise _unfit(f"{why}; {error}") from None
    found, why = _tried(what, load, content_id, folder)
    if found is None:
        forget(folder)
        raise _unfit(why)
    return found


def _tried(what: str, load: Callable[[Path], Any], content_id: str, folder: Path) -> tuple[Any, str]:
    """Load a folder's content, or give the reason why it does not have the expected id."""
    try:
        found = load(folder)
    except (InputError, OSError) as error:
        why = f"{error.where}: {error.brief}" if isinstance(error, InputError) else str(error)
        return None, f"cannot read the run's {what}: {why}"
    if found.id != content_id:
        return None, f"{folder} holds {what} {found.id}, not {content_id}"
    return found, ""


def shake_batch(run_key: RunKey, settings: Mapping[str, Any], jobs: pa.Table, budget_s: float) -> pa.Table:
    """Shake the first jobs of a batch, one or more, until the time budget is used up, and return their rows.

    Time affects only the number of jobs done, never a result; the client resubmits the remaining ones.

    settings: fields common to the specifications of all jobs (`Campaign.settings`).
    jobs: table from `Plan.batch`.
    Returns pa.Table: with `SCHEMA`.
    Raises UnfitWorkerError on errors of files, or if the worker computes other job ids.
    Raises as :func:`_assets_of`.
    """
    assets = _assets_of(run_key)
    rows: list[Row] = []
    with _ENGINE_LOCK, _ended_if_it_hangs(run_key, budget_s + run_key.limit_s):
        end = time.perf_counter() + budget_s
        for job in jobs.to_pylist():
            job_id, sha = job.pop("job_id"), assets.ensemble.sha(job["record_id"])
            spec = JobSpec(scene_id=run_key.scene_id, record_sha=sha, **job, **settings)
            if spec.job_id != job_id:
                raise _unfit(f"job {job_id} is {spec.job_id} here")
            try:
                row = run_job(spec, assets)
            except OSError as error:  # a disk or a limit of this machine: another worker may succeed
                raise _unfit(f"cannot work ({error})") from None
            except Exception as error:  # a failed job is a row, and must not stop the run
                log.exception("job %s failed", spec.job_id)
                row = lost_row(spec, "failed", f"{type(error).__name__}: {error}")
            rows.append({**row, **processor(), "worker": process_name(), "finished_at": datetime.now(UTC)})
            if time.perf_counter() >= end or LEAVING.is_set():
                break
    return table_of(rows)


@contextmanager
def _ended_if_it_hangs(run_key: RunKey, limit_s: float) -> Iterator[None]:
    """End this process, with its stack in its log, if the block takes longer; not where it is the client's own."""
    if run_key.client == process_name() or limit_s == math.inf:
        yield
        return
    # Also where compiled code neither returns nor lets another thread of Python run.
    faulthandler.dump_traceback_later(limit_s, exit=True, file=2)
    try:
        yield
    finally:
        faulthandler.cancel_dump_traceback_later()


def must_compile() -> bool:
    """Whether this worker's machine has no compiled code yet."""
    return not is_compiled()


async def check(run_key: RunKey) -> None:
    """Load the run's assets.

    In a separate thread, so that a worker that compiles or waits stays connected to its scheduler.

    Raises
    ------
    UnfitWorkerError, NotDeliveredError
        As :func:`_assets_of`.
    """
    single_blas_thread()
    pa.set_memory_pool(pa.system_memory_pool())  # Arrow's pool would retain 50 MB after reading records
    await asyncio.to_thread(_assets_of, run_key)


def lost_row(spec: JobSpec, status: str, message: str) -> Row:
    """Row of a job without an answer."""
    return {**identity(spec), "status": status, "message": message}


def _unfit(what: str) -> UnfitWorkerError:
    return UnfitWorkerError(f"worker {process_name()}: {what}", _address())


def _address() -> str | None:
    """Address of the current worker; None outside of a task."""
    try:
        return get_worker().address
    except ValueError:
        return None


def process_name() -> str:
    """Host and process."""
    return f"{socket.gethostname()}:{os.getpid()}"
