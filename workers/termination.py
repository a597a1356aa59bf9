"""When the answer to a shake is certain: an ordered list of rules, each a function of what was observed.

On ground at rest that is a matter of energy, which does not grow. On ground that still moves weakly it is measured
(benchmarks/reports/shortcuts.md), not proven: a motion in step with the rocking might feed it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from toppling.models.compiled import Array
from toppling.models.ground.points import LARGEST_OPEN_TILT_DEG
from toppling.models.scene import Scene
from toppling.models.statics import TOPPLED_FALL
from toppling.workers import standing
from toppling.workers.barrier import least_overturning_j_kg
from toppling.workers.observation import Observation
from toppling.workers.problem import Problem


class Seen(NamedTuple):
    """What a rule is asked about."""

    now: Observation
    pose: Array  # (7,)
    velocity: Array  # (6,)
    agrees: bool  # whether all steps so far found impulses on which all contacts agree
    moved: bool  # whether it has moved at all
    stands: bool  # whether it has not moved for a block
    held_until_s: float  # until when what it stands on holds it then
    problem: Problem


Rule = Callable[[Seen], bool]


def _disagrees(seen: Seen) -> bool:
    """A step found no impulses on which all contacts agree."""
    return not seen.agrees


def _diverged(seen: Seen) -> bool:
    """No finite state, or one faster than any energy in the motion explains."""
    return not seen.now.fastest_m_s <= seen.problem.speed_limit_m_s


def _left_ground(seen: Seen) -> bool:
    """The centre of mass is plumb over where the ground is not known."""
    problem = seen.problem
    if problem.scene.pedestal.is_plane:
        return False
    return problem.is_beyond_scan(seen.pose)


def _fallen(seen: Seen) -> bool:
    """The centre of mass has lost more of its height than that of a rock which stands may."""
    problem, now = seen.problem, seen.now
    if now.over_plane and now.lowest_m < fallen_below_m(problem):
        return True
    if problem.scene.pedestal.is_plane or now.fallen_m <= TOPPLED_FALL * problem.stood_m:
        return False
    over_m = problem.height_over_ground_m(seen.pose)
    return not over_m >= (1.0 - TOPPLED_FALL) * problem.stood_m


def fallen_below_m(problem: Problem) -> float:
    """Height over the interface plane below which a centre of mass has fallen."""
    return float((1.0 - TOPPLED_FALL) * problem.contact.com_m[2])


def _tilted(seen: Seen) -> bool:
    """The rock has tilted so far that its fate is no longer open."""
    return seen.now.largest_tilt_deg > LARGEST_OPEN_TILT_DEG


def _never_moved(seen: Seen) -> bool:
    """What it stands on holds it through the whole motion."""
    return not seen.moved and _is_held(seen)


def _is_held(seen: Seen) -> bool:
    """It stands, and what it stands on holds it to the end of the motion."""
    return seen.problem.shortcuts and seen.stands and seen.held_until_s >= seen.problem.motion.duration_s


def _rests(seen: Seen) -> bool:
    """After the motion it stands, or moves slowly on contacts that hold it."""
    now, problem = seen.now, seen.problem
    if now.time_s <= problem.motion.duration_s:
        return False
    if seen.stands:
        return seen.held_until_s == math.inf
    slow = max(now.drift_m_s, now.speed_m_s) < problem.rest_speed_m_s
    if not slow or now.over_plane:
        return False
    body = problem.scene.grounded
    return standing.holds(body, seen.pose, body.load_m_s2()[None], share=1.0)


def _too_little_energy(seen: Seen) -> bool:
    """After the motion: the rock rocks with less energy than overturns it, and does not slide.

    It counts as it will at rest: one that is tilted may come to stand, unless it is displaced anyway, or rolls back.
    """
    now, problem, options = seen.now, seen.problem, seen.problem.options.termination
    over_s = now.time_s - problem.motion.duration_s
    if not (problem.shortcuts and over_s > 0.0):
        return False
    if not now.over_plane:
        calmed = over_s > options.calmed_after * problem.unit_s
        return _stands_in(seen, options.certain_share if calmed else options.calm_share, calmed) is not None
    if not _has_little_energy(seen, options.certain_share):
        return False
    return problem.rolls or now.tilt_deg <= options.moved_deg or is_displaced(now, problem)


def _cannot_overturn(seen: Seen) -> bool:
    """Long after the motion: the energy overturns the rock in no yaw, and no slope keeps it sliding."""
    now, problem, scene = seen.now, seen.problem, seen.problem.scene
    if not now.over_plane:
        return False
    if now.time_s <= problem.motion.duration_s + problem.options.termination.calmed_after * problem.unit_s:
        return False
    slips_end = scene.contact.friction_kinetic >= friction_that_stops(scene)
    settles = slips_end or now.sliding_m_s <= problem.rest_speed_m_s
    return settles and now.energy_j_kg < least_overturning_j_kg(scene, now.tilt_deg, None)


def _time_is_up(seen: Seen) -> bool:
    """The rock's fate is still open at the cap."""
    problem = seen.problem
    return (
        seen.now.time_s > problem.motion.duration_s + problem.options.termination.cap_after * problem.unit_s
    )


