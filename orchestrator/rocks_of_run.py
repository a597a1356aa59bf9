"""What a run's folder says of its rocks: which, where they stand, how they settle, and which do not stand."""

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from toppling.models.errors import InputError
from toppling.models.settling import Settling
from toppling.orchestrator.plan import Plan, PlannedScene, Settled
from toppling.orchestrator.sites import Site
from toppling.orchestrator.task import lost_row
from toppling.results.run_integrity import SITES_FILE


def scene_or_sites(plan: Plan) -> str:
    """What the campaign in a run's folder names: its scene, or its table of rocks."""
    return SITES_FILE if plan.campaign.sites else "scene"


def site_in_run(scene: PlannedScene) -> Site:
    """A rock's row of the table that a run keeps."""
    assert scene.site is not None
    own = None if scene.ensemble_place == "ensemble" else Path(scene.ensemble_place)
    return dataclasses.replace(scene.site, scene=Path(scene.scene_place), ensemble=own, seismograms=None)


def rows_without_stand(plan: Plan) -> Iterator[dict[str, Any]]:
    """Rows of the jobs on rocks that do not stand."""
    problems = {key: str(one) for key, one in plan.settled.items() if isinstance(one, InputError)}
    names = {one.scene_id: one.rock for one in plan.scenes}
    for row in range(len(plan)) if problems else ():
        spec = plan.spec(row)
        if why := problems.get((spec.scene_id, spec.friction_static, spec.friction_kinetic)):
            yield {**lost_row(spec, "failed", why), "rock": names[spec.scene_id], "attempt": 1}


def scene_entries(plan: Plan) -> dict[str, Any]:
    """What `run.json` says of how rocks settle, and of each of many."""

    def most(scene_id: str) -> dict[str, Any] | None:
        known = plan.settled.items()
        found = [one for (name, *_), one in known if name == scene_id and isinstance(one, Settling)]
        return max(found, key=lambda one: one.tilt_deg).to_json() if found else None

    if not plan.campaign.sites:
        return {"settling": most(plan.scene_id)}
    entries = [
        _scene_entry(one, plan.settled) | {"jobs": jobs, "settling": most(one.scene_id)}
        for one, jobs in zip(plan.scenes, plan.jobs_of_scenes, strict=True)
    ]
    left_out = [{"rock": rock, "why": why} for rock, why in plan.left_out]
    return {"settling": None, "scenes": entries, "left_out": left_out}


def _scene_entry(scene: PlannedScene, settled: Settled) -> dict[str, Any]:
    site, of_scene = scene.site, [one for (name, *_), one in settled.items() if name == scene.scene_id]
    assert site is not None
    problems = "; ".join(str(one) for one in of_scene if isinstance(one, InputError))
    ids = {"rock": site.rock, "scene_id": scene.scene_id, "ensemble_id": scene.ensemble_id}
    location = {"site": site.site, "longitude": site.longitude, "latitude": site.latitude, "age": site.age}
    return {**ids, "ensemble": scene.ensemble_place, **location, "problem": problems or None}
