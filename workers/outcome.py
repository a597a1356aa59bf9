"""Outcome of a shake, from its trajectory."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from toppling.models.compiled import Array
from toppling.models.frames import azimuth_deg
from toppling.models.ground.points import ContactModel
from toppling.models.pedestal import LARGEST_OPEN_TILT_DEG
from toppling.models.rock import Trajectory
from toppling.models.statics import TOPPLED_FALL, TOPPLED_TILT_DEG
from toppling.workers.problem import Problem
from toppling.workers.termination import FALLS, Observation, is_displaced

_STATUS = {
    "speed_limit": "diverged",
    "time_cap": "undecided",
    "left_ground": "failed",
    "contacts_disagree": "failed",
}
"""Status by the rule that ended a shake without an answer."""

_LEVEL_SHARE = 1e-8
"""Tolerance over R on the height of the centre of mass of a rock at rest."""

_NEGLIGIBLE_WAY_SHARE = 1e-3
"""Displacement over R of the centre of mass below which a rock has not reached its balance over a point."""


@dataclass(frozen=True, eq=False)
class ShakeResult:
    """Outcome of a shake, and its cost.

    Parameters
    ----------
    status : str
        'ok', 'undecided' (not at rest within the cap), 'diverged' (a state that no energy in the motion explains) or
        'failed' (what `ended_by` names leaves no answer).
    outcome : str or None
        'stands', 'moved', 'toppled' or 'lodged'; None unless status is ok.
    toppled : bool or None
        True of a lodged rock too: it has left its support, and what stands beside it has caught it.
    topple_time_s, falls_toward_deg : float or None
        When the rock crossed its point of no return, from the start of the motion: its centre of mass was last highest,
        or, where it never rose, began to sink; and where it was then, seen from its start, or at the end, where it
        started past that point.
    max_tilt_deg, residual_tilt_deg, residual_yaw_deg : float
        Largest and last angle between the interface's normal and where the rock has carried it, since it was seated,
        or, where its start was given, from its pose in the scene; last turn about it, since the start.
    slip_m : float
        Way along the interface, at the end, of the material point that was in it below the centre of mass at the start.
    penetration_m : float
        Deepest that a contact point sank below the surface; a start inside the ground counts once it is raised.
    ended_by : str
        The rule that ended the shake.
    steps, engine_steps, simulated_s, skipped_s, wall_s
        Steps taken, those of them that the engine took or checked, time stepped through, time skipped with the rock at
        rest or its answer certain, and the cost.
    time_step_s : float
    trajectory : Trajectory or None
    """

    status: str
    outcome: str | None
    toppled: bool | None
    topple_time_s: float | None
    falls_toward_deg: float | None
    max_tilt_deg: float
    residual_tilt_deg: float
    residual_yaw_deg: float
    slip_m: float
    penetration_m: float
    ended_by: str
    steps: int
    engine_steps: int
    simulated_s: float
    skipped_s: float
    wall_s: float
    time_step_s: float
    trajectory: Trajectory | None = field(repr=False, default=None)


def result_of(
    ended_by: str,
    seen: Observation,
    problem: Problem,
    time_s: Array,
    pose: Array,
    *,
    trajectory: bool,
    lodged: bool = False,
    **cost: Any,
) -> ShakeResult:
    """Outcome by the whole trajectory (n,) and (n, 7), support frame, and by the last observation."""
    contact, status = problem.contact, _STATUS.get(ended_by, "ok")
    tilt = contact.tilts_deg(pose[:, 3:])
    fell = ended_by in dict(FALLS) or lodged or bool(tilt[-1] > TOPPLED_TILT_DEG)
    toppled = fell if status == "ok" else None
    turning = _point_of_no_return(ended_by, contact, pose[:, :3], tilt, lodged=lodged) if toppled else None
    outcome = None
    if status == "ok":
        displaced = is_displaced(seen, problem) or tilt[-1] > problem.options.termination.moved_deg
        fallen = "lodged" if lodged else "toppled"
        outcome = fallen if toppled else "moved" if displaced else "stands"
    return ShakeResult(
        status=status,
        outcome=outcome,
        toppled=toppled,
        topple_time_s=None if turning is None else float(time_s[turning]),
        falls_toward_deg=None if turning is None else _fell_toward_deg(contact, pose[:, :3], turning),
        max_tilt_deg=float(np.nanmax(tilt)),
        residual_tilt_deg=float(tilt[-1]),
        residual_yaw_deg=seen.turned_deg,
        slip_m=seen.slip_m,
        ended_by=ended_by,
        trajectory=_trajectory_of(contact, time_s, pose) if trajectory else None,
        **cost,
    )


def _trajectory_of(contact: ContactModel, time_s: Array, pose: Array) -> Trajectory:
    """The public view of a trajectory (n, 7) in the support frame."""
    turn = contact.scene_from_support
    relative = Rotation.from_quat(pose[:, 3:]) * Rotation.from_quat(contact.start_quaternion_xyzw).inv()
    quaternion = relative.as_quat()
    in_scene = np.column_stack([quaternion[:, :3] @ turn.T, quaternion[:, 3]])
    return Trajectory(time_s.copy(), pose[:, :3] @ turn.T + contact.origin_m, in_scene)


def _point_of_no_return(
    ended_by: str, contact: ContactModel, com_m: Array, tilt_deg: Array, *, lodged: bool
) -> int:
    """Index of the pose in which the final fall began.

    That in which the centre of mass was last highest, along the plumb line, but not of a later rise: between two looks
    a rock that fell lands on its next face, and one that came to rest on another face is rocked there by the rest of
    the motion. One that lodges swings against what holds it: of such a rock the highest moment counts.
    """
    if lodged:
        still = int(np.argmax(com_m @ contact.scene_from_support[2]))
    elif ended_by in dict(FALLS):
        low = com_m[:, 2] < (1.0 - TOPPLED_FALL) * contact.com_m[2]
        fallen = np.flatnonzero(low | (tilt_deg > LARGEST_OPEN_TILT_DEG))
        still = int(fallen[0]) - 1 if len(fallen) else len(com_m) - 1
    else:  # at rest on another face
        still = int(np.flatnonzero(tilt_deg <= TOPPLED_TILT_DEG).max(initial=0))
    level_m = _LEVEL_SHARE * contact.half_diagonal_m
    return _last_top(com_m @ contact.scene_from_support[2], max(still, 0), level_m)


def _fell_toward_deg(contact: ContactModel, com_m: Array, turning: int) -> float:
    """Azimuth of the way of the centre of mass (n, 3), support frame, up to the point of no return.

    A rock that starts past its balance has not moved by then but for rounding: it falls toward where it ends.
    """
    moved_m = (com_m - com_m[0]) @ contact.scene_from_support.T
    path_m = float(np.hypot(*moved_m[turning, :2]))
    seen = turning if path_m > _NEGLIGIBLE_WAY_SHARE * contact.half_diagonal_m else -1
    return azimuth_deg(moved_m[seen])


def _last_top(height_m: Array, still: int, level_m: float = 0.0) -> int:
    """Index of the last maximum up to index `still`, or of the one to which the height rises there.

    Where the height stays within `level_m` of the maximum, as that of a rock at rest, the last of these: a rock that
    has stood for a time and then falls without rising has its maximum when it leaves.
    """
    rises = np.append(np.diff(height_m) > 0.0, False)
    if rises[still]:
        return still + int(np.argmin(rises[still:]))
    before = np.flatnonzero(rises[:still])
    top = int(before[-1]) + 1 if len(before) else 0
    return top + int(np.flatnonzero(height_m[top : still + 1] >= height_m[top] - level_m)[-1])
