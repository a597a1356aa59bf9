"""Prevents child processes from importing modules from the working folder.

Python puts that folder before its own library for `python -c` and `python -m`, by which multiprocessing starts its
processes, so that every worker would execute a file `signal.py` next to a campaign.
"""

import contextlib
import os
import sys
from collections.abc import Iterator
from pathlib import Path

VARIABLE = "PYTHONSAFEPATH"


def safe_for_children() -> None:
    """Exclude the working folder from the import paths of all child processes."""
    os.environ[VARIABLE] = "1"


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
