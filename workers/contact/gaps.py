"""Gaps of the contact candidates and their rates. Compiled; knows no engine.

The gap of a candidate is the height of its material point over the plane that all meet, the support frame's z = 0;
negative where the point has penetrated.
"""

from __future__ import annotations

import math

import numpy as np

from toppling.models.compiled import Array, Vector, compiled, inner
from toppling.workers.quaternion import normal_in_body
from toppling.workers.simulation import (
    ARM_X,
    ARM_Y,
    ARM_Z,
    GAP,
    LEAST,
    MOBILITY,
    RATE,
    ROTATION,
    Simulation,
    X,
    Y,
    Z,
    points_in_use,
)


@inner
def look(sim: Simulation, index: int) -> None:
    """Arms and gaps of the candidates in use, and the rock's rotation and mobility, in a pose."""
    pose = sim.pose[index]
    _rotate(sim, pose)
    work, candidates = sim.work, sim.candidates
    a, b, c = work[ROTATION, 0], work[ROTATION, 1], work[ROTATION, 2]
    d, e, f = work[ROTATION + 1, 0], work[ROTATION + 1, 1], work[ROTATION + 1, 2]
    g, h, k = work[ROTATION + 2, 0], work[ROTATION + 2, 1], work[ROTATION + 2, 2]
    x, y, z = candidates[X], candidates[Y], candidates[Z]
    arm_x, arm_y, arm_z, gap = candidates[ARM_X], candidates[ARM_Y], candidates[ARM_Z], candidates[GAP]
    above = pose[2]
    for i in range(points_in_use(sim)):
        arm_x[i] = a * x[i] + b * y[i] + c * z[i]
        arm_y[i] = d * x[i] + e * y[i] + f * z[i]
        arm_z[i] = g * x[i] + h * y[i] + k * z[i]
        gap[i] = arm_z[i] + above


@inner
def _rotate(sim: Simulation, pose: Array) -> None:
    """Rotation of a pose, and the mobility that it gives the rock."""
    x, y, z, w = pose[3], pose[4], pose[5], pose[6]
    work, inertia = sim.work, sim.fixed[0].inertia_m2
    work[ROTATION, 0], work[ROTATION, 1], work[ROTATION, 2] = (
        1 - 2 * (y * y + z * z),
        2 * (x * y - z * w),
        2 * (x * z + y * w),
    )
    work[ROTATION + 1, 0], work[ROTATION + 1, 1], work[ROTATION + 1, 2] = (
        2 * (x * y + z * w),
        1 - 2 * (x * x + z * z),
        2 * (y * z - x * w),
    )
    work[ROTATION + 2, 0], work[ROTATION + 2, 1], work[ROTATION + 2, 2] = (
        2 * (x * z - y * w),
        2 * (y * z + x * w),
        1 - 2 * (x * x + y * y),
    )
    p, q, r = 1.0 / inertia[0], 1.0 / inertia[1], 1.0 / inertia[2]
    for i in range(3):
        for j in range(i + 1):
            value = (
                p * work[ROTATION + i, 0] * work[ROTATION + j, 0]
                + q * work[ROTATION + i, 1] * work[ROTATION + j, 1]
                + r * work[ROTATION + i, 2] * work[ROTATION + j, 2]
            )
            work[MOBILITY + i, j] = work[MOBILITY + j, i] = value


@inner
def find_rates(sim: Simulation, velocity: Array) -> None:
    """Rates of the gaps in the pose looked at, with a velocity (6,)."""
    candidates = sim.candidates
    rate, arm_x, arm_y = candidates[RATE], candidates[ARM_X], candidates[ARM_Y]
    w, p, q = velocity[2], velocity[3], velocity[4]
    for i in range(points_in_use(sim)):
        rate[i] = w + (p * arm_y[i] - q * arm_x[i])


@inner
def find_centripetal(sim: Simulation, velocity: Array) -> None:
    """Upward part of the points' accelerations toward the axis of rotation, spin x (spin x arm), into the row LEAST."""
    candidates = sim.candidates
    out, arm_x, arm_y, arm_z = candidates[LEAST], candidates[ARM_X], candidates[ARM_Y], candidates[ARM_Z]
    p, q, r = velocity[3], velocity[4], velocity[5]
    a, b, c = r * p, r * q, -p * p - q * q
    for i in range(points_in_use(sim)):
        out[i] = arm_x[i] * a + arm_y[i] * b + arm_z[i] * c


@inner
def lowest_looked_at_m(sim: Simulation) -> float:
    """Least gap in the pose looked at."""
    gap, lowest = sim.candidates[GAP], np.inf
    for i in range(points_in_use(sim)):
        lowest = min(lowest, gap[i])
    return lowest


@compiled
def lowest_gap_m(sim: Simulation, since: int) -> float:
    """Least gap, from a pose on, of the candidates that were in use so far."""
    candidates, lowest = sim.candidates, np.inf
    count = sim.set_points[sim.state[0].widest]
    for index in range(since, sim.state[0].last + 1):
        pose = sim.pose[index]
        nx, ny, nz = normal_in_body(pose)
        for i in range(count):
            arm = candidates[X, i] * nx + candidates[Y, i] * ny + candidates[Z, i] * nz
            lowest = min(lowest, arm + pose[2])
    return lowest


@inner
def gap_in_m(sim: Simulation, i: int, z: float, attitude: tuple[float, float, float, float]) -> float:
    """Gap of one candidate with the centre of mass at a height."""
    candidates = sim.candidates
    p, q, r, w = attitude
    a, b, c = candidates[X, i], candidates[Y, i], candidates[Z, i]
    up = 2 * (p * r - q * w) * a + 2 * (q * r + p * w) * b + (1 - 2 * (p * p + q * q)) * c
    return z + up


@inner
def turned_on(pose: Array, p: float, q: float, r: float, time_s: float) -> tuple[float, float, float, float]:
    """Attitude, a quaternion, after turning from a pose (7,) with a constant angular velocity: the exact rotation."""
    spin = math.sqrt(p * p + q * q + r * r)
    half = 0.5 * spin * time_s
    share = math.sin(half) / spin if half > 1e-6 else 0.5 * time_s * (1.0 - half * half / 6.0)
    a, b, c, d = p * share, q * share, r * share, math.cos(half)
    x, y, z, w = pose[3], pose[4], pose[5], pose[6]
    return (
        d * x + a * w + b * z - c * y,
        d * y - a * z + b * w + c * x,
        d * z + a * y - b * x + c * w,
        d * w - a * x - b * y - c * z,
    )


@compiled
def slip_m_s(velocity: Array, arm_m: Vector) -> float:
    """Speed along the plane of the point of a rock that is so far from its centre of mass; z is the normal."""
    along = velocity[0] + velocity[4] * arm_m[2] - velocity[5] * arm_m[1]
    across = velocity[1] + velocity[5] * arm_m[0] - velocity[3] * arm_m[2]
    return math.sqrt(along * along + across * across)
