"""Local processes that import no modules from the working folder."""

import contextlib
import os
import sys
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
