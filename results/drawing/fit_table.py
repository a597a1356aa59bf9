"""Fits in words: medians and betas with their intervals, and what few records cannot tell."""

from collections.abc import Iterable

import pandas as pd

from toppling.models.motions.measures import COMPARED
from toppling.results.analysis.resampling import LEAST_RECORDS
from toppling.results.drawing.style import digits, printed_unit, short_name, within

_NARROW_RECORDS = 20
"""Intervals of fewer records are too narrow."""


def fit_table(summary: pd.DataFrame, known: pd.DataFrame) -> pd.DataFrame:
    """Fits as the page shows them, without numbers for medians beyond what was shaken."""
    strongest = [float(known[name].max()) for name in summary["measures"]]
    table = pd.DataFrame({
        "measure": [f"{short_name(name)} ({printed_unit(name)})" for name in summary["measures"]],
        "strongest shaken": [digits(value) for value in strongest],
    })  # fmt: skip
    for name, bounds in (("median", strongest), ("beta", [None] * len(strongest))):
        values = summary.reindex(columns=[name, f"{name}_low", f"{name}_high"]).astype(
            float
        )  # none without a fit
        rows = values.itertuples(index=False)
        table[f"{name} (95 %)"] = [
            _with_interval(row, bound) for row, bound in zip(rows, bounds, strict=True)
        ]
    # Whole numbers, where some fits have none.
    counts = summary.reindex(columns=["samples", "samples_without_fit"]).astype("Int64")
    table = table.assign(**{"samples": counts["samples"], "without fit": counts["samples_without_fit"]})
    return table.assign(problem=summary["problem"]) if summary["problem"].astype(bool).any() else table


def _with_interval(numbers: Iterable[float], strongest: float | None) -> str:
    ends = [within(one, strongest) for one in numbers]
    return f"{ends[0]} ({ends[1]} to {ends[2]})" if ends[1] and ends[2] else ends[0]


def few_records(records: int) -> str:
    """What so few records cannot tell; empty where they are enough."""
    if records < LEAST_RECORDS:
        return (
            f"{records} {'record is' if records == 1 else 'records are'} too few: fewer than {LEAST_RECORDS} give "
            "no interval, and what other records would say is not known."
        )
    if records < _NARROW_RECORDS:
        return f"With {records} records, fewer than about {_NARROW_RECORDS}, the intervals are too narrow."
    return ""


def fit_words(summary: pd.DataFrame, known: pd.DataFrame) -> str:
    """Lognormal fits as a terminal shows them, and what so many records cannot tell.

    summary: from `analysis.fits.summary`.
    known: rows with an answer that the fits are of.
    """
    curves = summary[(summary["link"] == "probit") & summary["measures"].isin(COMPARED)]
    if curves.empty:
        return "no measure is known of every job: there is no fit"
    table = fit_table(curves.reset_index(drop=True), known)
    kept = [name for name in table if name not in ("samples", "without fit")]
    said = [table[kept].to_string(index=False), few_records(known["record_id"].nunique())]
    return "\n".join(filter(None, said))
