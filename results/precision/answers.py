"""Rows of results as answers to the jobs that were chosen, in their order whatever the order in which they came."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from toppling.results.precision.probit import Answers


def answers_of(
    frame: pd.DataFrame, jobs: Sequence[str], measures: Sequence[str], records: Mapping[str, int]
) -> dict[str, Answers]:
    """Answers to some jobs by measure.

    Parameters
    ----------
    frame : DataFrame
        Rows of results; weights in `record_weight` where they are unlike.
    jobs : sequence of str
        Ids, in the order chosen.
    measures : sequence of str
        One that is not positive in every row is left out.
    records : mapping
        Number of each record.
    """
    rows = frame.set_index("job_id").reindex(jobs)
    rows = rows[rows["toppled"].notna()]
    toppled = rows["toppled"].to_numpy(bool).astype(float)
    record = rows["record_id"].map(records).to_numpy(np.int64)
    weight = rows["record_weight"].to_numpy(float) if "record_weight" in rows else np.ones(len(rows))
    usable = [name for name in measures if (rows[name].fillna(0.0) > 0).all()]
    return {
        name: Answers(np.log(rows[name].to_numpy(float)), toppled, record, weight / weight.mean())
        for name in usable
    }
