"""Gaps of the contact candidates and their rates. Compiled; knows no engine.

The gap of a candidate is the clearance of its material point over the surface that it meets, along that surface's
normal, negative where the point has penetrated. Where all meet one plane, the support frame's z = 0, only heights are
looked at.
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
    NORMAL_X,
    NORMAL_Y,
    NORMAL_Z,
    OFFSET,
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
    pose, fixed = sim.pose[index], sim.fixed[0]
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
    if not fixed.flat:
        nx, ny, nz = candidates[NORMAL_X], candidates[NORMAL_Y], candidates[NORMAL_Z]
        for i in range(points_in_use(sim)):
            gap[i] = (
                nx[i] * (pose[0] + arm_x[i])
                + ny[i] * (pose[1] + arm_y[i])
                + nz[i] * (pose[2] + arm_z[i])
                - candidates[OFFSET, i]
            )


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
    rate, arm_x, arm_y, arm_z = candidates[RATE], candidates[ARM_X], candidates[ARM_Y], candidates[ARM_Z]
    u, v, w = velocity[0], velocity[1], velocity[2]
    p, q, r = velocity[3], velocity[4], velocity[5]
    if sim.fixed[0].flat:
        for i in range(points_in_use(sim)):
            rate[i] = w + (p * arm_y[i] - q * arm_x[i])
        return
    for i in range(points_in_use(sim)):
        rate[i] = (
            candidates[NORMAL_X, i] * (u + q * arm_z[i] - r * arm_y[i])
            + candidates[NORMAL_Y, i] * (v + r * arm_x[i] - p * arm_z[i])
            + candidates[NORMAL_Z, i] * (w + p * arm_y[i] - q * arm_x[i])
        )


@inner
def find_centripetal(sim: Simulation, velocity: Array) -> None:
    """Accelerations of the points toward the axis of rotation, along their normals, into the row LEAST.

    They are spin x (spin x arm), positive upward.
    """
    candidates = sim.candidates
    out, arm_x, arm_y, arm_z = candidates[LEAST], candidates[ARM_X], candidates[ARM_Y], candidates[ARM_Z]
    p, q, r = velocity[3], velocity[4], velocity[5]
    if sim.fixed[0].flat:
        a, b, c = r * p, r * q, -p * p - q * q
        for i in range(points_in_use(sim)):
            out[i] = arm_x[i] * a + arm_y[i] * b + arm_z[i] * c
        return
    square = p * p + q * q + r * r
    for i in range(points_in_use(sim)):
        nx, ny, nz = candidates[NORMAL_X, i], candidates[NORMAL_Y, i], candidates[NORMAL_Z, i]
        along = p * arm_x[i] + q * arm_y[i] + r * arm_z[i]
        out[i] = along * (p * nx + q * ny + r * nz) - square * (nx * arm_x[i] + ny * arm_y[i] + nz * arm_z[i])


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
    candidates, fixed, lowest = sim.candidates, sim.fixed[0], np.inf
    count = sim.set_points[sim.state[0].widest]
    for index in range(since, sim.state[0].last + 1):
        pose = sim.pose[index]
        if fixed.flat:
            nx, ny, nz = normal_in_body(pose)
            for i in range(count):
                arm = candidates[X, i] * nx + candidates[Y, i] * ny + candidates[Z, i] * nz
                lowest = min(lowest, arm + pose[2])
        else:
            for i in range(count):
                lowest = min(
                    lowest, gap_in_m(sim, i, pose[0], pose[1], pose[2], (pose[3], pose[4], pose[5], pose[6]))
                )
    return lowest


@inner
def gap_in_m(
    sim: Simulation, i: int, x: float, y: float, z: float, attitude: tuple[float, float, float, float]
) -> float:
    """Gap of one candidate with the centre of mass at (x, y, z)."""
    candidates = sim.candidates
    p, q, r, w = attitude
    a, b, c = candidates[X, i], candidates[Y, i], candidates[Z, i]
    up = 2 * (p * r - q * w) * a + 2 * (q * r + p * w) * b + (1 - 2 * (p * p + q * q)) * c
    if sim.fixed[0].flat:
        return z + up
    along = (1 - 2 * (q * q + r * r)) * a + 2 * (p * q - r * w) * b + 2 * (p * r + q * w) * c
    across = 2 * (p * q + r * w) * a + (1 - 2 * (p * p + r * r)) * b + 2 * (q * r - p * w) * c
    return (
        candidates[NORMAL_X, i] * (x + along)
        + candidates[NORMAL_Y, i] * (y + across)
        + candidates[NORMAL_Z, i] * (z + up)
        - candidates[OFFSET, i]
    )


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
