"""Shares estimated from few draws, and how much draws say that weigh unlike."""

from __future__ import annotations

from typing import Any

from toppling.models.arrays import Array


def jeffreys_mean(count: Any, of: Any) -> Any:
    """Share of which no more is known than that `count` of `of` draws have it (Jeffreys' prior): never 0 or 1."""
    return (count + 0.5) / (of + 1.0)


def effective_number(weights: Array) -> float:
    """Kish's number of equally weighted draws that say as much as these, which are not all 0."""
    share = weights / weights.max()  # squares of weights may be too small for a number
    return float(share.sum() ** 2 / (share**2).sum())
