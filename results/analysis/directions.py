"""Azimuths toward which the rock topples, and the least constant acceleration that topples it."""

import numpy as np
import pandas as pd

from toppling.models.frames import compass_deg

_HALF_SECTOR_DEG = 17.5
"""Half width of the sector around the weakest direction in which topplings are counted, degrees: 35 degrees in all,
as Veeraraghavan, Hudnut and Krishnan count them around their rock's overhang."""


def least_sector(quasi_static: pd.DataFrame | None) -> tuple[float, float] | None:
    """Sector (35 degrees) around the azimuth that the least constant acceleration topples the rock toward.

    quasi_static: `Run.quasi_static`.
    None where no constant acceleration is known to topple the rock.
    """
    found = weakest(quasi_static)
    return _sector_around(found[0] + 180.0) if found else None


def _sector_around(azimuth_deg: float) -> tuple[float, float]:
    return (azimuth_deg - _HALF_SECTOR_DEG) % 360.0, (azimuth_deg + _HALF_SECTOR_DEG) % 360.0


def weakest(quasi_static: pd.DataFrame | None) -> tuple[float, float] | None:
    """Azimuth and size of the least constant ground acceleration that topples the rock; None if not known."""
    known = None if quasi_static is None else quasi_static.astype(float).dropna(subset=["value"])
    if known is None or not np.isfinite(known["value"]).any():
        return None
    least = known.loc[known["value"].idxmin()]
    return float(least["ground_accelerates_toward_deg"]), float(least["value"])


def named(name: str, azimuth_deg: float | None) -> dict[str, float | None]:
    """Columns of an azimuth and its compass bearing, for `falls_toward` or `ground_accelerates_toward`."""
    bearing = None if azimuth_deg is None else float(compass_deg(azimuth_deg))
    return {f"{name}_deg": azimuth_deg, f"{name}_bearing_deg": bearing}


def topple_rose(frame: pd.DataFrame, petal_deg: float = 15.0) -> pd.DataFrame:
    """Count the toppled jobs by the azimuth they toppled toward.

    frame: rows of results.
    petal_deg: width of a petal; the first is centred on azimuth 0.
    Returns DataFrame: one row a petal: falls_toward_deg (its centre), falls_toward_bearing_deg, toppled,
    share_of_toppled.
    """
    petals = round(360.0 / petal_deg)
    azimuth = frame.loc[_toppled(frame), "falls_toward_deg"].dropna().to_numpy(float)
    index = np.floor((azimuth / 360.0 * petals) + 0.5).astype(int) % petals
    counts = np.bincount(index, minlength=petals)
    centre, share = np.arange(petals) * 360.0 / petals, counts / max(1, counts.sum())
    return pd.DataFrame({
        "falls_toward_deg": centre, "falls_toward_bearing_deg": compass_deg(centre), "toppled": counts,
        "share_of_toppled": share,
    })  # fmt: skip


def sector_share(frame: pd.DataFrame, low_deg: float, high_deg: float) -> dict[str, float]:
    """Fraction of jobs that topple toward a sector, counter-clockwise from `low_deg` to `high_deg`.

    Returns dict: low_deg, high_deg, jobs (with an answer), toppled, toppled_within, share_of_jobs, share_of_toppled.
    """
    width = (high_deg - low_deg) % 360.0 or (360.0 if high_deg != low_deg else 0.0)
    toppled = _toppled(frame)
    off = (frame["falls_toward_deg"].to_numpy(float) - low_deg) % 360.0
    within = int((toppled & (off <= width)).sum())
    jobs, all_toppled = int(frame["toppled"].notna().sum()), int(toppled.sum())
    return {
        "low_deg": low_deg,
        "high_deg": high_deg,
        "jobs": jobs,
        "toppled": all_toppled,
        "toppled_within": within,
        "share_of_jobs": within / jobs if jobs else np.nan,
        "share_of_toppled": within / all_toppled if all_toppled else np.nan,
    }


def _toppled(frame: pd.DataFrame) -> "pd.Series[bool]":
    return frame["toppled"].fillna(value=False).astype(bool)
