"""`toppling scene`: what it writes can be read by others."""

import base64
import dataclasses
import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from click.testing import CliRunner
from matplotlib.figure import Figure
from refusals import refused

sys.path.insert(0, str(Path(__file__).parents[2]))
from browser import needs_browser, overflow

from toppling.models.files.mesh_files import read_triangles
from toppling.models.hidden_base.intervals import base_sentences
from toppling.models.scene import Scene
from toppling.orchestrator.verbs.scene import scene
from toppling.results.drawing.page import scene_page
from toppling.results.drawing.painted_mesh import hidden, smooth_surface, view_frame
from toppling.results.drawing.scene_figures import (
    VIEWS_DEG,
    base_interval,
    beyond_frame,
    draw_statics,
    draw_view,
    numbers_of,
    polar_reach_m_s2,
    statics_words,
)


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
    assert "WebGLRenderer" in page
    assert "<h1>seen</h1>" not in page
    assert "<h1>block</h1>" in page
    assert 'src="http' not in page


def surveyed():
    """A block whose report says what a scan's does."""
    return dataclasses.replace(
        Scene.block(0.2, 0.3, 0.6),
        report={
            "uncertainty": {"volume_std_m3": 0.0012, "com_std_m": [0.0021, 0.0022, 0.0034]},
        },
    )  # fmt: skip


def test_show_says_how_far_the_numbers_spread(tmp_path):
    folder = surveyed().save(tmp_path / "block")
    CliRunner().invoke(scene, ["show", str(folder)], catch_exceptions=False)
    told = "\n".join(numbers_of(Scene.load(folder)))
    for number in ("0.0012 m³", "0.0021, 0.0022, 0.0034 m"):
        assert number in told


def test_the_centre_of_mass_has_one_uncertainty_and_its_level_is_said():
    assert "± 0.0021, 0.0022, 0.0034 m (one standard deviation)" in "\n".join(numbers_of(surveyed()))
    rows = [{"azimuth_deg": 0.0, "low_m_s2": 2.0, "median_m_s2": 3.0, "high_m_s2": 4.0}]
    said = {"level": 0.9, "draws": 48, "toppling": rows, "contacts": {"count": [3, 4, 6], "reach": []}}
    said["com_m"] = [[-0.03, 0.0, 0.03], [-0.02, 0.0, 0.02], [0.55, 0.6, 0.65]]
    drawn = dataclasses.replace(surveyed(), report={**surveyed().report, "unseen_base": said})
    told = "\n".join(numbers_of(drawn, base_sentences(drawn.report)))
    assert told.count("centre of mass within ± 0.03, 0.02, 0.05 m (x, y, z) in 90 % of these bases") == 1
    assert "0.0021, 0.0022" not in told


def test_of_a_scene_that_nobody_scanned_nothing_is_said_that_only_a_scan_measures(folder):
    told = "\n".join(numbers_of(Scene.load(folder)))
    assert not any(word in told for word in ("roughness", "seen", "invented", "split"))


def interfaced(given_by):
    """What a scan says whose interface was given or fitted thus."""
    report = {**surveyed().report, "interface": {"given_by": given_by, "roughness_m": 0.0123}}
    report["surface"] = {"seen_share": 0.8, "closed_share": 0.15, "invented_share": 0.05}
    return "\n".join(numbers_of(dataclasses.replace(surveyed(), report=report)))


@pytest.mark.parametrize("given_by", ["fit", "plane", "points", "outline"])
def test_roughness_is_told_of_an_interface_unless_a_plane_was_given(given_by):
    told = interfaced(given_by)
    assert "surface seen 80.0 %, closed at the interface 15.0 %, invented 5.0 %" in told
    assert ("roughness 0.0123 m" in told) == (given_by != "plane")


@pytest.mark.parametrize("steep", [30.0, np.inf])
def test_azimuths_whose_curve_leaves_the_frame_are_told_to_need_more_than_it_shows(steep):
    usual = np.full(72, 3.0)
    assert beyond_frame(usual) == []
    usual[:5] = steep
    assert beyond_frame(usual) == [f"beyond the frame: more than {polar_reach_m_s2(usual):.3g} m/s²"]
    assert polar_reach_m_s2(np.zeros(72)) > 0.0  # of a rock that falls by itself
    assert polar_reach_m_s2(np.repeat([0.0, 3.0], [60, 12])) >= 3.0


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


def test_gltf_turns_the_scene_and_does_not_mirror_it(folder, tmp_path):
    target = tmp_path / "block.glb"
    CliRunner().invoke(scene, ["export", str(folder), str(target)], catch_exceptions=False)
    parts = trimesh.load(target, force="scene")
    seen = trimesh.load(folder / "rock.ply", process=False).vertices
    rock = trimesh.transform_points(parts.geometry["rock"].vertices, parts.graph["rock"][0])
    # East is x, up is y, so south is z for the frame to be right-handed; glTF holds single precision.
    for vertex in rock:
        assert np.abs(seen - vertex[[0, 2, 1]] * [1.0, -1.0, 1.0]).max(axis=1).min() < 1e-6


