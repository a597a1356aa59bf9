"""What the parts of a run share while it is at work: its plan, who shakes, who watches, how far it has come."""

import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import pyarrow as pa
import pyarrow.compute as pc
from distributed import Client

from toppling.orchestrator.dispatch import USUAL_LIMITS, Limits
from toppling.orchestrator.plan import Plan, Rows
from toppling.orchestrator.task import RunKey


class RunError(RuntimeError):
    """The run cannot go on; what is stored stays, and the same command resumes."""


@dataclass
class RunProgress:
    """How far a run has come."""

    total: int  # jobs of the plan
    before: int  # jobs that had a row when this session began, those to be done again aside
    again: int = 0  # jobs to be done again whose new row is not stored yet
    what: str = "shaking"  # what is being done
    done: int = 0
    stored: int = 0
    toppled: int = 0
    workers: int = 0
    deaths: int = 0
    work_s: float = 0.0
    status: Counter[str] = field(default_factory=Counter)
    began: float = field(default_factory=time.monotonic)
    ended: float | None = None

    @property
    def elapsed_s(self) -> float:
        """Time since the session's first job went out, until its last came back."""
        return (time.monotonic() if self.ended is None else self.ended) - self.began

    @property
    def rate(self) -> float:
        """Jobs a second in this session."""
        return self.done / self.elapsed_s

    @property
    def left_s(self) -> float | None:
        """Time left at the rate so far: jobs go out in balanced blocks, so that those left cost as those done."""
        return self._left / self.rate if self.done else None

    @property
    def work_left_s(self) -> float:
        """Work of one process that is left, at the mean of the jobs so far; 0 before the first."""
        return self._left * self.work_s / self.done if self.done else 0.0

    @property
    def _left(self) -> int:
        return max(self.total - self.before - self.done, 0)

    @property
    def failed(self) -> int:
        """Jobs of this session that have no answer."""
        return self.done - self.status["ok"]

    def summary(self) -> dict[str, Any]:
        """State in words that a program reads."""
        names = ("done", "stored", "total", "again", "toppled", "failed", "workers", "deaths")
        return {**{name: getattr(self, name) for name in names}, "elapsed_s": round(self.elapsed_s, 1)}

    def count(self, rows: pa.Table) -> None:
        """Add rows, a table under `results.schema.SCHEMA`."""
        self.done += len(rows)
        self.status.update(rows["status"].to_pylist())
        self.toppled += pc.sum(rows["toppled"]).as_py() or 0
        self.work_s += pc.sum(rows["wall_s"]).as_py() or 0.0


ProgressCallback = Callable[[RunProgress], None]
"""Takes note of a run's state: called often, it must return at once."""


@dataclass(frozen=True)
class Work:
    """A run at work: what its jobs and stages share."""

    planned: Plan
    folder: Path  # the run's
    versions: tuple[tuple[str, str], ...]  # that workers must have, as of `task.versions`
    client: Client
    watch: ProgressCallback
    progress: RunProgress  # of the jobs of the plan; counted on
    limits: Limits = USUAL_LIMITS
    # Jobs that have a row already and are done again, each with the number of its newest attempt.
    redo: Mapping[str, int] = field(default_factory=dict)
    store: Path | None = None  # where rows go; the run's folder unless given

    @cached_property
    def run_keys(self) -> list[RunKey]:
        """What a worker must find before it does jobs of each scene."""
        return [
            RunKey(
                str(self.folder), one.scene_id, one.ensemble_id, self.versions, one.scene_place, one.ensemble_place
            )
            for one in self.planned.scenes
        ]  # fmt: skip


@dataclass(frozen=True)
class Answer:
    """What came back of a batch."""

    key: str
    # "rows"; of a worker that died or was told to leave "died", "left"; of one that lacks what it needs or cannot work
    # "undelivered", "unfit"; "cancelled"; "error" of any other.
    kind: str
    value: Any = None  # the rows, or the error
    worker: str = ""  # its address, where it matters


class JobSelection(Protocol):
    """The jobs that a run is to have rows of: a plan is the selection of all of its own."""

    @property
    def what(self) -> str:
        """Is being done, for a person who watches."""

    def pending(self, finished: set[str]) -> Rows:
        """Rows of the plan to shake next, in the order to start them; none once all that is wanted is finished."""

    def __len__(self) -> int:
        """Number of jobs in all, as far as known."""


class Stage(Protocol):
    """What is done before or after the jobs of a run, on the same workers."""

    @property
    def before(self) -> bool:
        """Whether it comes before them."""

    def due(self, planned: Plan, folder: Path) -> int:
        """Whether (or how much) there is to do now; asked again once the jobs are done."""

    def carry_out(self, work: Work) -> None:
        """Do it, or go on with it."""
