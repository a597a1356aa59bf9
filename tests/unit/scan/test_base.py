"""The hidden base and the pedestal below it: what follows from the seen rim alone, and how likely its kinds are."""

import numpy as np
import pytest
import trimesh
from patches import LEVEL, level, seen_of, upward

from toppling.models.arrays import effective_number
from toppling.models.hidden_base.evidence import (
    BEFORE,
    EFFECTIVE_SHARE,
    bowls,
    fractions_by_evidence,
    mixed_weights,
)
from toppling.models.hidden_base.gap import Base, GapDraw, Underside, hidden_base
from toppling.models.hidden_base.near_interface import NearInterface
from toppling.models.pedestal import Pedestal
from toppling.models.relief import contact_feet_m
from toppling.models.rock import Rock
from toppling.models.scan.close import close_rock
from toppling.models.scan.crevice import Grid
from toppling.models.scan.ground import pedestal_ground
from toppling.models.scan.surfels import Surfels
from toppling.models.shapes import box
from toppling.models.statics import quasi_static_toppling_m_s2

HEIGHT_M = 2.0
RADIUS_M = 0.45
SPACING_M = 0.006 * HEIGHT_M


def side(gap_deg=0.0, rim_m=0.0):
    """Points of a round rock's side that leans outward from its base, unseen over an angle, above a rim's height."""
    turn = np.deg2rad(np.arange(gap_deg, 360.0, np.rad2deg(SPACING_M / RADIUS_M)))
    up = rim_m + np.arange(0.0, 0.06 * HEIGHT_M, 0.5 * SPACING_M)
    turn, up = (grid.ravel() for grid in np.meshgrid(turn, up))
    out = RADIUS_M + 0.6 * up
    return np.column_stack([out * np.cos(turn), out * np.sin(turn), up])


def ground_around():
    points = level(0.9, SPACING_M)
    return points[np.hypot(*points[:, :2].T) > RADIUS_M]


@pytest.mark.parametrize("gap_deg", [0.0, 90.0])
def test_a_flat_base_is_flat_even_where_a_wall_hides_a_quarter_of_its_rim(gap_deg):
    base = hidden_base(NearInterface(side(gap_deg), ground_around(), HEIGHT_M))
    resting = (base.height_m == 0.0) & base.hidden
    # The rim is known to a cell of 0.01 m, 4 % of the area; the chord of a quarter would cut off 9 %.
    assert resting.sum() * base.grid.cell_m**2 == pytest.approx(np.pi * RADIUS_M**2, rel=0.04)


def test_a_base_whose_rim_was_seen_to_hang_all_around_rests_at_its_lowest():
    base = hidden_base(NearInterface(side(rim_m=0.01 * HEIGHT_M), level(0.9, SPACING_M), HEIGHT_M))
    assert base.height_m[base.hidden].min() == 0.0


def test_every_hole_of_an_underside_that_was_seen_may_touch():
    underside, holes = level(0.6, SPACING_M, 0.02), np.array([(0.3, 0.3), (-0.4, 0.0), (0.1, -0.4)])
    away = np.linalg.norm(underside[:, None, :2] - holes, axis=2).min(axis=1)
    base = hidden_base(NearInterface(underside[away > 0.1], level(0.9, SPACING_M), HEIGHT_M))
    assert base.grid.at(base.hidden, holes) == pytest.approx(1.0)


def test_scattered_strays_below_the_rock_change_nothing_away_from_them():
    strays = np.column_stack([np.full(11, 0.25), np.linspace(-0.3, 0.3, 11), np.zeros(11)])
    base = hidden_base(NearInterface(side(), np.vstack([ground_around(), strays]), HEIGHT_M))
    without = hidden_base(NearInterface(side(), ground_around(), HEIGHT_M))
    away = base.grid.nodes_m[..., 0] < 0.1
    np.testing.assert_array_equal((base.height_m == 0.0)[away], (without.height_m == 0.0)[away])


