"""Small campaigns of a block under pulses, for tests of plans and of runs."""

import json

from reference.idealised import ricker

from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.record import Record
from toppling.models.scene import Scene
from toppling.orchestrator.campaign import Campaign
from toppling.orchestrator.plan import plan_of


def campaign_in(folder, periods_s=(0.6, 1.0), scene=None, name="P{}", **axes):
    """The campaign of `campaign.toml`, beside its scene and its records P0, P1, ..."""
    (Scene.block(0.15, 0.2, 0.6) if scene is None else scene).save(folder / "scene")
    pulses = [Record.of(name.format(n), ricker(2.0, s, 0.01), event=f"E{n}") for n, s in enumerate(periods_s)]
    Ensemble.write(folder / "ensemble", pulses)
    content = {"scene": "scene", "ensemble": "ensemble", "azimuth_deg": [0, 90], "friction": [0.9], **axes}
    lines = [f"{key} = {json.dumps(value)}\n" for key, value in content.items()]
    (folder / "campaign.toml").write_text("".join(lines))
    return Campaign.read(folder / "campaign.toml")


def planned_in(folder, *given, **axes):
    """The plan of such a campaign."""
    return plan_of(campaign_in(folder, *given, **axes))
