"""Two records that are one: the same shaking at the same station, given twice."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import correlate

from toppling.models.motions.record import Record
from toppling.models.motions.stations import SAME_SHAKING_S

_LIKE_PEAKS = 0.1
"""Records whose PGA and PGV differ by more than this share are not compared sample by sample."""
_LIKE_SHAPE = 0.97
"""Correlation of the horizontal vectors' lengths from which two records are one."""
_COMPARED_STEP_S = 0.02


@dataclass(frozen=True)
class Shaking:
    """What names the shaking of a record, empty or None where nobody says."""

    table_event: str  # event by the metadata table
    # By the header.
    event: str
    station: str
    series: str
    start_s: float | None  # time of the first sample, seconds since 1970

    def is_that_of(self, other: "Shaking") -> bool:
        """Whether the names alone show that the two are one.

        One name is often that of a foreshock too: where table and header both name the events, both must agree, and
        records that know when they begin begin together.
        """
        at_one_place = bool(self.station) and (self.station, self.series) == (other.station, other.series)
        events = [(self.table_event, other.table_event), (self.event, other.event)]
        known = [pair for pair in events if all(pair)]
        together = (
            self.start_s is None
            or other.start_s is None
            or abs(self.start_s - other.start_s) <= SAME_SHAKING_S
        )
        return at_one_place and together and bool(known) and all(a == b for a, b in known)


@dataclass(frozen=True, eq=False)
class Candidate:
    """A record on its way into an ensemble."""

    record: Record
    shaking: Shaking
    corrected: bool
    warnings: tuple[str, ...] = ()  # what the user should know of it


def duplicates(candidates: Sequence[Candidate]) -> Iterator[tuple[Candidate, Candidate]]:
    """Pairs (kept, left out): of two records that are one, the corrected is kept, else the first."""
    out: set[int] = set()
    ordered = sorted(range(len(candidates)), key=lambda i: (not candidates[i].corrected, i))
    for place, i in enumerate(ordered):
        if i in out:
            continue
        for j in ordered[place + 1 :]:
            if j not in out and _are_one(candidates[i], candidates[j]):
                out.add(j)
                yield candidates[i], candidates[j]


def _are_one(a: Candidate, b: Candidate) -> bool:
    if a.shaking.is_that_of(b.shaking):
        return True
    for name in ("pga_m_s2", "pgv_m_s"):
        if abs(np.log(b.record.intensity[name] / a.record.intensity[name])) > _LIKE_PEAKS:
            return False
    return _likeness(_length(a.record), _length(b.record)) > _LIKE_SHAPE


def _length(record: Record) -> NDArray[np.float64]:
    """Length of the horizontal vector on a common step: the same whichever way the instrument was set up.

    Means over the step are as good as a resampling to tell records apart, at any ratio of the steps.
    """
    time = np.arange(np.ceil(record.motion.duration_s / _COMPARED_STEP_S) + 1) * _COMPARED_STEP_S
    horizontal = record.motion.mean_between(time)[:, :2]
    return np.hypot(horizontal[:, 0], horizontal[:, 1])


def _likeness(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """Largest correlation over all shifts in time, 1 for the same shape."""
    return float(correlate(a, b, method="fft").max() / np.sqrt((a @ a) * (b @ b)))
