"""`toppling scene`: what it writes can be read by others."""

import pytest
import trimesh
from click.testing import CliRunner

from models import InputError, Scene
from orchestrator.verbs.scene import scene


@pytest.fixture
def folder(tmp_path):
    return Scene.block(0.2, 0.3, 0.6).save(tmp_path / "block")


def test_show_writes_a_picture_and_a_standalone_page(folder, tmp_path):
    done = CliRunner().invoke(
        scene, ["show", str(folder), "--out", str(tmp_path / "seen")], catch_exceptions=False
    )
    assert done.exit_code == 0
    assert (tmp_path / "seen/scene.png").stat().st_size > 10_000
    page = (tmp_path / "seen/scene.html").read_text()
    assert "Plotly.newPlot" in page
    assert 'src="http' not in page


@pytest.mark.parametrize("suffix", [".glb", ".ply", ".obj"])
def test_an_exported_scene_holds_the_rock_in_place(folder, tmp_path, suffix):
    target = tmp_path / f"block{suffix}"
    CliRunner().invoke(scene, ["export", str(folder), str(target)], catch_exceptions=False)
    assert trimesh.load(target, force="mesh").bounds[1][2] == pytest.approx(1.2)


def test_an_unknown_format_is_refused(folder, tmp_path):
    with pytest.raises(InputError, match="cannot export"):
        CliRunner().invoke(
            scene, ["export", str(folder), str(tmp_path / "block.doc")], catch_exceptions=False
        )
    assert not (tmp_path / "block.doc").exists()
