"""Public functions behind the commands of the command line: `from toppling import scan, run, fragility`."""

from typing import Any

__all__ = [
    "constraining",
    "fragility_figures",
    "making",
    "reporting",
    "rocks",
    "running",
    "unseen",
]  # fmt: skip


def unseen(*_: Any, **__: Any) -> None:
    """Progress callback that does nothing."""
