"""Constraint on hazard by rocks that still stand: survival probabilities and inconsistent hazard branches."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd

from toppling.models.files.documents import finite
from toppling.results.analysis.lognormal import ends
from toppling.results.hazard.ages import Exposure
from toppling.results.hazard.events import Standing
from toppling.results.hazard.places import distance_km
from toppling.results.hazard.survival import (
    RandomRock,
    drawn_together,
    inconsistent_rate,
    random_rock,
    together,
    unexceeded,
)
from toppling.results.hazard.tree import HazardCurve, HazardTree, sources
from toppling.results.hazard.update import Update


@dataclass(frozen=True, eq=False)
class Constraint:
    """Constraint from standing rocks: on single events; with ages on rates; with a hazard model on its branches."""

    rocks: Sequence[Standing]  # over one measure, at one site
    confidence: float
    update: Update | None = None  # posterior of the hazard curves; needs ages
    exposure: Exposure | None = None  # of the rocks, where their ages are known

    @cached_property
    def bound(self) -> pd.DataFrame | None:
        """Annual rates that are inconsistent with the rocks under any hazard model; None without ages."""
        if self.exposure is None:
            return None
        return _bound_table(self.rocks, self.exposure, self.confidence)

    @cached_property
    def random_rock(self) -> RandomRock | None:
        """Fragility of a random rock of the site; None for a single rock."""
        return random_rock(self.rocks)

    @property
    def tables(self) -> dict[str, pd.DataFrame]:
        """Non-empty tables by name."""
        rates = {} if self.bound is None else {"rates": self.bound}
        return rates | (self.update.tables if self.update else {})

    def summary(self, ratio: float = 1.0, asked: tuple[float, float] | None = None) -> dict[str, Any]:
        """All results for JSON: SI units, None where a number is unknown or unbounded."""
        summary = _single_event(self.rocks, self.confidence)
        if self.exposure is not None:
            years = self.exposure.of_rocks
            summary["ages_independent"] = int((np.ptp(years, axis=1) > 0).sum()) > 1
            for row, rock, stood in zip(summary["rocks"], self.rocks, years, strict=True):
                row |= {"age": rock.age, "age_years": float(np.median(stood))}
        if site := self.random_rock:
            low, high = site.median_interval or (None, None)
            summary["random_rock"] = {
                "median": site.curve.median, "beta": site.curve.beta, "beta_within": site.beta_within,
                "beta_between": site.beta_between, "median_low": low, "median_high": high, "beyond": site.beyond,
            }  # fmt: skip
        summary |= {name: table.to_dict("records") for name, table in self.tables.items()}
        if (update := self.update) and (tree := update.tree):
            for row, branch in zip(summary["branches"], tree.branches, strict=True):
                row |= _place(branch.curve, asked)
            summary |= update.of_all_branches | {"hazard": _hazard(tree), "hazard_ratio": ratio}
        return finite(summary)


def _place(curve: HazardCurve, asked: tuple[float, float] | None) -> dict[str, Any]:
    """Site of a hazard curve, and its distance from the site requested."""
    place: dict[str, Any] = {"site_name": curve.site_name} if curve.site_name else {}
    if curve.site is None:
        return place
    place |= {"site_longitude_deg": curve.site[0], "site_latitude_deg": curve.site[1]}
    return place | ({"site_distance_km": float(distance_km(*curve.site, asked))} if asked else {})


def _hazard(tree: HazardTree) -> dict[str, Any]:
    return {
        "measure": tree.measure, "years": tree.years, "weights_from": tree.weights_from,
        "component": next((curve.component for curve in tree.curves if curve.component), ""),
        "site_name": tree.site_name, "site": list(tree.site) if tree.site else None, "files": sources(tree),
    }  # fmt: skip


def _bound_table(rocks: Sequence[Standing], exposure: Exposure, confidence: float) -> pd.DataFrame:
    """Annual rate of exceedance above which an intensity is inconsistent with the rocks, where it may topple one.

    Returns DataFrame: the measure's column, topples (probability that an event topples any rock),
    inconsistent_annual_rate and its inverse inconsistent_return_years: shorter return periods are inconsistent.
    """
    curves = [rock.curve for rock in rocks]
    low, high = (
        extreme(curve.intensity(tail) for curve in curves) for extreme, tail in ((min, 0.01), (max, 0.999))
    )
    intensity = np.geomspace(low, high * 1.001, 60)
    rate = inconsistent_rate(rocks, intensity, exposure, confidence)
    return pd.DataFrame(
        {
            curves[0].measure: intensity,
            "topples": together(curves, intensity),
            "inconsistent_annual_rate": rate,
            "inconsistent_return_years": 1.0 / rate,
        }
    )


def _single_event(rocks: Sequence[Standing], confidence: float) -> dict[str, Any]:
    """State the intensity that no single event exceeded, at a confidence: without age and hazard.

    Returns dict: measure, confidence, unexceeded, unexceeded_low and unexceeded_high (95 %, resampled records; not
    finite where a curve is unbounded or too many resamples have no fit), rocks.
    """
    curves = [rock.curve for rock in rocks]
    low = high = math.nan
    if drawn := drawn_together(rocks):
        low, high = ends(np.array([unexceeded(curves, confidence) for curves in drawn]))
    return {
        "measure": curves[0].measure,
        "confidence": confidence,
        "unexceeded": unexceeded(curves, confidence),
        "unexceeded_low": low,
        "unexceeded_high": high,
        "rocks": [
            {"name": rock.name, "narrowed_by": rock.narrowed_by}
            | curve.numbers
            | (asdict(curve.basis) if curve.basis else {})
            | (
                {"samples": len(samples.fitted), "samples_without_fit": samples.without_fit}
                if samples
                else {}
            )
            for rock, curve in zip(rocks, curves, strict=True)
            for samples in (curve.resampled,)
        ],
    }
