"""What rocks say under a set of events, in words."""

from collections.abc import Sequence
from typing import Any

from toppling.results.drawing.constraint_words import answer

_FEW_EVENTS = 5.0
"""Effective number of events below which a branch's survival hangs on a few."""

_NAMED_BRANCHES = 12


def event_words(statement: dict[str, Any]) -> str:
    """The statement in words, the answer first."""
    rocks = statement["rocks"]
    lines = [*answer(statement)] + [
        f"{rock['name']}: {rock['fragility']}, at {rock['site']}"
        + ("" if rock["site_distance_km"] is None else f", {rock['site_distance_km']:.1f} km from --site")
        for rock in rocks
    ]
    count = len(statement["branches"])
    stand = "the rock stands" if len(rocks) == 1 else f"all {len(rocks)} rocks stand"
    lines.append(
        f"Under {statement['events']:,} events of {count} {'branch' if count == 1 else 'branches'}, "
        f"{stand} with {statement['decided']['survival_mean_of_branches']:.3g}."
    )
    ranked = sorted(statement["branches"], key=lambda row: row["rank"])
    for row in ranked[:_NAMED_BRANCHES]:
        lines += _branch_words(row)
    if len(ranked) > _NAMED_BRANCHES:
        lines.append(f"and {len(ranked) - _NAMED_BRANCHES} branches more, in branches.csv (--out) and --json")
    if all(row["rejected"] for row in ranked):
        lines.append("Every branch is rejected.")
    few = [row["name"] for row in ranked if 0 < row["effective_events"] < _FEW_EVENTS]
    none = [row["name"] for row in ranked if row["effective_events"] == 0]
    if few:
        lines.append(
            f"Fewer than {_FEW_EVENTS:g} events bear the toppling rate of {_listed(few)}: simulate more years."
        )
    if none:
        lines.append(
            f"No event topples under {_listed(none)}: its true rate may be up to 3 events in the time simulated."
        )
    if len(statement["models"]) > 1:
        best, least = statement["models"][0], statement["models"][-1]
        lines.append(
            f"Of {len(statement['models'])} ground-motion models {best['model']} agrees best, "
            f"{best['bayes_factor']:.2g} times the average; the least, {least['model']}, "
            f"{least['bayes_factor']:.2g} times."
        )
    predicted = {row["left_out"]: row["survival_predicted"] for row in statement["left_out"]}
    lines += [
        f"Without {name}: the other rocks predict that it stands with {0.0 if chance is None else chance:.3g}"
        for name, chance in predicted.items()
    ]
    return "\n".join([*lines, *(f"Note: {note}." for note in statement["notes"])])


def _branch_words(row: dict[str, Any]) -> list[str]:
    weight = (
        "the rocks stand under no branch" if row["posterior_weight"] is None
        else f"weight {row['prior_weight']:.3g} becomes {row['posterior_weight']:.3g}"
    )  # fmt: skip
    factor = (
        "motions of any strength keep" if row["scale_factor"] is None
        else f"motions up to {row['scale_factor']:.2f} times as strong keep"
    )  # fmt: skip
    return [
        f"{row['name']}: topples at {row['toppling_rate']:.2e} a year, survival {row['survival']:.3g} "
        f"({row['survival_low']:.2g} to {row['survival_high']:.2g}, 95 %), "
        f"{'rejected' if row['rejected'] else 'kept'}; {weight}; {factor} it standing"
    ]


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")
