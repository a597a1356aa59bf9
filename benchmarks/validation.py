"""What the scores of `toppling validate` should not depend on: preset, engine, resolution of the mesh, contact points.

    .venv/bin/python benchmarks/validation.py FOLDER --mesh sp1.ply --outcome sp1_overturned [--draws 12]

Every variant shakes all tests on draws of the same bases and of all else that nobody measured. Puts its table into
benchmarks/reports/validation.md.
"""

import argparse
import tempfile
from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import trimesh
from pages import put

from toppling.models.files.mesh_files import read_triangles
from toppling.models.motions.shaketable import Experiment, read_experiment
from toppling.models.scene import Scene
from toppling.orchestrator.cluster import local
from toppling.orchestrator.studies.validation import Sampling, Shaken, ensemble_of, shake_tests, specimen
from toppling.results.analysis.prediction_scores import learnt, scores, share

PAGE = Path(__file__).parent / "reports" / "validation.md"
MEASURES = ("accuracy", "balanced_accuracy", "brier", "calibration_slope")


def finer(mesh: Path) -> tuple[np.ndarray, np.ndarray]:
    """The same surface, each of its triangles cut into four."""
    return trimesh.remesh.subdivide(*read_triangles(mesh))


def variants(mesh: Path, sampling: Sampling) -> Iterator[tuple[str, Scene, Sampling]]:
    """Name, scene and settings of each."""
    usual = specimen(mesh, sampling)
    yield "as `toppling validate` does it", usual, sampling
    yield "preset `fast`", usual, replace(sampling, preset="fast")
    yield "preset `standard`", usual, replace(sampling, preset="standard")
    yield "MuJoCo `draft`, no restitution", usual, replace(sampling, engine="mujoco")
    yield "contact points to a fifth of the noise", specimen(mesh, sampling, tolerance_share=0.2), sampling
    yield "mesh four times as fine", specimen(finer(mesh), sampling), sampling


def shaken(experiment: Experiment, scene: Scene, sampling: Sampling) -> Shaken:
    """All tests on all draws."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        ensemble_of(folder, experiment)
        scene.save(folder / "scene")
        return shake_tests(
            folder, experiment, sampling, partial(local, 2), lambda: nullcontext(lambda _: None)
        )


def row(experiment: Experiment, said: Shaken) -> str:
    """Scores without and with learning."""
    overturned = np.array([test.overturned for test in experiment.tests])
    group = np.array([test.ground_motion for test in experiment.tests])
    free = scores(overturned, share(said.toppled)[0])
    taught = scores(overturned, learnt(said.toppled, overturned, group))
    return " | ".join(f"{one[name]:.3f}" for one in (free, taught) for name in MEASURES)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--mesh", required=True)
    parser.add_argument("--outcome", required=True)
    parser.add_argument("--draws", type=int, default=12)
    given = parser.parse_args()
    experiment = read_experiment(given.folder, given.outcome)
    sampling = Sampling("pybullet", "draft", given.draws, 0.0)
    names = "accuracy | balanced | Brier | slope"
    lines = [f"| | {names} | learnt: {names} |", "|---" * 9 + "|"]
    for name, scene, asked in variants(given.folder / given.mesh, sampling):
        lines.append(f"| {name} | {row(experiment, shaken(experiment, scene, asked))} |")
        print(lines[-1], flush=True)
    put(PAGE, "invariance", "\n".join(lines))


if __name__ == "__main__":
    main()
