"""Interactive scan: a thread has a process compute the results of the latest hints, which can be queried and saved."""

import contextlib
import dataclasses
import multiprocessing
import tempfile
import threading
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from toppling.models.arrays import Array
from toppling.models.errors import InputError
from toppling.models.hidden_base.inspection import Inspection
from toppling.models.lengths import METRES
from toppling.models.scan.candidates import find_candidates, surfels_of
from toppling.models.scan.hints_file import KINDS
from toppling.models.scan.interface_hint import InterfaceHint
from toppling.models.scan.placement import Placement
from toppling.models.scan.read import Cloud
from toppling.models.scan.register import Registered, registered
from toppling.models.scan.surfels import picked
from toppling.models.scan.survey import CachedScan, Survey, work_out
from toppling.models.scene import Scene
from toppling.orchestrator.interrupt import signals_blocked
from toppling.orchestrator.pick.user_hints import UserHints, View, answer_shown, detail, tops, view_of
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


_Read = Callable[[UserHints], "Placed"]
_Write = Callable[[Survey, UserHints], None]


class _SupersededError(Exception):
    """Newer hints are waiting."""


@dataclass(frozen=True, eq=False)
class Answer:
    """Results of hints."""

    user_hints: UserHints
    cached: CachedScan
    label: NDArray[np.int8]  # (n,): 0 rock, 1 pedestal, 2 neither
    notes: tuple[str, ...]
    survey: Survey | None = None  # None until the hidden base is drawn


@dataclass(frozen=True, eq=False)
class Placed:
    """A cloud, and the transformation from its files' coordinates."""

    cloud: Cloud
    placement: Placement
    refused: bool = False  # whether it is only displayed, because of another up axis or unit

    @property
    def _metres_per_unit(self) -> Array:
        across, up = self.cloud.sources[0].metres_per_unit if self.cloud.sources else (1.0, 1.0)
        return np.array([across, across, up])

    def model(self, places_m: Array) -> Array:
        """Convert places in metres to the files' coordinates (n, 3)."""
        return self.placement.undo(places_m) / self._metres_per_unit

    def metres(self, places: Array) -> Array:
        """Convert places in the files' coordinates to metres (n, 3)."""
        return self.placement.apply(places * self._metres_per_unit)


