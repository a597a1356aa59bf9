"""Shares estimated from few draws, and how much draws say that weigh unlike."""

from __future__ import annotations

from typing import Any

from toppling.models.arrays import Array


def jeffreys_mean(count: Any, of: Any) -> Any:
    """Share of which no more is known than that `count` of `of` draws have it (Jeffreys' prior): never 0 or 1."""
    return (count + 0.5) / (of + 1.0)


def effective_number(weights: Array) -> float:
    """Kish's number of equally weighted draws that say as much as these."""
    return float(weights.sum() ** 2 / (weights**2).sum())
