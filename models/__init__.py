"""Scenes and motions, independent of engines and clusters."""

__all__ = [
    "arrays",
    "compiled",
    "errors",
    "frames",
    "kept",
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
