"""Clouds to scenes: read, split, close, measure; and a virtual scanner. The only room that knows Open3D."""

import importlib
from typing import Any

from toppling.models.alone import import_alone

import_alone("matplotlib.path", "matplotlibrc")


class _OnFirstUse:
    """Open3D, imported on its first use: that takes a second, and bases are drawn again without it."""

    def __getattr__(self, name: str) -> Any:
        return getattr(importlib.import_module("open3d"), name)


o3d: Any = _OnFirstUse()

__all__ = [
    "candidates", "close", "crevice", "hints_file", "interface", "interface_hint", "parts",
    "placement", "read", "register", "segment", "surfels", "survey", "uncertainty", "virtual",
]  # fmt: skip