def test_a_cliff_near_the_base_removes_no_support():
    """The pedestal ends 5 mm beside a block's edge, less than a cell of its mesh: the block tips over its own edge."""
    rock = box(0.51, 0.4, 1.0).moved(np.eye(3), (0.0, 0.0, 1.0))
    points = level(2.0, 0.02)
    points[points[:, 0] > 0.515, 2] = -1.0
    found = pedestal_ground(upward(points), np.ones(len(points), bool), rock, LEVEL)
    azimuths = np.arange(0.0, 360.0, 15.0)
    on_surface = quasi_static_toppling_m_s2(rock, found.pedestal, 9.81, azimuths)
    on_plane = quasi_static_toppling_m_s2(rock, Pedestal(LEVEL.point_m, LEVEL.normal), 9.81, azimuths)
    assert len(found.edges_m) == 1
    np.testing.assert_allclose(on_surface, on_plane, rtol=1e-6)


def test_no_pedestal_lies_below_a_base_that_was_seen_to_hang_over_lower_land():
    rock, points = box(1.0, 1.0, 1.0).moved(np.eye(3), (0.0, 0.0, 1.0)), level(2.0, 0.02)
    away = np.abs(points[:, :2]).max(axis=1)
    land, hangs = points - [0.0, 0.0, 1.0] * (away > 0.2)[:, None], points[(away > 0.2) & (away < 1.0)]
    seen = seen_of((hangs, 0.0 * hangs - [0.0, 0.0, 1.0]), (land, 0.0 * land + [0.0, 0.0, 1.0]))
    found = pedestal_ground(seen.surfels, ~seen.patches, rock, LEVEL).pedestal
    assert np.abs(found.vertices_m[:, :2]).max() < 0.3


def test_strays_near_the_rock_raise_no_spikes_on_the_pedestal():
    rock = box(0.5, 0.4, 1.0).moved(np.eye(3), (0.0, 0.0, 1.0))
    strays = np.random.default_rng(2).uniform([-0.8, 0.5, 0.005], [0.8, 0.8, 0.2], (20, 3))
    points = np.vstack([level(2.0, 0.02), strays])
    found = pedestal_ground(upward(points), np.ones(len(points), bool), rock, LEVEL)
    assert np.abs(found.pedestal.vertices_m[:, 2]).max() < 1e-3


def test_a_bump_seen_below_a_wide_flat_face_does_not_reach_into_the_rock():
    """A block on a low foot: the pedestal, seen 3 mm too high below its face of two triangles, would lift the rock."""
    foot, block = trimesh.creation.box((0.6, 0.6, 0.1)), trimesh.creation.box((1.6, 1.6, 1.0))
    mesh = foot.apply_translation([0, 0, 0.05]).union(block.apply_translation([0, 0, 0.52]))
    rock = Rock.from_triangles(mesh.vertices, mesh.faces)
    points = level(2.0, 0.02)
    points[:, 2] = 0.023 * np.exp(-((points[:, 0] - 0.55) ** 2 + points[:, 1] ** 2) / 0.01)
    found = pedestal_ground(upward(points), np.ones(len(points), bool), rock, LEVEL)
    assert contact_feet_m(rock, found.pedestal)[:, 2].min() > -1e-9


def test_a_slab_that_overhangs_its_base_by_three_heights_retains_its_ends():
    """A table on one leg: its points, as if all of it but the leg's base had been seen."""
    top, leg = trimesh.creation.box((7.0, 1.6, 0.4)), trimesh.creation.box((0.8, 0.8, 0.6))
    table = trimesh.boolean.union([top.apply_translation([0, 0, 0.8]), leg.apply_translation([0, 0, 0.3])])
    points, face = trimesh.sample.sample_surface_even(table, 40_000, seed=1)
    observed = points[:, 2] > 0.005
    surfels = Surfels(points[observed], table.face_normals[face[observed]], np.zeros(observed.sum()), 0.03)
    grid = Grid.over(np.array([-0.45, -0.45]), np.array([0.45, 0.45]), 0.01)
    base = Base(grid, np.zeros(grid.shape), (np.abs(grid.nodes_m) < 0.4).all(axis=-1))
    rock = close_rock(surfels, np.ones(observed.sum(), bool), base, LEVEL).rock
    # The octree's cells are 0.07 m wide, and round the edges off by as much.
    np.testing.assert_allclose(np.ptp(rock.vertices_m, axis=0), [7.0, 1.6, 1.0], atol=0.07)
    assert rock.volume_m3 == pytest.approx(table.volume, rel=0.03)


