"""Gaps of the contact candidates, their rates, and how a pose moves on. Pure and compiled; knows no engine.

A pose is an array (7,): centre of mass in the support frame, and attitude as a quaternion. A velocity is an array (6,):
of the centre of mass, and angular. A gap is the clearance of a candidate over the interface plane, negative where the
point has penetrated.
"""

from __future__ import annotations

import math

from toppling.workers.compiled import Array, Vector, compiled
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
def slip_m_s(velocity: Array, arm_m: Vector) -> float:
    """Speed along the plane of the point of a rock that is so far from its centre of mass; z is the normal."""
    along = velocity[0] + velocity[4] * arm_m[2] - velocity[5] * arm_m[1]
    across = velocity[1] + velocity[5] * arm_m[0] - velocity[3] * arm_m[2]
    return math.sqrt(along * along + across * across)
