"""What `levels = "hunt"` would have cost on a finished run of all levels, and how far its maps would be off.

    .venv/bin/python benchmarks/hunt.py RUN

The hunt is played back on the run's own answers, several times with other draws of the audits. Costs are wall times of
the run's jobs. A cell's error is read beside that of its records: the standard deviation of its probability over
records drawn anew. Cells of fewer than ten records are left out, as the maps mark them.
"""

import sys
from pathlib import Path

import numpy as np
import pandas as pd

from toppling.orchestrator import hunt as hunting
from toppling.orchestrator.hunt import Choice, Hunt, Ladder
from toppling.results.fragility import PLANES, cells
from toppling.results.hunted import estimated
from toppling.results.run import open_run

DRAWS, SAMPLES = 8, 40


def play_back(frame: pd.DataFrame, salt: int) -> tuple[pd.DataFrame, pd.Series]:
    """Rows as the hunt would have left them, and which were shaken."""
    toppled = dict(zip(frame["job_id"], frame["toppled"].fillna(value=False).astype(bool), strict=True))
    names = {job_id: f"{job_id}-{salt}" for job_id in toppled}
    groups = [
        [
            Ladder(tuple(levels.index), tuple(levels["job_id"]))
            for _, levels in together.sort_values("level_pga_m_s2").groupby("azimuth_deg")
        ]
        for _, together in frame.groupby(["record_id", "friction_static"])
    ]
    drawn = hunting.drawn
    hunting.drawn = lambda job_id, probability: drawn(names[job_id], probability)
    try:
        hunt = Hunt(groups)
        known: dict[str, bool] = {}
        marks: dict[str, Choice] = {}
        while True:
            rows, audits = hunt.next_rows(known)
            if not rows:
                break
            known |= {job_id: toppled[job_id] for job_id in frame.loc[rows, "job_id"]}
            marks |= audits
        left = hunt.skipped(known)
    finally:
        hunting.drawn = drawn
    played = frame.assign(
        choice_probability=np.nan, expected_toppled=pd.array([pd.NA] * len(frame), "boolean")
    )
    for choice in [*left, *marks.values()]:
        played.loc[choice.row, "choice_probability"] = choice.probability
        played.loc[choice.row, "expected_toppled"] = choice.expected
    skipped = [choice.row for choice in left]
    played.loc[skipped, "status"] = "skipped"
    played.loc[skipped, "toppled"] = pd.NA
    return estimated(played), ~frame.index.to_series().isin(skipped)


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


def probabilities(frame: pd.DataFrame, name: str) -> pd.DataFrame:
    """Cells of a map by the bounds that tell them apart."""
    plane = PLANES[name]
    table = cells(frame, plane)
    return table.set_index([f"{plane.x.column}_low", f"{plane.y.column}_low"]).rename(
        index=lambda edge: round(edge, 6)
    )


def main() -> None:
    """Print the table."""
    frame = open_run(Path(sys.argv[1])).frame()
    whole = frame.groupby("record_id")["job_id"].transform("size")
    frame = frame[whole == whole.max()].reset_index(drop=True)  # of a run that goes on, records that are done
    print(
        f"{len(frame)} jobs of {frame['record_id'].nunique()} records, {frame['toppled'].mean():.3f} topple"
    )
    full = {name: probabilities(frame, name) for name in PLANES}
    errors = {name: record_errors(frame, name) for name in PLANES}
    lines = []
    for salt in range(DRAWS):
        played, shaken = play_back(frame, salt)
        line: dict[str, object] = {
            "jobs": shaken.mean(),
            "cost": frame.loc[shaken, "wall_s"].sum() / frame["wall_s"].sum(),
        }
        for name, table in full.items():
            thick = table.index[~table["thin"]]
            off = probabilities(played, name)["probability"].loc[thick] - table.loc[thick, "probability"]
            line[f"{name} rms"], line[f"{name} largest"] = (
                float((off**2).mean() ** 0.5),
                float(off.abs().max()),
            )
            line[f"{name} of records"] = float((errors[name].loc[thick] ** 2).mean() ** 0.5)
        line["share shift"] = played["toppled_estimate"].mean() - float(frame["toppled"].mean())
        lines.append(line)
    print(pd.DataFrame(lines).mean().to_string(float_format=lambda value: f"{value:.4f}"))


if __name__ == "__main__":
    main()
