"""How much of the spread of toppling comes from the records, from the base and from friction."""

from __future__ import annotations

import numpy as np
import pandas as pd
from scipy.stats import chi2, f

from toppling.models.arrays import Array
from toppling.models.errors import InputError
from toppling.models.shares import effective_number

_LEAST = 3
"""Records, and realisations, of which a spread can be told."""
CAUSES = ("records", "base", "friction", "left")
_SAME = ["scene_id", "preset", "restitution"]


def spreads(frame: pd.DataFrame) -> pd.DataFrame:
    """Spread of the toppling probability at each level, and over all levels, by its causes.

    The jobs of a level are a table of records by realisations (times frictions), each entry the share that topples over
    azimuths. Its analysis of variance without replication gives the variance that records share, that realisations
    share, and what is left (Searle, Casella and McCulloch 1992, chapter 4). Of the variance that realisations share,
    friction has what a straight line through the logarithm of friction explains, the base the rest.

    Where bases do not weigh alike (`base_weight`, from `Run.weighted`), means and variances are of draws so weighted,
    with 1 - sum of squared shares in the place of (n - 1) / n.

    frame: rows of results of one scene, preset and restitution.
    Returns DataFrame: one row a level: level_pga_m_s2; probability of toppling; its standard deviation from record to
    record (records), from base to base with the centre of mass drawn beside it (base), from friction to friction
    (friction), and what depends on all together, or on chance (left); `_low` and `_high` (95 %) of the first three, as
    other records and draws would have it; `share_` of the variance that these share among each other; jobs,
    records_drawn and bases (draws, where the scene has none). The last row, whose level is null, holds their means.
    Raises InputError if there are fewer than three records or realisations.
    """
    rows = frame[frame["toppled"].notna()]
    drawn = rows[rows["realisation"] > 0]
    if drawn.groupby(["friction_static", "realisation"]).ngroups >= _LEAST:
        rows = drawn  # the nominal scene is no draw
    levels = (_spread(float(level), jobs) for level, jobs in rows.groupby("level_pga_m_s2"))
    found = [one for one in levels if one is not None]
    if not found:
        raise InputError("run.too_few_realisations",
            "no level has three records and three realisations that were all answered",
            where="the spread of toppling",
            expected=f"a campaign with realisations of at least {_LEAST + 1}, and {_LEAST} records or more",
            remedy="set realisations = 20 or so in the campaign, and run it with another --out")  # fmt: skip
    table = pd.DataFrame(found)
    means = {**table.mean(numeric_only=True), "level_pga_m_s2": None, "jobs": int(table["jobs"].sum())}
    means |= {name: int(table[name].max()) for name in ("records_drawn", "bases")}
    # Levels share their records and draws: their ends are averaged as the deviations are.
    for name in (*CAUSES, *(f"{cause}_{end}" for cause in CAUSES[:3] for end in ("low", "high"))):
        means[name] = float(np.sqrt((table[name] ** 2).mean()))
    table = pd.concat([table, pd.DataFrame([means])], ignore_index=True)
    total = sum(table[cause] ** 2 for cause in CAUSES[:3])
    for cause in CAUSES[:3]:
        table[f"share_{cause}"] = (table[cause] ** 2 / total).where(total > 0.0)
    return table


