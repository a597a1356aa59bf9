"""A rock that stood a recorded shaking tells of its base: each draw of it is shaken with the recorded motion.

The shakes are campaigns like any other, each motion as strong and as oriented as it was recorded. Their realisations
draw the bases, and friction and what else nobody measured beside them, as those of the run do. What they say is
arithmetic: `results.stood`.
"""

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import pandas as pd
from distributed import Client

from toppling.models.scene import Scene
from toppling.orchestrator.campaign import Campaign
from toppling.orchestrator.context import Tally, Watcher, Work
from toppling.orchestrator.dispatch import USUAL_LIMITS, Limits
from toppling.orchestrator.journal import tell
from toppling.orchestrator.plan import Plan, plan_of
from toppling.orchestrator.recorded import (
    AZIMUTHS_DEG,
    ENSEMBLES,
    SHAKES,
    Recorded,
    check_weighable,
    ensembles_in,
)
from toppling.orchestrator.session import Session
from toppling.results.run import open_run
from toppling.results.stood import FILE, FOLDER, Stood, weights_of

Shake = Callable[[Campaign, Path], object]
"""Carries a campaign out in a folder."""


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
    """Weigh the draws of a base by the motions that the rock is known to have stood (`orchestrator.recorded`).

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
    return _weigh_bases(campaign, recorded, place, shake, plan_id)


def _weigh_bases(
    campaign: Campaign, recorded: Recorded, place: Path, shake: Shake, plan_id: str | None = None
) -> Stood:
    """Shake every draw of the base with what the rock stood, and weigh the draws by it; goes on where it was stopped.

    Parameters
    ----------
    campaign : Campaign
        Whose contacts, engine, preset and unmeasured the shakes have.
    recorded : Recorded
        As `Recorded.write` wrote it to the folder.
    place : Path
        Where the shakes go, and `weights.json` once they are done.
    shake : callable
    plan_id : str or None
        Of the run that the weights are for.

    Raises
    ------
    InputError
        If a motion gets no answer, as where the engine refuses to shake this rock.
    """
    scene = Scene.load(campaign.scene)
    check_weighable(scene, 1, str(campaign.scene))
    assert scene.unseen is not None
    rows = []
    for ensemble in ensembles_in(place):
        known = ensemble.parent.name == ENSEMBLES[0]
        one = replace(
            campaign,
            ensemble=ensemble,
            pga_m_s2=(),
            azimuth_deg=() if known else AZIMUTHS_DEG,
            realisations=len(scene.unseen) * (SHAKES if known else 1),
            first_realisation=1,
            records=None,
            peak_displacement_m=None,
            audit=0,
            stood=(),
            precision=None,
            target=None,
        )
        shake(one, ensemble.parent / "run")
        rows.append(open_run(ensemble.parent / "run").frame())
    stood = Stood(recorded.motions, SHAKES, weights_of(pd.concat(rows), len(scene.unseen)))
    stood.write(place / FILE, plan_id)
    return stood
