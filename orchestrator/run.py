"""A plan carried out: its jobs shaken, with the stages that it asks for."""

from collections.abc import Collection, Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

from distributed import Client

from toppling.orchestrator.campaign import Campaign
from toppling.orchestrator.context import ProgressCallback, RunProgress, Stage
from toppling.orchestrator.dispatch import USUAL_LIMITS, Limits
from toppling.orchestrator.plan import Plan, plan_of
from toppling.orchestrator.session import Session
from toppling.orchestrator.studies.conditioning import Weighing
from toppling.orchestrator.studies.precision import select_jobs
from toppling.workers.engines import ENGINES


def run(
    planned: Plan,
    folder: Path,
    cluster: AbstractContextManager[Client],
    watch: ProgressCallback,
    limits: Limits = USUAL_LIMITS,
    again: Collection[str] = (),
    stages: Sequence[Stage] = (),
) -> RunProgress:
    """Carry a plan out, or go on with it, as :meth:`toppling.orchestrator.session.Session.carry_out`.

    A new run begins with a look at how its rocks settle, and with a weighing of bases where the campaign asks for it.

    Raises
    ------
    InputError
        If a rock does not stand, the folder is of another campaign, or workers are unfit for the run.
    RunError
        If the run cannot go on; what was done stays.
    """
    ENGINES[planned.campaign.engine].require()
    session = Session(cluster, watch, limits, again, [Weighing(shake_alone), *stages])
    return session.carry_out(planned, folder.absolute(), select_jobs(planned, folder.absolute()))


def shake_alone(
    campaign: Campaign, folder: Path, client: Client, watch: ProgressCallback, limits: Limits = USUAL_LIMITS
) -> RunProgress:
    """Carry a campaign out, or go on with it, on workers at hand and without stages."""
    return Session(nullcontext(client), watch, limits).carry_out(plan_of(campaign), folder.absolute())
