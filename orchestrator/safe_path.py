"""No process that the program starts imports anything from the folder that it happens to be started in.

Python puts that folder before its own library for `python -c` and `python -m`, by which multiprocessing starts its
processes, so that a file `signal.py` beside a campaign would be run by every worker.
"""

import contextlib
import os
import sys
from collections.abc import Iterator
from pathlib import Path

VARIABLE = "PYTHONSAFEPATH"


def safe_for_children() -> None:
    """Let every Python that this process starts leave its working folder alone."""
    os.environ[VARIABLE] = "1"


def safe_as_module() -> None:
    """Take the working folder, which `python -m toppling` begins with, out of the paths of this process and workers."""
    if sys.flags.safe_path or not sys.path:
        return
    if not sys.path[0] or Path(sys.path[0]).resolve() == Path.cwd():
        del sys.path[0]


@contextlib.contextmanager
def without_working_folder() -> Iterator[None]:
    """Keep the working folder out of the paths that workers are started with; in a notebook it is the first of them.

    The folder of a program that calls this one stays: workers import that program.
    """
    safe_for_children()
    before = list(sys.path)
    sys.path[:] = [path for path in sys.path if path]
    try:
        yield
    finally:
        sys.path[:] = before
