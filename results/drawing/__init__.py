"""Figures and pages, drawn from tables and scenes that other modules compute."""

from toppling.models import matplotlib_alone as matplotlib_alone

__all__ = [
    "constraint_folder", "constraint_words", "fit_figures", "magnitude_figures", "page", "record_figures", "roses",
    "run_figures", "scene_export", "scene_figures", "sentences", "side_by_side_figures", "style",
    "templates", "trajectory_figures",
]  # fmt: skip
