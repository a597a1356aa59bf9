"""What a run's folder says of its rocks: which, where they stand, how they settle, and which do not stand."""

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from toppling.models.errors import InputError
from toppling.orchestrator.plan import Plan, PlannedScene
from toppling.orchestrator.sites import Site
from toppling.orchestrator.task import lost_row


def site_in_run(scene: PlannedScene) -> Site:
    """A rock's row of the table that a run keeps."""
    assert scene.site is not None
    own = None if scene.ensemble_place == "ensemble" else Path(scene.ensemble_place)
    return dataclasses.replace(scene.site, scene=Path(scene.scene_place), ensemble=own, seismograms=None)


def rows_without_stand(plan: Plan) -> Iterator[dict[str, Any]]:
    """Rows of the jobs on rocks that do not stand."""
    unstable = {one.scene_id: one for one in plan.scenes if one.settlings.problems}
    for row in range(len(plan)) if unstable else ():
        spec = plan.spec(row)
        scene = unstable.get(spec.scene_id)
        if scene and isinstance(
            why := scene.settlings.with_friction[spec.friction_static, spec.friction_kinetic], InputError
        ):
            yield {**lost_row(spec, "failed", str(why)), "rock": scene.rock, "attempt": 1}


def scene_entries(plan: Plan) -> dict[str, Any]:
    """What `run.json` says of how rocks settle, and of each of many, of which some may not stand.

    Raises InputError if the only rock does not stand.
    """
    largest = [one.settlings.largest for one in plan.scenes]
    settling = [one and one.to_json() for one in largest]
    if not plan.campaign.sites:
        plan.scenes[0].settlings.checked()
        return {"settling": settling[0]}
    entries = [
        _scene_entry(one) | {"jobs": jobs, "settling": settles}
        for one, jobs, settles in zip(plan.scenes, plan.jobs_of_scenes, settling, strict=True)
    ]
    left_out = [{"rock": rock, "why": why} for rock, why in plan.left_out]
    return {"settling": None, "scenes": entries, "left_out": left_out}


def _scene_entry(scene: PlannedScene) -> dict[str, Any]:
    site = scene.site
    assert site is not None
    problems = "; ".join(map(str, scene.settlings.problems))
    ids = {"rock": site.rock, "scene_id": scene.scene_id, "ensemble_id": scene.ensemble_id}
    location = {"site": site.site, "longitude": site.longitude, "latitude": site.latitude, "age": site.age}
    return {**ids, "ensemble": scene.ensemble_place, **location, "problem": problems or None}
