"""A side or a rim that nobody saw goes on as what was seen does, down to the foot, and draws end at many places."""

import numpy as np
import pytest
from patches import level

from toppling.models.hidden_base.gap import BaseObservation, Relief, Underside, draw_gaps
from toppling.models.hidden_base.near_interface import (
    DRAWN,
    SIDE_TANGENT,
    NearInterface,
    SidesSeen,
    UnseenSide,
)
from toppling.models.scan.close import extended_side

HEIGHT_M, PITCH_M = 2.0, 0.012
CENTRE_M = np.array([0.3, -0.2])


def outline(turn_deg, depth_m=0.45, width_m=0.45):
    turn = np.deg2rad(turn_deg)
    return CENTRE_M + np.column_stack([depth_m * np.cos(turn), width_m * np.sin(turn)])


def side(unseen_deg, **axes):
    """Points of a side that leans outward from its rim, unseen over a range about azimuth 0."""
    turn = np.arange(0.5 * unseen_deg, 360.0 - 0.5 * unseen_deg, 1.5)
    up = np.arange(0.0, 0.06 * HEIGHT_M, 0.5 * PITCH_M)
    rim = outline(turn, **axes) - CENTRE_M
    out = 1.0 + 0.6 * up[:, None, None]
    points = np.concatenate(
        [CENTRE_M + out * rim, np.broadcast_to(up[:, None, None], (len(up), len(turn), 1))], 2
    )
    return points.reshape(-1, 3)


def ground(unseen_deg):
    points = level(1.5, PITCH_M)
    offset = points[:, :2] - CENTRE_M
    shadow = np.abs(np.rad2deg(np.arctan2(offset[:, 1], offset[:, 0]))) < 0.5 * unseen_deg
    lit = (np.hypot(*offset.T) > 0.46) & ~shadow
    return points[lit]


def in_range_deg(unseen_deg):
    return np.linspace(-0.4, 0.4, 9) * unseen_deg


def seen_around(gaps_deg):
    low = side(0.0)
    return low[np.rad2deg(np.arctan2(*(low[:, :2] - CENTRE_M).T[::-1])) % 120.0 >= gaps_deg]


RING = np.array([(np.cos(turn), np.sin(turn), 0.0) for turn in np.linspace(0.0, 6.2, 60)])
SINGLE_DIRECTION = np.tile([[1.0, 0.02, 0.0], [1.001, 0.02, 0.0], [1.0, 0.021, 0.0]], (50, 1))


@pytest.mark.parametrize(
    "low",
    [
        seen_around(0.0),
        seen_around(65.0),
        RING,
        np.vstack([SINGLE_DIRECTION, [[-1.0, 1.0, 0.0], [-1.0, -1.0, 0.0]]]),
    ],
    ids=["around", "with gaps", "in few places", "in one direction"],
)
def test_no_rim_is_extended_where_it_was_seen_around_or_in_a_single_direction(low):
    assert UnseenSide.of(low) is None


@pytest.mark.parametrize("unseen_deg", [90.0, 150.0, 180.0])
def test_the_rim_of_a_round_base_goes_on_as_a_circle(unseen_deg):
    found = UnseenSide.of(side(unseen_deg))
    assert found.share_out(outline(in_range_deg(unseen_deg))) == pytest.approx(np.ones(9), abs=0.06)


@pytest.mark.parametrize("axes", [{"depth_m": 0.5}, {"depth_m": 0.4}, {"depth_m": 0.25}, {"width_m": 0.5}])
@pytest.mark.parametrize("unseen_deg", [120.0, 150.0])
def test_drawn_rims_lie_on_both_sides_of_the_true_rim(axes, unseen_deg):
    found = UnseenSide.of(side(unseen_deg, **axes))
    true = outline(in_range_deg(unseen_deg), **axes)
    share = np.array([found.share_out(true, number) for number in range(DRAWN)])
    middle = share[:, 2:7]
    assert (middle.min(axis=0) < 1.0).all()
    assert (middle.max(axis=0) > 1.0).all()


