"""Worker processes of this machine, which may begin before there is a scheduler for them.

What a worker imports takes a second and a half, in which the program that starts it imports, and checks its plan.
"""

import contextlib
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from typing import IO

_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""How many there are decides in which order BLAS sums, and with it the last bit."""

_ENVIRONMENT = _ONE_THREAD | {
    "PYTHONSAFEPATH": "1",  # nothing is imported from the folder that it happens to be started in
    "MALLOC_TRIM_THRESHOLD_": "65536",
    "DASK_LOGGING__DISTRIBUTED": "error",  # a worker's own faults are reported by the run
}


class WorkerProcess:
    """A process that waits to be told its scheduler, and ends when its standard input closes."""

    def __init__(self) -> None:
        self.errors: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115  (closed by `end`)
        command = [sys.executable, "-P", "-m", "toppling.orchestrator.worker_process"]
        pipe = subprocess.PIPE
        self.process = subprocess.Popen(
            command, stdin=pipe, stdout=pipe, stderr=self.errors, env=os.environ | _ENVIRONMENT,
            start_new_session=True,
        )  # fmt: skip

    def end(self) -> None:
        """End the process, if it has not ended, and close what leads to it."""
        self.process.kill()
        with self.process, self.errors, contextlib.suppress(OSError):  # the rest of what was told
            assert self.process.stdin is not None
            self.process.stdin.close()


_AHEAD: list[WorkerProcess] = []


def worker_process() -> WorkerProcess:
    """A process that was started ahead, or another."""
    with contextlib.suppress(IndexError):
        return _AHEAD.pop()
    return WorkerProcess()


@contextlib.contextmanager
def started_ahead(count: int) -> Iterator[None]:
    """Let so many processes begin, at most one a core; those that nobody has taken in the end are ended."""
    with contextlib.suppress(OSError):  # who needs them will tell
        _AHEAD.extend(WorkerProcess() for _ in range(min(count, os.cpu_count() or 1)))
    try:
        yield
    finally:
        while _AHEAD:
            _AHEAD.pop().end()
