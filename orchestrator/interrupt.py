"""Graceful stop by Ctrl-C: the first signal stops the program, further ones are ignored.

SIGTERM (a batch system's warning) and SIGHUP (a closed terminal) act likewise. The first signal raises
KeyboardInterrupt in the main thread at any point. Critical sections therefore defer it, it is raised again where a
finalizer or a library suppressed it, and later failures are attributed to it and not reported.
"""

import contextlib
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from types import FrameType
from typing import Any, NoReturn, TypeVar

INTERRUPTED = 128 + signal.SIGINT
"""Exit code of a stopped program, as shells give it."""
_PATIENCE_S = 60
"""Time after the first signal at which the process is ended forcibly, s."""
ENDS = (signal.SIGTERM, signal.SIGHUP)
"""Signals that are treated like Ctrl-C."""
POLL_S = 0.1
"""Interval between checks of a state that nothing announces, s: an interrupt, a lost scheduler, a last job."""
LOOK_S = 1.0
"""Interval between looks at workers, and longest wait for an answer of theirs, s."""

_Entered = TypeVar("_Entered")


class _Stop:
    """State of a requested stop. Not a dataclass, whose import would dominate that of this module."""

    asked_at: float | None = None
    blocked = 0


_STOP = _Stop()


def as_program(work: Callable[[], object]) -> NoReturn:
    """Run the main function of a process and exit with its code, or with `INTERRUPTED` after Ctrl-C at any point.

    SIGTERM and SIGHUP act likewise, unless they are ignored, as by `nohup`.
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
        finally:  # nothing is left to stop
            end_of_stop()
            signal.signal(signal.SIGINT, signal.SIG_IGN)
            for number in ENDS:
                if signal.getsignal(number) is _stop_once:
                    signal.signal(number, signal.SIG_DFL)
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)  # noqa: T201  (click may not be imported yet)
        code = INTERRUPTED
    if code == INTERRUPTED:  # cleanup is complete, and the interpreter's shutdown may be slow
        with contextlib.suppress(OSError):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(INTERRUPTED)
    sys.exit(code)


def _stop_once(signum: int, frame: FrameType | None) -> None:  # noqa: ARG001  (a signal handler's signature)
    """Raise KeyboardInterrupt for the first signal, and ignore further ones during the cleanup."""
    for number in (signal.SIGINT, *ENDS):
        signal.signal(number, signal.SIG_IGN)
    # Exceptions in finalizers and threads after the stop are its consequence.
    sys.unraisablehook = lambda _: None
    threading.excepthook = lambda _: None
    _STOP.asked_at = time.monotonic()
    signal.signal(signal.SIGALRM, _look)
    signal.setitimer(signal.ITIMER_REAL, POLL_S, POLL_S)
    _raise_unless_held()


def end_of_stop() -> None:
    """Mark a KeyboardInterrupt as handled, so that it is not raised again."""
    signal.setitimer(signal.ITIMER_REAL, 0.0)


def _look(signum: int, frame: FrameType | None) -> None:  # noqa: ARG001
    """Raise a KeyboardInterrupt again that was suppressed: libraries do so in finalizers and bare excepts."""
    if _STOP.asked_at is not None and time.monotonic() - _STOP.asked_at > _PATIENCE_S:
        print("stopped: the end took too long", file=sys.stderr, flush=True)  # noqa: T201  (nothing else works here)
        os._exit(INTERRUPTED)
    _raise_unless_held()


def _raise_unless_held() -> None:
    error = sys.exc_info()[1]  # exception being handled in the interrupted main thread
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__context__
    if error is None and not _STOP.blocked:
        raise KeyboardInterrupt


@contextmanager
def signals_as_stop() -> Iterator[None]:
    """Convert exceptions after a requested stop to KeyboardInterrupt: workers and connections are lost by it."""
    try:
        yield
    except Exception as error:
        if _STOP.asked_at is not None:
            raise KeyboardInterrupt from error
        raise


@contextmanager
def held_back() -> Iterator[None]:
    """Defer a KeyboardInterrupt to the end of the block."""
    _STOP.blocked += 1
    try:
        yield
    finally:
        _STOP.blocked -= 1
        if _STOP.asked_at is not None:
            _raise_unless_held()


@contextmanager
def uninterrupted(inner: AbstractContextManager[_Entered]) -> Iterator[_Entered]:
    """Enter and leave a context protected from Ctrl-C, to which the block is open.

    An incomplete entry would leave processes behind, and an incomplete exit threads and error messages.
    """
    with ExitStack() as protected, ExitStack() as entered:
        with held_back():
            found = entered.enter_context(inner)
        try:
            yield found
        finally:
            protected.enter_context(held_back())


@contextmanager
def signals_blocked() -> Iterator[None]:
    """Block Ctrl-C and SIGHUP in threads started within the block, and in their child processes.

    A terminal sends these signals to all processes, but the main thread shuts down the others without messages.
    """
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()  # it would unblock the signals in the thread that first needs it
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGHUP})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
