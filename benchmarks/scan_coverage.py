"""How often the intervals of scanned rocks hold the truth, by family: of rocks that nothing was tuned on.

Puts its table into benchmarks/reports/scan.md.

    .venv/bin/python benchmarks/scan_coverage.py [--count 2] [--first 0] [--family NAME ...]

COUNT rocks of each family are scanned without a hint, and once more with a click on the rock where they are refused;
where it is asked which crease is meant, with the lowest that is offered, as a user who sees the rock would take.
"""

import argparse
import re
import time
from pathlib import Path
from typing import Any

import numpy as np
from pages import put, table
from rock_families import AZIMUTHS_DEG, LEARNT, TESTED, family_rock

from toppling.models.errors import InputError
from toppling.models.scan import virtual
from toppling.models.scan.interface_hint import hint_of
from toppling.models.scan.survey import Survey, survey

PAGE = Path(__file__).parent / "reports" / "scan.md"


def row_of(family: str, seed: int) -> dict[str, float]:
    """What became of one rock: shares of azimuths, errors in per cent, processor seconds."""
    known = family_rock(family, seed)
    cloud, _ = virtual.cloud_of(known.stations, virtual.DEMO_ORIGIN_M)
    begin = time.process_time()
    top = known.truth.rock.com_m[:2] + virtual.DEMO_ORIGIN_M[:2]
    found: Survey | None = None
    hints: dict[str, Any] = {}
    for _ in range(2):
        try:
            found = survey(cloud, **hints)
            break
        except InputError as error:
            print(known.name, f"[{error.code}]", error.what[:150], flush=True)
            hints = {"near_m": (float(top[0]), float(top[1]))}
            if offered := re.findall(r"--point (\S+?),(\S+?),([-+.\d]+)", error.what):
                directions = np.array(offered, float).reshape(-1, 3, 3)
                hints = {
                    "hint": hint_of(points=directions[directions[:, :, 2].mean(axis=1).argmin()].tolist())
                }
    if found is None:
        return {"rocks": 1.0, "accepted": 0.0}
    scene, true = found.scene, known.truth.rock
    table = scene.report["unseen_base"]["toppling"]
    low, median, high = (
        np.array([entry[key] for entry in table]) for key in ("low_m_s2", "median_m_s2", "high_m_s2")
    )
    right = np.interp(
        [entry["azimuth_deg"] for entry in table], AZIMUTHS_DEG, known.toppling_m_s2, period=360.0
    )
    least = int(right.argmin())
    moved = scene.rock.com_m + scene.origin_m - true.com_m - virtual.DEMO_ORIGIN_M
    return {
        "rocks": 1.0,
        "accepted": 1.0,
        "without a click": float(not hints),
        "held": float(((low <= right) & (right <= high)).mean()),
        "below": float((right < low).mean()),
        "least held": float(low[least] <= right[least] <= high[least]),
        "width": float(np.median((high - low) / median)),
        "log of truth over median, rms": float(np.sqrt((np.log(right / median) ** 2).mean())),
        "volume %": 100.0 * (scene.rock.volume_m3 / true.volume_m3 - 1.0),
        "centre of mass, % of height": 100.0 * float(np.linalg.norm(moved)) / true.height_m,
        "processor s": time.process_time() - begin,
    }


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=2)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--family", nargs="*", default=[*LEARNT, *TESTED])
    given = parser.parse_args()
    rows: dict[str, dict[str, float]] = {}
    for family in given.family:
        found = []
        for seed in range(given.first, given.first + given.count):
            found.append(row_of(family, seed))
            print(family, seed, {key: round(value, 2) for key, value in found[-1].items()}, flush=True)
        columns = list(dict.fromkeys(column for row in found for column in row))
        rows[family] = {
            column: float(np.mean([row[column] for row in found if column in row])) for column in columns
        } | {"rocks": float(len(found))}
        put(PAGE, "families", table(rows, "family"))


if __name__ == "__main__":
    main()
