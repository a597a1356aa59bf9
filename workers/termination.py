"""When the answer to a shake is certain: an ordered list of rules, each a pure function of what was observed.

On ground at rest that is a matter of energy, which does not grow. On ground that still moves weakly it is measured
(benchmarks/reports/shortcuts.md), not proven: a motion in step with the rocking might feed it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from toppling.models.scene import Scene
from toppling.models.statics import TOPPLED_FALL
from toppling.workers.barrier import least_overturning_j_kg
from toppling.workers.contact.contact_points import LARGEST_OPEN_TILT_DEG
from toppling.workers.observation import Body, Displacement, Observation, Watch
from toppling.workers.problem import Problem

Rule = Callable[[Observation, Problem], bool]


def diverged(seen: Observation, problem: Problem) -> bool:
    """No finite state, or one faster than any energy in the motion explains."""
    sound = seen.fastest_m_s <= problem.speed_limit_m_s
    return not sound


def fallen(seen: Observation, problem: Problem) -> bool:
    """The centre of mass has lost more of its height than that of a rock which stands may."""
    return seen.lowest_m < _fallen_below_m(problem)


def _fallen_below_m(problem: Problem) -> float:
    return float((1.0 - TOPPLED_FALL) * problem.contact.com_m[2])


def tilted(seen: Observation, problem: Problem) -> bool:  # noqa: ARG001  (a rule's signature)
    """The rock has tilted so far that its fate is no longer open."""
    return seen.largest_tilt_deg > LARGEST_OPEN_TILT_DEG


def slid_off(seen: Observation, problem: Problem) -> bool:  # noqa: ARG001  (a rule's signature)
    """The rock has slid so far that even lying it would tip over the end of its pedestal."""
    return seen.beyond_end


def _too_little_energy(seen: Observation, problem: Problem) -> bool:
    """After the motion: the rock rocks with less energy than overturns it, and does not slide.

    It counts as it will at rest: one that is tilted may come to stand, unless it is displaced anyway, or rolls back.
    """
    options = problem.options.termination
    if not (problem.shortcuts and seen.time_s > problem.motion.duration_s):
        return False
    if not _has_little_energy(seen, problem, options.certain_share):
        return False
    return problem.rolls or seen.tilt_deg <= options.moved_deg or is_displaced(seen, problem)


def _cannot_overturn(seen: Observation, problem: Problem) -> bool:
    """Long after the motion: the energy overturns the rock in no yaw, and no slope keeps it sliding."""
    scene, options = problem.scene, problem.options.termination
    if seen.time_s <= problem.motion.duration_s + options.calmed_after * problem.unit_s:
        return False
    slips_end = scene.contact.friction_kinetic >= friction_that_stops(scene)
    settles = slips_end or seen.sliding_m_s <= problem.rest_speed_m_s
    return settles and seen.energy_j_kg < least_overturning_j_kg(scene, seen.tilt_deg, None)


def _time_is_up(seen: Observation, problem: Problem) -> bool:
    """The rock's fate is still open at the cap."""
    return seen.time_s > problem.motion.duration_s + problem.options.termination.cap_after * problem.unit_s


def _calms_down(seen: Observation, problem: Problem) -> bool:
    """All that is left of the motion is weak, so is the rocking, and the rock is displaced anyway, or rolls back."""
    options = problem.options.termination
    if not (problem.shortcuts and problem.weak_from_s < seen.time_s <= problem.motion.duration_s):
        return False
    near = seen.tilt_deg < options.weak_tilt_deg and abs(seen.yaw_deg) < options.weak_yaw_deg
    told = problem.rolls or (near and is_displaced(seen, problem))
    return told and _has_little_energy(seen, problem, options.calm_share)


Rules = tuple[tuple[str, Rule], ...]
"""By what they are called in a result."""

FALLS: Rules = (("speed_limit", diverged), ("fallen", fallen), ("tilted", tilted), ("slid_off", slid_off))
"""Looked at first; after the last three the rock has toppled whatever its pose."""

ENDS: Rules = (
    ("rest_certain", _too_little_energy),
    ("rest_certain", _cannot_overturn),
    ("time_cap", _time_is_up),
    ("rest_certain", _calms_down),
)
"""Looked at of a rock that does not rest."""


def first_met(rules: Rules, seen: Observation, problem: Problem) -> str | None:
    """What the first of the rules that applies is called; None while the answer is open."""
    return next((name for name, applies in rules if applies(seen, problem)), None)


def watch_of(problem: Problem) -> Watch:
    """When a rock must be looked at: one of :data:`FALLS` applies, it is slow, or one of :data:`ENDS` may apply."""
    return Watch(
        body=Body.of(problem),
        fastest_m_s=problem.speed_limit_m_s,
        lowest_m=_fallen_below_m(problem),
        tilt_deg=LARGEST_OPEN_TILT_DEG,
        drift_m_s=problem.rest_speed_m_s,
        until_s=min(problem.motion.duration_s, problem.weak_from_s if problem.shortcuts else np.inf),
    )


def unwatched(problem: Problem) -> Watch:
    """Every block calls for a look."""
    return watch_of(problem)._replace(until_s=-np.inf)


def is_displaced(seen: Displacement, problem: Problem) -> bool:
    """Whether the rock has slid or turned about the normal so far that it counts as moved, however it rocks."""
    options = problem.options.termination
    far_m = options.moved_share * problem.contact.half_diagonal_m
    return seen.slip_m > far_m or seen.turned_deg > options.moved_deg


def _has_little_energy(seen: Observation, problem: Problem, share: float) -> bool:
    # Past its balance all of a rock's energies are below that of lying: no share of them holds it.
    energy = max(seen.energy_j_kg, 0.0)
    barrier = least_overturning_j_kg(problem.scene, seen.tilt_deg, seen.yaw_deg)
    return energy < share * barrier and seen.sliding_m_s <= problem.rest_speed_m_s


def friction_that_stops(scene: Scene) -> float:
    """Kinetic friction, tan(slope), below which a rock that slips on the pedestal slides for ever."""
    return float(np.tan(np.deg2rad(scene.pedestal.slope_deg)))
