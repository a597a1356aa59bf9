"""Clouds to scenes: read, split, close, measure; and a virtual scanner. The only room that knows Open3D."""

from toppling.models import matplotlib_alone as matplotlib_alone

__all__ = [
    "candidates",
    "close",
    "crevice",
    "directions",
    "hints_file",
    "interface",
    "interface_hint",
    "parts",
    "placement",
    "read",
    "register",
    "segment",
    "surfels",
    "survey",
    "uncertainty",
    "virtual",
]  # fmt: skip