@pytest.mark.parametrize("unseen_deg", [90.0, 150.0])
def test_the_hidden_base_reaches_to_the_rim_that_nobody_saw(unseen_deg):
    under = Underside.of(NearInterface(side(unseen_deg), ground(unseen_deg), HEIGHT_M))
    area_m2 = under.hidden.sum() * under.grid.cell_m**2
    assert area_m2 == pytest.approx(np.pi * 0.45**2, rel=0.08)  # a cell of the rim is 4 %
    corner_m2 = 0.45**2 * (np.tan(np.deg2rad(0.5 * min(unseen_deg, 150.0))) - np.deg2rad(0.5 * unseen_deg))
    more_m2 = under.widest.sum() * under.grid.cell_m**2 - area_m2
    assert 0.25 * corner_m2 < more_m2 < corner_m2  # between tangents at the ends of what was seen


def test_draws_touch_up_to_their_own_rim_and_rise_beyond_it():
    along = np.linspace(-1.0, 1.0, 13)
    places = np.stack(np.meshgrid(along, along), axis=-1).reshape(-1, 2)
    ends_m = np.array([0.1, 0.7])
    beyond = np.maximum(places[None, :, 0] - ends_m[:, None], 0.0)
    nothing = np.zeros(0)
    observed = BaseObservation(
        places, np.zeros(0, int), nothing, nothing, nothing, np.zeros(0, int), np.zeros(len(places)),
        np.zeros(0, int), beyond,
    )  # fmt: skip
    weight = np.tile([-0.4, 0.0], (8, 1))
    drawn = draw_gaps(observed, weight, [Relief(0.1, 0.02, 0.7, 0.002, 0.1)], np.random.default_rng(2))
    assert len(drawn) == 8
    for gap in drawn:
        own = beyond[gap.number % 2]
        assert (gap.gap_m[own > 0.0] >= SIDE_TANGENT * own[own > 0.0]).all()
    reach_m = [places[gap.gap_m <= 0.0][:, 0].max() for gap in drawn]
    assert max(reach_m[0::2]) <= 0.1
    assert max(reach_m[1::2]) > 0.1


APART_M = 0.04


def barrel(unseen_deg):
    """Patches and normals of a side whose radius is 1 at the foot and at the top, 1.3 in between."""
    turn = np.deg2rad(np.arange(0.5 * unseen_deg, 360.0 - 0.5 * unseen_deg, 2.0))
    up = np.arange(0.0, 3.0, APART_M)
    up, turn = (grid.ravel() for grid in np.meshgrid(up, turn, indexing="ij"))
    radius, slope = radius_at(up), -np.cos(np.pi * up / 3.0) * 0.1 * np.pi
    points = np.column_stack([radius * np.cos(turn), radius * np.sin(turn), up])
    normals = np.column_stack([np.cos(turn), np.sin(turn), slope])
    return points, normals / np.linalg.norm(normals, axis=1)[:, None]


def radius_at(up):
    return 1.0 + 0.3 * np.sin(np.pi * up / 3.0)


@pytest.mark.parametrize("unseen_deg", [90.0, 150.0])
def test_a_round_side_goes_on_round_and_faces_outward(unseen_deg):
    points, normals = barrel(unseen_deg)
    places, outward = extended_side(UnseenSide.of(points[points[:, 2] < 0.2]), points, normals, APART_M)
    turn = np.rad2deg(np.arctan2(places[:, 1], places[:, 0]))
    middle = np.abs(turn) < 0.4 * unseen_deg
    away = np.linalg.norm(places[:, :2], axis=1) / radius_at(places[:, 2])
    assert away[middle] == pytest.approx(np.ones(middle.sum()), abs=0.08)
    assert (np.abs(turn) < 0.5 * unseen_deg + 15.0).all()  # a sector of directions and a half
    assert ((outward[:, :2] * places[:, :2]).sum(axis=1) > 0.0).all()
    assert np.ptp(places[:, 2]) > 2.7


STEP_M = 0.02


def rounded(turn, up):
    """Radius of a barrel of revolution, .5 at its middle."""
    return 0.5 - 0.12 * (up - 0.5 * HEIGHT_M) ** 2 + 0.0 * turn


