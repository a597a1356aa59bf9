"""Fragility of precariously balanced rocks: scenes, motions, shakes, and the functions behind the command line.

Names are imported when they are first used, which avoids slow imports.

Examples
--------
>>> import numpy as np
>>> from toppling import Motion, Scene, shake
>>> block = Scene.block(half_width=0.2, half_depth=0.2, half_height=0.6)
>>> pulse_m_s2 = 5.0 * np.sin(np.pi * np.arange(0.0, 2.0, 0.005))
>>> shake(block, Motion(np.outer(pulse_m_s2, [1.0, 0.0, 0.0]), time_step_s=0.005)).outcome
'toppled'
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from toppling.models.errors import InputError
    from toppling.models.hidden_base.rough_base import Standing, with_rough_base
    from toppling.models.motions.ensemble import Ensemble
    from toppling.models.motions.motion import Motion
    from toppling.models.motions.record import Record
    from toppling.models.scene import Scene
    from toppling.orchestrator.campaign import Campaign
    from toppling.orchestrator.public.constraining import Dates, constrain
    from toppling.orchestrator.public.fragility_figures import fragility
    from toppling.orchestrator.public.making import scan, scan_again
    from toppling.orchestrator.public.reporting import query, report
    from toppling.orchestrator.public.running import plan, run
    from toppling.orchestrator.studies.seismograms import check
    from toppling.results.reader import Run, open_run
    from toppling.workers.outcome import ShakeResult
    from toppling.workers.shaking import shake
    from toppling.workers.start import State
    from toppling.workers.unmeasured import Unmeasured

__all__ = [
    "Campaign",
    "Dates",
    "Ensemble",
    "InputError",
    "Motion",
    "Record",
    "Run",
    "Scene",
    "ShakeResult",
    "Standing",
    "State",
    "Unmeasured",
    "check",
    "constrain",
    "fragility",
    "open_run",
    "plan",
    "query",
    "report",
    "run",
    "scan",
    "scan_again",
    "shake",
    "with_rough_base",
]

_HOMES = {
    "Campaign": "toppling.orchestrator.campaign",
    "Dates": "toppling.orchestrator.public.constraining",
    "Ensemble": "toppling.models.motions.ensemble",
    "InputError": "toppling.models.errors",
    "Motion": "toppling.models.motions.motion",
    "Record": "toppling.models.motions.record",
    "Run": "toppling.results.reader",
    "Scene": "toppling.models.scene",
    "ShakeResult": "toppling.workers.outcome",
    "Standing": "toppling.models.hidden_base.rough_base",
    "State": "toppling.workers.start",
    "Unmeasured": "toppling.workers.unmeasured",
    "check": "toppling.orchestrator.studies.seismograms",
    "constrain": "toppling.orchestrator.public.constraining",
    "fragility": "toppling.orchestrator.public.fragility_figures",
    "open_run": "toppling.results.reader",
    "plan": "toppling.orchestrator.public.running",
    "query": "toppling.orchestrator.public.reporting",
    "report": "toppling.orchestrator.public.reporting",
    "run": "toppling.orchestrator.public.running",
    "scan": "toppling.orchestrator.public.making",
    "scan_again": "toppling.orchestrator.public.making",
    "shake": "toppling.workers.shaking",
    "with_rough_base": "toppling.models.hidden_base.rough_base",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'toppling' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return __all__
