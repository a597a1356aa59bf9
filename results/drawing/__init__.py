"""Figures and pages, drawn from tables and scenes that other modules compute."""

from toppling.models.alone import import_alone

import_alone("matplotlib.path", "matplotlibrc")

__all__ = [
    "hazard_figures", "record_figures", "roses", "run_figures", "scene_figures", "sentences",
    "side_by_side_figures", "style", "templates", "trajectory_figures",
]  # fmt: skip
