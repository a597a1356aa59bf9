"""Compiling what a shake uses, once for a machine."""

from __future__ import annotations

import contextlib
import fcntl
import subprocess
import sys
from collections.abc import Callable

from toppling.models.compiled import COMPLETE, FOLDER

_ENSURED: list[bool] = []


def ensure_compiled(use_everything: Callable[[], object]) -> None:
    """Compile by using everything once, unless that was done before; of several processes one does it.

    Without a folder that is a process's own matter and happens when it first shakes.
    """
    if _ENSURED:
        return
    _ENSURED.append(True)
    if FOLDER is None or _is_compiled():
        return
    with (FOLDER / "lock").open("w") as lock:
        with contextlib.suppress(OSError):  # a file system without locks: two processes may do it twice
            fcntl.flock(lock, fcntl.LOCK_EX)
        if not _is_compiled():
            sys.stderr.write("compiling for this machine, once: about a minute\n")
            use_everything()
            (FOLDER / COMPLETE).touch()


def _is_compiled() -> bool:
    """Whether the next process finds compiled what a shake needs."""
    return FOLDER is not None and (FOLDER / COMPLETE).exists()


def compile_apart() -> None:
    """Compile the inner loop in a separate process, whose memory is freed at its end."""
    if not _is_compiled() and FOLDER is not None:
        program = "from toppling.workers.shaking import compile_once; compile_once()"
        # Ctrl-C is for this process, which ends the other one.
        subprocess.run([sys.executable, "-P", "-c", program], check=True, start_new_session=True)
