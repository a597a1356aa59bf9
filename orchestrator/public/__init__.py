"""Public functions behind the commands of the command line: `from toppling import scan, run, fragility`."""

from typing import Any

__all__ = [
    "REALISATIONS", "constraining", "fragility_figures", "hazard_question",
    "making", "reporting", "rocks", "running", "unseen",
]  # fmt: skip

REALISATIONS = 8
"""Number of half samples of a scan's points, for the uncertainty."""


def unseen(*_: Any, **__: Any) -> None:
    """Progress callback that does nothing."""
