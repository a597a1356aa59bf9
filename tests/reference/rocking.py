"""Plane rocking of a body on two corners, event by event: no slip, no bounce (Housner 1963, Yim et al. 1980).

The angle is positive where the body turns toward +x, about its right corner. With r the pivot's distance from
the centre of mass, beta the angle of that line to the vertical at rest and i the inertia over mass about the
pivot, i theta'' = -r [(g + a_z) sin(beta sgn - theta) + a_x cos(beta sgn - theta)]. Landing on the other
corner the impulse acts at that corner: the angular momentum about it is kept.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import OdeSolution, solve_ivp
from scipy.optimize import brentq

Array = NDArray[np.float64]

TOLERANCE = 1e-11
"""Relative, of the integrator (Dormand and Prince 8(5,3)) with located events."""

_STILL = 1e-9  # an impact that leaves less than this share of p is the last of its train


@dataclass(frozen=True)
class PlaneBody:
    """A rigid body on two corners: their horizontal distances from the centre of mass, its height and its inertia."""

    right_m: float
    left_m: float
    height_m: float
    inertia_per_mass_m2: float

    @classmethod
    def rectangle(cls, half_width_m: float, half_height_m: float) -> PlaneBody:
        """Return a solid rectangle on its corners."""
        return cls(half_width_m, half_width_m, half_height_m, (half_width_m**2 + half_height_m**2) / 3)

    def arm_m(self, sense: int) -> float:
        """Distance from the centre of mass to the right (+1) or left (-1) corner."""
        return float(np.hypot(self.right_m if sense > 0 else self.left_m, self.height_m))

    def slenderness(self, sense: int) -> float:
        """Angle at rest of the line to the right (+1) or left (-1) corner from the vertical."""
        return float(np.arctan2(self.right_m if sense > 0 else self.left_m, self.height_m))

    def inertia_about_corner_m2(self, sense: int) -> float:
        """Inertia over mass about the right (+1) or left (-1) corner."""
        return self.inertia_per_mass_m2 + self.arm_m(sense) ** 2

    def impact_ratio(self, landing: int) -> float:
        """Angular velocity after landing on the right (+1) or left (-1) corner over that before."""
        remaining = self.inertia_per_mass_m2 + self.height_m**2 - self.right_m * self.left_m
        return remaining / self.inertia_about_corner_m2(landing)


@dataclass(frozen=True)
class Ground:
    """Ground acceleration (a_x, a_z), m/s2, at a time, and the times (k,) between which it is smooth.

    Uplift from rest is looked for at these times and between neighbours. After the last the acceleration is zero.
    """

    at: Callable[[float], tuple[float, float]]
    breaks_s: Array

    @classmethod
    def samples(
        cls, time_step_s: float, horizontal_m_s2: ArrayLike, vertical_m_s2: ArrayLike | float = 0.0
    ) -> Ground:
        """Return ground acceleration that is linear between samples."""
        horizontal = np.asarray(horizontal_m_s2, float)
        vertical = np.broadcast_to(np.asarray(vertical_m_s2, float), horizontal.shape)
        last = len(horizontal) - 2

        def at(time: float) -> tuple[float, float]:
            place = time / time_step_s
            i = min(max(int(place), 0), last)
            part = place - i
            if part > 1.0:
                return 0.0, 0.0
            return (
                float(horizontal[i] + part * (horizontal[i + 1] - horizontal[i])),
                float(vertical[i] + part * (vertical[i + 1] - vertical[i])),
            )

        return cls(at, np.arange(len(horizontal), dtype=np.float64) * np.float64(time_step_s))

    @classmethod
    def constant(cls, horizontal_m_s2: float, duration_s: float) -> Ground:
        """Return a rectangular pulse."""
        return cls(
            lambda time: (horizontal_m_s2 if time <= duration_s else 0.0, 0.0), np.array([0.0, duration_s])
        )

    @classmethod
    def sine(cls, amplitude_m_s2: float, period_s: float, cycles: float = 1.0) -> Ground:
        """Return a sine pulse that starts with a positive acceleration."""
        end = cycles * period_s

        def at(time: float) -> tuple[float, float]:
            return (amplitude_m_s2 * float(np.sin(2 * np.pi * time / period_s)) if time < end else 0.0), 0.0

        return cls(at, np.linspace(0.0, end, int(np.ceil(16 * cycles)) + 1))

    @classmethod
    def still(cls) -> Ground:
        """Return ground at rest."""
        return cls(lambda _: (0.0, 0.0), np.array([0.0, 0.0]))


@dataclass
class Rocking:
    """Times of the impacts, angular velocities just before them, and the side (+1, -1) on which the body lies, or 0."""

    impacts_s: list[float] = field(default_factory=list)
    rates_before_rad_s: list[float] = field(default_factory=list)
    overturned: int = 0
    pieces: list[tuple[float, float, OdeSolution]] = field(default_factory=list)

    def angle_at(self, time_s: ArrayLike) -> Array:
        """Angle at times (k,), rad; zero at rest."""
        time = np.atleast_1d(np.asarray(time_s, float))
        angle = np.zeros(len(time))
        for start, end, solution in self.pieces:
            within = (time >= start) & (time <= end)
            if within.any():
                angle[within] = solution(time[within])[0]
        return angle


def rock(
    body: PlaneBody, ground: Ground, duration_s: float, angle_rad: float = 0.0, gravity_m_s2: float = 9.81
) -> Rocking:
    """Rock a body that is let go at an angle, until a time or until it lies on its side.

    A body whose impact ratio is not positive does not rock (alpha above 54.7 degrees for a rectangle): ValueError.
    """
    if min(body.impact_ratio(1), body.impact_ratio(-1)) <= 0:
        msg = f"{body} has no positive impact ratio: it does not rock from corner to corner"
        raise ValueError(msg)
    result = Rocking()
    time, angle, rate = 0.0, angle_rad, 0.0
    sense = int(np.sign(angle_rad))
    while time < duration_s:
        if sense == 0:
            uplift = _next_uplift(body, ground, gravity_m_s2, time, duration_s)
            if uplift is None:
                break
            time, sense = uplift
            angle = rate = 0.0
        later = ground.breaks_s[ground.breaks_s > time + 1e-12]
        span = (time, float(min(later[0], duration_s)) if len(later) else duration_s)
        solved = _swing(body, ground, gravity_m_s2, sense, span, (angle, rate))
        result.pieces.append((time, float(solved.t[-1]), solved.sol))
        time = float(solved.t[-1])
        angle, rate = float(solved.y[0, -1]), float(solved.y[1, -1])
        if len(solved.t_events[1]):
            result.overturned = sense
            break
        if len(solved.t_events[0]):
            result.impacts_s.append(time)
            result.rates_before_rad_s.append(rate)
            sense = -sense
            angle, rate = 0.0, rate * body.impact_ratio(sense)
            if abs(rate) < _STILL * np.sqrt(gravity_m_s2 / body.arm_m(sense)):
                sense, time = 0, time + 1e-9
    return result


def overturns(body: PlaneBody, ground: Ground) -> int:
    """Sense (+1, -1) in which a ground motion overturns a body, or 0."""
    slowest = np.sqrt(max(body.inertia_about_corner_m2(s) / (9.81 * body.arm_m(s)) for s in (1, -1)))
    return rock(body, ground, float(ground.breaks_s[-1]) + 30.0 * float(slowest)).overturned


def _swing(body, ground, gravity, sense, span, state) -> Any:
    """Integrate about one corner until it lands, lies on its side, or the ground's acceleration kinks."""
    arm, inertia = body.arm_m(sense), body.inertia_about_corner_m2(sense)
    beta = sense * body.slenderness(sense)

    def motion(time: float, y: Array) -> list[float]:
        a_x, a_z = ground.at(min(time, span[1]))
        lever = beta - y[0]
        return [y[1], -arm / inertia * ((gravity + a_z) * np.sin(lever) + a_x * np.cos(lever))]

    def lands(_: float, y: Array) -> float:
        return sense * float(y[0])

    def lies(_: float, y: Array) -> float:
        return sense * float(y[0]) - 0.5 * np.pi

    lands.terminal, lands.direction = True, -1.0  # type: ignore[attr-defined]
    lies.terminal, lies.direction = True, 1.0  # type: ignore[attr-defined]
    return solve_ivp(
        motion,
        span,
        state,
        "DOP853",
        dense_output=True,
        events=(lands, lies),
        rtol=TOLERANCE,
        atol=abs(beta) * TOLERANCE * 1e-2,
        first_step=min(1e-3, 0.5 * (span[1] - span[0])),
    )


def _next_uplift(
    body: PlaneBody, ground: Ground, gravity: float, start: float, duration: float
) -> tuple[float, int] | None:
    """First time from a start at which the moment about a corner lifts the body, and its sense."""

    def lifting(time: float, sense: int) -> float:
        a_x, a_z = ground.at(time)
        return -sense * a_x - (gravity + a_z) * np.tan(body.slenderness(sense))

    found: list[tuple[float, int]] = []
    within = (ground.breaks_s > start) & (ground.breaks_s <= duration)
    breaks = np.concatenate([[start], ground.breaks_s[within]])
    for sense in (1, -1):
        if lifting(start, sense) > 0:
            found.append((start, sense))
            continue
        values = np.array([lifting(t, sense) for t in breaks])
        rising = np.flatnonzero(values > 0)
        if len(rising):
            i = int(rising[0])
            found.append((float(brentq(lifting, breaks[i - 1], breaks[i], args=(sense,), xtol=1e-15)), sense))
    return min(found) if found else None
