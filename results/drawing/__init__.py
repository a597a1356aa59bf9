"""Figures and pages, drawn from tables and scenes that other modules compute."""

from toppling.models import matplotlib_alone as matplotlib_alone

__all__ = [
    "fit_figures",
    "hazard_figures",
    "record_figures",
    "roses",
    "run_figures",
    "scene_figures",
    "sentences",
    "side_by_side_figures",
    "style",
    "templates",
    "trajectory_figures",
]  # fmt: skip
