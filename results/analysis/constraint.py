"""The statement: survival and rejection for some rocks under some hazard branches."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd

from toppling.models.files.documents import finite
from toppling.results.hazard.curves import HazardCurve, any_topples, continued, toppling_rate, unstated_shares
from toppling.results.hazard.places import distance_km
from toppling.results.hazard.survival import (
    RandomRock,
    Standing,
    drawn_together,
    joint_survival,
    random_rock,
    rejected_rate,
    unexceeded,
)
from toppling.results.hazard.tree import sources
from toppling.results.hazard.update import (
    Update,
    changes_table,
    levels_table,
    parts_table,
    updated_table,
)


@dataclass(frozen=True, eq=False)
class Constraint:
    """What some rocks say: about single events, with ages about rates, and with a hazard about its branches."""

    rocks: Sequence[Standing]
    confidence: float
    update: Update | None = None  # of the hazard that is asked about; it needs ages
    dated: bool = False  # whether ages are known

    @cached_property
    def bound(self) -> pd.DataFrame | None:
        """Rates that are rejected whatever the hazard; None without ages."""
        return _bound_table(self.rocks, self.confidence) if self.dated else None

    @cached_property
    def branches(self) -> pd.DataFrame | None:
        """Branches of the hazard; None without one."""
        return _branch_table(self.update) if self.update else None

    @cached_property
    def random_rock(self) -> RandomRock | None:
        """One fragility of the site; None for a single rock."""
        return random_rock(self.rocks)

    def tables(self) -> dict[str, pd.DataFrame]:
        """Tables by name, those that hold something."""
        found = {"rejected": self.bound, "branches": self.branches}
        if self.update:
            found |= {
                "updated": updated_table(self.update), "changes": changes_table(self.update),
                "levels": levels_table(self.update), "parts": parts_table(self.update),
            }  # fmt: skip
        return {name: table for name, table in found.items() if table is not None and len(table)}

    def summary(self, ratio: float = 1.0, asked: tuple[float, float] | None = None) -> dict[str, Any]:
        """Everything, as JSON holds it: SI units, None where a number is not known or has no bound."""
        summary = _single_event(self.rocks, self.confidence)
        if self.dated:
            summary["ages_independent"] = sum(len(rock.years) > 1 for rock in self.rocks) > 1
            for row, rock in zip(summary["rocks"], self.rocks, strict=True):
                row["age_years"] = float(np.median(rock.years))
        if site := self.random_rock:
            low, high = site.median_interval or (None, None)
            summary["random_rock"] = {
                "median": site.curve.median, "beta": site.curve.beta, "beta_within": site.beta_within,
                "beta_between": site.beta_between, "median_low": low, "median_high": high, "beyond": site.beyond,
            }  # fmt: skip
        summary |= {name: table.to_dict("records") for name, table in self.tables().items()}
        if update := self.update:
            for row, branch in zip(summary["branches"], update.tree.branches, strict=True):
                row |= _place(branch.curve, asked)
            summary |= {
                "mean": update.factors.iloc[-1].to_dict(),
                "decided": update.decided,
                "intervals_carry": list(update.draws.carries) if update.draws else [],
                "hazard": _hazard(update),
                "hazard_ratio": ratio,
            }
        return finite(summary)


def _place(curve: HazardCurve, asked: tuple[float, float] | None) -> dict[str, Any]:
    """Site of a hazard curve, and its distance from the site requested."""
    place: dict[str, Any] = {"site_name": curve.site_name} if curve.site_name else {}
    if curve.site is None:
        return place
    place |= {"site_longitude_deg": curve.site[0], "site_latitude_deg": curve.site[1]}
    return place | ({"site_distance_km": float(distance_km(*curve.site, asked))} if asked else {})


def _hazard(update: Update) -> dict[str, Any]:
    tree = update.tree
    return {
        "measure": tree.measure, "years": tree.years, "weights_from": tree.weights_from,
        "component": next((curve.component for curve in tree.curves if curve.component), ""),
        "site_name": tree.site_name, "site": list(tree.site) if tree.site else None, "files": sources(tree),
        "assumed": list(dict.fromkeys(curve.assumed for curve in tree.curves if curve.assumed)),
    }  # fmt: skip


def _branch_table(update: Update) -> pd.DataFrame:
    """Survival, verdict, weights and factors of each hazard branch.

    A branch is rejected where the rocks survive with less than 1 - confidence (5 % in Stirling et al. 2021).

    Returns DataFrame: one row a branch: name, toppling_rate (annual, any of the rocks), unstated_below and
    unstated_above (shares of the rate outside the curve's points, not counted: `results.hazard`), survival,
    survival_least (with these counted), rejected (by survival), prior_weight, posterior_weight (null where no
    branch lets the rocks survive), scale_factor and rate_factor (by which
    motions and rates may be multiplied for survival to stay above 1 - confidence). Survival and factors with _low
    and _high: 95 %, over other records and ages; null where neither is known to vary.
    """
    curves = [rock.curve for rock in update.rocks]
    shares = [unstated_shares(curves, branch) for branch in update.tree.curves]
    nothing = np.full(len(shares), math.nan)
    table = pd.DataFrame(
        {
            "name": [branch.name for branch in update.tree.branches],
            "toppling_rate": [toppling_rate(curves, branch) for branch in update.tree.curves],
            "unstated_below": [below for below, _ in shares],
            "unstated_above": [above for _, above in shares],
            "survival_least": [
                joint_survival(update.rocks, continued(branch, curves)) for branch in update.tree.curves
            ],
            "rejected": update.rejected,
            "prior_weight": update.tree.weights,
            "posterior_weight": nothing if update.posterior is None else update.posterior,
        }
    )
    factors = update.factors.iloc[: len(table)]
    return table.join(factors.drop(columns="name"))


def _bound_table(rocks: Sequence[Standing], confidence: float) -> pd.DataFrame:
    """Annual rate of exceedance above which each intensity is rejected, where a rock may topple.

    Returns DataFrame: the measure's column, topples (probability that an event topples any), rejected_annual_rate
    and rejected_return_years, its inverse: shorter return periods are rejected.
    """
    curves = [rock.curve for rock in rocks]
    low, high = (
        extreme(curve.intensity(tail) for curve in curves) for extreme, tail in ((min, 0.01), (max, 0.999))
    )
    intensity = np.geomspace(low, high * 1.001, 60)
    rate = rejected_rate(rocks, intensity, confidence)
    return pd.DataFrame(
        {
            curves[0].measure: intensity,
            "topples": any_topples(curves, intensity),
            "rejected_annual_rate": rate,
            "rejected_return_years": 1.0 / rate,
        }
    )


def _single_event(rocks: Sequence[Standing], confidence: float) -> dict[str, Any]:
    """State the intensity that no single event exceeded, at a confidence: without age and hazard.

    Returns dict: measure, confidence, unexceeded, unexceeded_low and unexceeded_high (95 %, resampled records; not
    finite where a curve does not tell, or too many draws have no fit: such a draw bounds nothing), rocks.
    """
    curves = [rock.curve for rock in rocks]
    low = high = math.nan
    if shared := drawn_together(rocks):
        together, fewest = shared
        low, high = fewest.interval(np.array([unexceeded(drawn, confidence) for drawn in together]))
    return {
        "measure": curves[0].measure,
        "confidence": confidence,
        "unexceeded": unexceeded(curves, confidence),
        "unexceeded_low": low,
        "unexceeded_high": high,
        "rocks": [
            {"name": rock.name, "median": rock.curve.median, "beta": rock.curve.beta}
            | (asdict(rock.curve.basis) if rock.curve.basis else {})
            | (
                {"samples": len(samples.fitted), "samples_without_fit": samples.without_fit}
                if samples
                else {}
            )
            for rock in rocks
            for samples in (rock.curve.resampled,)
        ],
    }
