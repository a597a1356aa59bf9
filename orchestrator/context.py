"""Common state of a running session: plan, cluster, progress, and the protocol of job selections."""

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
from toppling.orchestrator.task import RunKey, process_name


class RunError(RuntimeError):
    """The run cannot continue; stored rows are kept, and the same command resumes it."""


@dataclass
class RunProgress:
    """Progress of a run."""

    total: int  # jobs of the plan
    before: int  # jobs with a row when this session began, except those to repeat
    what: str = "shaking"  # current activity
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
        """Time from the submission of the session's first job to the return of its last, s."""
        return (time.monotonic() if self.ended is None else self.ended) - self.began

    @property
    def rate(self) -> float:
        """Jobs per second in this session."""
        return self.done / self.elapsed_s

    @property
    def work_left_s(self) -> float:
        """Remaining work of a single process at the mean cost so far, s; 0 before the first job."""
        left = max(self.total - self.before - self.done, 0)
        return left * self.work_s / self.done if self.done else 0.0

    @property
    def failed(self) -> int:
        """Number of jobs of this session without an answer."""
        return self.done - self.status["ok"]

    def summary(self) -> dict[str, Any]:
        """State for JSON."""
        names = ("done", "stored", "total", "toppled", "failed", "workers", "deaths")
        return {**{name: getattr(self, name) for name in names}, "elapsed_s": round(self.elapsed_s, 1)}

    def count(self, rows: pa.Table) -> None:
        """Count rows, a table with `results.schema.SCHEMA`."""
        self.done += len(rows)
        self.status.update(rows["status"].to_pylist())
        self.toppled += pc.sum(rows["toppled"]).as_py() or 0
        self.work_s += pc.sum(rows["wall_s"]).as_py() or 0.0


ProgressCallback = Callable[[RunProgress], None]
"""Receives a run's state; called often, so it must return immediately."""


@dataclass(frozen=True)
class Work:
    """Context of a running session for its jobs, weights and audits."""

    planned: Plan
    folder: Path  # the run's folder
    versions: tuple[tuple[str, str], ...]  # required of workers, from `task.versions`
    client: Client
    watch: ProgressCallback
    progress: RunProgress  # progress of the plan's jobs, updated in place
    limits: Limits = USUAL_LIMITS
    # Jobs to repeat although they have a row, with the number of their newest attempt.
    redo: Mapping[str, int] = field(default_factory=dict)
    store: Path | None = None  # folder for rows; the run's folder unless given

    @cached_property
    def run_keys(self) -> list[RunKey]:
        """Run key of each scene, which a worker checks before it does jobs."""
        return [
            RunKey(
                str(self.folder), rock.scene_id, rock.ensemble_id, self.versions, rock.scene_place, rock.ensemble_place,
                process_name(), self.limits.job_s,
            )
            for rock in self.planned.scenes
        ]  # fmt: skip


@dataclass(frozen=True)
class Answer:
    """Result of a batch."""

    key: str
    # "rows"; "died" or "left" if the worker died or was asked to leave; "undelivered" or "unfit" if it lacks assets
    # or cannot work; "cancelled"; "error" for any other exception.
    kind: str
    value: Any = None  # the rows, or the exception
    worker: str = ""  # address of the worker, where needed


class JobSelection(Protocol):
    """Selection of the jobs that a run does; a plan selects all of its jobs."""

    @property
    def what(self) -> str:
        """Description of the current activity for progress displays."""

    def pending(self, finished: set[str]) -> Rows:
        """Rows of the plan to shake next, in the order to start them; empty when the selection is complete."""

    def __len__(self) -> int:
        """Total number of jobs, as far as known."""
