"""Whether the time told beforehand is right: five campaigns, each estimated and then run on local workers.

    .venv/bin/python benchmarks/estimates.py SCENE ENSEMBLE [WORKERS]

Prints, for each, the work that was expected, the work that its jobs took, and the ratio.
"""

import sys
import tempfile
from pathlib import Path

import pandas as pd

from toppling.models.motions.ensemble import Ensemble
from toppling.models.scene import Scene
from toppling.orchestrator.advice import estimate
from toppling.orchestrator.campaign import Campaign
from toppling.orchestrator.cluster import local
from toppling.orchestrator.plan import plan
from toppling.orchestrator.run import run

CAMPAIGNS = {
    "levels of the study": {"pga_m_s2": list(range(1, 20)), "azimuth_deg": [45], "preset": "fast", "every": 7},
    "weak": {"pga_m_s2": [1, 2, 3, 4], "azimuth_deg": [0, 90, 180, 270], "preset": "standard", "every": 9},
    "strong": {"pga_m_s2": [12, 15, 18], "azimuth_deg": [45, 225], "preset": "standard", "every": 4},
    "slippery": {"pga_m_s2": [4, 8, 12], "azimuth_deg": [135], "friction": [0.4, 0.6], "preset": "fast", "every": 4},
    "finest": {"pga_m_s2": [3, 6, 9, 12], "azimuth_deg": [45], "preset": "reference", "every": 3},
}  # fmt: skip
"""Axes, and every which record is taken."""


def main() -> None:
    scene, ensemble = (Path(path).absolute() for path in sys.argv[1:3])
    workers = int(sys.argv[3]) if len(sys.argv) > 3 else 2
    rows = []
    rock, motions = Scene.load(scene), Ensemble.load(ensemble)
    for name, axes in CAMPAIGNS.items():
        result = {key: value for key, value in axes.items() if key != "every"}
        records = motions.record_ids[:: int(str(axes["every"]))]
        inputs = {"scene": str(scene), "ensemble": str(ensemble), "friction": [1.0], "records": records,
            "audit": 0}  # fmt: skip
        planned = plan(Campaign.of(inputs | result, Path()), rock, motions)
        expected = estimate(planned)
        with tempfile.TemporaryDirectory() as folder:
            progress = run(planned, Path(folder) / "run", local(workers), lambda _: None)
        if expected is not None:
            rows.append({
                "campaign": name, "jobs": len(planned), "expected_work_s": expected.work_s, "work_s": progress.work_s,
                "ratio": expected.work_s / progress.work_s, "expected_s": expected.work_s / workers,
                "took_s": progress.elapsed_s,
            })  # fmt: skip
            print(rows[-1], flush=True)
    print(pd.DataFrame(rows).to_string(index=False, float_format=lambda value: f"{value:.2f}"))


if __name__ == "__main__":
    main()
