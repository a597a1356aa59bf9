"""When the answer to a shake is certain: an ordered list of rules, each a function of what a block of steps showed."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from toppling.models.compiled import Array, Vector, compiled, inner
from toppling.models.ground.body import RESTING_SHARE
from toppling.models.ground.pairs import moved_m
from toppling.models.ground.plane import is_over_plane
from toppling.models.ground.rigid import (
    cross,
    dot,
    kinetic_j_kg,
    minus,
    normal_in_body,
    plus,
    rotation_of,
    turned,
    yaw_between,
)
from toppling.models.ground.stepping import Grounded
from toppling.models.pedestal import LARGEST_OPEN_TILT_DEG
from toppling.models.scene import Scene
from toppling.models.statics import TOPPLED_FALL
from toppling.workers import standing
from toppling.workers.barrier import least_overturning_j_kg, lying_arms_m
from toppling.workers.problem import Problem


class Body(NamedTuple):
    """A rock, as compiled code observes it; support frame."""

    points_m: Array  # (n, 3) that can touch the plane, body axes
    lying_m: Array  # (n, 3) from each of them to the centre of mass as the rock stood in the scene
    scene_pose: Array
    below_m: Array  # (3,) point of the interface below the centre of mass at the start, body axes
    up: Array  # (3,) upward unit vector
    gravity_m_s2: float

    @classmethod
    def of(cls, problem: Problem) -> Body:
        """Make the body of a problem."""
        contact, (start_pose, _) = problem.contact, problem.initial
        return cls(
            points_m=np.ascontiguousarray(contact.points_body_m),
            lying_m=np.ascontiguousarray(lying_arms_m(contact)),
            scene_pose=contact.start_pose,
            below_m=-start_pose[2] * np.array(normal_in_body(start_pose)),
            up=np.ascontiguousarray(contact.scene_from_support[2]),
            gravity_m_s2=problem.scene.gravity_m_s2,
        )


class Observation(NamedTuple):
    """A block of steps, and the rock at its end; angles in degrees."""

    time_s: float
    fastest_m_s: float
    """Largest speed of the centre of mass in the block; NaN where a state is not finite."""
    largest_tilt_deg: float
    """Largest tilt in the block."""
    drift_m_s: float
    """Mean speed, over the block, of the point that moved most."""
    speed_m_s: float
    """Speed of the fastest point."""
    sliding_m_s: float
    """Speed along the ground of the fastest contact that carries; infinite where none does."""
    energy_j_kg: float
    """Kinetic energy, and potential energy above that of the rock lying where it is on its plane, per mass."""
    tilt_deg: float
    yaw_deg: float
    """Turn about the normal since the pose of the scene, -180 to 180."""
    turned_deg: float
    """Size of the turn about the normal since the start, 0 to 180."""
    slip_m: float
    """Way along the interface of the material point that was in it below the centre of mass at the start."""
    fallen_m: float
    """Height, along the plumb line, that the centre of mass has lost since the start."""
    lowest_m: float
    """Least height of the centre of mass over the interface in the block."""
    com_m: Vector
    over_plane: bool
    """Whether all that the rock may touch where it is lies in the interface plane."""


@compiled
def observe(sim: Grounded, body: Body, since: int) -> Observation:
    """Look at the steps since a pose."""
    last = sim.counts[1]
    pose, velocity = sim.pose[last], sim.velocity[last]
    fastest, cosine, lowest = _size(velocity), 1.0, np.inf
    for i in range(since, last + 1):
        here = sim.pose[i]
        fastest = max(fastest, _size(sim.velocity[i]))
        if not (math.isfinite(here[0]) and math.isfinite(here[1]) and math.isfinite(here[2])):
            fastest = np.nan
        cosine, lowest = min(cosine, _upright(here, body.scene_pose)), min(lowest, here[2])
    turn, start = sim.work.turn, sim.pose[0]
    rotation_of(start, turn)
    first = plus(start, 1.0, turned(turn, body.below_m))
    rotation_of(pose, turn)
    lying, below = _lying_com_m(body, pose, turn), plus(pose, 1.0, turned(turn, body.below_m))
    x, y = below[0] - first[0], below[1] - first[1]
    turned_deg = math.degrees(yaw_between(start, pose))
    up, lasted_s = body.up, sim.time_s[last] - sim.time_s[since]
    height = up[0] * (pose[0] - lying[0]) + up[1] * (pose[1] - lying[1]) + up[2] * (pose[2] - lying[2])
    return Observation(
        time_s=sim.time_s[last],
        fastest_m_s=fastest,
        largest_tilt_deg=math.degrees(math.acos(min(max(cosine, -1.0), 1.0))),
        drift_m_s=moved_m(sim.pose[since], pose, sim.size_m) / lasted_s if lasted_s > 0.0 else 0.0,
        speed_m_s=_size(velocity[:3]) + _size(velocity[3:]) * sim.size_m,
        sliding_m_s=_sliding_m_s(sim, velocity),
        energy_j_kg=kinetic_j_kg(turn, sim.inertia_m2, velocity) + body.gravity_m_s2 * height,
        tilt_deg=math.degrees(math.acos(min(max(_upright(pose, body.scene_pose), -1.0), 1.0))),
        yaw_deg=math.degrees(yaw_between(body.scene_pose, pose)),
        turned_deg=abs((turned_deg + 180.0) % 360.0 - 180.0),
        slip_m=math.sqrt(x * x + y * y),
        fallen_m=dot(minus(sim.pose[0], pose), up),
        lowest_m=lowest,
        com_m=(pose[0], pose[1], pose[2]),
        over_plane=is_over_plane(sim.over, pose, turn, sim.lists.farthest_m, RESTING_SHARE * sim.size_m),
    )


@inner
def _upright(pose: Array, scene_pose: Array) -> float:
    """Cosine of the angle of the interface's normal, carried along from the pose of the scene, to where it was."""
    return dot(normal_in_body(pose), normal_in_body(scene_pose))


