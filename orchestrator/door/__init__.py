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
    from toppling.models.errors import InputError as InputError
    from toppling.models.hidden_base.rough_base import Standing as Standing
    from toppling.models.hidden_base.rough_base import with_rough_base as with_rough_base
    from toppling.models.motions.ensemble import Ensemble as Ensemble
    from toppling.models.motions.motion import Motion as Motion
    from toppling.models.motions.record import Record as Record
    from toppling.models.scene import Scene as Scene
    from toppling.orchestrator.campaign import Campaign as Campaign
    from toppling.orchestrator.public.constraining import Dates as Dates
    from toppling.orchestrator.public.constraining import constrain as constrain
    from toppling.orchestrator.public.making import scan as scan
    from toppling.orchestrator.public.making import scan_again as scan_again
    from toppling.orchestrator.public.reporting import fragility as fragility
    from toppling.orchestrator.public.reporting import query as query
    from toppling.orchestrator.public.reporting import report as report
    from toppling.orchestrator.public.running import plan as plan
    from toppling.orchestrator.public.running import run as run
    from toppling.orchestrator.studies.seismograms import check as check
    from toppling.results.reader import Run as Run
    from toppling.results.reader import open_run as open_run
    from toppling.workers.outcome import ShakeResult as ShakeResult
    from toppling.workers.shaking import shake as shake
    from toppling.workers.start import State as State
    from toppling.workers.unmeasured import Unmeasured as Unmeasured

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
    "fragility": "toppling.orchestrator.public.reporting",
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

__all__ = [*_HOMES]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'toppling' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return __all__
