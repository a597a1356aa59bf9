"""Scenes and motions, independent of engines and clusters."""

__all__ = [
    "arrays",
    "caching",
    "compiled",
    "errors",
    "frames",
    "lengths",
    "matplotlib_alone",
    "openquake",
    "pedestal",
    "proportions",
    "relief",
    "scene",
    "settling",
    "shapes",
    "statics",
    "terminal",
    "trajectory",
]  # fmt: skip