def _calms_down(seen: Seen) -> bool:
    """All that is left of the motion is weak, so is the rocking, and the rock is displaced anyway, or rolls back."""
    now, problem, options = seen.now, seen.problem, seen.problem.options.termination
    if not (
        problem.shortcuts and now.over_plane and problem.weak_from_s < now.time_s <= problem.motion.duration_s
    ):
        return False
    near = now.tilt_deg < options.weak_tilt_deg and abs(now.yaw_deg) < options.weak_yaw_deg
    told = problem.rolls or (near and is_displaced(now, problem))
    return told and _has_little_energy(seen, options.calm_share)


Rules = tuple[tuple[str, Rule], ...]
"""By what they are called in a result."""

FALLS: Rules = (("fallen", _fallen), ("tilted", _tilted))
"""After these the rock has toppled whatever its pose."""

RULES: Rules = (
    ("contacts_disagree", _disagrees),
    ("speed_limit", _diverged),
    ("left_ground", _left_ground),
    *FALLS,
    ("never_moved", _never_moved),
    ("rest", _rests),
    ("rest_certain", _is_held),
    ("rest_certain", _too_little_energy),
    ("rest_certain", _cannot_overturn),
    ("time_cap", _time_is_up),
    ("rest_certain", _calms_down),
)
"""In the order in which they are asked."""


def first_met(seen: Seen) -> str | None:
    """What the first of the rules that applies is called; None while the answer is open."""
    return next((name for name, applies in RULES if applies(seen)), None)


def is_displaced(now: Observation, problem: Problem) -> bool:
    """Whether the rock has slid or turned about the normal so far that it counts as moved, however it rocks."""
    options = problem.options.termination
    far_m = options.moved_share * problem.contact.half_diagonal_m
    return now.slip_m > far_m or now.turned_deg > options.moved_deg


def _has_little_energy(seen: Seen, share: float) -> bool:
    # Past its balance all of a rock's energies are below that of lying: no share of them holds it.
    now, problem = seen.now, seen.problem
    barrier = least_overturning_j_kg(problem.scene, now.tilt_deg, now.yaw_deg)
    return max(now.energy_j_kg, 0.0) < share * barrier and now.sliding_m_s <= problem.rest_speed_m_s


def _stands_in(seen: Seen, share: float, calmed: bool) -> Array | None:
    """The pose in which a rock off its plane comes to stand, if it has less than a share of what overturns it there."""
    problem, body = seen.problem, seen.problem.scene.grounded
    if not seen.now.sliding_m_s <= problem.rest_speed_m_s:
        return None
    rest = standing.let_down(body, seen.pose)
    if rest is None:
        return None
    off_deg = math.degrees(2.0 * math.acos(min(abs(float(seen.pose[3:] @ rest[3:])), 1.0)))
    if not calmed and off_deg > problem.options.termination.moved_deg:
        return None  # what is told of its last pose is to be true of its rest
    energy = standing.energy_j_kg(body, seen.pose, seen.velocity, rest)
    return rest if energy < share * standing.least_overturning_j_kg(body, rest, energy / share) else None


def friction_that_stops(scene: Scene) -> float:
    """Kinetic friction, tan(slope), below which a rock that slips on the pedestal slides for ever."""
    return float(np.tan(np.deg2rad(scene.pedestal.slope_deg)))
