"""Cost of ground motions: raw files to an ensemble, and a motion for a job.

    .venv/bin/python benchmarks/motions.py [FOLDER [METADATA]]

FOLDER holds record files, METADATA is the table that says what they do not. Without them only the cost of a job's
motion is measured, on synthetic records.
"""

import statistics
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.importing import import_records, record_files
from toppling.models.motions.impose import impose
from toppling.models.motions.metadata import read_table
from toppling.models.motions.synthetic import synthetic_ensemble

ROUNDS = 2000


def importing(folder: Path, metadata: Path | None, out: Path) -> Ensemble:
    """Import files, and say how long it took."""
    began = time.perf_counter()
    used = time.process_time()
    files = record_files([folder])
    outcome = import_records(files, read_table(metadata) if metadata else [])
    ensemble = Ensemble.write(out, outcome.records)
    print(
        f"import: {len(outcome.records)} records of {len(files)} files, {len(outcome.refusals)} left out, in "
        f"{time.perf_counter() - began:.1f} s ({time.process_time() - used:.1f} s of one core)"
    )
    return ensemble


def imposing(ensemble: Ensemble) -> None:
    """Cost of a job's motion: scaled, turned, measured; and its integral, which the engine asks for step by step."""
    random = np.random.default_rng(1)
    names = ensemble.record_ids
    imposed, stepped, reading = [], [], []
    for k in range(ROUNDS):
        began = time.perf_counter()
        # As jobs come: many of one record, then the next.
        record = ensemble.record(names[k * len(names) // ROUNDS])
        reading.append(time.perf_counter() - began)
        began = time.perf_counter()
        motion = impose(record, random.uniform(1.0, 19.0), random.uniform(0.0, 360.0)).motion
        imposed.append(time.perf_counter() - began)
        began = time.perf_counter()
        motion.velocity_at(np.arange(0.0, motion.duration_s, 0.008))
        stepped.append(time.perf_counter() - began)
    for what, times in (("impose", imposed), ("on the engine's step (8 ms)", stepped)):
        ninety = float(np.quantile(times, 0.9))
        print(f"{what}: {1e3 * statistics.median(times):.2f} ms median, {1e3 * ninety:.2f} ms for 9 of 10")
    print(f"read a record: {1e3 * sum(reading) / len(names):.2f} ms, once for all of its jobs")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as scratch:
        if len(sys.argv) > 1:
            table = Path(sys.argv[2]) if len(sys.argv) > 2 else None
            imposing(importing(Path(sys.argv[1]), table, Path(scratch)))
        else:
            imposing(Ensemble.write(scratch, synthetic_ensemble(20, 1)))
