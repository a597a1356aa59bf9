"""A process of its own for a scan's work: native code that lets no other thread run delays no click then."""

import contextlib
import multiprocessing
import threading
import traceback
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any, NoReturn

from toppling.models.errors import InputError
from toppling.orchestrator.interrupt import kept_from_children
from toppling.orchestrator.safe_path import without_working_folder


class EndedError(Exception):
    """The process was ended on purpose."""


class Apart:
    """One process, started when it is needed, that calls one function at a time."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._process: Any = None
        self._line: Any = None
        self._over = False

    def do(self, note: Callable[[str], None], function: Callable[..., Any], *arguments: Any) -> Any:
        """Call `function(*arguments, note)` there; what `note` raises here ends the call there at its next note.

        Raises EndedError once `end` was called.
        Raises InputError if the process died, as one does that takes more memory than there is.
        Raises Exception: whatever the function raises.
        """
        line = self._started()
        stopped: BaseException | None = None
        try:
            line.send((function, arguments))
            while (answer := line.recv())[0] == "note":
                try:
                    note(answer[1])
                except Exception as error:
                    stopped = error
                line.send(stopped is None)
        except (EOFError, OSError):
            self._died()
        if stopped is not None:
            raise stopped
        kind, content = answer
        if kind == "raised":
            raise content
        return content

    def end(self) -> None:
        """End the process at once, from any thread; there will be no other."""
        with self._lock:
            self._over = True
            if self._process is not None:
                self._process.kill()

    def _started(self) -> Connection:
        with self._lock:
            if self._over:
                raise EndedError
            if self._process is None:
                spawn = multiprocessing.get_context("spawn")
                self._line, there = spawn.Pipe()
                self._process = spawn.Process(target=_serve, args=(there,), daemon=True)
                with without_working_folder(), kept_from_children():
                    self._process.start()
                there.close()
            return self._line

    def _died(self) -> NoReturn:
        with self._lock:
            if self._over:
                raise EndedError from None
            self._process.join()
            code, self._process = self._process.exitcode, None
        raise InputError(
            f"the process that works the scan out has died (exit code {code})",
            where="the scan",
            expected="enough memory for this cloud",
            remedy="end other programs, or crop the cloud to the rock and its pedestal",
        ) from None


class _StoppedError(Exception):
    """Nobody waits for this any more."""


def _serve(line: Connection) -> None:
    """Do what is asked, until the one who asks is gone."""

    def note(stage: str) -> None:
        line.send(("note", stage))
        if not line.recv():
            raise _StoppedError

    with contextlib.suppress(EOFError, OSError):
        while True:
            function, arguments = line.recv()
            try:
                answer = "done", function(*arguments, note)
            except InputError as error:
                answer = "raised", error
            except _StoppedError:
                answer = "done", None
            except Exception as error:
                traceback.print_exception(error)
                answer = "raised", RuntimeError(f"{type(error).__name__}: {error}")
            line.send(answer)
