"""Statistics of a run's result rows: toppling probabilities, fragility curves and their uncertainty. No drawing."""

__all__ = [
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
