"""Small campaigns of a block under pulses, for tests of plans and of runs."""

import json

from reference.idealised import ricker

from toppling.models.files.digest import write_json
from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.record import Record
from toppling.models.scene import Scene
from toppling.orchestrator.campaign import Campaign
from toppling.orchestrator.plan import plan_of
from toppling.results.reader import open_run
from toppling.results.run_integrity import SCHEMA_VERSION, digests_of
from toppling.results.store import write_part
from toppling.workers.engines import DEFAULT, ENGINES

VERSIONS = {"toppling": "0.1", "physics": "1"}


def campaign_in(folder, periods_s=(0.6, 1.0), scene=None, name="P{}", **axes):
    """The campaign of `campaign.toml`, beside its scene and its records P0, P1, ..."""
    (Scene.block(0.15, 0.2, 0.6) if scene is None else scene).save(folder / "scene")
    pulses = [Record.of(name.format(n), ricker(2.0, s, 0.01), event=f"E{n}") for n, s in enumerate(periods_s)]
    Ensemble.write(folder / "ensemble", pulses)
    content = {"scene": "scene", "ensemble": "ensemble", "azimuth_deg": [0, 90], "friction": [0.9], **axes}
    lines = [f"{key} = {json.dumps(value)}\n" for key, value in content.items()]
    (folder / "campaign.toml").write_text("".join(lines))
    return Campaign.read(folder / "campaign.toml")


def run_document(**changes):
    """Content of a `run.json`, with changes."""
    ids = {"plan_id": "plan", "rock": "rock", "scene_id": "scene", "ensemble_id": "ensemble"}
    counts = {"schema_version": SCHEMA_VERSION, "jobs": 3, "sessions": [], "files": {}, "settling": None}
    made = {"created_at": "2026", "versions": VERSIONS, "engine": ENGINES[DEFAULT].citation}
    return {**ids, **counts, **made, **changes}


def run_in(folder, rows, **changes):
    """A run of one rock with some rows, in a folder that may hold its scene and ensemble."""
    folder.mkdir(parents=True, exist_ok=True)
    write_json(folder / "run.json", run_document(jobs=len(rows), files=digests_of(folder), **changes))
    if rows:
        write_part(folder, rows)
    return open_run(folder)


NEEDED = (
    "campaign.toml", "jobs.parquet", "scene/scene.json", "scene/rock.ply", "scene/pedestal.ply",
    "ensemble/catalog.parquet", "ensemble/motions.parquet",
)  # fmt: skip
"""Initial files of every run of one rock."""


def planned_in(folder, *given, **axes):
    """The plan of such a campaign."""
    return plan_of(campaign_in(folder, *given, **axes))
