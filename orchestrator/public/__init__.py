"""Public functions behind the commands of the command line: `from toppling import scan, run, fragility`."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

__all__ = ["constraining", "making", "reporting", "rocks", "running", "unseen"]


def unseen(*_: Any, **__: Any) -> None:
    """Progress callback that does nothing."""


def paths_of(given: str | Path | Sequence[str | Path]) -> tuple[Path, ...]:
    """Paths of a single path or a sequence."""
    return tuple(map(Path, [given] if isinstance(given, str | Path) else given))
