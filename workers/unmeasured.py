"""Unmeasured quantities of a shaking: friction, restitution, the turn, what the band left out. Realisations draw it."""

from __future__ import annotations

import dataclasses
import hashlib
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from toppling.models.motions.imposing import with_motion_above
from toppling.models.motions.record import Record, motion_sha
from toppling.models.pedestal import ContactProperties


@dataclass(frozen=True)
class Unmeasured:
    """Distributions that a campaign states before any outcome is looked at; realisation 0 draws nothing.

    Parameters
    ----------
    friction : (float, float) or None
        Friction is as likely anywhere between these; None leaves the job's, which varies by some per cent.
    restitution : (float, float) or None
        The same of the coefficient of restitution.
    yaw_deg : float
        The motion is turned about the vertical by at most so much, either way.
    either_sense : bool
        Whether the motion's positive axis may as well point the other way.
    band_hz : float or None
        Where the records' band ends, of whose motion above nothing is known.
    above_band : (float, float) or None
        Motion in the octave above it over that in the octave below (root mean squares) is as likely anywhere between
        these.
    """

    friction: tuple[float, float] | None = None
    restitution: tuple[float, float] | None = None
    yaw_deg: float = 0.0
    either_sense: bool = False
    band_hz: float | None = None
    above_band: tuple[float, float] | None = None

    def turn_deg(self, realisation: int) -> float:
        """By which a realisation turns the motion, degrees counter-clockwise."""
        if realisation == 0:
            return 0.0
        _, _, yaw, sense, _ = _point(realisation)
        return self.yaw_deg * (2.0 * yaw - 1.0) + (180.0 if self.either_sense and sense < 0.5 else 0.0)

    def contact(self, contact: ContactProperties, realisation: int) -> ContactProperties:
        """Contact properties of a realisation; what is not drawn stays."""
        if realisation == 0:
            return contact
        friction, restitution = _point(realisation)[:2]
        static, kinetic, bounce = contact.friction_static, contact.friction_kinetic, contact.restitution
        if self.friction is not None:
            static = kinetic = _between(self.friction, friction)
        if self.restitution is not None:
            bounce = _between(self.restitution, restitution)
        return ContactProperties(static, kinetic, bounce)

    def record(self, record: Record, realisation: int) -> Record:
        """The record with what its band left out; its strength is stated without."""
        if realisation == 0 or self.band_hz is None or self.above_band is None:
            return record
        seed = hashlib.sha256(f"{record.sha}:{realisation}".encode()).digest()[:8]
        random = np.random.default_rng(int.from_bytes(seed, "little"))
        share = _between(self.above_band, _point(realisation)[4])
        motion = with_motion_above(record.motion, self.band_hz, share, random)
        sha = motion_sha(motion, record.intensity["strong_azimuth_deg"])
        return dataclasses.replace(record, motion=motion, sha=sha)


@lru_cache(maxsize=64)
def _point(realisation: int) -> tuple[float, float, float, float, float]:
    """Point of the unit cube: few realisations fill it evenly, and the same whatever their number."""
    from scipy.stats import qmc  # most campaigns are read without it, and it takes half a second

    point = qmc.Sobol(5, rng=29).fast_forward(realisation).random(1)[0]
    return tuple(point.tolist())


def _between(interval: tuple[float, float], share: float) -> float:
    low, high = interval
    return low + share * (high - low)
