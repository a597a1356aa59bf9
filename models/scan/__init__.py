"""Clouds to scenes: read, split, close, measure; and a virtual scanner. The only room that knows Open3D."""

from toppling.models import matplotlib_alone as matplotlib_alone

__all__ = [
    "candidates", "close", "crevice", "doubt", "hints_file", "interface",
    "interface_hint", "invented", "measure", "parts", "placement", "read", "reference", "register", "segment",
    "survey", "view", "virtual", "worked_out",
]  # fmt: skip
