"""Proportions estimated from few draws, and the effective number of weighted draws."""

from __future__ import annotations

from typing import Any

from toppling.models.arrays import Array


def jeffreys_mean(count: Any, of: Any) -> Any:
    """Posterior mean of a proportion under Jeffreys' prior, after `count` of `of` draws: never 0 or 1."""
    return (count + 0.5) / (of + 1.0)


def effective_number(weights: Array) -> float:
    """Kish's effective number of draws with weights that are not all 0."""
    share = weights / weights.max()  # avoids underflow of squares
    return float(share.sum() ** 2 / (share**2).sum())
