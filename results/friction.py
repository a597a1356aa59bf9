"""Friction against friction: the same cells, and the same jobs, under two coefficients."""

import pandas as pd

from results.fragility import Plane, cells

_JOB = ["scene_id", "preset", "restitution", "record_id", "level_pga_m_s2", "azimuth_deg", "realisation"]


def compare_cells(frame: pd.DataFrame, plane: Plane, reference: float) -> pd.DataFrame:
    """Toppling probability of each cell under each static friction against that under a reference friction.

    Only jobs that were answered under both are compared, so that a difference is friction's.

    Parameters
    ----------
    frame : DataFrame
        Rows of results of one scene, preset and restitution.
    plane : Plane
    reference : float
        Static friction on the horizontal axis.

    Returns
    -------
    DataFrame
        One row a friction and cell: friction_static, the cell's bounds, records, probability, wilson_low,
        wilson_high, and the same three with `reference_` before them, thin.
    """
    answered = frame[frame["toppled"].notna()]
    base = answered[answered["friction_static"] == reference]
    tables = []
    for friction, jobs in answered.groupby("friction_static"):
        if friction == reference:
            continue
        shared = base[_JOB].merge(jobs[_JOB])
        ours, theirs = (cells(part.merge(shared), plane) for part in (jobs, base))
        bounds = [name for name in ours.columns if name.endswith(("_low", "_high")) and "wilson" not in name]
        numbers = ["probability", "wilson_low", "wilson_high"]
        renamed = theirs[[*bounds, *numbers]].rename(columns={name: f"reference_{name}" for name in numbers})
        both = ours[[*bounds, "records", *numbers, "thin"]].merge(renamed, on=bounds)
        tables.append(both.assign(friction_static=friction, reference_friction_static=reference))
    return pd.concat(tables, ignore_index=True) if tables else pd.DataFrame()


def compare_jobs(frame: pd.DataFrame, reference: float) -> pd.DataFrame:
    """Pair each job with the same one under a reference friction, and count how the answers differ.

    Returns
    -------
    DataFrame
        One row a friction: friction_static, pairs, both, neither, only_this, only_reference.
    """
    answered = frame[frame["toppled"].notna()].astype({"toppled": bool})
    base = answered.loc[answered["friction_static"] == reference, [*_JOB, "toppled"]]
    lines = []
    for friction, jobs in answered.groupby("friction_static"):
        if friction == reference:
            continue
        pairs = jobs[[*_JOB, "toppled"]].merge(base, on=_JOB, suffixes=("", "_reference"))
        this, that = pairs["toppled"], pairs["toppled_reference"]
        lines.append({
            "friction_static": friction, "reference_friction_static": reference, "pairs": len(pairs),
            "both": int((this & that).sum()), "neither": int((~this & ~that).sum()),
            "only_this": int((this & ~that).sum()), "only_reference": int((~this & that).sum()),
        })  # fmt: skip
    return pd.DataFrame(lines)
