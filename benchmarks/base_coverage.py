"""How often the 95 % interval of a scanned rock's median holds the median of the true rock under the same records.

    .venv/bin/python benchmarks/base_coverage.py --out FOLDER [--strangers FOLDER] [--family NAME ...]

Each stranger is NAME.laz with NAME_truth_rock.ply, NAME_truth_pedestal.ply and, for comparison, the accelerations of
NAME_truth_toppling.json; of each family one rock is made and scanned. Scans and runs that FOLDER has are kept. The
scan's jobs are spread over draws of its hidden base. The true rock is shaken as a draw is, on the feet of its own
meshes (`models.relief`), which cost a hundredth of the meshes; these are thinned where it does not stand on them.
"""

import argparse
import dataclasses
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import open3d
from pages import put, table
from rock_families import AZIMUTHS_DEG, family_rock
from scipy.spatial import ConvexHull

from toppling import Campaign, Ensemble, InputError, Scene, fragility, run, scan
from toppling.models.files.mesh_files import write_ply
from toppling.models.frames import plane_axes
from toppling.models.hidden_base.unseen_base import BaseDraw, UnseenBase, least_feet
from toppling.models.motions.synthetic import synthetic_ensemble
from toppling.models.pedestal import Pedestal
from toppling.models.relief import contact_feet_m, height_below
from toppling.models.rock import Rock
from toppling.models.scan.virtual import DEMO_ORIGIN_M

PAGE = Path(__file__).parent / "reports" / "scan.md"

RECORDS, BASES, FRICTION = 16, 16, 0.8
STRENGTHS = (1.2, 1.7, 2.4, 3.4, 4.8)
"""Levels of PGA in units of the least constant acceleration that topples the median base."""
MEASURE = "pgv_m_s"

CLOSE, BAND, HIGH = 0.02, 0.15, 0.3
"""In heights of the rock: clearance up to which crossing edges count, limits of the two tolerances of its feet."""
FACES = 2000

Known = tuple[str, list[Path], Any, Any, np.ndarray, np.ndarray]
"""Name, clouds, true rock, true pedestal, azimuths (degrees) and the toppling accelerations of the meshes there."""


def strangers(folder: Path) -> Iterator[Known]:
    for rock in sorted(folder.glob("*_truth_rock.ply")):
        name = rock.name.removesuffix("_truth_rock.ply")
        tips = json.loads((folder / f"{name}_truth_toppling.json").read_text())
        pedestal = folder / f"{name}_truth_pedestal.ply"
        yield name, [folder / f"{name}.laz"], rock, pedestal, np.array(tips["az"]), np.array(tips["value"])


def generated(families: list[str], seed: int, out: Path) -> Iterator[Known]:
    for family in families:
        known = family_rock(family, seed)
        files = [out / f"{family}_{number}.ply" for number in range(len(known.stations))]
        for file, station in zip(files, known.stations, strict=True):
            write_ply(file, station.points_m + DEMO_ORIGIN_M, np.empty((0, 3), np.int64))
        rock, pedestal = known.truth.rock, known.truth.pedestal
        meshes = (rock.vertices_m, rock.faces), (pedestal.vertices_m, pedestal.faces)
        yield family, files, *meshes, AZIMUTHS_DEG, known.toppling_m_s2


