"""Ctrl-C, as often as somebody presses it: the first stops the program in order, the others change nothing.

So do SIGTERM (a batch system's warning) and SIGHUP (a terminal that closes). The first raises KeyboardInterrupt in the
main thread, wherever that is. So what must be whole holds it back, it is raised again where a finalizer or a library
swallowed it, and what fails after it fails because of it and is not told.
"""

import contextlib
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from types import FrameType
from typing import Any, NoReturn, TypeVar

INTERRUPTED = 130
"""Exit code of a program that was stopped."""

_PATIENCE_S = 60
"""What has not ended in order so long after it was told to is ended without."""

ENDS = (signal.SIGTERM, signal.SIGHUP)
"""What ends a program as Ctrl-C does."""

_LOOK_S = 0.1
"""Time between looks at whether the KeyboardInterrupt is still on its way."""

_Entered = TypeVar("_Entered")


class _Stop:
    """Whether and when a stop was asked for. No dataclass, whose import takes longer than that of all else here."""

    asked_at: float | None = None
    blocked = 0


_STOP = _Stop()


def as_program(work: Callable[[], object]) -> NoReturn:
    """Do the work of a whole process and exit with its code; after Ctrl-C, wherever that came, with `INTERRUPTED`.

    So after SIGTERM and SIGHUP, unless whoever started it has them ignored, as `nohup` does.
    """
    signal.signal(signal.SIGINT, _stop_once)
    for number in ENDS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _stop_once)
    code: Any = 0
    try:
        try:
            with signals_as_stop():
                work()
        except SystemExit as end:
            code = end.code
        finally:  # there is nothing left to stop
            end_of_stop()
            signal.signal(signal.SIGINT, signal.SIG_IGN)
            for number in ENDS:
                if signal.getsignal(number) is _stop_once:
                    signal.signal(number, signal.SIG_DFL)
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)  # noqa: T201  (what click is to say may not be imported yet)
        code = INTERRUPTED
    if code == INTERRUPTED:  # all that had to end has ended: the interpreter's own end may be slow
        with contextlib.suppress(OSError):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(INTERRUPTED)
    sys.exit(code)


def _stop_once(signum: int, frame: FrameType | None) -> None:  # noqa: ARG001  (a signal handler's signature)
    """Raise KeyboardInterrupt for the first signal, and let no other come between it and an orderly end."""
    for number in (signal.SIGINT, *ENDS):
        signal.signal(number, signal.SIG_IGN)
    # What a finalizer or a thread fails with after the stop, it fails with because of it.
    sys.unraisablehook = lambda _: None
    threading.excepthook = lambda _: None
    _STOP.asked_at = time.monotonic()
    signal.signal(signal.SIGALRM, _look)
    signal.setitimer(signal.ITIMER_REAL, _LOOK_S, _LOOK_S)
    _raise_unless_held()


def end_of_stop() -> None:
    """Take a KeyboardInterrupt for done: it is not raised again."""
    signal.setitimer(signal.ITIMER_REAL, 0.0)


def _look(signum: int, frame: FrameType | None) -> None:  # noqa: ARG001
    """See whether the KeyboardInterrupt is still on its way: libraries swallow it in finalizers and bare excepts."""
    if _STOP.asked_at is not None and time.monotonic() - _STOP.asked_at > _PATIENCE_S:
        print("stopped: the end took too long", file=sys.stderr, flush=True)  # noqa: T201  (nothing else works here)
        os._exit(INTERRUPTED)
    _raise_unless_held()


def _raise_unless_held() -> None:
    error = sys.exc_info()[1]  # of the main thread, which was interrupted here
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__context__
    if error is None and not _STOP.blocked:
        raise KeyboardInterrupt


@contextmanager
def signals_as_stop() -> Iterator[None]:
    """What fails once a stop was asked for is the stop: workers and connections are gone because of it."""
    try:
        yield
    except Exception as error:
        if _STOP.asked_at is not None:
            raise KeyboardInterrupt from error
        raise


@contextmanager
def held_back() -> Iterator[None]:
    """Inside no KeyboardInterrupt is raised; one that is due is raised at the end."""
    _STOP.blocked += 1
    try:
        yield
    finally:
        _STOP.blocked -= 1
        if _STOP.asked_at is not None:
            _raise_unless_held()


class Uninterrupted(AbstractContextManager[_Entered]):
    """A context whose beginning and end Ctrl-C does not cut in two, but what is done in it.

    Half a beginning leaves processes behind, and half an end threads and pages of errors.
    """

    def __init__(self, inner: AbstractContextManager[_Entered]) -> None:
        self._inner = inner

    def __enter__(self) -> _Entered:
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

    def __exit__(self, *raised: Any) -> bool | None:
        with held_back():
            return self._inner.__exit__(*raised)


@contextmanager
def kept_from_children() -> Iterator[None]:
    """Threads that are started meanwhile, and processes that these start, are not told of Ctrl-C.

    A terminal sends it to all of them, and SIGHUP as it closes: the main thread ends the others, which have nothing to
    say.
    """
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()  # it would let the signals through in the thread that first needs it
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGHUP})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
