"""Draws of the base of a mesh on a plane: on each the rock stands, without a turn that nobody saw."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from refusals import refused
from scipy.spatial import ConvexHull

from toppling.models.files.digest import seal
from toppling.models.files.schemas import BASES as FILE
from toppling.models.frames import rotation_between
from toppling.models.hidden_base.rough_base import Standing, with_rough_base
from toppling.models.hidden_base.unseen_base import BaseDraw, UnseenBase, least_feet
from toppling.models.pedestal import Pedestal
from toppling.models.scene import Scene
from toppling.models.shapes import box
from toppling.models.statics import (
    at_rest,
    equilibrium_possible,
    quasi_static_toppling_m_s2,
    support_polygon_m,
)


def cobble():
    """A block of many vertices, so that noise can shape its base: 0.3 x 0.2 x 0.8 m."""
    mesh = trimesh.creation.box((0.3, 0.2, 0.8))
    for _ in range(4):
        mesh = mesh.subdivide()
    return Scene.from_mesh((mesh.vertices, mesh.faces), 0.7, slope_deg=3.0)


@pytest.fixture(scope="module")
def drawn():
    return with_rough_base(
        cobble(), std_m=(0.002, 0.002), wavelength_m=0.12, band_m=0.08, draws=6, com_std_m=0.003
    )


def test_on_every_drawn_base_the_rock_is_at_rest_in_its_pose(drawn):
    for number in range(len(drawn.unseen)):
        scene = drawn.on_base(number)
        assert len(support_polygon_m(scene.rock, scene.pedestal)) >= 3
        still = equilibrium_possible(scene.rock, scene.pedestal, scene.gravity_m_s2, 0.7, np.zeros(3))
        assert still[0], number


def test_a_drawn_base_moves_the_rock_as_a_rigid_body(drawn):
    for number, draw in enumerate(drawn.unseen.draws):
        scene = drawn.on_base(number)
        offset_m = drawn.rock.com_m + draw.com_offset_m - drawn.rock.vertices_m
        moved_m = scene.rock.com_m - scene.rock.vertices_m
        np.testing.assert_allclose(
            np.linalg.norm(moved_m, axis=1), np.linalg.norm(offset_m, axis=1), atol=1e-9
        )
        assert scene.rock.com_m @ scene.pedestal.normal > 0.35


def test_bases_differ_where_nobody_saw_and_the_side_above_stays(drawn):
    limits = [
        quasi_static_toppling_m_s2(scene.rock, scene.pedestal, 9.81, (0.0,))[0][1]
        for scene in map(drawn.on_base, range(len(drawn.unseen)))
    ]
    assert np.ptp(limits) > 0.02
    top = [drawn.on_base(number).rock.feet_m[:, 2].max() for number in range(len(drawn.unseen))]
    assert np.ptp(top) < 0.02


def test_bases_survive_the_disk_and_belong_to_the_scenes_id(drawn, tmp_path):
    drawn.save(tmp_path / "scene")
    loaded = Scene.load(tmp_path / "scene")
    assert loaded.id == drawn.id != replace(drawn, unseen=None).id
    np.testing.assert_array_equal(loaded.on_base(2).rock.feet_m, drawn.on_base(2).rock.feet_m)


def test_the_same_seed_gives_the_same_bases_and_another_gives_others():
    ask = {"std_m": (0.002, 0.002), "wavelength_m": 0.12, "band_m": 0.08, "draws": 2}
    first, again, other = (with_rough_base(cobble(), **ask, seed=seed) for seed in (1, 1, 2))
    assert first.id == again.id != other.id


def test_a_rock_known_to_bear_more_has_only_bases_that_bear_it():
    ask = {"std_m": (0.004, 0.004), "wavelength_m": 0.12, "band_m": 0.08, "draws": 4}
    scene = with_rough_base(cobble(), **ask, standing=Standing(least_toppling_m_s2=1.6))
    for number in range(4):
        realised = scene.on_base(number)
        limits = quasi_static_toppling_m_s2(
            realised.rock, realised.pedestal, 9.81, np.arange(0.0, 360.0, 15.0)
        )
        assert min(limit for _, limit in limits) > 1.6


def test_bases_on_which_the_rock_would_never_stand_are_refused_with_their_count():
    standing = Standing(least_toppling_m_s2=9.0)
    with refused("base.hardly_stands", "0.002"):
        with_rough_base(
            cobble(), std_m=(0.002, 0.002), wavelength_m=0.12, band_m=0.08, draws=1, standing=standing
        )


def test_a_scene_on_a_nominal_base_retains_mesh_mass_and_draws(drawn, tmp_path):
    upright = replace(
        drawn.unseen, draws=tuple(BaseDraw(draw.feet_m, draw.com_offset_m) for draw in drawn.unseen.draws)
    )
    plain = replace(drawn, unseen=upright)
    scene = replace(drawn, unseen=replace(upright, nominal=2))
    np.testing.assert_array_equal(scene.rock.feet_m, plain.on_base(2).rock.feet_m)
    np.testing.assert_array_equal(scene.rock.com_m, plain.rock.com_m)
    scene.save(tmp_path / "scene")
    loaded = Scene.load(tmp_path / "scene")
    assert loaded.id == scene.id != plain.id
    np.testing.assert_array_equal(loaded.rock.feet_m, scene.rock.feet_m)
    for number in range(len(upright)):
        of_plain, of_nominal = plain.on_base(number), loaded.on_base(number)
        np.testing.assert_array_equal(of_nominal.rock.feet_m, of_plain.rock.feet_m)
        np.testing.assert_allclose(of_nominal.rock.com_m, of_plain.rock.com_m, atol=1e-12)
    assert loaded.on_base(2).id != loaded.id


@pytest.mark.parametrize("nominal", ["6", "-1", "true", '"2"', "1.0"])
def test_a_nominal_base_that_is_none_of_the_draws_is_refused(drawn, tmp_path, nominal):
    path = tmp_path / FILE
    replace(drawn.unseen, nominal=3).write(path)
    path.write_text(path.read_text().replace('"nominal": 3', f'"nominal": {nominal}'))
    seal(path)
    with refused("draws.value_unusable", "nominal"):
        UnseenBase.read(path)


def test_a_leaning_block_is_let_down_onto_the_face_below_its_centre_of_mass():
    leaning = rotation_between((0.0, 0.0, 1.0), (np.sin(0.05), 0.0, np.cos(0.05)))
    block = box(0.2, 0.2, 0.5).moved(leaning, (0.3, -0.2, 1.7))
    plane = Pedestal(np.array([0.0, 0.0, 0.4]), np.array([0.0, 0.0, 1.0]))
    turn, shift = at_rest(block, plane, 9.81)
    rested = block.moved(turn, shift)
    np.testing.assert_allclose(turn @ leaning, np.eye(3), atol=1e-6)
    assert rested.com_m[2] == pytest.approx(0.9, abs=1e-6)
    assert rested.vertices_m[:, 2].min() == pytest.approx(0.4, abs=1e-9)


@pytest.mark.thorough
@pytest.mark.parametrize("tolerance_m", [1e-2, 1e-3, 1e-4])
def test_omitted_contacts_lie_within_the_tolerance_of_the_hull_of_the_others(tolerance_m):
    place = np.random.default_rng(1).uniform(-0.5, 0.5, (3000, 2))
    cap = np.column_stack([place, 1.0 - np.sqrt(1.0 - (place**2).sum(axis=1))])
    com = np.array([0.0, 0.0, 1.0])
    remaining = least_feet(cap, np.zeros((0, 3)), com, tolerance_m)
    assert len(remaining) < len(least_feet(cap, np.zeros((0, 3)), com, 0.0))
    facets = ConvexHull(np.vstack([remaining, com])).equations
    below = facets[facets[:, 2] < -0.2]
    assert (cap @ below[:, :3].T + below[:, 3]).max() < 1.0001 * tolerance_m
