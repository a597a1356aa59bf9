"""An atlas of virtual rocks end to end, from clouds to page, on this machine: wall time and where it went.

.venv/bin/python benchmarks/virtual_atlas.py --out atlas                       # 20 rocks, 100 records, 5 levels
.venv/bin/python benchmarks/virtual_atlas.py --out atlas --rocks 5 --records 24
"""

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from blind_rocks import blind_rock

from toppling.models.files.mesh_files import write_ply

FIRST_SEED = 4600
LEVELS_M_S2 = (2.0, 4.0, 7.0, 11.0, 16.0)


def clouds_of(folder: Path, seed: int) -> list[Path]:
    """Write the stations of a random rock's survey."""
    _, _, stations = blind_rock(seed)
    files = [folder / f"station{number}.ply" for number in range(len(stations))]
    folder.mkdir(parents=True, exist_ok=True)
    for file, station in zip(files, stations, strict=True):
        write_ply(file, station.points_m, np.empty((0, 3), np.int64))
    return files


def called(*words: object) -> subprocess.CompletedProcess[str]:
    """Call the program."""
    command = [str(Path(sys.executable).with_name("toppling")), *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def table_of(scenes: Sequence[Path]) -> str:
    """Sites along a line of places, each rock at its own."""
    rows = [
        f"{scene},site {number},{-117.5 + 0.05 * number:.3f},{34.0 + 0.03 * (number % 7):.3f}\n"
        for number, scene in enumerate(scenes)
    ]
    return "scene,site,longitude,latitude\n" + "".join(rows)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--rocks", type=int, default=20)
    parser.add_argument("--records", type=int, default=100)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--preset", default="fast")
    given = parser.parse_args()
    out, took, began = given.out, {}, time.monotonic()
    out.mkdir(parents=True, exist_ok=True)

    def lap(what: str) -> None:
        nonlocal began
        took[what] = time.monotonic() - began
        print(f"{what:40s} {took[what]:8.1f} s", flush=True)
        began = time.monotonic()

    files = [
        clouds_of(out / "clouds" / f"rock{number:02d}", FIRST_SEED + number) for number in range(given.rocks)
    ]
    lap("clouds, ray by ray")
    scenes, refused = [], []
    for stations in files:
        scene = Path("scenes") / stations[0].parent.name
        done = called("scan", *stations, "--units", "m", "--out", out / scene)
        if done.returncode:
            refused.append((scene.name, done.stderr.strip().splitlines()[-3:]))
        else:
            scenes.append(scene)
    lap(f"scans, {len(scenes)} of {given.rocks} rocks")
    for name, why in refused:
        print(f"  {name} refused: {' '.join(why)}")
    made = called("records", "synthesise", "--out", out / "quakes", "--count", given.records, "--seed", 46)
    made.check_returncode()
    lap(f"{given.records} records")
    (out / "sites.csv").write_text(table_of(scenes))
    (out / "campaign.toml").write_text(
        f'sites = "sites.csv"\nensemble = "quakes"\npga_m_s2 = {list(LEVELS_M_S2)}\nazimuth_deg = [0]\n'
        f'friction = [0.8]\npreset = "{given.preset}"\naudit = 0\n'
    )
    words = ("--out", out / "run", "--workers", given.workers, "--json")
    done = called("run", out / "campaign.toml", *words)
    if done.returncode not in (0, 3):
        raise SystemExit(done.stderr)
    document = json.loads(done.stdout.strip().splitlines()[-1])
    lap(f"run, {document['jobs']} jobs on {given.workers} workers")
    shaking = document["work_s"] / given.workers
    print(
        f"  of it shaking {shaking:.1f} s, {document['wall_s'] - shaking:.1f} s of the session beside it; "
        f"{document['failed']} failed"
    )
    print("  " + "\n  ".join(line for line in done.stderr.splitlines() if "stand" in line))
    called("atlas", out / "run").check_returncode()
    lap("page, figure, table and map")
    print(f"{'in all':40s} {sum(took.values()):8.1f} s")


if __name__ == "__main__":
    main()
