"""What the rows of runs say: shares, curves and their uncertainty. Nothing here draws."""

__all__ = [
    "SAMPLES", "audit_statistics", "bases", "constraint", "directions", "exchange", "fits", "fragility",
    "friction_comparison", "lognormal", "plane_reference", "ranking", "regression", "resampling",
    "side_by_side", "unphysical",
]  # fmt: skip

SAMPLES = 200
"""Of resampled records, for intervals of 95 %."""
