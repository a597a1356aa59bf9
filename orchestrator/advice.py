"""Warnings before a campaign runs and suggestions after it, one sentence each."""

import math
from collections.abc import Sequence

import numpy as np
import pyarrow as pa

from toppling.models.errors import counted
from toppling.models.files.documents import listed
from toppling.models.frames import STANDARD_GRAVITY_M_S2, quadrant_of
from toppling.models.hidden_base.intervals import median_width
from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.quality import LIMITS_WORDS, is_beyond, words
from toppling.models.pedestal import ContactProperties
from toppling.models.scene import Scene
from toppling.orchestrator.campaign import Campaign
from toppling.orchestrator.pilot import Statics, statics_of
from toppling.orchestrator.status import LevelCount

_LARGEST_FRICTION = 1.5
"""Friction coefficient of rock on rock above which a value is more likely an angle in degrees."""
_G_AT_MOST = 1.5
"""Level below which all levels are more likely in g than in m/s²."""
REALISATIONS = 25
"""Recommended number of realisations of a rock with drawn bases: the nominal base and enough others for a spread."""
HARDLY_FRACTION = 0.05
"""Maximum fraction toppled at the lowest level for levels to cover the transition."""
MOSTLY_FRACTION = 0.5
"""Minimum fraction toppled at the highest."""
_LEAST_WITHIN = 3
"""Minimum number of levels within the transition that resolves it."""


def warnings_of(campaign: Campaign, scene: Scene) -> list[str]:
    """Probable mistakes in a campaign that is formally valid.

    Examples
    --------
    >>> from pathlib import Path
    >>> from toppling import Scene
    >>> axes = {"pga_m_s2": [0.2, 0.9], "azimuth_deg": [0], "friction": [35]}
    >>> slips = Campaign.of({"scene": "s", "ensemble": "e", **axes}, Path("."))
    >>> for sentence in warnings_of(slips, Scene.block(0.2, 0.2, 0.6)):
    ...     print(sentence)
    friction 35 is above 1.5: is it in degrees? tan(35°) is 0.7
    all levels are below 1.5 m/s2: are they in g? 0.9 g is 8.83 m/s2
    """
    found = []
    for static, _ in campaign.friction:
        if static > _LARGEST_FRICTION:
            angle = f": is it in degrees? tan({static:g}°) is {math.tan(math.radians(static)):.2g}"
            usual = ": rock on rock has 0.6 to 1.0"
            found.append(
                f"friction {static:g} is above {_LARGEST_FRICTION:g}{angle if 10 <= static < 80 else usual}"
            )
    if scene.unseen is not None and campaign.first_realisation == 0 and campaign.realisations == 1:
        found.append(
            f"only one of the rock's possible bases is shaken, but the base is hidden; {_width_sentence(scene)}"
            f"'realisations = {REALISATIONS}' spreads the jobs over others too"
        )
    statics = statics_of(scene.with_contact(ContactProperties.of(campaign.friction[0])))
    return found + _of_statics(campaign, statics, scene)


def shaking_warnings(campaign: Campaign, ensemble: Ensemble) -> list[str]:
    """Warning of levels at which scaled records exceed all recorded ground motions; empty if there are none."""
    catalog, chosen = ensemble.catalog, set(campaign.records or ensemble.record_ids)
    used = catalog.filter(pa.array([name in chosen for name in ensemble.record_ids]))
    own, pgv_m_s, pgd_m = (used[name].to_numpy()[:, None] for name in ("pga_m_s2", "pgv_m_s", "pgd_m"))
    levels = np.array(campaign.pga_m_s2 or [np.nan])
    factor = levels / own if campaign.pga_m_s2 else np.ones((len(used), 1))
    pgv_m_s, pgd_m = pgv_m_s * factor, pgd_m * factor
    pgd_m = np.minimum(pgd_m, campaign.peak_displacement_m or np.inf)
    beyond = is_beyond(factor, pgv_m_s, pgd_m)
    if not beyond.any():
        return []
    worst = sorted(zip(-pgv_m_s.max(axis=1), range(len(used)), strict=True))
    names = used["record_id"].to_pylist()
    named = [
        f"{names[row]} ({words(factor[row].max(), -speed, pgd_m[row].max())})"
        for speed, row in worst
        if beyond[row].any()
    ]
    at = f" at {levels.max():g} m/s2" if campaign.pga_m_s2 else ""
    return [
        f"{100 * beyond.mean():.0f} % of the jobs shake beyond what was ever recorded ({LIMITS_WORDS}):"
        f"{at} {listed(named)}; lower levels, stronger records (toppling records select --pga) or those "
        "with less PGV for their PGA avoid it, and the report shows the effect of leaving these jobs out"
    ]


