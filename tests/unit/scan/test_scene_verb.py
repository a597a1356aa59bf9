"""`toppling scene`: what it writes can be read by others."""

import numpy as np
import pytest
import trimesh
from click.testing import CliRunner
from refusals import refused

from toppling.models.files.mesh_files import read_triangles
from toppling.models.scene import Scene
from toppling.orchestrator.verbs.scene import scene


@pytest.fixture
def folder(tmp_path):
    return Scene.block(0.2, 0.3, 0.6).save(tmp_path / "block")


@pytest.mark.parametrize(("suffix", "up"), [(".glb", 1), (".gltf", 1), (".ply", 2), (".obj", 2)])
def test_an_export_holds_rock_and_pedestal_in_place_upright_by_the_formats_rule_and_is_read_as_it_stands(
    folder, tmp_path, suffix, up
):
    target = tmp_path / f"block{suffix}"
    CliRunner().invoke(scene, ["export", str(folder), str(target)], catch_exceptions=False)
    assert trimesh.load(target, force="mesh").bounds[1][up] == pytest.approx(1.2)
    rock, pedestal = (read_triangles(folder / f"{name}.ply") for name in ("rock", "pedestal"))
    vertices, faces = read_triangles(target)
    assert len(faces) == len(rock[1]) + len(pedestal[1])
    assert vertices.min(axis=0) == pytest.approx(pedestal[0].min(axis=0), abs=1e-6)  # single precision
    top = vertices[vertices[:, 2] > 1.1]
    assert np.abs(top).max(axis=0) == pytest.approx([0.2, 0.3, 1.2])


def test_an_unknown_format_is_refused(folder, tmp_path):
    target = tmp_path / "block.doc"
    with refused("scene.format_unknown"):
        CliRunner().invoke(scene, ["export", str(folder), str(target)], catch_exceptions=False)
    assert not target.exists()