class Picking:
    """A cloud with hints and their results.

    placed: cloud shown at first.
    read: reads the clouds as placed by hints.
    write: writes a survey with its hints.
    target: output folder, for display.
    user_hints: initial hints.
    answer: stored results of the initial hints, whose reduced cloud is not split again.
    """

    def __init__(
        self,
        placed: Placed,
        read: _Read,
        write: _Write,
        target: str,
        user_hints: UserHints,
        answer: Answer | None = None,
    ) -> None:
        self._read, self._write, self._target = read, write, target
        self._placed = placed
        self._placed_by = None if placed.refused else user_hints.of_the_cloud
        self._apart = Apart()
        self._folder = tempfile.TemporaryDirectory(prefix="toppling-pick-")
        self._stored: Stored | None = None
        self._error: dict[str, str] | None = None
        self._stage = "reading"
        self._changed = threading.Condition()
        self._number = 1
        self._user_hints = user_hints
        self._wanted, self._working, self._done = 1, 0, 0
        self._saving, self._saved, self._ended = False, 0, False
        self._initial, self._answer = answer, answer
        self._drawn: dict[UserHints, Answer] = {}  # results of the current split, for undoing hints
        if answer is not None and answer.survey is not None:
            self._drawn[user_hints] = answer
        self._candidates: list[dict[str, Any]] | None = None if answer is None else tops(answer.cached)
        self.view = view_of(placed.cloud.points_m, None if answer is None else answer.label, 0)

    # Requests of a page, from any thread.

    def set_hints(self, user_hints: UserHints) -> None:
        """Replace all hints."""
        self._set(_user_hints=user_hints, _wanted=self._wanted + 1, _error=None)

    def save(self) -> None:
        """Write the scene, once it is drawn."""
        self._set(_saving=True, _error=None)

    def end(self) -> None:
        """Stop working."""
        self._set(_ended=True)
        self._apart.end()

    def pick(self, at_m: Array, eye_m: Array) -> dict[str, list[float]]:
        """Point picked by a ray from the eye (3,) through a place (3,): survey coordinates, and those of its file."""
        cloud = self._known
        row = picked(cloud.points_m, at_m, eye_m, min(self.view.spacings_m))
        place = np.round(cloud.points_m[row] + cloud.origin_m, 4)
        return {"place_m": place.tolist(), "model": self._placed.model(place[None])[0].tolist()}

    def detail(self, middle_m: Array, reach_m: float) -> tuple[float, bytes]:
        """Spacing and packed points of a cube about a place (3,) of the cloud's frame, for drawing."""
        answer = self._answer
        return detail(self._known.points_m, None if answer is None else answer.label, middle_m, reach_m)

    def state(self) -> dict[str, Any]:
        """State without the points, for JSON."""
        with self._changed:
            answer, view, cloud, length = self._answer, self.view, self._known, self._user_hints.length
            state: dict[str, Any] = {
                "number": self._number,
                "origin_m": cloud.origin_m.tolist(),
                "points": len(cloud.points_m),
                "view": {"number": view.number, "counts": view.counts, "spacings_m": view.spacings_m},
                "units": list(METRES),
                "kinds": KINDS,
                "again": self._initial is not None,
                "placed": self._placed.placement.by.startswith("--gcp"),
                "hints": dataclasses.asdict(self._user_hints),
                "ends_m": None if length is None else self._placed.metres(np.array(length[:2])).tolist(),
                "stage": self._stage or ("starting" if self._done != self._wanted else ""),
                "error": self._error,
                "candidates": self._candidates,
                "saving": self._saving,
                "saved": self._saved,
                "target": self._target,
                "current": answer is not None
                and answer.user_hints == self._user_hints
                and answer.survey is not None,
                "answer": None,
            }
        if answer is not None:
            state["answer"] = answer_shown(answer.survey, answer.cached) | {"notes": answer.notes}
        return state

    def wait(self, number: int, seconds: float) -> None:
        """Wait until the state differs from that of a number, or for some time."""
        with self._changed:
            self._changed.wait_for(lambda: self._number != number or self._ended, seconds)

    # Work in a separate thread.

    def work(self) -> None:
        """Compute the results of hints until the end."""
        with self._folder:
            while True:
                with self._changed:
                    self._changed.wait_for(lambda: self._ended or self._saving or self._done != self._wanted)
                    if self._ended:
                        return
                    self._working, user_hints = self._wanted, self._user_hints
                    stale = self._done != self._working
                try:
                    self._follow(user_hints) if stale else self._store()
                    error = None
                except (_SupersededError, EndedError):
                    continue
                except Exception as failed:  # any error is shown by the page, which continues
                    error = _plain(failed)
                saving = self._saving and stale and error is None
                self._set(_done=self._working, _stage="", _saving=saving, _error=error)
                if self._candidates is None:  # rocks in the cloud, if the scan failed to find them
                    self._set(_stage="looking for what stands there")
                    with contextlib.suppress(EndedError):
                        found = self._apart.do(lambda _: None, look_around, self._cloud_apart())
                        self._set(_candidates=found, _stage="")

    def _follow(self, user_hints: UserHints) -> None:
        """Compute the results of hints, as far as they change."""
        inspection = user_hints.inspection()
        user_hints.hint()  # an invalid interface is refused first
        if self._placed_by != user_hints.of_the_cloud:
            self._place(user_hints)
        answer = self._answer
        if answer is None or answer.user_hints.of_the_split != user_hints.of_the_split:
            answer = self._split(user_hints)
        if user_hints not in self._drawn:
            result = dataclasses.replace(answer.cached, inspection=inspection)
            scene, cached = self._apart.do(self._note, draw, result)
            survey = Survey(scene, answer.label, answer.notes, cached)
            self._drawn[user_hints] = Answer(user_hints, cached, answer.label, answer.notes, survey)
        self._set(_answer=self._drawn[user_hints])

    def _split(self, user_hints: UserHints) -> Answer:
        """Split the cloud by hints, and update the view."""
        if self._initial is not None:
            raise InputError(
                "pick.needs_clouds",
                "this needs the clouds, of which the scan has stored only the rock's surroundings",
                where="--again",
                expected="hints on the base: touch, daylight, pull",
                remedy="take the hint back, or scan the clouds with --pick and --hints, the scene's hints.toml",
            )
        near = None if user_hints.near is None else (user_hints.near[0], user_hints.near[1])
        hints = near, user_hints.hint(), user_hints.inspection()
        registered, result, label, notes, view = self._apart.do(
            self._note, split, self._cloud_apart(), *hints, self.view.number + 1
        )
        self._placed = dataclasses.replace(self._placed, cloud=registered.cloud())
        answer = Answer(user_hints, result, label, notes)
        self._drawn.clear()
        self._set(_answer=answer, view=view, _candidates=self._candidates or tops(result))
        return answer

    def _cloud_apart(self) -> Stored:
        """Cloud stored for the other process."""
        if self._stored is None:
            folder = Path(self._folder.name) / str(self.view.number)
            self._stored = Stored.of(self._placed.cloud, folder)
            self._placed = dataclasses.replace(self._placed, cloud=self._stored.cloud())
        return self._stored

    def _place(self, user_hints: UserHints) -> None:
        """Read the clouds with new placement hints; all former results become invalid."""
        self._note("reading")
        placed = self._read(user_hints)
        self._drawn.clear()
        self._set(
            _placed=placed,
            _placed_by=user_hints.of_the_cloud,
            _stored=None,
            _answer=None,
            _candidates=None,
            view=view_of(placed.cloud.points_m, None, self.view.number + 1),
        )

    def _store(self) -> None:
        """Write the scene of the latest hints."""
        answer = self._answer
        if answer is None or answer.survey is None or answer.user_hints != self._user_hints:
            raise InputError(
                "pick.no_scene",
                "of these hints came no scene",
                where="saving",
                expected="hints of which a rock on its pedestal came",
                remedy="undo the last hint, or give others",
            )
        self._note("writing")
        self._write(answer.survey, answer.user_hints)
        self._saved += 1

    @property
    def _known(self) -> Cloud:
        return self._placed.cloud

    def _note(self, stage: str) -> None:
        """Report the stage, or stop if newer hints are waiting."""
        if self._ended or self._working != self._wanted:
            raise _SupersededError
        self._set(_stage=stage)

    def _set(self, **values: Any) -> None:
        with self._changed:
            for name, value in values.items():
                setattr(self, name, value)
            self._number += 1
            self._changed.notify_all()


def _plain(failed: Exception) -> dict[str, str]:
    """Error for the page; the traceback of an unexpected error is printed to the terminal."""
    names = ("what", "where", "expected", "remedy")
    if isinstance(failed, InputError):
        return {name: getattr(failed, name) for name in names}
    if not isinstance(failed, OSError):
        traceback.print_exception(failed)
    return dict.fromkeys(names, "") | {"what": f"{type(failed).__name__}: {failed}"}
