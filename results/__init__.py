"""Answers: the schema and the store of a run, queries, fragility, figures, hazard constraints."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from results.run import Run, open_run

__all__ = ["Run", "open_run"]


def __getattr__(name: str) -> Any:
    # Reading needs pandas and DuckDB; writing a run must not.
    if name in __all__:
        from results import run

        return getattr(run, name)
    msg = f"module 'results' has no attribute {name!r}"
    raise AttributeError(msg)
