"""Ctrl-C, as often as somebody presses it: the first stops the program in order, the others change nothing.

The first raises KeyboardInterrupt in the main thread, wherever that is. So what must be whole holds it back, what a
finalizer swallows is raised again, and what fails after it fails because of it and is not told.
"""

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from types import FrameType, TracebackType
from typing import Any, NoReturn, TypeVar

INTERRUPTED = 130
"""Exit code of a program that was stopped."""

PATIENCE_S = 60
"""What has not ended in order so long after it was told to is ended without."""

AGAIN_S = 0.02
"""After so long a KeyboardInterrupt that a finalizer swallowed is raised again, outside of it."""

Entered = TypeVar("Entered")


class _Stop:
    """Whether a stop was asked for, and how it stands. No dataclass, whose import takes longer than all of this one."""

    asked = False
    held = 0
    due = False


_STOP = _Stop()


def as_program(work: Callable[[], object]) -> NoReturn:
    """Do the work of a whole process and exit with its code; after Ctrl-C, wherever that came, with `INTERRUPTED`."""
    signal.signal(signal.SIGINT, stop_once)
    code: Any = 0
    try:
        try:
            with told_as_stop():
                work()
        except SystemExit as end:
            code = end.code
        finally:  # there is nothing left to stop
            signal.signal(signal.SIGINT, signal.SIG_IGN)
            signal.signal(signal.SIGTERM, signal.SIG_DFL)
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)  # noqa: T201  (what click is to say may not be imported yet)
        code = INTERRUPTED
    if code == INTERRUPTED:  # all that had to end has ended: the interpreter's own end may be slow
        with contextlib.suppress(OSError):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(INTERRUPTED)
    sys.exit(code)


def stop_once(signum: int, frame: FrameType | None) -> None:  # noqa: ARG001  (a signal handler's signature)
    """Raise KeyboardInterrupt for the first signal, and let no other come between it and an orderly end."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    sys.unraisablehook = _unraisable
    threading.excepthook = _of_no_interest
    _STOP.asked = True
    _STOP.due = bool(_STOP.held)
    _raise_in_time(held=_STOP.due)


def _raise_in_time(*, held: bool = False) -> None:
    signal.signal(signal.SIGALRM, _end)
    signal.alarm(PATIENCE_S)
    if not held:
        raise KeyboardInterrupt


def _end(signum: int, frame: FrameType | None) -> None:  # noqa: ARG001
    print("stopped: the end took too long", file=sys.stderr, flush=True)  # noqa: T201  (nothing else works here)
    os._exit(INTERRUPTED)


def _unraisable(what: "sys.UnraisableHookArgs") -> None:
    """A finalizer or a callback of the interpreter has failed: Ctrl-C must not end there, and the rest is its doing."""
    if issubclass(what.exc_type, KeyboardInterrupt):
        signal.signal(signal.SIGALRM, _again)
        signal.setitimer(signal.ITIMER_REAL, AGAIN_S)


def _again(signum: int, frame: FrameType | None) -> None:  # noqa: ARG001
    _raise_in_time()


def _of_no_interest(what: threading.ExceptHookArgs) -> None:
    """A thread has failed after the stop."""


@contextmanager
def told_as_stop() -> Iterator[None]:
    """What fails once a stop was asked for is the stop: workers and connections are gone because of it."""
    try:
        yield
    except Exception as error:
        if _STOP.asked:
            raise KeyboardInterrupt from error
        raise


@contextmanager
def held_back() -> Iterator[None]:
    """Inside no KeyboardInterrupt is raised; one that is due is raised at the end."""
    _STOP.held += 1
    try:
        yield
    finally:
        _STOP.held -= 1
        if _STOP.due and not _STOP.held:
            _STOP.due = False
            raise KeyboardInterrupt


class Whole(AbstractContextManager[Entered]):
    """A context whose beginning and end Ctrl-C does not cut in two, but what is done in it.

    Half a beginning leaves processes behind, and half an end threads and pages of errors.

    Parameters
    ----------
    inner : context manager
    """

    def __init__(self, inner: AbstractContextManager[Entered]) -> None:
        self._inner = inner

    def __enter__(self) -> Entered:
        entered = False
        try:
            with held_back():
                found = self._inner.__enter__()
                entered = True
        except KeyboardInterrupt:
            if entered:
                self._inner.__exit__(*sys.exc_info())
            raise
        return found

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> bool | None:
        with held_back():
            return self._inner.__exit__(kind, error, trace)


@contextmanager
def kept_from_children() -> Iterator[None]:
    """Threads that are started meanwhile, and processes that these start, are not told of Ctrl-C.

    A terminal sends it to all of them: the main thread ends the others, which have nothing to say.
    """
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()  # it would let the signals through in the thread that first needs it
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
