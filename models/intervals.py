"""What the draws of an unseen base say, in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from toppling.models.frames import compass_deg


def base_sentences(report: Mapping[str, Any]) -> list[str]:
    """What a person should know of a scanned rock's hidden base, from its scene's report; nothing without draws.

    The azimuths are those of the ground acceleration; the rock topples the other way.
    """
    found = report.get("unseen_base")
    if not found:
        return []
    if contradiction := found.get("contradiction"):
        return [f"warning: what was seen contradicts that the rock stands: {contradiction}"]
    table = found["toppling"]
    least = min(table, key=lambda each: each["median_m_s2"])
    share = f"{100 * found['level']:.0f} % of {found['draws']} bases that agree with all that was seen"
    few, _, many = found["contacts"]["count"]
    com = np.array(found["com_m"])
    sentences = [
        f"least constant acceleration that topples it, in {share}: {_interval(least)}, where the ground accelerates "
        f"toward azimuth {least['azimuth_deg']:.0f}° (compass {compass_deg(least['azimuth_deg']):.0f}°); over all "
        f"azimuths the interval's width is {100 * median_width(table):.0f} % of its median",
        f"contacts: {few} to {many} places touch, {_reach(found)} from the vertical through the centre of mass, which "
        "is known to ± " + ", ".join(f"{0.5 * (high - low):.2g}" for low, _, high in com) + " m (x, y, z)",
    ]
    if "without_inspection" in found:
        before = found["without_inspection"]
        told = (
            "no base agreed"
            if before is None
            else f"its width was {100 * median_width(before):.0f} % of its median"
        )
        sentences.append(f"what is known by inspection tightens the interval: without it {told}")
    if not found.get("nominal_at_rest", True):
        sentences.append(
            "warning: with the centre of mass of the mesh the rock is at rest as scanned on none of the bases: the "
            "nominal scene has a smooth base, while the rock stands on every drawn base with the centre drawn with it"
        )
    return sentences


def median_width(table: list[dict[str, Any]]) -> float:
    """Median over azimuths of an interval's width over its median."""
    return float(np.median([
        (each["high_m_s2"] - each["low_m_s2"]) / max(each["median_m_s2"], 1e-9) for each in table
    ]))  # fmt: skip


def _interval(each: dict[str, Any]) -> str:
    return f"{each['low_m_s2']:.2f} to {each['high_m_s2']:.2f} m/s² (median {each['median_m_s2']:.2f})"


def _reach(found: dict[str, Any]) -> str:
    table = found["contacts"]["reach"]
    low, high = min(each["low_m"] for each in table), max(each["high_m"] for each in table)
    return f"{low:.2g} to {high:.2g} m"
