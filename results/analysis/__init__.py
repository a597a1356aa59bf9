"""Statistics of a run's result rows: toppling probabilities, fragility curves and their uncertainty. No drawing."""

__all__ = [
    "CONFIDENCE", "DIRECTION_BINS", "FEW", "HEADLINE_MEASURE", "SAMPLES", "audit_statistics",
    "constraint", "exchange", "fits", "fragility", "lognormal", "resampling", "side_by_side",
    "unphysical",
]  # fmt: skip

SAMPLES = 200
"""Number of bootstrap resamples of the records, for intervals of 95 %."""

CONFIDENCE = 0.95
"""Probability of the intervals, and of what a standing rock excludes unless another one is asked for."""

FEW = 10
"""Number of records, topplings or events below which what rests on them is not stated: its error is a third."""

DIRECTION_BINS = 8
"""Default number of direction bins around the circle."""

HEADLINE_MEASURE = "pgv_m_s"
"""Preferred measure of a run's summary, as in 'toppling constrain', because hazard curves of PGV exist."""
