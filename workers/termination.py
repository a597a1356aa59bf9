"""When the answer to a shake is certain: an ordered list of rules, each a pure function of what was observed.

On ground at rest that is a matter of energy, which does not grow. On ground that still moves weakly it is measured
(docs/shortcuts.md), not proven: a motion in step with the rocking might feed it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from toppling.models.motions.motion import Motion
from toppling.models.scene import Scene
from toppling.models.statics import TOPPLED_FALL, quasi_static_toppling_m_s2
from toppling.workers.barrier import least_overturning_j_kg
from toppling.workers.contact_points import LARGEST_OPEN_TILT_DEG, contact_of
from toppling.workers.observation import Observation
from toppling.workers.options import TerminationOptions
from toppling.workers.problem import Problem

Array = NDArray[np.float64]

AZIMUTH_STEP_DEG = 10.0


@dataclass(frozen=True)
class Verdict:
    """Why a shake has ended.

    Parameters
    ----------
    status : str
        'ok', 'undecided' or 'diverged'.
    ended_by : str
        Name of the rule.
    """

    status: str
    ended_by: str


@dataclass(frozen=True, eq=False)
class Context:
    """What the rules hold an observation against.

    Parameters
    ----------
    problem : Problem
    weak_from_s : float
        From when on what is left of it is weak.
    speed_limit_m_s : float
        What no energy in the motion explains.
    """

    problem: Problem
    weak_from_s: float
    speed_limit_m_s: float

    @property
    def options(self) -> TerminationOptions:
        """The preset's."""
        return self.problem.options.termination

    @property
    def motion_s(self) -> float:
        """How long the ground moves."""
        return self.problem.motion.duration_s

    @property
    def unit_s(self) -> float:
        """sqrt(R / g)."""
        return math.sqrt(self.problem.contact.half_diagonal_m / self.problem.scene.gravity_m_s2)


Rule = Callable[[Observation, Context], Verdict | None]


def diverged(seen: Observation, context: Context) -> Verdict | None:
    """No finite state, or one faster than any energy in the motion explains."""
    sound = seen.fastest_m_s <= context.speed_limit_m_s
    return None if sound else Verdict("diverged", "speed_limit")


def fallen(seen: Observation, context: Context) -> Verdict | None:
    """The centre of mass has lost more of its height than that of a rock which stands may."""
    low = seen.lowest_m < (1.0 - TOPPLED_FALL) * context.problem.contact.com_m[2]
    return Verdict("ok", "fallen") if low else None


def tilted(seen: Observation, context: Context) -> Verdict | None:  # noqa: ARG001  (a rule's signature)
    """The rock has tilted so far that its fate is no longer open."""
    return Verdict("ok", "tilted") if seen.largest_tilt_deg > LARGEST_OPEN_TILT_DEG else None


def slid_off(seen: Observation, context: Context) -> Verdict | None:  # noqa: ARG001  (a rule's signature)
    """The rock has slid so far that even lying it would tip over the end of its pedestal."""
    return Verdict("ok", "slid_off") if seen.beyond_end else None


def too_little_energy(seen: Observation, context: Context) -> Verdict | None:
    """After the motion: the rock rocks with less energy than overturns it, and does not slide.

    It counts as it will at rest: one that is tilted may come to stand, unless it is displaced anyway.
    """
    if not (context.problem.shortcuts and seen.time_s > context.motion_s):
        return None
    if not _has_little_energy(seen, context, context.options.certain_share):
        return None
    shows = seen.tilt_deg <= context.options.moved_deg or is_displaced(seen, context)
    return Verdict("ok", "rest_certain") if shows else None


def cannot_overturn(seen: Observation, context: Context) -> Verdict | None:
    """Long after the motion: the energy overturns the rock in no yaw, and no slope keeps it sliding."""
    if seen.time_s <= context.motion_s + context.options.calmed_after * context.unit_s:
        return None
    slips_end = context.problem.scene.contact.friction_kinetic >= friction_that_stops(context.problem.scene)
    settles = slips_end or seen.sliding_m_s <= context.problem.rest_speed_m_s
    held = seen.energy_j_kg < least_overturning_j_kg(context.problem.scene, seen.tilt_deg, None)
    return Verdict("ok", "rest_certain") if held and settles else None


