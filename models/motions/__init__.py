"""Records: read, process, measure, scale, turn, make."""

__all__ = [
    "ensemble",
    "fetch",
    "importing",
    "intensity",
    "measures",
    "metadata",
    "motion",
    "quality",
    "record",
    "selection",
    "synthetic",
]  # fmt: skip
