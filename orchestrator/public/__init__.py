"""What the verbs of the command line do, as functions with results: `from toppling import scan, run, fragility`."""

from typing import Any

__all__ = [
    "REALISATIONS", "constraining", "fragility_figures", "hazard_question",
    "making", "reporting", "rocks", "running", "unseen",
]  # fmt: skip

REALISATIONS = 8
"""Half samples of a scan's points, for the uncertainty."""


def unseen(*_: Any, **__: Any) -> None:
    """Take note of nothing: for callers who do not watch."""