def time_is_up(seen: Observation, context: Context) -> Verdict | None:
    """The rock's fate is still open at the cap."""
    capped = seen.time_s > context.motion_s + context.options.cap_after * context.unit_s
    return Verdict("undecided", "time_cap") if capped else None


def calms_down(seen: Observation, context: Context) -> Verdict | None:
    """All that is left of the motion is weak, so is the rocking, and the rock is displaced anyway."""
    if not (context.problem.shortcuts and context.weak_from_s < seen.time_s <= context.motion_s):
        return None
    options = context.options
    near = seen.tilt_deg < options.weak_tilt_deg and abs(seen.yaw_deg) < options.weak_yaw_deg
    calm = near and is_displaced(seen, context) and _has_little_energy(seen, context, options.calm_share)
    return Verdict("ok", "rest_certain") if calm else None


FALLS: tuple[Rule, ...] = (diverged, fallen, tilted, slid_off)
"""Looked at first."""

ENDS: tuple[Rule, ...] = (too_little_energy, cannot_overturn, time_is_up, calms_down)
"""Looked at of a rock that does not rest."""


def verdict(rules: tuple[Rule, ...], seen: Observation, context: Context) -> Verdict | None:
    """What the first of the rules that applies says; None while the answer is open."""
    for rule in rules:
        said = rule(seen, context)
        if said is not None:
            return said
    return None


def is_displaced(seen: Observation, context: Context) -> bool:
    """Whether the rock has slid or turned about the normal so far that it counts as moved, however it rocks."""
    options, half_diagonal_m = context.options, context.problem.contact.half_diagonal_m
    return seen.slip_m > options.moved_share * half_diagonal_m or seen.turned_deg > options.moved_deg


def _has_little_energy(seen: Observation, context: Context, share: float) -> bool:
    # Past its balance all of a rock's energies are below that of lying: no share of them holds it.
    energy = max(seen.energy_j_kg, 0.0)
    barrier = least_overturning_j_kg(context.problem.scene, seen.tilt_deg, seen.yaw_deg)
    return energy < share * barrier and seen.sliding_m_s <= context.problem.rest_speed_m_s


def friction_that_stops(scene: Scene) -> float:
    """Kinetic friction, tan(slope), below which a rock that slips on the pedestal slides for ever."""
    return float(np.tan(np.deg2rad(scene.pedestal.slope_deg)))


def weak_from_s(scene: Scene, motion: Motion, share: float) -> float:
    """Time from which a motion is weak, s: at 1 / share times its strength it would neither tip nor drag the rock.

    What tips it is the least constant acceleration of any azimuth that, slowly applied, topples
    (:mod:`models.statics`): of any, since a rock that has turned has its weakest side elsewhere.
    """
    stronger = motion.acceleration_m_s2 / share
    downward = scene.gravity_m_s2 + stronger[:, 2]
    holds = np.hypot(stronger[:, 0], stronger[:, 1]) < downward * _tipping_ratio(scene)
    force = (np.array([0.0, 0.0, -scene.gravity_m_s2]) - stronger) @ contact_of(scene).scene_from_support
    grips = np.hypot(force[:, 0], force[:, 1]) < -scene.contact.friction_kinetic * force[:, 2]
    strong = np.flatnonzero(~(holds & grips))
    return (strong[-1] + 1) * motion.time_step_s if len(strong) else 0.0


@lru_cache(maxsize=8)
def _tipping_ratio(scene: Scene) -> float:
    """Least constant horizontal acceleration that topples the rock, over gravity."""
    azimuths = np.arange(0.0, 360.0, AZIMUTH_STEP_DEG).tolist()
    least = quasi_static_toppling_m_s2(scene.rock, scene.pedestal, scene.gravity_m_s2, azimuths)
    return min(value for _, value in least) / scene.gravity_m_s2
