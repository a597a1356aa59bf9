"""The findings of Veeraraghavan, Hudnut and Krishnan (2017), tested on the runs of a study of any rock."""

import math
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.stats import binomtest, spearmanr

from toppling.models.frames import apart_deg
from toppling.results.analysis.directions import HALF_SECTOR_DEG, sector_around, sector_share
from toppling.results.analysis.fragility import DIRECTION_BINS, PLANES, effective_records, wilson
from toppling.results.analysis.friction_comparison import (
    compare_cells,
    compare_jobs,
    friction_words,
    frictions,
    paired_jobs,
)

_LOW_PGA_M_S2, _LOW_PGV_M_S, _LOW_PROBABILITY = 3.0, 0.75, 0.2

_UNSURE = 0.05
"""Significance level: a rank correlation with a larger p value is not taken as seen."""

_HARDLY = 0.3
"""A rank correlation below this counts as hardly any dependence."""

_FIGURE_10_PGV_M_S, _FIGURE_10_DURATION_S = 3.0, 30.0
"""The study's figure of PGV and duration ends there."""

_WITHIN = 0.3
"""The study's band about equal toppling probabilities."""


@dataclass(frozen=True)
class Finding:
    """One statement of the study, and what the runs show."""

    name: str
    paper: str  # what the study found for its rock
    found: str  # what was found here, in numbers
    agrees: bool | None  # None where the runs are inconclusive

    @property
    def line(self) -> str:
        """One line of a checked list."""
        mark, verdict = {
            True: ("[x]", "as in the study"),
            False: ("[ ]", "this rock disagrees"),
            None: ("[?]", "these runs do not tell"),
        }[self.agrees]
        return f"- {mark} {self.name}: {self.found} ({verdict}: {self.paper})"


def findings(
    main: pd.DataFrame,
    frictions_run: pd.DataFrame,
    weakest_azimuth_deg: float,
    lines: pd.DataFrame,
    directions: int = DIRECTION_BINS,
) -> list[Finding]:
    """Check the study's list.

    main: rows at friction 1 in all directions.
    frictions_run: rows of one direction with every friction.
    weakest_azimuth_deg: of the least ground acceleration that topples quasi-statically; the rock then topples the other
    way.
    lines: from `analysis.plane_reference.reference_lines`.
    directions: bins of the vector PGA.
    """
    return [
        _rarely_below(main),
        _pga_falls_with(main, "pgv_pga_s", "toppling PGA falls with PGV/PGA"),
        _pgv_hardly_on_duration(main, weakest_azimuth_deg, directions),
        _pga_falls_with(main, "duration_energy_s", "toppling PGA falls with duration"),
        _toward_the_overhang(main, (weakest_azimuth_deg + 180.0) % 360.0),
        _directionality(main),
        _lower_friction(frictions_run),
        _within_the_band(frictions_run),
        _lines_everywhere(lines, directions),
    ]


def _rarely_below(main: pd.DataFrame) -> Finding:
    weak = main[
        (main["pga_m_s2"] < _LOW_PGA_M_S2) & (main["pgv_m_s"] < _LOW_PGV_M_S) & main["toppled"].notna()
    ]
    name = f"probability below {_LOW_PROBABILITY:g} for PGA < {_LOW_PGA_M_S2:g} m/s2 and PGV < {_LOW_PGV_M_S:g} m/s"
    paper = "less than 0.2"
    if not len(weak):
        return Finding(name, paper, "no such jobs", None)
    share = float(weak["toppled"].mean())
    one = weak.assign(weight=1.0, pool=0)
    low, high = wilson(pd.Series([share]), effective_records(one, ["pool"]).reset_index(drop=True))
    share_words = f"{share:.3f} of {len(weak)} jobs ({low[0]:.3f} to {high[0]:.3f}, by record)"
    return Finding(name, paper, share_words, share < _LOW_PROBABILITY)


def _toppling_levels(main: pd.DataFrame) -> pd.DataFrame:
    """Least PGA and PGV that topple, by record: the median over azimuths, infinite where no level topples."""
    known = main[main["toppled"].notna()]
    job = ["record_id", "azimuth_deg"]
    least = known[known["toppled"].astype(bool)].groupby(job)[["pga_m_s2", "pgv_m_s"]].min()
    every = known.groupby(job)[["pgv_pga_s", "duration_energy_s"]].first()
    table = every.join(least, how="left")
    table[["pga_m_s2", "pgv_m_s"]] = table[["pga_m_s2", "pgv_m_s"]].fillna(math.inf)
    return table.groupby("record_id").median()


def _rank(table: pd.DataFrame, one: str, other: str) -> tuple[float, float, int]:
    """Spearman's correlation with its p value; records that never topple rank above all that do."""
    measured = table.dropna(subset=[other])
    if len(measured) < 5 or measured[one].nunique() < 2 or measured[other].nunique() < 2:
        return math.nan, math.nan, len(measured)
    found = spearmanr(measured[one].rank(), measured[other])
    return float(found.statistic), float(found.pvalue), len(measured)


def _pga_falls_with(main: pd.DataFrame, measure: str, name: str) -> Finding:
    rank, p, records = _rank(_toppling_levels(main), "pga_m_s2", measure)
    paper = "it decreases"
    if math.isnan(rank):
        return Finding(name, paper, "too few records", None)
    agrees = None if rank < 0 and p >= _UNSURE else rank < 0
    return Finding(name, paper, _correlation(rank, p, records), agrees)


