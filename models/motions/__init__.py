"""Records: read, process, measure, scale, turn, make."""

__all__ = [
    "ensemble", "fetch", "importing", "imposing", "intensity", "measures", "metadata", "motion", "quality",
    "record", "selection", "synthetic",
]  # fmt: skip
