"""What is seen of the gap at a rim: of a side that goes on below it, of an underside, of a rim behind rubble."""

import numpy as np
import pytest
from patches import LEVEL, level

from toppling.models.hidden_base.gap import GapDraw, Underside
from toppling.models.hidden_base.inspection import Inspection
from toppling.models.hidden_base.near_interface import NearInterface, near_the_interface
from toppling.models.hidden_base.observed import UNSEEN_STD_SHARE, clearances, hidden_part
from toppling.models.hidden_base.statics import _low_feet
from toppling.models.pedestal import Pedestal
from toppling.models.scan.crevice import seen_apart
from toppling.models.scan.surfels import Surfels

HEIGHT_M, RADIUS_M, PITCH_M, RIM_M = 2.0, 0.5, 0.01, 0.04


def rings(radii_m, heights_m):
    random, points = np.random.default_rng(1), []
    for radius, height in zip(radii_m, heights_m, strict=True):
        turn = np.arange(0.0, 2.0 * np.pi, PITCH_M / radius)
        away = radius + random.uniform(-0.2, 0.2, len(turn)) * PITCH_M
        points.append(np.column_stack([away * np.cos(turn), away * np.sin(turn), np.full(len(turn), height)]))
    return np.vstack(points)


def seen_at_the_rim(low, ground):
    near = NearInterface(low, ground, HEIGHT_M)
    part = hidden_part(Underside.of(near), near, Inspection(), LEVEL)
    return part.observed


def ground_from(radius_m):
    radii = np.arange(radius_m, 1.5, PITCH_M)
    return rings(radii, np.zeros(len(radii)))


@pytest.fixture(scope="module")
def wall():
    heights = np.arange(RIM_M, 0.3, PITCH_M)
    return rings(np.full(len(heights), RADIUS_M), heights)


def test_a_steep_side_is_seen_down_to_its_lowest_point_and_may_end_a_part_of_the_spacing_below(wall):
    observed = seen_at_the_rim(wall, ground_from(RADIUS_M - 0.06))
    np.testing.assert_allclose(observed.gap_m, RIM_M, atol=1e-9)
    assert np.all((observed.std_m > 0.1 * PITCH_M) & (observed.std_m < 0.5 * PITCH_M))


def test_an_error_common_to_the_rim_does_not_follow_the_observations_at_its_places():
    """It would lift a rim whose low places are those with large errors, as where points lie sparse."""
    sparse = np.random.default_rng(3).random(3000) < np.linspace(0.15, 1.0, 3000)
    turn = np.linspace(0.0, 2.0 * np.pi, 3000)
    height = RIM_M + np.random.default_rng(4).uniform(0.0, 0.2, 3000)
    side = np.column_stack([RADIUS_M * np.cos(turn), RADIUS_M * np.sin(turn), height])[sparse]
    observed = seen_at_the_rim(side, ground_from(RADIUS_M - 0.3))
    assert np.ptp(observed.std_m) > 0.2 * np.median(observed.std_m)
    assert np.ptp(observed.shared_m) == 0.0


def test_a_level_underside_is_as_high_as_its_points(wall):
    radii = np.arange(RADIUS_M - 0.06, RADIUS_M, PITCH_M)
    underside = rings(radii, np.full(len(radii), RIM_M))
    observed = seen_at_the_rim(np.vstack([wall, underside]), ground_from(RADIUS_M - 0.12))
    inner = np.hypot(*observed.places_m[observed.known].T) < RADIUS_M - 0.05
    assert inner.sum() > 20
    np.testing.assert_allclose(observed.gap_m[inner], RIM_M, atol=0.05 * PITCH_M)


def test_below_a_rim_whose_pedestal_was_not_seen_the_gap_is_anything_up_to_its_height(wall):
    observed = seen_at_the_rim(wall, ground_from(RADIUS_M + 0.05))  # rubble lay there
    np.testing.assert_allclose(observed.gap_m, 0.5 * RIM_M)
    np.testing.assert_allclose(observed.std_m, UNSEEN_STD_SHARE * RIM_M)
    assert len(set(observed.group)) == 1


