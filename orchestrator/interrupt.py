"""Ctrl-C, as often as somebody presses it: the first stops the program in order, the others change nothing."""

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

INTERRUPTED = 130
"""Exit code of a program that was stopped."""

PATIENCE_S = 60
"""What has not ended in order so long after it was told to is ended without."""


def stop_once(signum: int, frame: FrameType | None) -> None:  # noqa: ARG001  (a signal handler's signature)
    """Raise KeyboardInterrupt for the first signal, and let no other come between it and an orderly end."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    signal.signal(signal.SIGALRM, _end)
    signal.alarm(PATIENCE_S)
    raise KeyboardInterrupt


def _end(signum: int, frame: FrameType | None) -> None:  # noqa: ARG001
    print("stopped: the end took too long", file=sys.stderr, flush=True)  # noqa: T201  (nothing else works here)
    os._exit(INTERRUPTED)


@contextmanager
def kept_from_children() -> Iterator[None]:
    """Threads that are started meanwhile, and processes that these start, are not told of Ctrl-C.

    A terminal sends it to all of them: the main thread ends the others, which have nothing to say.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
