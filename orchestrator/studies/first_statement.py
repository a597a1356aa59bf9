"""A first statement before the maps: some of a run's jobs chosen as for a precision, then all the others."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from toppling.orchestrator.context import Work
from toppling.orchestrator.plan import Plan
from toppling.orchestrator.session import work_off
from toppling.orchestrator.studies.precision import JobsForPrecision
from toppling.results.store import result_files


@dataclass(frozen=True)
class FirstStatement:
    """The rounds that come before a run's other jobs."""

    precision: float  # half of the interval of 95 % at which they end
    most_jobs: int  # after which they end however wide it is
    say: Callable[[str], None]  # told the sentence
    before: bool = True

    def due(self, planned: Plan, folder: Path) -> bool:  # noqa: ARG002
        """Whether no job has been done yet: later there is no first statement."""
        return not result_files(folder)

    def carry_out(self, work: Work) -> None:
        """Shake the rounds, and say what they tell."""
        wanted = JobsForPrecision(
            work.planned, work.folder, self.precision, alone=False, most_jobs=self.most_jobs
        )
        work_off(wanted, work)
        for one in wanted.statements:
            self.say(one.get("words", one["sentence"]))
