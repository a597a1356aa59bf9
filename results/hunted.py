"""Rows of a run that shook the levels it chose (`levels = "hunt"`): what they say of the levels that were skipped.

A skipped level is expected to answer as its bracket says. Those that were shaken all the same, each with a known
probability, tell how often that is wrong: by the inverse of the probability they stand for the others. The estimate of
a level is then expected + (answer - expected) / probability where it was shaken, and what is expected where not. Its
mean over the draws is the answer, whatever the answers are, so that every sum of estimates, and every share, is
unbiased.
A single estimate is no probability and may lie outside 0 to 1.
"""

import numpy as np
import pandas as pd

SKIPPED = "skipped"
"""Status of a level that was not shaken."""

ESTIMATE = "toppled_estimate"
"""Column that `estimated` adds."""


def is_hunted(frame: pd.DataFrame) -> bool:
    """Whether rows are of a run that chose its levels."""
    return "choice_probability" in frame and bool(frame["choice_probability"].notna().any())


def estimated(frame: pd.DataFrame) -> pd.DataFrame:
    """Add to rows what each stands for in a sum (`toppled_estimate`); `toppled` of a skipped one is what is expected.

    A run that shook all its levels stays as it is.
    """
    if not is_hunted(frame):
        return frame
    expected = frame["expected_toppled"].astype("boolean")
    skipped = frame["status"] == SKIPPED
    toppled = frame["toppled"].astype("boolean").mask(skipped, expected)
    answer = toppled.astype("Float64").to_numpy(float, na_value=np.nan)
    guess = expected.astype("Float64").to_numpy(float, na_value=np.nan)
    probability = frame["choice_probability"].to_numpy(float)
    audited = ~skipped.to_numpy() & ~np.isnan(probability)
    estimate = np.where(audited, guess + (answer - guess) / np.where(audited, probability, 1.0), answer)
    return frame.assign(toppled=toppled, **{ESTIMATE: estimate})


def shaken(frame: pd.DataFrame) -> pd.DataFrame:
    """Rows that were shaken, by the weight (`record_weight`) with which they stand for all."""
    if not is_hunted(frame):
        return frame
    kept = frame[frame["status"] != SKIPPED]
    weight = 1.0 / kept["choice_probability"].fillna(1.0)
    return kept.assign(record_weight=kept.get("record_weight", 1.0) * weight)