@inner
def _sliding_m_s(sim: Grounded, velocity: Array) -> float:
    """Along the ground, of the fastest contact that carries."""
    fastest = -1.0
    for k in range(sim.counts[0]):
        n, arm = sim.contacts[k].normal, sim.contacts[k].arm_m
        if dot(sim.contacts[k].impulse, n) > 0.0:
            rate = plus(velocity, 1.0, cross((velocity[3], velocity[4], velocity[5]), arm))
            fastest = max(fastest, _size(plus(rate, -dot(rate, n), n)))
    return fastest if fastest >= 0.0 else np.inf


@inner
def _size(vector: Array | Vector) -> float:
    return math.sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2])


@inner
def _lying_com_m(body: Body, pose: Array, turn: Array) -> Vector:
    """Centre of mass if the rock lay where it is, on its lowest point."""
    lowest, index = np.inf, 0
    for i in range(len(body.points_m)):
        height = dot(turn[2], body.points_m[i])
        if height < lowest:
            lowest, index = height, i
    arm = turned(turn, body.points_m[index])
    yaw = yaw_between(body.scene_pose, pose)
    cos, sin = math.cos(yaw), math.sin(yaw)
    x, y, z = body.lying_m[index]
    return pose[0] + arm[0] + cos * x - sin * y, pose[1] + arm[1] + sin * x + cos * y, z


class Seen(NamedTuple):
    """State of a shake that the rules decide on."""

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
    """The support holds it in static equilibrium through the whole motion."""
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
    return problem.scene.rolls or now.tilt_deg <= options.moved_deg or is_displaced(now, problem)


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
    """All that is left of the motion is weak, so is the rocking, and the rock is displaced anyway.

    What rolls on a rounded base is moved by any motion.
    """
    now, problem, options = seen.now, seen.problem, seen.problem.options.termination
    if not problem.shortcuts or problem.scene.rolls or not now.over_plane:
        return False
    if not problem.weak_from_s < now.time_s <= problem.motion.duration_s:
        return False
    near = now.tilt_deg < options.weak_tilt_deg and abs(now.yaw_deg) < options.weak_yaw_deg
    return near and is_displaced(now, problem) and _has_little_energy(seen, options.calm_share)


Rules = tuple[tuple[str, Rule], ...]
"""Rules by their names in a result."""

FALLS: Rules = (("fallen", _fallen), ("tilted", _tilted))
"""After these the rock has toppled whatever its pose."""

RULES: Rules = (
    ("speed_limit", _diverged),
    ("left_ground", _left_ground),
    *FALLS,
    ("contacts_disagree", _disagrees),
    ("never_moved", _never_moved),
    ("rest", _rests),
    ("rest_certain", _is_held),
    ("rest_certain", _too_little_energy),
    ("rest_certain", _cannot_overturn),
    ("time_cap", _time_is_up),
    ("rest_certain", _calms_down),
)
"""Rules in the order in which they are asked."""


def first_met(seen: Seen) -> str | None:
    """Name of the first rule that applies; None while the answer is open."""
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