@pytest.mark.thorough
@pytest.mark.parametrize("radius_per_height", [0.2, 0.4, 0.7, 3.0])
def test_a_rim_seen_as_a_single_row_of_points_encloses_the_base_however_wide_it_is(radius_per_height):
    height_m, spacing_m = 2.0, 0.018
    count = int(2.0 * np.pi * radius_per_height * height_m / spacing_m)
    turn = 2.0 * np.pi * np.arange(count) / count
    rim = radius_per_height * height_m * np.column_stack([np.cos(turn), np.sin(turn), np.zeros(count)])
    under = Underside.of(NearInterface(rim, 1.5 * rim, height_m))
    area_m2 = under.grid.cell_m**2 * under.hidden.sum()
    assert area_m2 == pytest.approx(np.pi * (radius_per_height * height_m) ** 2, rel=0.05)
    assert max(under.grid.shape) < 430  # or the base of a squat rock would take minutes


@pytest.mark.parametrize(("rough", "rounded"), [(0.0, -1e4), (-1e4, 0.0)])
def test_a_rim_does_not_tell_a_rough_base_from_a_rounded_one(rough, rounded):
    """Their priors miss some bases: one is 1e4 units of likelihood away, and keeps its share of the weight."""
    likelihood = {"flat": -1e4, "rough": rough, "rounded": rounded}
    gaps = [GapDraw(np.zeros(3), value, 0, kind, value) for kind, value in likelihood.items()]
    assert fractions_by_evidence(gaps) == pytest.approx({"flat": 0.0, "rough": 0.5, "rounded": 0.5})


def test_an_uninformative_rim_leaves_kinds_as_likely_as_before():
    gaps = [GapDraw(np.zeros(3), -7.0, 0, kind, -7.0) for kind in BEFORE]
    assert fractions_by_evidence(gaps) == pytest.approx(BEFORE)


def test_a_rim_weighs_shapes_of_a_kind_as_little_as_kinds_and_standing_in_full():
    """Errors of neighbouring places of a rim are not independent: its likelihood counts to the power 0.15."""
    seen = [GapDraw(np.zeros(3), value, 0, "rounded", value) for value in (0.0, -10.0)]
    first, second = mixed_weights(seen, {"rounded": 1.0})
    assert second / first == pytest.approx(np.exp(-1.5))
    cost = [GapDraw(np.zeros(3), value, 0, "rounded", 0.0) for value in (0.0, -2.0)]
    first, second = mixed_weights(cost, {"rounded": 1.0})
    assert second / first == pytest.approx(np.exp(-2.0))


def test_a_draw_of_overwhelming_weight_does_not_suppress_the_others_of_its_kind():
    gaps = [GapDraw(np.zeros(3), value, 0, "rough", 0.0) for value in (0.0, *np.linspace(-500.0, -100.0, 39))]
    assert effective_number(mixed_weights(gaps, {"rough": 1.0})) == pytest.approx(EFFECTIVE_SHARE * len(gaps))


@pytest.mark.parametrize("number", range(len(bowls(1.0))))
def test_a_rounded_base_lies_as_tilted_as_its_weight_turned_it(number):
    """Whichever its shape: the slope of its middle line is not known before within 3 degrees."""
    across = np.linspace(-0.5, 0.5, 11)
    places = np.stack(np.meshgrid(across, across), axis=-1).reshape(-1, 2)
    slope = places[:, 0] / (places[:, 0] @ places[:, 0])
    covariance = bowls(1.0)[number].covariance(places)
    assert np.sqrt(slope @ covariance @ slope) > np.tan(np.deg2rad(2.8))
