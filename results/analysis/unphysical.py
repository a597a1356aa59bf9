"""Jobs whose scaled motion exceeds all recorded ground motions, and the effect of leaving them out."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import pandas as pd

from toppling.models.errors import counted
from toppling.models.files.documents import finite, listed
from toppling.models.motions.quality import LIMITS_WORDS, is_beyond, words
from toppling.results.analysis import fits, lognormal
from toppling.results.analysis.fragility import chief
from toppling.results.reader import Run


@dataclass(frozen=True)
class Strongest:
    """A record's largest scale factor (NaN if unknown), PGV and PGD after scaling, with its jobs and topplings."""

    record_id: str
    factor: float
    pgv_m_s: float
    pgd_m: float
    jobs: int
    toppled: int


@dataclass(frozen=True)
class Unphysical:
    """Unphysically strong jobs of a run, and the run's results without them."""

    # Numbers of unphysical and of all jobs with an answer, then those among them that toppled.
    jobs: int
    of_jobs: int
    toppled: int
    of_toppled: int
    records: tuple[Strongest, ...]  # records of the unphysical jobs, the most topplings first
    # Fraction toppled, with and without them.
    share: float
    share_without: float
    # Median PGA of a single rock with its highest friction; None without a fit within the shaken range.
    median_pga_m_s2: float | None
    median_pga_without_m_s2: float | None

    @property
    def sentence(self) -> str:
        """Summary for a reader."""
        named = [
            f"{r.record_id} ({words(r.factor, r.pgv_m_s, r.pgd_m)}, {counted(r.toppled, 'toppling')})"
            for r in self.records
        ]
        part = (
            f", {self.toppled / self.of_toppled:.0%} of all topplings".replace("%", " %")
            if self.toppled
            else ""
        )
        return (
            f"{self.jobs:,} of {self.of_jobs:,} jobs shook beyond what was ever recorded ({LIMITS_WORDS}){part}: "
            f"{listed(named, 2)}. {self._change}"
        )

    @property
    def _change(self) -> str:
        change = f"share toppled is {self.share_without:.3f} instead of {self.share:.3f}"
        if self.median_pga_m_s2 is None:
            return f"Without them the {change}"
        if self.median_pga_without_m_s2 is None:
            return f"Without them the {change}, and no median PGA lies within what was shaken"
        return (
            f"Without them the median PGA is {self.median_pga_without_m_s2:.3g} instead of "
            f"{self.median_pga_m_s2:.3g} m/s², and the {change}"
        )

    def to_json(self) -> dict[str, Any]:
        """Fields as JSON numbers, null where undefined."""
        return finite(asdict(self))


def unphysical_of(run: Run, frame: pd.DataFrame | None = None) -> Unphysical | None:
    """Unphysically strong jobs of a run; None where there are none.

    frame: weighted rows; read from the run unless given.
    """
    known = fits.answered(run.weighted(run.frame()) if frame is None else frame)
    factor = _factors(run, known)
    beyond = is_beyond(factor, known["pgv_m_s"].to_numpy(float), known["pgd_m"].to_numpy(float))
    if not beyond.any():
        return None
    toppled = known["toppled"].to_numpy(bool)
    weight = known.get("record_weight", pd.Series(1.0, known.index)).to_numpy(float)
    left = ~beyond
    return Unphysical(
        jobs=int(beyond.sum()),
        of_jobs=len(known),
        toppled=int(toppled[beyond].sum()),
        of_toppled=int(toppled.sum()),
        records=_strongest(known[beyond].assign(factor=factor[beyond])),
        share=float(np.average(toppled, weights=weight)),
        share_without=float(np.average(toppled[left], weights=weight[left])) if left.any() else math.nan,
        median_pga_m_s2=_median(known),
        median_pga_without_m_s2=_median(known[left]),
    )


def _factors(run: Run, known: pd.DataFrame) -> np.ndarray:
    """Scale factor of each job's record, from the catalogue's PGA; NaN where unknown."""
    if run.rocks:
        found = pd.Series(math.nan, known.index)
        for rock in run.rocks:
            of_rock = known["scene_id"] == rock.scene_id()
            found[of_rock] = _factors(rock, known[of_rock])
        return found.to_numpy()
    motions = run.motions()
    if motions is None:
        return np.full(len(known), math.nan)
    own = dict(zip(*(motions.column(name).to_pylist() for name in ("record_id", "pga_m_s2")), strict=True))
    return (known["level_pga_m_s2"] / known["record_id"].map(own).astype(float)).to_numpy()


def _strongest(beyond: pd.DataFrame) -> tuple[Strongest, ...]:
    found = []
    for record_id, jobs in beyond.groupby("record_id"):
        factor, pgv_m_s, pgd_m = (float(jobs[name].max()) for name in ("factor", "pgv_m_s", "pgd_m"))
        toppled = int(jobs["toppled"].sum())
        found.append(Strongest(str(record_id), factor, pgv_m_s, pgd_m, len(jobs), toppled))
    return tuple(sorted(found, key=lambda record: (-record.toppled, -record.pgv_m_s)))


def _median(known: pd.DataFrame) -> float | None:
    """Median PGA of a single rock with its highest friction, where it lies within the shaken range."""
    if known["scene_id"].nunique() != 1:
        return None
    jobs = chief(known).reset_index(drop=True)
    curve = lognormal.fit(jobs, ["pga_m_s2"]).lognormal
    return (
        curve.median if curve and jobs["pga_m_s2"].min() <= curve.median <= jobs["pga_m_s2"].max() else None
    )