@pytest.mark.parametrize(("gaps_in", "ends"), [(0.8, False), (1.5, True)])
def test_a_side_that_hangs_ends_where_the_pedestal_was_seen_more_than_a_gap_farther_in(wall, gaps_in, ends):
    """Else it may go on down at 45 degrees behind what was seen, as a rock's that stands in a crevice."""
    observed = seen_at_the_rim(wall, ground_from(RADIUS_M - gaps_in * RIM_M - 0.5 * PITCH_M))
    right = np.isclose(observed.gap_m, RIM_M if ends else 0.5 * RIM_M) & (observed.group == int(ends))
    assert right.mean() > 0.95


def test_a_clearance_is_taken_over_the_pedestals_surface_and_there_is_none_outside_it():
    """A round rock that rolls where its pedestal falls away topples sooner than over the plane."""
    corners = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.2], [1.0, 1.0, 0.2], [-1.0, 1.0, 0.0]])
    falls = Pedestal(np.zeros(3), LEVEL.normal, corners * [1.0, 1.0, -1.0], np.array([[0, 1, 2], [0, 2, 3]]))
    places = np.array([[0.0, 0.3, 0.05], [0.5, -0.2, 0.07], [3.0, 0.0, 0.1]])
    np.testing.assert_allclose(clearances(places, LEVEL, falls), [[0.0, 0.3, 0.15], [0.5, -0.2, 0.22]])
    np.testing.assert_array_equal(clearances(places, LEVEL, None), places)


def test_a_rock_touches_nothing_where_land_was_seen_far_below_a_gap_in_its_underside():
    """A slab on a neck, of whose underside more was not seen than the neck hides."""
    places = level(1.0, 0.02)
    away, gap = np.abs(places[:, :2]).max(axis=1), (places[:, 0] > 0.4) & (places[:, 0] < 0.8)
    neck, slab = (away > 0.15) & (away < 0.2), places[(away > 0.2) & ~gap] + [0.0, 0.0, 0.01]
    land = places[away > 0.2] - [0.0, 0.0, 0.5]
    patches = np.vstack([slab, places[neck], land])
    normals = np.tile([0.0, 0.0, 1.0], (len(patches), 1))
    normals[: len(slab)] *= -1.0
    surfels = Surfels(patches, normals, np.zeros(len(patches)), 0.02)
    apart = seen_apart(surfels, np.arange(len(patches)) < len(slab), LEVEL, HEIGHT_M)
    under, without = (
        Underside.of(NearInterface(slab, places[neck], HEIGHT_M, apart=found)) for found in (apart, None)
    )
    touching, unknown = (np.abs(u.grid.nodes_m[u.may_touch]).max(axis=-1) for u in (under, without))
    assert touching.max() < 0.25
    assert unknown.max() > 0.35
    part = hidden_part(under, NearInterface(slab, places[neck], HEIGHT_M, apart=apart), Inspection(), LEVEL)
    observed = part.observed
    assert (observed.floor_m[np.abs(observed.places_m).max(axis=1) > 0.25] > 0.0).all()
    feet = _low_feet(part, GapDraw(0.0 * observed.floor_m, 0.0, 0), part.side_m, HEIGHT_M)
    assert 0.1 < np.abs(feet[:, :2]).max() < 0.25  # of a rock that tips none is over the land either


def test_a_side_seen_high_shapes_the_base_where_it_hangs_over_what_was_seen_of_the_pedestal(wall):
    """Elsewhere it may go on down, behind plants or a wall."""
    side, ground = wall + np.array([0.0, 0.0, 0.15]), ground_from(RADIUS_M - 0.1)
    low, _ = near_the_interface(side, ground[ground[:, 0] > 0.0], HEIGHT_M)
    assert low[(side[:, 0] > 0.05) & (side[:, 2] < 0.4)].all()
    assert not low[side[:, 0] < -0.2].any()
