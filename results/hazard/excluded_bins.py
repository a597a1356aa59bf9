"""Which of a deaggregation's magnitudes and distances a standing rock excludes, and how much of the hazard they are."""

import math
from collections.abc import Sequence

import numpy as np
import pandas as pd

from toppling.models.motions.deaggregation import Bin
from toppling.results.analysis.lognormal import Lognormal
from toppling.results.hazard.magnitudes import Model, Occurrence, toppling_probability


def excluded_bins(
    bins: Sequence[Bin], models: Sequence[Model], weights: Sequence[float], fragility: Lognormal,
    occurrences: Sequence[Occurrence],
) -> pd.DataFrame:  # fmt: skip
    """Toppling probability and verdict of the earthquake in the middle of each bin that contributes.

    Parameters
    ----------
    bins : sequence of Bin
    models, weights : sequences
        Ground-motion models, and their weights.
    occurrences : sequence of Occurrence

    Returns
    -------
    DataFrame
        One row an occurrence and bin: occurrence, magnitude, distance_km (middles), share (of the hazard that is taken
        apart), topples (probability that one such earthquake topples the rock), excluded, beyond_models (outside what
        the models are for, taken as their nearest). The largest share first.
    """
    known = [one for one in bins if one.contribution > 0]
    magnitude = np.array([math.fsum(one.magnitude) / 2 for one in known])
    distance = np.array([math.fsum(one.distance_km) / 2 for one in known])
    share = np.array([one.contribution for one in known])
    topples, beyond = np.zeros(len(known)), np.zeros(len(known), bool)
    for model, weight in zip(models, np.asarray(weights, float) / sum(weights), strict=True):
        within = np.clip(magnitude, *model.magnitudes), np.clip(distance, *model.distances_km)
        topples += weight * toppling_probability(fragility, *model.motion(*within))
        beyond |= (within[0] != magnitude) | (within[1] != distance)
    tables = [
        pd.DataFrame({
            "occurrence": one.name, "magnitude": magnitude, "distance_km": distance, "share": share / share.sum(),
            "topples": topples, "excluded": topples >= one.probability, "beyond_models": beyond,
        }).sort_values("share", ascending=False)
        for one in occurrences
    ]  # fmt: skip
    return pd.concat(tables, ignore_index=True)


def bins_words(table: pd.DataFrame) -> list[str]:
    """How much of the hazard the rock excludes, an occurrence a line, and its strongest contribution."""
    lines = []
    for occurrence, rows in table.groupby("occurrence", sort=False):
        gone = rows[rows["excluded"]]
        most = rows.iloc[0]
        lines.append(
            f"{str(occurrence).capitalize()}: {100 * gone['share'].sum():.3g} % of the deaggregated hazard, "
            f"{len(gone)} of {len(rows)} bins, is of earthquakes that the rock excludes; the largest contribution, "
            f"magnitude {most['magnitude']:.2f} at {most['distance_km']:.3g} km, topples it with "
            f"{most['topples']:.2g}"
        )
    if table["beyond_models"].any():
        lines.append("Bins beyond what the models are for are taken as their nearest.")
    return lines
