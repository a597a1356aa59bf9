"""Entries of a run's folder on its rocks: their sites, settling, and those that do not stand."""

import dataclasses
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from toppling.models.contact import ContactProperties
from toppling.models.errors import InputError
from toppling.models.scene import Scene
from toppling.models.settling import Settling
from toppling.orchestrator.campaign import Campaign
from toppling.orchestrator.plan import Plan, PlannedScene
from toppling.orchestrator.site_table import Site
from toppling.workers.seating import settled


class Settlings(dict[tuple[float, float], Settling | InputError]):
    """Settling of a nominal rock for each friction, static and kinetic, or the reason why it does not stand."""

    @classmethod
    def of(cls, campaign: Campaign, scene: Scene) -> "Settlings":
        """Settle the rock with each friction of a campaign."""
        found = cls()
        for static, kinetic in sorted(set(campaign.friction)):
            try:
                stands = settled(scene.with_contact(ContactProperties.of((static, kinetic))))
                found[static, kinetic] = Settling.between(scene.rock, stands.rock, scene.pedestal.normal)
            except InputError as error:
                what = f"with friction {static:g}: {error.what}"
                found[static, kinetic] = InputError(
                    error.code, what, where=str(campaign.scene), expected=error.expected, remedy=error.remedy
                )
        return found

    @property
    def problems(self) -> list[InputError]:
        """Reasons why the rock does not stand."""
        return [found for found in self.values() if isinstance(found, InputError)]

    def checked(self) -> Settling | None:
        """Largest settling; InputError if the rock does not stand with every friction, which every job would repeat."""
        for problem in self.problems:
            raise problem
        return self.largest

    @property
    def largest(self) -> Settling | None:
        """Settling with the largest tilt; None if the rock stands with no friction."""
        stands = [found for found in self.values() if isinstance(found, Settling)]
        return max(stands, key=lambda settling: settling.tilt_deg, default=None)


def settlings_of(plan: Plan) -> list[Settlings]:
    """Settling of each rock of a plan."""
    return [Settlings.of(scene.campaign, Scene.load(scene.campaign.scene)) for scene in plan.scenes]


def site_in_run(scene: PlannedScene) -> Site:
    """Row of a rock in the run's table of rocks."""
    assert scene.site is not None
    own = None if scene.ensemble_place == "ensemble" else Path(scene.ensemble_place)
    return dataclasses.replace(scene.site, scene=Path(scene.scene_place), ensemble=own, seismograms=None)


def rows_without_stand(plan: Plan, settlings: Sequence[Settlings]) -> Iterator[dict[str, Any]]:
    """Rows of the jobs on rocks that do not stand."""
    from toppling.orchestrator.task import lost_row  # with Dask

    unstable = {
        scene.scene_id: (scene.rock, settles)
        for scene, settles in zip(plan.scenes, settlings, strict=True)
        if settles.problems
    }
    for row in range(len(plan)) if unstable else ():
        spec = plan.spec(row)
        rock, settlings_here = unstable.get(spec.scene_id, (None, Settlings()))
        why = settlings_here.get((spec.friction_static, spec.friction_kinetic))
        if isinstance(why, InputError):
            yield {**lost_row(spec, "failed", str(why)), "rock": rock, "attempt": 1}


def scene_entries(plan: Plan, settlings: Sequence[Settlings]) -> dict[str, Any]:
    """Entries of `run.json` on the settling of a single rock, or on each rock of an atlas.

    Raises InputError if a single rock does not stand.
    """
    largest = [rock.largest and rock.largest.to_json() for rock in settlings]
    if not plan.campaign.sites:
        settlings[0].checked()
        return {"settling": largest[0]}
    counts = np.bincount(plan.columns["scene_id"], minlength=len(plan.scenes)).tolist()
    entries = []
    for scene, settles, jobs, most in zip(plan.scenes, settlings, counts, largest, strict=True):
        site = scene.site
        assert site is not None
        entries.append({
            "rock": site.rock, "scene_id": scene.scene_id, "ensemble_id": scene.ensemble_id,
            "ensemble": scene.ensemble_place, "site": site.site, "longitude": site.longitude,
            "latitude": site.latitude, "age": site.age, "problem": "; ".join(map(str, settles.problems)) or None,
            "jobs": jobs, "settling": most,
        })  # fmt: skip
    left_out = [{"rock": rock, "why": why} for rock, why in plan.left_out]
    return {"settling": None, "scenes": entries, "left_out": left_out}
