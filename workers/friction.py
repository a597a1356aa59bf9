"""The axes along which Bullet's friction acts, chosen so that it opposes the slip.

Bullet gives each contact two rows of friction and brings their impulses back to the cone together. Each row has
a step of its own, the inverse of the foot's mobility along its axis, so that the iterations do not converge to
friction against the slip v but to one against (v_a / K_aa, v_b / K_bb). It leans by half of ln(K_aa / K_bb)
times the sine of twice the angle from the axes to the slip: a plate of 1:3 in plan that slid at 30 degrees to
its axes went 10 % too far and 14 degrees to the side, at any time step. The lean vanishes where the slip goes
along an axis, and where the foot is as mobile along one axis as along the other, which are the bisectors of its
principal ones. So the engine's world is turned about the normal to where the feet that touch lean least.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence

from toppling.workers.contact import ContactModel, Pose
from toppling.workers.way import Vector

LEAN_RAD = 1e-3
"""Axes are kept while friction leans by less: it then is wrong by a thousandth of itself, and across the slip."""

LEAN_OF_IMPACT_RAD = 1e-2
"""The same for the slip with which an impact leaves the feet: it is not known before."""

BETWEEN = [cmath.exp(4j * math.radians(degrees)) for degrees in range(0, 90, 2)]
"""Of axes, exp(-4j angle): where feet slip in different directions none serve all, and the best of these are taken."""

Foot = tuple[complex, complex]
"""How unlike its mobilities are along the interface's x and y, over their mean, as a complex number that turns by twice
the axes' angle; and the square of its slip's direction, 0 where it may slip in any."""


def feet_of(
    contact: ContactModel,
    feet: Sequence[int],
    pose: Pose,
    velocity_m_s: Vector,
    angular_velocity_rad_s: Vector,
    slips_from_m_s: float,
) -> list[Foot]:
    """What decides on the axes, of some feet.

    Parameters
    ----------
    contact : ContactModel
    feet : sequence of int
        Indices of the contact points that touch or are about to.
    pose, velocity_m_s, angular_velocity_rad_s
        The rock's, support frame.
    slips_from_m_s : float
        Feet that are slower may slip in any direction, and so may those that come down faster than they slip.
    """
    # Complex numbers stand for vectors along the interface: p, q, r for the body's axes. Bare Python, as feet are few.
    x, y, z, w = pose[1]
    p = complex(1 - 2 * (y * y + z * z), 2 * (x * y + z * w))
    q = complex(2 * (x * y - z * w), 1 - 2 * (x * x + z * z))
    r = complex(2 * (x * z + y * w), 2 * (y * z - x * w))
    normal = 2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)
    forward, turning = complex(velocity_m_s[0], velocity_m_s[1]), 1j * angular_velocity_rad_s[2]
    rolling = -1j * complex(angular_velocity_rad_s[0], angular_velocity_rad_s[1])
    pp, qq, rr, pq, pr, qr = p * p, q * q, r * r, 2 * p * q, 2 * p * r, 2 * q * r
    told: list[Foot] = []
    for foot in feet:
        (a, b, c), (aa, bb, cc, ab, ac, bc) = contact.arms_and_mobilities[foot]
        height = normal[0] * a + normal[1] * b + normal[2] * c
        upright = (
            aa * normal[0] ** 2 + bb * normal[1] ** 2 + cc * normal[2] ** 2
            + 2 * (ab * normal[0] * normal[1] + ac * normal[0] * normal[2] + bc * normal[1] * normal[2])
        )  # fmt: skip
        # Half the difference of the mobilities along the interface's x and y, and that between them, over their mean.
        unlike = (aa * pp + bb * qq + cc * rr + ab * pq + ac * pr + bc * qr) / (2.0 + aa + bb + cc - upright)
        arm = p * a + q * b + r * c
        slip = forward + turning * arm + rolling * height
        speed, rise = abs(slip), velocity_m_s[2] - (rolling * arm.conjugate()).real
        told.append((unlike, (slip / speed) ** 2 if speed > max(slips_from_m_s, abs(rise)) else 0j))
    return told


def squared_lean(feet: Sequence[Foot], axes_rad: float) -> float:
    """Sum over the feet of the square of the angle, rad, by which friction leans with axes at that angle."""
    turned = cmath.exp(-2j * axes_rad)
    # Half is the mean over all directions, in which a foot may slip that does not yet.
    return sum(
        (unlike * turned).real ** 2 * ((slip * turned).imag ** 2 if slip else 0.5) for unlike, slip in feet
    )


def least_leaning_rad(feet: Sequence[Foot], present_rad: float) -> float:
    """Angle from the support frame's x to the axes along which the friction of some feet leans least.

    Parameters
    ----------
    feet : sequence of Foot
    present_rad : float
        The angle at present, kept where it serves.

    Returns
    -------
    float
        Where the lean is least, in the mean of its square over the feet: at the present angle, along the slip, on the
        bisectors of the feet's principal axes or, where they slip in different directions, between these. Of a single
        foot always on its bisectors, which serve any slip: that of an impact is another one after it.
    """
    if len(feet) == 1:
        feet = [(feet[0][0], 0j)]
    if squared_lean(feet, present_rad) < LEAN_RAD**2 * len(feet):
        return present_rad
    with_slip = 0.5 * cmath.phase(sum(slip for _, slip in feet))
    bisecting = 0.25 * cmath.phase(-sum(unlike**2 for unlike, _ in feet))
    exact = min((present_rad, with_slip, bisecting), key=lambda axes: squared_lean(feet, axes))
    if squared_lean(feet, exact) < LEAN_RAD**2 * len(feet) or not any(slip for _, slip in feet):
        return exact
    # Its only parts that go with the axes' angle are those with exp(-4j angle) and with the square of it.
    once = twice = 0j
    for unlike, slip in feet:
        once += -0.5j * (slip * unlike.conjugate()).imag * slip * unlike if slip else 0.25 * unlike**2
        twice -= 0.125 * (slip * unlike) ** 2
    between = min(BETWEEN, key=lambda turned: (once * turned + twice * turned * turned).real)
    return min(exact, -0.25 * cmath.phase(between), key=lambda axes: squared_lean(feet, axes))
