"""Records: read, process, measure, scale, turn, make."""

__all__ = [
    "above_band", "catalogue", "deaggregation", "ensemble", "fetch", "idealised", "importing",
    "impose", "intensity", "measures", "metadata", "motion", "quality", "record", "selection", "shaketable",
    "synthetic",
]  # fmt: skip