def test_the_page_shows_the_pedestal_also_where_it_is_an_endless_plane(folder):
    told = json.loads(
        re.search(r'id="data">(.*?)</script>', scene_page(Scene.load(folder), "block")).group(1)
    )
    faces = {name: len(base64.b64decode(told[name]["index"])) // 12 for name in ("rock", "pedestal")}
    assert faces == {"rock": 12, "pedestal": 2}


def test_a_block_keeps_its_edges_and_a_boulder_is_smooth():
    block, ball = Scene.block(0.2, 0.3, 0.6).rock, trimesh.creation.icosphere(3)
    sharp = smooth_surface(block.vertices_m, block.faces, "k")
    assert np.abs(sharp.normals).max(axis=1) == pytest.approx(1.0)  # each along an axis, none between faces
    smooth = smooth_surface(ball.vertices, ball.faces, "k")
    assert len(smooth.vertices_m) == len(ball.vertices)
    assert np.einsum("ij,ij->i", smooth.normals, ball.vertices) == pytest.approx(1.0, abs=1e-3)


def test_a_point_is_hidden_by_what_lies_nearer_to_the_eye_and_not_by_what_it_lies_on():
    triangle = np.array([[[-1.0, -1.0, 0.0], [3.0, -1.0, 0.0], [-1.0, 3.0, 0.0]]])
    points = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0], [0.0, 0.0, -0.01], [4.0, 4.0, -1.0]])
    assert hidden(points, triangle, tolerance_m=0.05).tolist() == [True, False, False, False]


@needs_browser
@pytest.mark.parametrize("width_px", [1400, 400])
def test_the_page_draws_in_a_browser_and_nothing_sticks_out(folder, tmp_path, width_px):
    assert overflow(scene_page(Scene.load(folder), "block", ["a note"]), width_px, tmp_path) == []


@pytest.mark.parametrize(("slope_deg", "planes"), [(0.0, [2, 2, 2]), (30.0, [2, 2, 0])])
def test_the_picture_shows_an_endless_plane_behind_the_rock_in_every_view_from_above_it(slope_deg, planes):
    slope, downhill = np.radians([slope_deg, 60.0])
    normal = np.array([*(np.sin(slope) * np.array([np.cos(downhill), np.sin(downhill)])), np.cos(slope)])
    block = Scene.block(0.2, 0.3, 0.6)
    drawn = dataclasses.replace(block, pedestal=dataclasses.replace(block.pedestal, normal=normal))
    seen = []
    for view in VIEWS_DEG:
        axes = Figure().add_subplot()
        draw_view(axes, drawn, *view)
        red, _, blue = axes.collections[0].get_facecolor()[:, :3].T
        seen.append(int((blue > red).sum()))
        toward = (
            trimesh.Trimesh(drawn.rock.vertices_m, drawn.rock.faces).face_normals @ view_frame(*view)[:, 2]
        )
        assert len(red) == (toward > 1e-9).sum() + seen[-1]  # those behind are hidden by these
        assert (blue > red)[: seen[-1]].all()  # painted first
    assert seen == planes


@pytest.mark.parametrize("suffix", [".glb", ".gltf", ".ply", ".obj"])
def test_two_exports_into_one_folder_leave_each_other_alone(folder, tmp_path, suffix):
    other = Scene.block(0.4, 0.4, 1.0).save(tmp_path / "other")
    out = tmp_path / "out"
    out.mkdir()
    for name in (folder, other):
        CliRunner().invoke(
            scene, ["export", str(name), str(out / f"{name.name}{suffix}")], catch_exceptions=False
        )
    assert {path.name for path in out.iterdir()} == {f"block{suffix}", f"other{suffix}"}
    heights = [
        np.ptp(trimesh.load(out / f"{name}{suffix}", force="mesh").bounds, axis=0)
        for name in ("block", "other")
    ]
    assert not np.allclose(*heights)


def test_an_unknown_format_is_refused(folder, tmp_path):
    with refused("scene.format_unknown"):
        CliRunner().invoke(
            scene, ["export", str(folder), str(tmp_path / "block.doc")], catch_exceptions=False
        )
    assert not (tmp_path / "block.doc").exists()


def test_the_interval_of_the_bases_that_may_be_goes_round_the_statics():
    table = [
        {"azimuth_deg": float(a), "low_m_s2": 2.0, "median_m_s2": 2.5, "high_m_s2": 3.0}
        for a in range(0, 360, 10)
    ]
    drawn = dataclasses.replace(surveyed(), report={"unseen_base": {"toppling": table, "level": 0.9}})
    azimuth, low, high, level = base_interval(drawn)
    assert (azimuth[-1] - azimuth[0], level) == (360.0, 0.9)
    assert set(low) == {2.0}
    assert set(high) == {3.0}
    axes = Figure().add_subplot(projection="polar")
    draw_statics(axes, drawn)
    assert len(axes.collections) == 1  # the bases
    assert "90 % of possible bases" in statics_words(drawn)
    assert len(base_interval(surveyed())[0]) == 0