def _pgv_hardly_on_duration(main: pd.DataFrame, weakest_azimuth_deg: float, directions: int) -> Finding:
    """As the study reads its figure 10a; what all jobs say beside it."""
    figure_10a = main[
        (apart_deg(main["pga_azimuth_deg"], weakest_azimuth_deg) <= 180.0 / directions)
        & (main["pgv_m_s"] < _FIGURE_10_PGV_M_S)
        & (main["duration_energy_s"] < _FIGURE_10_DURATION_S)
    ]
    rank, p, records = _pgv_on_duration(figure_10a)
    name, paper = "toppling PGV hardly depends on duration", "more or less independent"
    if math.isnan(rank):
        return Finding(name, paper, "too few records", None)
    hardly = abs(rank) < _HARDLY
    found = (
        f"{_correlation(rank, p, records)} for vector PGA around {weakest_azimuth_deg:g} degrees, "
        f"PGV < {_FIGURE_10_PGV_M_S:g} m/s and duration < {_FIGURE_10_DURATION_S:g} s; "
        f"of all jobs: {_correlation(*_pgv_on_duration(main))}"
    )
    return Finding(name, paper, found, None if not hardly and p >= _UNSURE else hardly)


def _pgv_on_duration(jobs: pd.DataFrame) -> tuple[float, float, int]:
    table = _toppling_levels(jobs)
    return _rank(table[np.isfinite(table["pgv_m_s"])], "pgv_m_s", "duration_energy_s")


def _correlation(rank: float, p: float, records: int) -> str:
    return f"rank correlation {rank:+.2f} over {records} records (p {p:.2g})"


def _toward_the_overhang(main: pd.DataFrame, overhang_deg: float) -> Finding:
    sector = sector_share(main, *sector_around(overhang_deg))
    name = "topplings cluster around the overhang"
    paper = "60 % of the cases in a sector of 35 degrees around it"
    if not sector["toppled"]:
        return Finding(name, paper, "nothing toppled", None)
    azimuth = np.deg2rad(main["topple_azimuth_deg"].dropna().to_numpy(float))
    mean = np.exp(1j * azimuth).mean()
    off = float(apart_deg(math.degrees(np.angle(mean)), overhang_deg))
    found = (
        f"{100 * sector['share_of_toppled']:.0f} % of {sector['toppled']} topplings in a sector of "
        f"{2 * HALF_SECTOR_DEG:g} degrees around {overhang_deg:g} degrees; their mean azimuth is {off:.0f} degrees off"
    )
    evenly = 2 * HALF_SECTOR_DEG / 360.0
    return Finding(name, paper, found, bool(sector["share_of_toppled"] > 2 * evenly and off < 45.0))


def _directionality(main: pd.DataFrame) -> Finding:
    values = main.drop_duplicates("record_id")["directionality"].dropna()
    weak = int((values > 0.9).sum())
    found = f"{weak} of {len(values)} records"
    share = weak / len(values) if len(values) else math.nan
    agrees = None if math.isnan(share) else 0.25 <= share <= 0.75
    return Finding("about half of the records lack strong directionality", "65 of 140", found, agrees)


def _lower_friction(rows: pd.DataFrame) -> Finding:
    name, paper = "lower friction gives more toppling", "most cells lie above the diagonal"
    if len(frictions(rows)) < 2:
        return Finding(name, paper, "one friction only", None)
    highest = frictions(rows)[-1]
    parts = [
        f"{counts.only_this} topple only at {friction_words(counts.friction_static, counts.friction_kinetic)}, "
        f"{counts.only_reference} only at the highest, of {counts.pairs} pairs"
        for counts in compare_jobs(rows, highest).itertuples()
    ]
    # Levels of one record topple together: records are the sample.
    pairs = paired_jobs(rows, highest)
    net = pairs["toppled"].astype(int) - pairs["toppled_reference"]
    by_record = net.groupby(pairs["record_id"]).sum()
    percent = 100.0 * net.mean()
    error = 196.0 / max(len(net), 1) * math.sqrt(len(by_record)) * by_record.std(ddof=0)
    more, fewer = int((by_record > 0).sum()), int((by_record < 0).sum())
    unsure = not more + fewer or binomtest(more, more + fewer).pvalue >= _UNSURE
    votes = (
        f"share changed by {percent:+.1f} percentage points ({percent - error:+.1f} to {percent + error:+.1f}, "
        f"by record); lower friction gives more in {more} records, less in {fewer}"
    )
    return Finding(name, paper, "; ".join([*parts, votes]), None if unsure else more > fewer)


def _within_the_band(rows: pd.DataFrame) -> Finding:
    name, paper = f"most cells within {_WITHIN:g} of those of the highest friction", "in general within 0.3"
    if len(frictions(rows)) < 2:
        return Finding(name, paper, "one friction only", None)
    cells = compare_cells(rows, PLANES["pga_pgv"], frictions(rows)[-1])
    within = (cells["probability"] - cells["reference_probability"]).abs() <= _WITHIN
    return Finding(name, paper, f"{int(within.sum())} of {len(cells)} cells", bool(within.mean() > 0.5))


def _lines_everywhere(lines: pd.DataFrame, directions: int) -> Finding:
    there = lines["azimuth_deg"].nunique() if len(lines) else 0
    found = f"lines of 1 and 99 % in {there} of {directions} directions"
    name = "two-contact reference lines in figure 6"
    return Finding(name, "in every direction", found, there == directions)
