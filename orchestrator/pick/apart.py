"""Computation of a scan in a separate process that caches the cloud, so that native code does not delay clicks."""

import contextlib
import dataclasses
import multiprocessing
import threading
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from toppling.models.errors import InputError
from toppling.models.hidden_base.inspection import Inspection
from toppling.models.scan.candidates import find_candidates, surfels_of
from toppling.models.scan.interface_hint import InterfaceHint
from toppling.models.scan.read import Cloud
from toppling.models.scan.register import Registered, registered
from toppling.models.scan.survey import CachedScan, work_out
from toppling.models.scene import Scene
from toppling.orchestrator.interrupt import signals_blocked
from toppling.orchestrator.pick.user_hints import View, view_of
from toppling.orchestrator.processes import without_working_folder


class EndedError(Exception):
    """The process was ended deliberately."""


class Apart:
    """Process, started when needed, that executes one function call at a time."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._process: Any = None
        self._line: Any = None
        self._over = False

    def do(self, note: Callable[[str], None], function: Callable[..., Any], *arguments: Any) -> Any:
        """Call `function(*arguments, note)` in the process; an exception of `note` here stops it at its next note.

        Raises EndedError once `end` was called.
        Raises InputError if the process died, such as by lack of memory.
        Raises Exception: exceptions of the function.
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
        """End the process immediately and permanently, from any thread."""
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
                with without_working_folder(), signals_blocked():
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
            "pick.process_died",
            f"the process that works the scan out has died (exit code {code})",
            where="the scan",
            expected="enough memory for this cloud",
            remedy="end other programs, or crop the cloud to the rock and its pedestal",
        ) from None


class _StoppedError(Exception):
    """The result is no longer needed."""


def _serve(line: Connection) -> None:
    """Execute calls until the connection is closed."""

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


_Note = Callable[[str], None]

_KNOWN: dict[Path, Registered] = {}
"""Registered cloud of this process, by its folder."""


@dataclass(frozen=True, eq=False)
class Stored:
    """Cloud whose arrays are files, memory-mapped by all processes, so that they are in memory once."""

    folder: Path
    rest: Cloud

    @classmethod
    def of(cls, cloud: Cloud, folder: Path) -> "Stored":
        """Write a cloud to a new folder."""
        folder.mkdir()
        for name in ("points_m", "station", "label"):
            if (values := getattr(cloud, name)) is not None:
                np.save(folder / f"{name}.npy", values)
        none = cloud.points_m[:0]
        return cls(folder, dataclasses.replace(cloud, points_m=none, station=cloud.station[:0], label=None))

    def cloud(self) -> Cloud:
        """The memory-mapped cloud."""
        arrays: dict[str, Any] = {
            path.stem: np.asarray(np.load(path, mmap_mode="r")) for path in self.folder.glob("*.npy")
        }
        return dataclasses.replace(self.rest, **arrays)


def split(
    stored: Stored,
    near_m: tuple[float, float] | None,
    hint: InterfaceHint | None,
    inspection: Inspection,
    number: int,
    note: _Note,
) -> tuple[Stored, CachedScan, NDArray[np.int8], tuple[str, ...], View]:
    """Register (once) and split a cloud; returns the registered cloud, results, labels, notes, and numbered view."""
    cloud = _cloud(stored, note)
    result, label, notes = work_out(cloud, note, near_m, hint, inspection)
    note("showing the rock")
    moved = Stored(stored.folder / "registered", stored.rest)
    fitted = moved if moved.folder.exists() else stored
    return fitted, result, label, notes, view_of(cloud.cloud.points_m, label, number)


def _cloud(stored: Stored, note: _Note) -> Registered:
    if stored.folder not in _KNOWN:
        note("registering stations")
        read = stored.cloud()
        _KNOWN.clear()
        fitted = registered(read)
        if fitted.cloud is not read:
            mapped = Stored.of(fitted.cloud, stored.folder / "registered")
            fitted = dataclasses.replace(fitted, cloud=mapped.cloud())
        _KNOWN[stored.folder] = fitted
    return _KNOWN[stored.folder]


def draw(result: CachedScan, note: _Note) -> tuple[Scene, CachedScan]:
    """Draw the hidden base."""
    note("drawing the hidden base")
    return result.scene()


def look_around(stored: Stored, _: _Note) -> list[dict[str, Any]]:
    """Rocks in a cloud."""
    points = stored.cloud().points_m
    return [
        {"top_m": candidate.top_m.tolist(), "height_m": candidate.height_m}
        for candidate in find_candidates(points, surfels_of(points))
    ]
