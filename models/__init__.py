"""Scenes and motions, independent of engines and clusters."""

__all__ = [
    "alone", "arrays", "caching", "compiled", "errors", "frames", "lengths", "pedestal", "relief", "rock", "scene",
    "shapes", "smooth_mesh", "statics", "terminal",
]  # fmt: skip
