"""The axes along which Bullet's friction acts, chosen so that it opposes the slip.

Bullet gives each contact two rows of friction and brings their impulses back to the cone together. Each row has a
step of its own, the inverse of the point's mobility along its axis, so that the iterations do not converge to
friction against the slip v but to one against (v_a / K_aa, v_b / K_bb). Its direction is off by half of ln(K_aa /
K_bb) times the sine of twice the angle from the axes to the slip: a plate of 1:3 in plan that slid at 30 degrees to
its axes went 10 % too far and 14 degrees to the side, at any time step. The error vanishes where the slip goes along
an axis, and where the point is as mobile along one axis as along the other, which are the bisectors of its principal
ones. So the engine's world is turned about the normal to where the friction of the points that touch is least off.

Complex numbers stand for vectors along the interface. Of each point `unlike` is how its mobilities along x and y
differ, over their mean: it turns by twice the axes' angle. `slip` is the square of its slip's direction, 0 where it
may slip in any.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from toppling.models.compiled import Array, Indices, compiled

Complex = NDArray[np.complex128]

CANDIDATES = np.exp(4j * np.deg2rad(np.arange(0.0, 90.0, 2.0)))
"""Of axes, exp(-4j angle): where points slip in different directions none serve all, and the best of these is taken."""


@compiled(allocates=True)
def point_mobilities(
    points_m: Array,
    mobilities: Array,
    points: Indices,
    pose: Array,
    velocity: Array,
    slips_from_m_s: float,
) -> tuple[Complex, Complex]:
    """What decides on the axes, `unlike` and `slip` (k,), of the points of these indices (k,).

    `points_m` (n, 3) and `mobilities` (n, 6), arm x (inertia / mass)^-1 x arm as xx, yy, zz, xy, xz, yz, are those of
    all contact points, body axes. Points slower than `slips_from_m_s` may slip in any direction, and so may those that
    come down faster than they slip.
    """
    x, y, z, w = pose[3], pose[4], pose[5], pose[6]
    p = complex(1 - 2 * (y * y + z * z), 2 * (x * y + z * w))
    q = complex(2 * (x * y - z * w), 1 - 2 * (x * x + z * z))
    r = complex(2 * (x * z + y * w), 2 * (y * z - x * w))
    nx, ny, nz = 2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)
    forward, turning = complex(velocity[0], velocity[1]), 1j * velocity[5]
    rolling = -1j * complex(velocity[3], velocity[4])
    pp, qq, rr, pq, pr, qr = p * p, q * q, r * r, 2 * p * q, 2 * p * r, 2 * q * r
    unlike, slip = np.empty(len(points), np.complex128), np.empty(len(points), np.complex128)
    for k, i in enumerate(points):
        a, b, c = points_m[i, 0], points_m[i, 1], points_m[i, 2]
        aa, bb, cc = mobilities[i, 0], mobilities[i, 1], mobilities[i, 2]
        ab, ac, bc = mobilities[i, 3], mobilities[i, 4], mobilities[i, 5]
        height = nx * a + ny * b + nz * c
        upright = (
            aa * nx * nx + bb * ny * ny + cc * nz * nz + 2 * (ab * nx * ny + ac * nx * nz + bc * ny * nz)
        )
        # Half the difference of the mobilities along the interface's x and y, and that between them, over their mean.
        unlike[k] = (aa * pp + bb * qq + cc * rr + ab * pq + ac * pr + bc * qr) / (
            2.0 + aa + bb + cc - upright
        )
        arm = p * a + q * b + r * c
        sliding = forward + turning * arm + rolling * height
        speed = math.sqrt(sliding.real * sliding.real + sliding.imag * sliding.imag)
        rise = velocity[2] - (rolling * arm.conjugate()).real
        if speed > max(slips_from_m_s, abs(rise)):
            slip[k] = sliding * sliding / (speed * speed)
        else:
            slip[k] = 0j
    return unlike, slip


@compiled
def squared_error(unlike: Complex, slip: Complex, axes_rad: float) -> float:
    """Sum over the points of the squared angle, rad, by which friction is off the slip with axes at that angle."""
    turned = complex(math.cos(2.0 * axes_rad), -math.sin(2.0 * axes_rad))
    total = 0.0
    for k in range(len(unlike)):
        size = (unlike[k] * turned).real
        # Half is the mean over all directions, in which a point may slip that does not yet.
        across = (slip[k] * turned).imag ** 2 if slip[k] != 0 else 0.5
        total += size * size * across
    return total


@compiled(allocates=True)
def best_axes_rad(unlike: Complex, slip: Complex, present_rad: float, allowed_rad: float) -> float:
    """Angle from the support frame's x to the axes along which the friction of some points is least off.

    In the mean of its square over the points: at the present angle, where that is off by less than `allowed_rad`, along
    the slip, on the bisectors of the points' principal axes or, where they slip in different directions, between these.
    Of a single point always on its bisectors, which serve any slip: that of an impact is another one after it.
    """
    count = len(unlike)
    if count == 1:
        slip = np.zeros(1, np.complex128)
    enough = allowed_rad * allowed_rad * count
    present = squared_error(unlike, slip, present_rad)
    if present < enough:
        return present_rad
    along, bisecting, slips = 0j, 0j, False
    for k in range(count):
        along += slip[k]
        bisecting -= unlike[k] * unlike[k]
        slips = slips or slip[k] != 0
    best, least = present_rad, present
    for axes in (0.5 * math.atan2(along.imag, along.real), 0.25 * math.atan2(bisecting.imag, bisecting.real)):
        error = squared_error(unlike, slip, axes)
        if error < least:
            best, least = axes, error
    if least < enough or not slips:
        return best
    # The only parts of the sum that go with the axes' angle are those with exp(-4j angle) and with the square of it.
    once, twice = 0j, 0j
    for k in range(count):
        both = slip[k] * unlike[k]
        if slip[k] != 0:
            once += -0.5j * (slip[k] * unlike[k].conjugate()).imag * both
        else:
            once += 0.25 * unlike[k] * unlike[k]
        twice -= 0.125 * both * both
    chosen, lowest = CANDIDATES[0], np.inf
    for turned in CANDIDATES:
        value = (once * turned + twice * turned * turned).real
        if value < lowest:
            chosen, lowest = turned, value
    axes = -0.25 * math.atan2(chosen.imag, chosen.real)
    return axes if squared_error(unlike, slip, axes) < least else best
