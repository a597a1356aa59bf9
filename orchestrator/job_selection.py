"""Which of a run's jobs are wanted: all of its plan, unless something else chooses among them."""

from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from toppling.orchestrator.folder import set_jobs
from toppling.orchestrator.plan import Plan

Rows = NDArray[np.int64]


class JobSelection(Protocol):
    """The jobs that a run is to have rows of."""

    @property
    def what(self) -> str:
        """Is being done, for a person who watches."""

    def pending(self, finished: set[str]) -> Rows:
        """Rows of the plan to shake next, in the order to start them; none once all that is wanted is finished."""

    def total(self) -> int:
        """Number of jobs in all, as far as known."""


class AllJobs:
    """Every job of a plan.

    Parameters
    ----------
    folder : Path
        The run's: a run that was to end with a statement may go on to all of its jobs.
    """

    what = "shaking"

    def __init__(self, planned: Plan, folder: Path) -> None:
        self.planned = planned
        set_jobs(folder, len(planned))

    def pending(self, finished: set[str]) -> Rows:
        """As of `JobSelection`."""
        return self.planned.pending(finished)

    def total(self) -> int:
        """As of `JobSelection`."""
        return len(self.planned)


Choose = Callable[[Plan, Path], JobSelection]
"""The jobs wanted of a plan in a run's folder."""