def _spread(level: float, jobs: pd.DataFrame) -> dict[str, float] | None:
    """Analysis of variance of one level; None where too little was answered."""
    draw = ["friction_static", "friction_kinetic", "realisation"]
    entries = jobs.assign(toppled=jobs["toppled"].astype(float)).pivot_table(
        index="record_id", columns=draw, values="toppled", aggfunc="mean"
    )
    entries = entries.dropna(axis="columns", thresh=int(0.5 * len(entries)) + 1).dropna(axis="index")
    values = entries.to_numpy()
    records, draws = values.shape
    if records < _LEAST or draws < _LEAST:
        return None
    of = np.full(records, 1.0 / records)
    by_base = jobs.assign(weight=jobs.get("base_weight", 1.0)).groupby(draw)["weight"].first()
    weight = by_base.reindex(entries.columns).to_numpy()
    share_of = weight / weight.sum()
    by_record, by_draw = values @ share_of, of @ values
    mean = float(of @ by_record)
    free_records, free_draws = 1.0 - 1.0 / records, 1.0 - 1.0 / effective_number(share_of)
    if free_draws <= 0.0:
        return None
    deviation = (values - by_record[:, None] - by_draw + mean) ** 2
    left = float(of @ deviation @ share_of) / (free_records * free_draws)
    of_records = float(of @ (by_record - mean) ** 2) / free_records - left * (1.0 - free_draws)
    of_draws = float(share_of @ (by_draw - mean) ** 2) / free_draws - left / records
    factor = jobs.groupby(draw)["friction_factor"].first().reindex(entries.columns).fillna(1.0).to_numpy()
    friction = np.log(np.maximum(entries.columns.get_level_values(0).to_numpy(float) * factor, 1e-9))
    share = _explained(friction, by_draw, share_of)
    draws_in_effect = 1.0 / (1.0 - free_draws)
    error = left, (records - 1) * (draws_in_effect - 1.0)
    of_record = draws_in_effect * of_records + left, records - 1
    of_draws_ends = component_interval((records * of_draws + left, draws_in_effect - 1.0), error, records)
    ends = {
        "records": component_interval(of_record, error, draws_in_effect),
        "base": of_draws_ends * (1.0 - share),
        "friction": of_draws_ends * share,
    }
    return {
        "level_pga_m_s2": level, "probability": mean, "records": max(of_records, 0.0) ** 0.5,
        "base": (max(of_draws, 0.0) * (1.0 - share)) ** 0.5, "friction": (max(of_draws, 0.0) * share) ** 0.5,
        "left": left**0.5,
        **{f"{cause}_{end}": value**0.5 for cause, pair in ends.items()
           for end, value in zip(("low", "high"), pair.tolist(), strict=True)},
        "jobs": len(jobs), "records_drawn": records,
        "bases": (jobs["base"].nunique() if "base" in jobs else 0) or draws,
    }  # fmt: skip


_Mean = tuple[float, float]
"""A mean square of an analysis of variance, with its degrees of freedom."""


def component_interval(of_cause: _Mean, error: _Mean, times: float) -> Array:
    """Ends of the 95 % interval of a component of variance, (2,): Williams and Tukey's.

    of_cause: its expectation is the error's and `times` the component.

    Searle, Casella and McCulloch 1992, section 3.6; exact to within some per cent for normal effects, and on the wide
    side. It tells how far other records, or other bases, drawn alike would move the component.
    """
    tails = np.array([0.975, 0.025])
    (square, freedom), (error_square, error_freedom) = of_cause, error
    least = square - error_square * f.ppf(tails, freedom, error_freedom)
    return np.maximum(least, 0.0) / (times * chi2.ppf(tails, freedom) / freedom)


def _explained(cause: np.ndarray, effect: np.ndarray, share: np.ndarray) -> float:
    """Share of a variance that a straight line explains, less what it explains by chance (adjusted), 0 to 1."""
    count = effective_number(share)
    if count <= 2 or np.ptp(cause) == 0.0 or np.ptp(effect) == 0.0:
        return 0.0
    variance = np.cov(cause, effect, aweights=share)
    if not variance[0, 0] * variance[1, 1] > 0.0:
        return 0.0
    squared = variance[0, 1] ** 2 / (variance[0, 0] * variance[1, 1])
    return float(np.clip(1.0 - (1.0 - squared) * (count - 1) / (count - 2), 0.0, 1.0))


def surroundings(frame: pd.DataFrame) -> list[tuple[str, pd.DataFrame]]:
    """Rows that may be taken together, with a name where there are several kinds."""
    groups = list(frame.groupby(_SAME, dropna=False))
    return [
        ("" if len(groups) == 1 else ", ".join(f"{n} {v}" for n, v in zip(_SAME, key, strict=True)), jobs)
        for key, jobs in groups
    ]
