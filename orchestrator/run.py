"""A campaign carried out: planned, checked, its jobs shaken with the stages that it asks for."""

from collections.abc import Collection, Sequence
from contextlib import AbstractContextManager
from pathlib import Path

from distributed import Client

from toppling.orchestrator.campaign import Campaign
from toppling.orchestrator.context import Stage, Tally, Watcher
from toppling.orchestrator.dispatch import USUAL_LIMITS, Limits
from toppling.orchestrator.plan import plan_of
from toppling.orchestrator.session import Session
from toppling.orchestrator.stands import settled_scenes
from toppling.orchestrator.studies.conditioning import Weighing
from toppling.orchestrator.studies.precision import jobs_wanted
from toppling.workers.engines import ENGINES


def run(
    campaign: Campaign,
    folder: Path,
    cluster: AbstractContextManager[Client],
    watch: Watcher,
    limits: Limits = USUAL_LIMITS,
    again: Collection[str] = (),
    stages: Sequence[Stage] = (),
) -> Tally:
    """Carry a campaign out, or go on with it; the folder then holds `results.parquet`.

    Parameters
    ----------
    campaign : Campaign
    folder : Path
        The run's folder, made if absent.
    cluster, watch, limits, again
        As of :class:`toppling.orchestrator.session.Session`.
    stages : sequence of Stage
        Besides the weighing of bases, which a campaign asks for by itself.

    Returns
    -------
    Tally
        Of this session.

    Raises
    ------
    InputError
        If the campaign does not fit its scene, its ensemble or the folder, or workers are unfit for the run.
    RunError
        If the run cannot go on; what was done stays.
    """
    folder = folder.absolute()
    planned = plan_of(campaign)
    settled = {} if folder.exists() else settled_scenes(planned)
    ENGINES[campaign.engine].require()
    session = Session(cluster, watch, limits, again, [Weighing(), *stages], jobs_wanted)
    return session.carry_out(planned, folder, settled)
