"""When the next point comes down to the surface. Pure and compiled; knows no engine."""

from __future__ import annotations

import numpy as np

from toppling.workers.compiled import Array, compiled
from toppling.workers.contact.gaps import gaps_m, moved


@compiled
def time_to_contact_s(
    point_m: Array,
    pose: Array,
    velocity: Array,
    acceleration: Array,
    since_s: float,
    end_s: float,
) -> float:
    """Time at which one point (1, 3), body axes, comes down to the plane; `end_s` if it does not before.

    The velocity is that at a time `since_s` before the pose; a step moves the rock with that of its middle.
    """
    there, gap, mean = np.empty(7), np.empty(1), np.empty(6)
    low, high = 0.0, end_s
    gaps_m(point_m, pose, gap)
    before_s, before_m, time = 0.0, gap[0], end_s
    for _ in range(30):
        for k in range(6):
            mean[k] = velocity[k] + acceleration[k] * (since_s + 0.5 * time)
        moved(pose, mean, time, there)
        gaps_m(point_m, there, gap)
        if gap[0] > 0.0:
            if time == end_s:
                return end_s
            low = time
        else:
            high = time
        slope = (gap[0] - before_m) / (time - before_s) if time != before_s else -1.0
        before_s, before_m = time, gap[0]
        following = time - gap[0] / slope if slope < 0.0 else 0.5 * (low + high)
        if not low < following < high:
            following = 0.5 * (low + high)
        if abs(following - time) < 1e-13 * end_s:
            break
        time = following
    return time
