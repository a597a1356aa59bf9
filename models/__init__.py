"""Scenes and motions, independent of engines and clusters."""

__all__ = [
    "arrays", "bearings", "compiled", "contact", "errors", "frames", "kept",
    "lengths", "matplotlib_alone", "numba_alone", "openquake", "pedestal", "relief", "scene", "settling", "shapes",
    "shares", "spelling", "statics", "trajectory",
]  # fmt: skip
