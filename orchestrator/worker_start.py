"""Worker processes of this machine, which may begin before there is a scheduler for them.

What a worker imports takes a second and a half, in which the program that starts it imports, and checks its plan.
"""

import contextlib
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator

_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""Environment variables of the number of BLAS threads, which affects the order of sums and so the last bit."""

_ENVIRONMENT = _ONE_THREAD | {
    "PYTHONSAFEPATH": "1",  # nothing is imported from the folder that it happens to be started in
    "DASK_LOGGING__DISTRIBUTED": "error",  # a worker's own faults are reported by the run
}


class WorkerProcess(subprocess.Popen[bytes]):
    """Process that waits for its scheduler's address, and ends when its standard input is closed."""

    def __init__(self) -> None:
        self.error_file = tempfile.TemporaryFile()  # noqa: SIM115  (closed by `end`)
        pipe, environment = subprocess.PIPE, os.environ | _ENVIRONMENT
        super().__init__([sys.executable, "-P", "-m", "toppling.orchestrator.worker_process"], stdin=pipe,
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
    """Start processes in advance, at most one per core; those still unused at the end of the block are ended."""
    with contextlib.suppress(OSError):  # who needs them will tell
        _AHEAD.extend(WorkerProcess() for _ in range(min(count, os.cpu_count() or 1)))
    try:
        yield
    finally:
        while _AHEAD:
            _AHEAD.pop().end()
