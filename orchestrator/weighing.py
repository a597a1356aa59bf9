"""A campaign's bases are weighed before its jobs, by the motions that it knows the rock to have stood."""

from contextlib import nullcontext
from pathlib import Path

from distributed import Client

from toppling.orchestrator.campaign import Campaign
from toppling.orchestrator.context import Tally, Watcher, Work
from toppling.orchestrator.dispatch import USUAL_LIMITS, Limits
from toppling.orchestrator.journal import tell
from toppling.orchestrator.plan import Plan, plan_of
from toppling.orchestrator.session import Session
from toppling.orchestrator.stood import Recorded, weigh_bases
from toppling.results.stood import FILE, FOLDER, Stood


class Weighing:
    """Bases are weighed, before the jobs, by the motions that the campaign knows the rock to have stood."""

    before = True

    def due(self, planned: Plan, folder: Path) -> bool:
        """Whether there are such motions, and no weights yet; damaged ones are told before work is done."""
        if not planned.recorded:
            return False
        if (folder / FOLDER / FILE).exists():
            Stood.read(folder / FOLDER / FILE)
            return False
        return True

    def carry_out(self, work: Work) -> None:
        """Weigh them."""
        planned = work.planned
        assert planned.recorded is not None
        weigh(
            planned.campaign, planned.recorded, work.folder / FOLDER, work.client, work.watch, work.limits,
            planned.id,
        )  # fmt: skip


def weigh(
    campaign: Campaign,
    recorded: Recorded,
    place: Path,
    client: Client,
    watch: Watcher,
    limits: Limits = USUAL_LIMITS,
    plan_id: str | None = None,
) -> Stood:
    """Weigh the draws of a base by the motions that the rock is known to have stood (`orchestrator.stood`).

    Raises
    ------
    InputError, RunError
        As :func:`toppling.orchestrator.run.run`, and if a motion gets no answer.
    """

    def weighing(tally: Tally) -> None:
        tally.what = "shaking each base with what the rock stood"
        watch(tally)

    def shake(one: Campaign, target: Path) -> None:
        Session(nullcontext(client), weighing, limits).carry_out(plan_of(one), target.absolute())

    tell("weighing the bases", records=[one.record_id for one in recorded.records])
    return weigh_bases(campaign, recorded, place, shake, plan_id)
