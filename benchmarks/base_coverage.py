"""How often the 95 % interval of a scanned rock's median holds the median of the true rock under the same records.

    .venv/bin/python benchmarks/base_coverage.py --out FOLDER [--strangers FOLDER] [--family NAME ...]

Each stranger is NAME.laz with NAME_truth_rock.ply and NAME_truth_pedestal.ply; of each family one rock is made and
scanned. The scan's jobs are spread over draws of its hidden base; those of the true rock have its own.
"""

import argparse
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from pages import table
from rock_families import family_rock

from toppling import Campaign, Ensemble, InputError, Scene, fragility, run, scan
from toppling.models.files.mesh_files import write_ply
from toppling.models.motions.synthetic import synthetic_ensemble
from toppling.models.scan.virtual import DEMO_ORIGIN_M

RECORDS, BASES, FRICTION = 24, 12, 0.8
STRENGTHS = (1.2, 1.7, 2.4, 3.4, 4.8)
"""Levels of PGA in units of the least constant acceleration that topples the median base."""
MEASURE = "pgv_m_s"

Rock = tuple[str, list[Path], Any, Any]
"""Name, clouds, true rock and true pedestal."""


def strangers(folder: Path) -> Iterator[Rock]:
    for rock in sorted(folder.glob("*_truth_rock.ply")):
        name = rock.name.removesuffix("_truth_rock.ply")
        yield name, [folder / f"{name}.laz"], rock, folder / f"{name}_truth_pedestal.ply"


def generated(families: list[str], seed: int, out: Path) -> Iterator[Rock]:
    for family in families:
        known = family_rock(family, seed)
        files = [out / f"{family}_{number}.ply" for number in range(len(known.stations))]
        for file, station in zip(files, known.stations, strict=True):
            write_ply(file, station.points_m + DEMO_ORIGIN_M, np.empty((0, 3), np.int64))
        rock, pedestal = known.truth.rock, known.truth.pedestal
        yield known.name, files, (rock.vertices_m, rock.faces), (pedestal.vertices_m, pedestal.faces)


def curve_of(scene: Path, folder: Path, ensemble: Path, levels: list[float], bases: int) -> Any:
    """Fragility curve of a scene, from a run in a new folder."""
    text = [f'scene = "{scene}"', f'ensemble = "{ensemble}"', f"pga_m_s2 = {levels}", "azimuth_deg = [45.0]"]
    text += [f"friction = [{FRICTION}]", f"realisations = {bases}", 'preset = "fast"']
    (campaign := folder.with_suffix(".toml")).write_text("\n".join(text))
    done = run(Campaign.read(campaign), folder, workers=1)
    return fragility(done.run, fit=True, samples=200).curves.popitem()[1][MEASURE]


def row_of(rock: Rock, out: Path, ensemble: Path) -> dict[str, float]:
    """Medians of the scanned and of the true rock, m/s, and whether the interval of the former holds the latter."""
    name, files, body, ground = rock
    scanned, true = out / name / "scanned", out / name / "true"
    scene = scan(files, scanned).scene
    Scene.from_mesh(body, pedestal=ground, friction=FRICTION).save(true)
    least = min(float(each["median_m_s2"]) for each in scene.report["unseen_base"]["toppling"])
    levels = [round(strength * least, 2) for strength in STRENGTHS]
    found = curve_of(scanned, out / name / "run", ensemble, levels, BASES)
    right = curve_of(true, out / name / "true_run", ensemble, levels, 1)
    low, high = found.median_interval
    parts = {f"{cause} %": 100.0 * part for cause, part in found.interval_parts.items()}
    return {
        "low": low, "median": found.median, "high": high, "true median": right.median,
        "ln true/median": math.log(right.median / found.median), **parts, "inside": low <= right.median <= high,
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--strangers", type=Path)
    parser.add_argument("--family", nargs="*", default=[])
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    (ensemble := given.out.absolute() / "ensemble").parent.mkdir(parents=True)
    Ensemble.write(ensemble, synthetic_ensemble(RECORDS, 1))
    rows: dict[str, dict[str, float]] = {}
    rocks = list(strangers(given.strangers)) if given.strangers else []
    for rock in [*rocks, *generated(given.family, given.seed, given.out)]:
        try:
            rows[rock[0]] = row_of(rock, given.out.absolute(), ensemble)
            print(rock[0], rows[rock[0]], flush=True)
        except InputError as error:
            print(rock[0], f"[{error.code}]", error.what, flush=True)
    print(table(rows, "rock"))


if __name__ == "__main__":
    main()
