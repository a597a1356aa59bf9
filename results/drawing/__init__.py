"""Every picture and page: drawing only, from tables and scenes that other modules made."""

from toppling.models import matplotlib_alone as matplotlib_alone

__all__ = [
    "constraint_folder", "constraint_words", "event_words", "fit_table", "magnitude_figures", "page",
    "presets", "record_figures", "replay_page", "run_figures", "scenarios", "scene_export", "scene_figures",
    "settling_figure", "side_by_side_figures", "study_figures", "style", "validation_figures", "watch_page",
]  # fmt: skip
