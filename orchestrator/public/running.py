"""Planning and execution of campaigns."""

from __future__ import annotations

import os
from collections.abc import Collection
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pyarrow as pa

from toppling.models.caching import Described
from toppling.models.files.stores import at_hand, sole_writer
from toppling.models.motions.ensemble import Ensemble
from toppling.models.scene import Scene
from toppling.orchestrator.advice import shaking_warnings, warnings_of
from toppling.orchestrator.campaign import Campaign
from toppling.orchestrator.dispatch import USUAL_LIMITS, Limits
from toppling.orchestrator.plan import Plan, plan_of
from toppling.orchestrator.plan import plan as expand
from toppling.orchestrator.public import unseen
from toppling.orchestrator.rocks_of_run import Settling, Settlings, scene_entries, settlings_of
from toppling.orchestrator.run_folder import claimed
from toppling.results.reader import Run

if TYPE_CHECKING:
    from distributed import Client

    from toppling.orchestrator.context import ProgressCallback, RunProgress


@dataclass(frozen=True, eq=False, repr=False)
class Planned(Described):
    """Planned campaign: its jobs and warnings.

    Parameters
    ----------
    campaign : Campaign
    plan : Plan
    scene : Scene or None
        None for many rocks.
    settling : Settling or None
        Settling of the rock with the friction for which it tilts most; None for many rocks.
    warnings : list of str
        Probable mistakes.
    rocks : dict
        For many rocks: `scenes`, an entry for each, and `left_out`, those that cannot be read.
    """

    campaign: Campaign
    plan: Plan
    scene: Scene | None
    settling: Settling | None
    warnings: list[str]
    rocks: dict[str, Any] = field(default_factory=dict)

    @property
    def jobs(self) -> pa.Table:
        """Rows of the jobs: id, record, level (m/s2), azimuth (degrees), friction, restitution and realisation."""
        return self.plan.jobs

    def _facts(self) -> dict[str, object]:
        rocks, warnings = len(self.plan.scenes), "; ".join(self.warnings) or "none"
        return {"jobs": len(self.plan), "rocks": rocks, "preset": self.campaign.preset, "warnings": warnings}


def plan(campaign: Campaign | str | Path) -> Planned:
    """Check a campaign against its scene and ensemble and expand it to its jobs, as `toppling plan` does.

    Parameters
    ----------
    campaign : Campaign or path
        A file in TOML, or what was read from it.

    Raises
    ------
    InputError
        If the campaign does not fit its scene or its ensemble, or the rock does not stand by itself.
    """
    chosen = campaign if isinstance(campaign, Campaign) else Campaign.read(campaign)
    if chosen.sites:
        planned = plan_of(chosen)
        entries = scene_entries(planned, settlings_of(planned))
        problems = [f"{scene['rock']}: {scene['problem']}" for scene in entries["scenes"] if scene["problem"]]
        problems += [f"{rock['rock']} is left out: {rock['why']}" for rock in entries["left_out"]]
        return Planned(chosen, planned, None, None, problems, entries)
    scene, ensemble = Scene.load(chosen.scene), Ensemble.load(chosen.ensemble)
    planned = expand(chosen, scene, ensemble)
    settling = Settlings.of(chosen, scene).checked()
    warnings = warnings_of(chosen, scene) + shaking_warnings(chosen, ensemble)
    return Planned(chosen, planned, scene, settling, warnings)


class FinishedRun(Run):
    """A run, open for reading, after a session that has finished.

    Parameters
    ----------
    path : Path
        The run's folder; for a run in an object store, its local copy.
    session : RunProgress
        Progress of this session.
    """

    def __init__(self, path: Path, session: RunProgress) -> None:
        super().__init__(path)
        self.session = session


def run(
    campaign: Campaign | str | Path,
    out: str | Path,
    *,
    cluster: Client | AbstractContextManager[Client] | str | None = None,
    workers: int | None = None,
    watch: ProgressCallback = unseen,
    limits: Limits = USUAL_LIMITS,
    again: Collection[str] = (),
    take_over: bool = False,
) -> FinishedRun:
    """Execute or resume a campaign, including its audit, as `toppling run` does.

    Parameters
    ----------
    campaign : Campaign or path
    out : path
        The run's folder: a new one, or one of this campaign to resume. For an address in an object store, such as
        ``s3://bucket/run``, a local copy is written, and uploaded every few seconds and at the end.
    cluster : Dask client, context manager of one, address of a scheduler, or None
        Where the jobs run, such as ``"tcp://host:8786"``, ``Client(address)`` or ``cluster.get_client()`` of Dask
        Gateway, Kubernetes or Coiled; processes of this machine unless given.
    workers : int or None
        Number of local processes; one per core unless given.
    watch : callable
        Called often with the progress of the session.
    limits : Limits
        Limits beyond which a job is given up.
    again : collection of str
        Statuses whose jobs are repeated, such as ``{"failed"}``.
    take_over : bool
        Go on with a run in an object store although another process, which was killed, still holds it.

    Raises
    ------
    InputError
        If the campaign does not fit its scene, its ensemble or the folder, workers are unfit for the run, or the
        store does not answer or is written to by another process.
    RunError
        If the run cannot continue; stored rows are kept, and the same call resumes it.
    """
    from toppling.orchestrator.cluster import existing, local
    from toppling.orchestrator.run import run as execute

    chosen = campaign if isinstance(campaign, Campaign) else Campaign.read(campaign)
    folder = at_hand(out)
    given = existing(cluster) if isinstance(cluster, str) else cluster
    where = given if given is not None else local(workers or os.cpu_count() or 1)
    with sole_writer(folder, take_over=take_over) as check_writer, claimed(folder.absolute()):

        def watching(progress: RunProgress) -> None:
            check_writer()
            watch(progress)

        session = execute(plan_of(chosen), folder, where, watching, limits, again)
    return FinishedRun(folder, session)
