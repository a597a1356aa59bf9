"""When the next candidate comes down to its surface. Compiled; knows no engine."""

from __future__ import annotations

from toppling.models.compiled import Array, inner
from toppling.workers.contact.gaps import gap_in_m, turned_on
from toppling.workers.simulation import Simulation


@inner
def time_to_contact_s(
    sim: Simulation, i: int, pose: Array, velocity: Array, acceleration: Array, since_s: float, end_s: float
) -> float:
    """Time at which one candidate comes down to its surface; `end_s` if it does not before.

    The velocity is that at a time `since_s` before the pose; a step moves the rock with that of its middle.
    """
    low, high = 0.0, end_s
    before_m = gap_in_m(sim, i, pose[2], (pose[3], pose[4], pose[5], pose[6]))
    before_s, time = 0.0, end_s
    for _ in range(30):
        middle_s = since_s + 0.5 * time
        z = pose[2] + time * (velocity[2] + acceleration[2] * middle_s)
        p = velocity[3] + acceleration[3] * middle_s
        q = velocity[4] + acceleration[4] * middle_s
        r = velocity[5] + acceleration[5] * middle_s
        gap = gap_in_m(sim, i, z, turned_on(pose, p, q, r, time))
        if gap > 0.0:
            if time == end_s:
                return end_s
            low = time
        else:
            high = time
        slope = (gap - before_m) / (time - before_s) if time != before_s else -1.0
        before_s, before_m = time, gap
        following = time - gap / slope if slope < 0.0 else 0.5 * (low + high)
        if not low < following < high:
            following = 0.5 * (low + high)
        if abs(following - time) < 1e-13 * end_s:
            break
        time = following
    return time
