"""A side that was seen higher up only is led down to the foot as the rock's other sides go down, with its own slope."""

import numpy as np
import pytest

from toppling.models.hidden_base.near_interface import DRAWN, SidesSeen, UnseenSide
from toppling.models.scan.close import side_gone_on

HEIGHT_M, STEP_M = 2.0, 0.02


def rounded(turn, up):
    """Radius of a barrel of revolution, .5 at its middle."""
    return 0.5 - 0.12 * (up - 0.5 * HEIGHT_M) ** 2 + 0.0 * turn


def upright(turn, up):
    """Radius of a square block, .4 from its axis to its sides."""
    return 0.4 / np.maximum(np.abs(np.cos(turn)), np.abs(np.sin(turn)))


def wider_below(turn, up):
    """The same block, whose side toward azimuth 0 comes forward below: .1 in a metre."""
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


def share_of_true(found, radius, number=None):
    """Distances of the true outline's places, in the range that nobody saw, over those of the outline found."""
    turn = np.deg2rad(np.arange(-30.0, 31.0, 5.0))
    return found.share_out(radius(turn, 0.0)[:, None] * np.column_stack([np.cos(turn), np.sin(turn)]), number)


@pytest.mark.parametrize(
    ("radius", "hidden_to_m"),
    [*((shape, to_m) for shape in SHAPES for to_m in (0.3, 1.0)), (rounded, 1.4), (upright, 1.4)],
)
def test_the_foot_lies_below_the_side_that_was_seen_above_it(radius, hidden_to_m):
    share = share_of_true(foot(radius, hidden_to_m)[0], radius)
    assert share == pytest.approx(np.ones(len(share)), abs=0.06)


@pytest.mark.parametrize("radius", SHAPES)
def test_drawn_feet_lie_on_both_sides_of_the_true_one(radius):
    found = foot(radius, 1.0)[0]
    middle = np.array([share_of_true(found, radius, number)[4:9].mean() for number in range(DRAWN)])
    assert middle.min() < 0.95
    assert middle.max() > 1.05


@pytest.mark.parametrize("radius", SHAPES)
def test_the_side_goes_down_to_its_foot_below_what_was_seen_of_it(radius):
    found, points, normals = foot(radius, 1.0)
    places, _ = side_gone_on(found, points, normals, 2.0 * STEP_M)
    turn = np.arctan2(places[:, 1], places[:, 0])
    middle = (np.abs(turn) < 0.5) & (places[:, 2] < 0.9)
    away = np.linalg.norm(places[:, :2], axis=1) / radius(turn, places[:, 2])
    assert away[middle] == pytest.approx(np.ones(middle.sum()), abs=0.06)
    assert places[middle, 2].min() < 0.1


def test_a_crown_that_shows_beyond_a_side_that_nobody_saw_tells_nothing_of_it():
    points, normals = patches(rounded, 0.8 * HEIGHT_M)
    assert len(SidesSeen.of(points, normals, np.zeros(2)).led_down(0.0)) == 0


def test_nothing_is_led_down_where_the_side_was_seen_down_to_the_foot():
    points, normals = patches(upright, 0.0)
    assert len(SidesSeen.of(points, normals, np.zeros(2)).led_down(0.0)) == 0


def test_a_rock_without_steep_sides_leads_nothing_down():
    points = np.random.default_rng(1).uniform(size=(50, 3))
    sides = SidesSeen.of(points, np.tile([0.0, 0.0, 1.0], (50, 1)), np.zeros(2))
    assert len(sides.led_down(0.0)) == 0


def test_a_few_places_around_tell_of_no_side_that_was_not_seen():
    turn = np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False)
    assert UnseenSide.of(np.column_stack([np.cos(turn), np.sin(turn), 0.0 * turn])) is None