def _where(vertices: np.ndarray, faces: np.ndarray, keep: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Triangles of a mesh whose corners are all kept."""
    used, corners = np.unique(faces[keep[faces].all(axis=1)], return_inverse=True)
    return vertices[used], corners.reshape(-1, 3)


def _thinned(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    mesh = open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(vertices), open3d.utility.Vector3iVector(faces.astype(np.int32))
    )
    mesh = mesh.remove_duplicated_vertices().simplify_quadric_decimation(FACES)
    return np.array(mesh.vertices), np.array(mesh.triangles, np.int64)


def on_its_feet(scene: Scene) -> Scene:
    """A rock on the feet of its meshes, on one drawn base that is the true one."""
    rock, pedestal, height_m = scene.rock, scene.pedestal, scene.rock.height_m
    assert pedestal.vertices_m is not None
    assert pedestal.faces is not None
    frame = np.vstack([*plane_axes(pedestal.normal), pedestal.normal])
    above, below = (
        (points - pedestal.point_m) @ frame.T for points in (rock.vertices_m, pedestal.vertices_m)
    )
    gap = above[:, 2] - height_below(above[:, :2], below, pedestal.faces, highest=True)
    from_below = height_below(below[:, :2], above, rock.faces, highest=False) - below[:, 2]
    close = _where(rock.vertices_m, rock.faces, gap < CLOSE * height_m)
    under = _where(pedestal.vertices_m, pedestal.faces, from_below < CLOSE * height_m)
    touching = contact_feet_m(
        dataclasses.replace(rock, vertices_m=close[0], faces=close[1]),
        Pedestal(pedestal.point_m, pedestal.normal, *under),
    )
    feet = np.vstack(
        [
            np.column_stack([above[:, :2], gap]),
            np.column_stack([below[:, :2], from_below]),
            (touching - pedestal.point_m) @ frame.T,
        ]
    )
    com = (rock.com_m - pedestal.point_m) @ frame.T
    feet = feet[np.isfinite(feet[:, 2])]
    corners = ConvexHull(np.vstack([feet, com])).vertices
    feet = feet[corners[corners < len(feet)]]
    low, high = (
        feet[(feet[:, 2] >= start * height_m) & (feet[:, 2] < end * height_m)]
        for start, end in ((-1.0, BAND), (BAND, HIGH))
    )
    high = least_feet(high, np.array([[*com[:2], 2.0 * com[2]]]), com, 3e-4 * height_m)
    few = np.vstack([least_feet(low, high, com, 1e-4 * height_m), high])
    return dataclasses.replace(
        scene,
        rock=Rock.from_triangles(*_thinned(rock.vertices_m, rock.faces)),
        pedestal=Pedestal(pedestal.point_m, pedestal.normal, *_thinned(pedestal.vertices_m, pedestal.faces)),
        unseen=UnseenBase(height_m, (BaseDraw(few),), 0),
    )


def curve_of(scene: Path, folder: Path, ensemble: Path, levels: list[float], bases: int) -> Any:
    """Fragility curve of a scene, from its run."""
    text = [f'scene = "{scene}"', f'ensemble = "{ensemble}"', f"pga_m_s2 = {levels}", "azimuth_deg = [45.0]"]
    text += [f"friction = [{FRICTION}]", f"realisations = {bases}", 'preset = "fast"']
    (campaign := folder.with_suffix(".toml")).write_text("\n".join(text))
    done = run(Campaign.read(campaign), folder, workers=1)
    return fragility(done, fit=True, samples=200).curves.popitem()[1][MEASURE]


def row_of(known: Known, out: Path, ensemble: Path) -> dict[str, float]:
    """Medians of the scanned and of the true rock, m/s, and whether the interval of the former holds the latter."""
    name, files, body, ground, azimuths_deg, right_m_s2 = known
    scanned, true = out / name / "scanned", out / name / "true"
    scene = Scene.load(scanned) if scanned.exists() else scan(files, scanned).scene
    truth = Scene.from_mesh(body, pedestal=ground, friction=FRICTION)
    if scene.is_drawn_over_plane:
        truth = on_its_feet(truth)
    else:
        thin = _thinned(truth.rock.vertices_m, truth.rock.faces)
        truth = Scene.from_mesh(thin, pedestal=_thinned(*truth.pedestal_triangles()), friction=FRICTION)
    if not true.exists():
        truth.save(true)
    tips_m_s2 = np.array([tips for _, tips in truth.tips_m_s2(azimuths_deg)])
    least = min(float(entry["median_m_s2"]) for entry in scene.report["unseen_base"]["toppling"])
    levels = [round(strength * least, 2) for strength in STRENGTHS]
    found = curve_of(scanned, out / name / "run", ensemble, levels, BASES)
    right = curve_of(true, out / name / "true_run", ensemble, levels, 1)
    low, high = found.median_interval
    parts = {f"{cause} %": 100.0 * part for cause, part in found.interval_parts.items()}
    return {
        "low": low, "median": found.median, "high": high, "true median": right.median,
        "ln true/median": math.log(right.median / found.median), **parts, "inside": low <= right.median <= high,
        "true statics off by, rms %": 100.0 * float(np.sqrt((np.log(tips_m_s2 / right_m_s2) ** 2).mean())),
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
    (ensemble := given.out.absolute() / "ensemble").parent.mkdir(parents=True, exist_ok=True)
    if not ensemble.exists():
        Ensemble.write(ensemble, synthetic_ensemble(RECORDS, 1))
    rows: dict[str, dict[str, float]] = {}
    rocks = list(strangers(given.strangers)) if given.strangers else []
    for rock in [*rocks, *generated(given.family, given.seed, given.out)]:
        try:
            rows[rock[0]] = row_of(rock, given.out.absolute(), ensemble)
            print(rock[0], rows[rock[0]], flush=True)
        except InputError as error:
            print(rock[0], f"[{error.code}]", error.what, flush=True)
    put(PAGE, "bases", table(rows, "rock"))


if __name__ == "__main__":
    main()
