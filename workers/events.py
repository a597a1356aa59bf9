"""Contact events: gaps of the contact points, how fast they close, and when the next impact comes.

Pure and compiled; knows no engine. A pose is an array (7,): centre of mass in the support frame, and attitude as a
quaternion. A velocity is an array (6,): of the centre of mass, and angular. A gap is the clearance of a contact point
over the interface plane, negative where the point has penetrated.
"""

from __future__ import annotations

import math

import numpy as np

from toppling.workers.compiled import Array, compiled
from toppling.workers.quaternion import normal_in_body, to_body


@compiled
def gaps_m(points_m: Array, pose: Array, out: Array) -> None:
    """Gaps of the first n contact points, into `out` (n,)."""
    nx, ny, nz = normal_in_body(pose)
    above = pose[2]
    for i in range(len(out)):
        out[i] = (points_m[i, 0] * nx + points_m[i, 1] * ny + points_m[i, 2] * nz) + above


@compiled
def gap_rates_m_s(points_m: Array, pose: Array, velocity: Array, out: Array) -> None:
    """Rates of the gaps of the first n contact points, into `out` (n,): velocities along the normal."""
    p, q, _ = velocity[3], velocity[4], velocity[5]
    # The normal part of spin x arm is (spin x arm) . n = arm . (n x spin); the arms end at the lowest points.
    a, b, c = to_body(-q, p, 0.0, pose)
    for i in range(len(out)):
        out[i] = velocity[2] + (points_m[i, 0] * a + points_m[i, 1] * b + points_m[i, 2] * c)


@compiled
def centripetal_m_s2(points_m: Array, pose: Array, velocity: Array, out: Array) -> None:
    """Acceleration of the first n points toward their axis of rotation, along the normal, into `out` (n,).

    It is spin x (spin x arm), positive upward.
    """
    x, y, z = velocity[3], velocity[4], velocity[5]
    a, b, c = to_body(z * x, z * y, -x * x - y * y, pose)
    for i in range(len(out)):
        out[i] = points_m[i, 0] * a + points_m[i, 1] * b + points_m[i, 2] * c


@compiled
def moved(pose: Array, velocity: Array, time_s: float, out: Array) -> None:
    """Pose (7,) after moving with a constant velocity (6,), as the engine moves a rock."""
    for k in range(3):
        out[k] = pose[k] + time_s * velocity[k]
    p, q, r = velocity[3], velocity[4], velocity[5]
    spin = math.sqrt(p * p + q * q + r * r)
    half = 0.5 * spin * time_s
    share = math.sin(half) / spin if half > 1e-6 else 0.5 * time_s * (1.0 - half * half / 6.0)
    a, b, c, d = p * share, q * share, r * share, math.cos(half)
    x, y, z, w = pose[3], pose[4], pose[5], pose[6]
    out[3] = d * x + a * w + b * z - c * y
    out[4] = d * y - a * z + b * w + c * x
    out[5] = d * z + a * y - b * x + c * w
    out[6] = d * w - a * x - b * y - c * z


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
