"""Scenes and motions, independent of engines and clusters."""

__all__ = [
    "arrays", "bearings", "compiled", "contact", "described", "errors", "frames", "kept",
    "lengths", "matplotlib_alone", "openquake", "pedestal", "proportions", "relief", "scene", "settling",
    "shapes", "spelling", "statics", "terminal", "trajectory",
]  # fmt: skip
