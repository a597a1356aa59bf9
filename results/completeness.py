"""How much of a run has been done, said first wherever an unfinished one is read."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Completeness:
    """Jobs that a run was begun with, and those that have run."""

    planned: int | None  # None where the run does not say, as one that is no whole folder
    done: int  # jobs with a row, whatever its status
    stored: int = 0  # rows that a session said it had stored

    @property
    def left(self) -> int:
        """Jobs that have not run; 0 where it is not known how many there are."""
        return max((self.planned or 0) - self.done, 0)

    @property
    def remark(self) -> str:
        """What an unfinished run has to say of itself; empty for a finished one.

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
    """Rows that a session of a run had stored when it ended, the most of all, by its `run.json`."""
    counts = [one.get("done") for one in document.get("sessions") or ()]
    return max((count for count in counts if type(count) is int), default=0)
