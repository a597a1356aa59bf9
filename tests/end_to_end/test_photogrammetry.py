"""A photogrammetric model of a rock, in its own unit and attitude, becomes the rock that it was made from."""

import json
import subprocess
import sys

import numpy as np
import pytest
from virtual_rocks import stump_on_a_slope

from toppling.models.scan import virtual
from toppling.models.scan.hints_file import read_hints

COMMAND = [sys.executable, "-P", "-m", "toppling", "scan"]
MM_Y_UP = np.array([[1000.0, 0.0, 0.0], [0.0, 0.0, 1000.0], [0.0, -1000.0, 0.0]])


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """A rock of 2 m on a slope, and a textured model of two objects of it in millimetres, y up."""
    folder = tmp_path_factory.mktemp("model")
    truth = stump_on_a_slope()
    lines, first = ["mtllib skin.mtl"], 1
    for number, (vertices, faces) in enumerate(
        [(truth.rock.vertices_m, truth.rock.faces), (truth.pedestal.vertices_m, truth.pedestal.faces)]
    ):
        lines += [f"o object{number}", "usemtl skin"]
        lines += ["v {:.3f} {:.3f} {:.3f}".format(*place) for place in vertices @ MM_Y_UP.T]
        lines += [f"vt {place % 64 / 64:.4f} {place // 64 / 999:.4f}" for place in range(len(vertices))]
        lines += ["f " + " ".join(f"{corner}/{corner}" for corner in face) for face in faces + first]
        first += len(vertices)
    (folder / "model.obj").write_text("\n".join(lines) + "\n")
    marks = np.array([[3.0, 0.0, 0.2], [-2.0, 3.0, 0.1], [-1.0, -3.5, -0.3], [0.0, 1.0, 1.9]])
    np.savetxt(
        folder / "gcp.csv",
        np.hstack([marks @ MM_Y_UP.T, marks + virtual.DEMO_ORIGIN_M]),
        fmt="%.4f",
        delimiter=",",
    )
    return folder, truth.rock


def test_a_placed_model_has_the_volume_and_centre_of_mass_of_the_true_body(site):
    folder, true = site
    completed = subprocess.run(
        [*COMMAND, "model.obj", "--gcp", "gcp.csv", "--crs", "EPSG:32611", "--out", "rock"],
        cwd=folder, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert completed.returncode == 0, completed.stderr
    scene = json.loads((folder / "rock" / "scene.json").read_text())
    # The half a percent; the base, which no camera sees, is drawn .3 % off.
    assert scene["rock"]["volume_m3"] == pytest.approx(true.volume_m3, rel=0.005)
    place = np.add(scene["origin_m"], scene["rock"]["com_m"])
    np.testing.assert_allclose(
        place, true.com_m + virtual.DEMO_ORIGIN_M, atol=0.01
    )  # half a percent of its height
    assert scene["report"]["surface"]["invented_share"] < 0.01
    assert read_hints(folder / "rock" / "hints.toml").keys() == {"gcp", "crs"}
    assert scene["report"]["files"][0]["epsg"] == 32611
