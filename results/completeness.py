"""Progress of a run, reported first wherever an unfinished run is read."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Completeness:
    """Numbers of planned, done and stored jobs of a run."""

    planned: int | None  # None where unknown, as in an incomplete folder
    done: int  # jobs with a row of any status
    stored: int = 0  # rows stored according to `run.json`

    @property
    def left(self) -> int:
        """Number of jobs that have not run; 0 where the planned number is unknown."""
        return max((self.planned or 0) - self.done, 0)

    @property
    def remark(self) -> str:
        """Remark on an unfinished run; empty for a finished one.

        Examples
        --------
        >>> Completeness(4320, 1602).remark
        '2,718 of 4,320 jobs have not run'
        >>> Completeness(4320, 0, stored=4320).remark
        '4,320 of 4,320 jobs have no row here, and 4,320 were stored: the folder was not copied whole'
        """
        if not self.left:
            return ""
        jobs = f"{self.left:,} of {self.planned:,} jobs {'has' if self.left == 1 else 'have'}"
        if self.stored <= self.done:
            return f"{jobs} not run"
        return f"{jobs} no row here, and {self.stored:,} were stored: the folder was not copied whole"


def rows_stored(document: Mapping[str, Any]) -> int:
    """Largest number of rows that a session of a run had stored when it ended, from `run.json`."""
    counts = [session.get("done") for session in document.get("sessions") or ()]
    return max((count for count in counts if type(count) is int), default=0)
