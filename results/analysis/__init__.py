"""Statistics of a run's result rows: toppling probabilities, fragility curves and their uncertainty. No drawing."""

__all__ = [
    "DIRECTION_BINS",
    "HEADLINE_MEASURE",
    "SAMPLES",
    "audit_statistics",
    "constraint",
    "exchange",
    "fits",
    "fragility",
    "lognormal",
    "plane_reference",
    "resampling",
    "side_by_side",
    "unphysical",
]  # fmt: skip

SAMPLES = 200
"""Number of bootstrap resamples of the records, for intervals of 95 %."""

DIRECTION_BINS = 8
"""Default number of direction bins around the circle."""

HEADLINE_MEASURE = "pgv_m_s"
"""Preferred measure of a run's summary, as in 'toppling constrain', because hazard curves of PGV exist."""