def upright(turn, up):
    """Radius of a square block, .4 from its axis to its sides."""
    return 0.4 / np.maximum(np.abs(np.cos(turn)), np.abs(np.sin(turn)))


def wider_below(turn, up):
    """A block whose side toward azimuth 0 comes forward below: .1 in a metre."""
    along, across = np.maximum(np.abs([np.cos(turn), np.sin(turn)]), 1e-9)
    return np.minimum(0.4 / across, np.where(np.cos(turn) > 0.0, 0.5 - 0.1 * up, 0.4) / along)


SHAPES = [rounded, upright, wider_below]


def patches(radius, hidden_to_m, half_deg=60.0):
    """Patches and normals of its side, hidden up to a height in a range of directions about azimuth 0."""
    turn, up = np.meshgrid(np.arange(-np.pi, np.pi, 0.04), np.arange(0.01, HEIGHT_M, STEP_M))
    seen = (np.abs(np.rad2deg(turn)) > half_deg) | (up > hidden_to_m)
    turn, up = turn[seen], up[seen]
    out = np.column_stack([np.cos(turn), np.sin(turn)])
    points = np.column_stack([radius(turn, up)[:, None] * out, up])
    return points, np.column_stack([out, np.zeros(len(out))])


def foot(radius, hidden_to_m):
    points, normals = patches(radius, hidden_to_m)
    low = points[points[:, 2] < 0.06 * HEIGHT_M]
    led_down = SidesSeen.of(points, normals, np.zeros(2)).led_down(0.0)
    return UnseenSide.of(low, led_down=led_down), points, normals


def fraction_of_true(found, radius, number=None):
    """Distances of the true outline's places, in the range that nobody saw, over those of the outline found."""
    turn = np.deg2rad(np.arange(-30.0, 31.0, 5.0))
    return found.share_out(radius(turn, 0.0)[:, None] * np.column_stack([np.cos(turn), np.sin(turn)]), number)


@pytest.mark.parametrize(
    ("radius", "hidden_to_m"),
    [*((shape, to_m) for shape in SHAPES for to_m in (0.3, 1.0)), (rounded, 1.4), (upright, 1.4)],
)
def test_the_lower_end_lies_below_the_side_seen_above_it(radius, hidden_to_m):
    share = fraction_of_true(foot(radius, hidden_to_m)[0], radius)
    assert share == pytest.approx(np.ones(len(share)), abs=0.06)


@pytest.mark.parametrize("radius", SHAPES)
def test_drawn_lower_ends_lie_on_both_sides_of_the_true_end(radius):
    found = foot(radius, 1.0)[0]
    middle = np.array([fraction_of_true(found, radius, number)[4:9].mean() for number in range(DRAWN)])
    assert middle.min() < 0.95
    assert middle.max() > 1.05


@pytest.mark.parametrize("radius", SHAPES)
def test_the_side_extends_to_its_lower_end_below_what_was_seen(radius):
    found, points, normals = foot(radius, 1.0)
    places, _ = extended_side(found, points, normals, 2.0 * STEP_M)
    turn = np.arctan2(places[:, 1], places[:, 0])
    middle = (np.abs(turn) < 0.5) & (places[:, 2] < 0.9)
    away = np.linalg.norm(places[:, :2], axis=1) / radius(turn, places[:, 2])
    assert away[middle] == pytest.approx(np.ones(middle.sum()), abs=0.06)
    assert places[middle, 2].min() < 0.1


LEVEL_PATCHES = np.random.default_rng(1).uniform(size=(50, 3)), np.tile([0.0, 0.0, 1.0], (50, 1))


@pytest.mark.parametrize(
    "seen",
    [patches(rounded, 0.8 * HEIGHT_M), patches(upright, 0.0), LEVEL_PATCHES],
    ids=["a crown beyond a hidden side", "down to the foot", "no steep side"],
)
def test_observations_far_from_a_lower_end_extend_no_side(seen):
    assert len(SidesSeen.of(*seen, np.zeros(2)).led_down(0.0)) == 0
