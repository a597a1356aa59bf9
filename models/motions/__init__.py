"""Records: read, process, measure, scale, turn, make."""

__all__ = [
    "above_band", "catalogue", "deaggregation", "ensemble", "fetch", "importing",
    "impose", "intensity", "measures", "metadata", "motion", "quality", "record", "selection",
    "synthetic",
]  # fmt: skip
