"""Two runs of the same jobs by two engines, cell by cell beside the records' own error.

    .venv/bin/python benchmarks/engines.py RUN OTHER

Prints shares, single answers that differ, tilts, and the differences of the maps' cells.
"""

import sys
from pathlib import Path

import numpy as np
import pandas as pd

from toppling.results.analysis.fragility import PLANES, cells
from toppling.results.reader import open_run

LEAST_TILT_DEG = 0.1
"""Tilts below count as this one: rocks that are hardly lifted would outweigh those that rock."""

SAMPLES = 40
"""Number of resamples of records, for a cell's own error."""

JOB = ["record_id", "azimuth_deg", "level_pga_m_s2", "friction_static", "realisation"]


def answers(value: pd.DataFrame, other: pd.DataFrame) -> dict[str, float]:
    """Jobs that both answered: shares toppled, single answers that differ, tilts where both stand."""
    both = value.merge(other, on=JOB, suffixes=("", "_other")).dropna(subset=["toppled", "toppled_other"])
    fell, fell_other = (both[name].astype(bool) for name in ("toppled", "toppled_other"))
    stands = ~fell & ~fell_other & (both["max_tilt_deg"] > LEAST_TILT_DEG)
    ratio = np.log(both["max_tilt_deg_other"] / both["max_tilt_deg"])[stands]
    return {
        "jobs": len(both),
        "share toppled": fell.mean(),
        "of the other": fell_other.mean(),
        "stand here, topple there": (~fell & fell_other).sum(),
        "topple here, stand there": (fell & ~fell_other).sum(),
        "tilt there over here, mean log": ratio.mean(),
        "its standard error": ratio.std() / len(ratio) ** 0.5,
    }


def probabilities(frame: pd.DataFrame, name: str) -> pd.DataFrame:
    """Cells of a map by the bounds that tell them apart."""
    plane = PLANES[name]
    table = cells(frame, plane)
    return table.set_index([f"{plane.x.column}_low", f"{plane.y.column}_low"]).rename(
        index=lambda edge: round(edge, 6)
    )


def record_errors(frame: pd.DataFrame, name: str) -> pd.Series:
    """Standard deviation of each cell's probability over records drawn anew."""
    random = np.random.default_rng(1)
    records = frame["record_id"].unique()
    of_record = {record: rows.index.to_numpy() for record, rows in frame.groupby("record_id")}
    samples = []
    for _ in range(SAMPLES):
        rows = np.concatenate([of_record[record] for record in random.choice(records, len(records))])
        samples.append(probabilities(frame.loc[rows], name)["probability"])
    return pd.concat(samples, axis=1).std(axis=1)


def differences(value: pd.DataFrame, other: pd.DataFrame, plane: str) -> dict[str, float]:
    """Differences of a map's cells of ten records or more, and the standard deviations that records leave them."""
    table, known = probabilities(value, plane), probabilities(other, plane)
    thick = table.index[~table["thin"]].intersection(known.index)
    off = known["probability"].loc[thick] - table["probability"].loc[thick]
    std = record_errors(value, plane).loc[thick]
    return {
        "cells": len(thick),
        "root mean square": float((off**2).mean() ** 0.5),
        "largest": float(off.abs().max()),
        "of records": float((std**2).mean() ** 0.5),
        "share within one std of records": float((off.abs() <= std).mean()),
        "within two": float((off.abs() <= 2.0 * std).mean()),
    }


def main() -> None:
    first, other = (open_run(Path(path)).frame() for path in sys.argv[1:3])
    print(pd.Series(answers(first, other)).to_string(float_format=lambda value: f"{value:.4f}"))
    print(pd.DataFrame({name: differences(first, other, name) for name in PLANES}).round(4).to_string())


if __name__ == "__main__":
    main()
