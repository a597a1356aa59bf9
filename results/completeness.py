"""How much of a run has been done, said first wherever an unfinished one is read."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Completeness:
    """Jobs that a run was begun with, and those that have run."""

    planned: int | None  # None where the run does not say, as one that is no whole folder
    done: int  # jobs with a row, whatever its status

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
        """
        if not self.left:
            return ""
        return f"{self.left:,} of {self.planned:,} jobs {'has' if self.left == 1 else 'have'} not run"