def _width_sentence(scene: Scene) -> str:
    interval = scene.report.get("unseen_base", {}).get("toppling")
    if not interval:
        return ""
    return f"the interval of the toppling acceleration is {100 * median_width(interval):.0f} % of its median wide; "


def _of_statics(campaign: Campaign, statics: Statics, scene: Scene) -> list[str]:
    """Warnings of levels and frictions that do not fit the static toppling acceleration."""
    found, least = [], statics.least_m_s2
    highest = max(campaign.pga_m_s2, default=math.inf)  # no levels: unscaled records
    if highest < min(least, _G_AT_MOST):
        return [  # the next warning would have the same cause
            f"all levels are below {_G_AT_MOST:g} m/s2: are they in g? "
            f"{highest:g} g is {highest * STANDARD_GRAVITY_M_S2:.3g} m/s2"
        ]
    if highest <= least:
        found.append(
            f"all levels are below the least constant acceleration that topples the rock ({least_static(statics)}): "
            "hardly any job will topple it; 'toppling init' writes levels that suit it"
        )
    return found + [
        f"with friction {static:g} the rock slides in every direction before it tips: few jobs will topple it"
        for static, _ in campaign.friction
        if static * scene.gravity_m_s2 < least
    ]


def least_static(statics: Statics) -> str:
    """Describe the least static toppling acceleration with its azimuth, and where the rock slides before it tips."""
    slides = statics.slides_m_s2
    found = f"{statics.least_m_s2:.3g} m/s2, ground toward {quadrant_of(statics.azimuth_deg)}"
    return (
        found
        if math.isinf(slides)
        else f"{found}; toward some azimuths it slides before, from {slides:.3g} m/s2"
    )


def suggestions(levels: Sequence[LevelCount]) -> list[str]:
    """Suggestions for the next campaign from the fractions toppled at each level of a run.

    shares: one per level.

    Examples
    --------
    >>> suggestions([LevelCount(9.0, 78, 0), LevelCount(13.0, 78, 7)])
    ['7 of 156 toppled, 9 % at the highest level: add levels above 13 m/s2']
    """
    rising = sorted((level for level in levels if level.jobs), key=lambda level: level.level_m_s2)
    if not rising:
        return []
    low, high = rising[0], rising[-1]
    jobs, toppled = sum(level.jobs for level in rising), sum(level.toppled for level in rising)
    found = []
    if high.fraction < MOSTLY_FRACTION:
        at = f", {100 * high.fraction:.0f} % at the highest level" if toppled else ""
        found.append(f"{toppled} of {jobs} toppled{at}: add levels above {high.level_m_s2:g} m/s2")
    if low.fraction > HARDLY_FRACTION:
        at = f"{low.toppled} of {low.jobs} toppled at the lowest level"
        found.append(f"{at}: add levels below {low.level_m_s2:g} m/s2")
    within = [level for level in rising if HARDLY_FRACTION < level.fraction < 1.0 - HARDLY_FRACTION]
    if not found and len(within) < _LEAST_WITHIN:
        below = max(level.level_m_s2 for level in rising if level.fraction <= HARDLY_FRACTION)
        above = [level.level_m_s2 for level in rising if level.fraction >= 1.0 - HARDLY_FRACTION]
        top = min(above, default=high.level_m_s2)
        found.append(
            f"the share that topples rises within {counted(len(within), 'level')}: "
            f"add levels between {below:g} and {top:g} m/s2"
        )
    return found
