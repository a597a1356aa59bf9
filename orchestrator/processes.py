"""Local processes: worker processes started in advance, and import paths without the working folder."""

import contextlib
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

VARIABLE = "PYTHONSAFEPATH"


def safe_for_children() -> None:
    """Exclude the working folder from import paths of child processes; threads of BLAS mostly wait for each other."""
    os.environ |= {VARIABLE: "1", "OPENBLAS_NUM_THREADS": "1"}


def safe_as_module() -> None:
    """Remove the working folder, which `python -m toppling` adds, from the import paths of this process and workers."""
    if sys.flags.safe_path or not sys.path:
        return
    if not sys.path[0] or Path(sys.path[0]).resolve() == Path.cwd():
        del sys.path[0]


@contextlib.contextmanager
def without_working_folder() -> Iterator[None]:
    """Exclude the working folder, the first path in a notebook, from the import paths of workers.

    The folder of the calling program stays, because workers import that program.
    """
    safe_for_children()
    before = list(sys.path)
    sys.path[:] = [path for path in sys.path if path]
    try:
        yield
    finally:
        sys.path[:] = before


_SINGLE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""Environment variables of the number of BLAS threads, which affects the order of sums and so the last bit."""

_ENVIRONMENT = _SINGLE_THREAD | {
    "PYTHONSAFEPATH": "1",  # nothing is imported from the folder that it happens to be started in
    "DASK_LOGGING__DISTRIBUTED": "error",  # a worker's own faults are reported by the run
}


class WorkerProcess(subprocess.Popen[bytes]):
    """Process that waits for its scheduler's address, and ends when its standard input is closed."""

    def __init__(self) -> None:
        self.error_file = tempfile.TemporaryFile()  # noqa: SIM115  (closed by `end`)
        pipe, environment = subprocess.PIPE, os.environ | _ENVIRONMENT
        super().__init__([sys.executable, "-P", "-m", "toppling.orchestrator.local_workers"], stdin=pipe,
                         stdout=pipe, stderr=self.error_file, env=environment, start_new_session=True)  # fmt: skip

    def end(self) -> None:
        """End the process if necessary, and close its pipes."""
        self.kill()
        with self.error_file, contextlib.suppress(OSError), self:  # the pipe may still hold what was told
            pass


_AHEAD: list[WorkerProcess] = []


def worker_process() -> WorkerProcess:
    """Take a process that was started in advance, or start one."""
    with contextlib.suppress(IndexError):
        return _AHEAD.pop()
    return WorkerProcess()


@contextlib.contextmanager
def started_ahead(count: int) -> Iterator[None]:
    """Start processes in advance, at most one per core; those still unused at the end of the block are ended.

    What a worker imports takes a second and a half, in which the program that starts it imports, and checks its plan.
    """
    with contextlib.suppress(OSError):  # who needs them will tell
        _AHEAD.extend(WorkerProcess() for _ in range(min(count, os.cpu_count() or 1)))
    try:
        yield
    finally:
        while _AHEAD:
            _AHEAD.pop().end()
