"""Results of the draws of an unseen base, in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from toppling.models.frames import quadrant_of

FEW_DISTINCT = 10
"""Different draws below which an interval says little."""
_LIFTS_EARLY = 0.1
"""Share of the toppling acceleration by which lift-off comes before it, so that both are stated."""
PULL = "pull"
_AS_IT_WAS = 0.05
"""Relative change of an interval's width that draws of other random numbers bring too."""


def base_sentences(report: Mapping[str, Any]) -> list[str]:
    """Sentences on the hidden base of a scanned rock, from its scene's report; none without draws.

    The azimuths are those of the ground acceleration; the rock topples the other way.
    """
    found = report.get("unseen_base")
    if not found:
        return []
    if contradiction := found.get("contradiction"):
        return [f"warning: what was seen contradicts that the rock stands: {contradiction}"]
    table = found["toppling"]
    least = min(table, key=lambda row: row["median_m_s2"])
    share = f"{100 * found['level']:.0f} % of {found['draws']} bases that agree with all that was seen"
    few, _, many = found["contacts"]["count"]
    com = np.array(found["com_m"])
    sentences = [
        f"least constant acceleration that topples it, in {share}: {_interval(least)}, where the ground accelerates "
        f"toward {quadrant_of(least['azimuth_deg'])}; over all "
        f"azimuths the interval's width is {100 * median_width(table):.0f} % of its median",
        f"contacts: {few} to {many} places touch; centre of mass within ± "
        + ", ".join(f"{0.5 * (high - low):.2g}" for low, _, high in com)
        + f" m (x, y, z) in {100 * found['level']:.0f} % of these bases",
    ]
    if kinds := found.get("kinds"):
        counted = sorted(kinds.items(), key=lambda row: -row[1]["draws"])
        words = ", ".join(f"{kind} {100 * row['draws'] / found['draws']:.0f} %" for kind, row in counted)
        sentences.append(f"kind of the base, by its rim and hints: {words}")
    if opening := found.get("lift_off"):
        sentences += _lift_off_sentences(table, opening)
    if "without_inspection" in found:
        sentences.append(inspection_sentence(table, found["without_inspection"]))
    sentences += [
        f"warning: what was seen foretells a gap of {row['gap_m']:.2g} m where place {row['place']} that is said to "
        "touch lies: the bases touch there as said; check it"
        for row in found.get("touches_at_gaps", [])
    ]
    sentences += [
        f"warning: the pull of {row['ratio']:.3g} of the weight toward {quadrant_of(row['azimuth_deg'])} lies outside "
        f"what bases that agree with the scan bear, {row['low']:.3g} to {row['high']:.3g} in "
        f"{100 * found['level']:.0f} % of them: check it, and that its azimuth is that of "
        "the force, not of the ground; if it is right the rock topples otherwise than is stated, and the interface "
        "may be another (--plane, --point)"
        for row in found.get("pulls_beyond", [])
    ]
    if "next_observations" in found:
        pull, width = narrowing_pull(found)
        after = f"{100 * width:.0f} % after {pull}" if pull else "no pull narrows it"
        now = f"{100 * median_width(table):.0f} % of its median"
        sentences.append(f"expected width of the interval, now {now}: {after}")
    distinct = found.get("distinct", found["draws"])
    if distinct < FEW_DISTINCT:
        sentences.append(
            f"warning: only {distinct} distinct base{'' if distinct == 1 else 's'} among the {found['draws']} drawn "
            f"agree{'s' if distinct == 1 else ''} with the pull: the intervals say little; check its azimuth and ratio"
        )
    if not found.get("nominal_at_rest", True):
        sentences.append(
            "warning: with the centre of mass of the mesh the rock is at rest as scanned on none of the bases: the "
            "nominal scene has a smooth base, while the rock stands on every drawn base with the centre drawn with it"
        )
    return sentences


def volume_text(report: Mapping[str, Any], mesh_m3: float) -> str:
    """Volume of a rock with its drawn bases, median and interval; of its mesh where there are none."""
    found = report.get("unseen_base") or {}
    if "volume_m3" not in found:
        return f"{mesh_m3:.4g} m³"
    low, median, high = found["volume_m3"]
    return f"{median:.4g} m³ ({low:.4g} to {high:.4g} in {100 * found['level']:.0f} % of its bases)"


def narrowing_pull(found: Mapping[str, Any]) -> tuple[str, float]:
    """The pull that narrows the interval most, in words, and the width that it is expected to leave; "" if none does.

    found: what the draws of an unseen base say.
    """
    pulls = [observation for observation in found.get("next_observations", ()) if observation["kind"] == PULL]
    if not pulls:
        return "", np.inf
    best = min(pulls, key=lambda pull: pull["width"])
    narrows = best["width"] < (1.0 - _AS_IT_WAS) * median_width(found["toppling"])
    return (f"a pull toward {quadrant_of(best['from_deg'])}" if narrows else ""), best["width"]


def median_width(table: list[dict[str, Any]]) -> float:
    """Median over azimuths of an interval's width over its median."""
    return float(np.median([
        (row["high_m_s2"] - row["low_m_s2"]) / max(row["median_m_s2"], 1e-9) for row in table
    ]))  # fmt: skip


def _lift_off_sentences(table: list[dict[str, Any]], opening: list[dict[str, Any]]) -> list[str]:
    """Where contacts open long before the rock overturns: both, at the azimuth at which they open first."""
    least = min(range(len(table)), key=lambda row: opening[row]["median_m_s2"])
    lifts, topples = opening[least], table[least]
    if lifts["median_m_s2"] > (1.0 - _LIFTS_EARLY) * topples["median_m_s2"]:
        return []
    return [
        f"where the ground accelerates toward {quadrant_of(lifts['azimuth_deg'])}, contacts begin to open at "
        f"{_interval(lifts)}: it rocks before it overturns, at {_interval(topples)}"
    ]


def inspection_sentence(table: list[dict[str, Any]], before: list[dict[str, Any]] | None) -> str:
    """Effect of hints on the interval, with its width with and without them."""
    if before is None:
        return "without what is known by inspection no base agreed"
    width, was = median_width(table), median_width(before)
    does = "narrows the interval" if width < was else "widens the interval"
    if abs(width - was) <= _AS_IT_WAS * was:
        does = "leaves the interval as it was"
    change = f"its width is {100 * width:.0f} % of its median, {100 * was:.0f} % without"
    return f"what is known by inspection {does}: {change}"


def _interval(row: dict[str, Any]) -> str:
    return f"{row['low_m_s2']:.2f} to {row['high_m_s2']:.2f} m/s² (median {row['median_m_s2']:.2f})"
