"""The crevice: what is rock and what pedestal beside it; where one side was not seen the interface is refused."""

import numpy as np
import pytest
from patches import level
from refusals import refused

from toppling.models.hidden_base.gap import hidden_base
from toppling.models.hidden_base.near_interface import NearInterface
from toppling.models.scan.crevice import Grid, depth_of_holes, judge_crevice
from toppling.models.scan.interface import Interface
from toppling.models.scan.segment import PEDESTAL, ROCK

HEIGHT_M = 2.0


def level_at(height_m):
    return Interface(np.array([0.0, 0.0, height_m]), np.array([0.0, 0.0, 1.0]), np.eye(3), 0.0)


def sheet(height_m, apart_m=0.02):
    points = level(1.0, apart_m)
    return points + np.outer(np.random.default_rng(1).normal(height_m, 1e-3, len(points)), [0.0, 0.0, 1.0])


def side(low_m, high_m):
    turn, up = np.meshgrid(np.arange(0.0, 2 * np.pi, 0.05), np.arange(low_m, high_m, 0.02))
    return np.column_stack([0.4 * np.cos(turn.ravel()), 0.4 * np.sin(turn.ravel()), up.ravel()])


def judged(rock, pedestal, interface, *, given=False):
    points = np.concatenate([rock, pedestal])
    label = np.repeat(np.array([ROCK, PEDESTAL], np.int8), [len(rock), len(pedestal)])
    return judge_crevice(points, label, interface, HEIGHT_M, 0.01 * HEIGHT_M, given=given)


def test_a_rim_that_a_misregistered_station_shows_on_the_pedestal_is_refused():
    # Nothing of the rock is left above the sheet up to where its side begins, 0.3 m up: the crevice is no crevice.
    foot = sheet(0.0)[np.hypot(*sheet(0.0).T[:2]) < 0.4]
    with refused("interface.too_few_points", "0"):
        judged(np.concatenate([foot, side(0.3, 2.0)]), sheet(0.0), level_at(0.0))


@pytest.mark.parametrize("height_m", [1.0, -0.5])
def test_an_interface_given_through_the_rock_or_below_the_pedestal_is_refused(height_m):
    with refused("interface.too_few_points"):
        judged(side(0.0, 2.0), sheet(0.0), level_at(height_m), given=True)


def test_a_crevice_hidden_below_an_overhang_is_not_judged():
    high, ground = side(0.4, 2.0), sheet(0.0)
    assert (judged(high, ground, level_at(0.0))[: len(high)] == ROCK).all()
    far = ground[np.hypot(*ground.T[:2]) > 0.9]
    low = side(0.0, 2.0)
    assert (judged(low, far, level_at(0.0)) == np.repeat([ROCK, PEDESTAL], [len(low), len(far)])).all()


def test_what_the_cut_took_off_the_rocks_lower_end_is_restored():
    # The sheet is rough by 1 mm: what hangs 1 cm over it, at the rock's outline, is no pedestal.
    cut_off = side(0.01, 0.06)
    label = judged(side(0.06, 2.0), np.concatenate([cut_off, sheet(0.0)]), level_at(0.0))
    foot, ground = np.split(label[-len(cut_off) - len(sheet(0.0)) :], [len(cut_off)])
    assert (foot == ROCK).all()
    assert (ground == PEDESTAL).all()


def test_a_shoulder_that_the_sheet_cannot_follow_takes_nothing_from_the_rock():
    ground = sheet(0.0, apart_m=0.008)  # the sheet's cells are 1.7 cm wide
    ground[:, 2] -= 1.5 * np.maximum(np.hypot(*ground[:, :2].T) - 0.43, 0.0)  # a neck of the rock's own width
    rock = side(0.009, 2.0)
    label = judged(rock, ground, level_at(0.0))
    assert (label[: len(rock)] == ROCK).all()
    assert (label[len(rock) :] == PEDESTAL).all()


def test_the_face_of_a_cliff_below_the_rock_stays_the_pedestals():
    # The rock is flush with the edge; half way down the face begins a ledge, to which the sheet falls too early.
    ground = sheet(0.0)
    ground[ground[:, 0] > 0.4, 2] -= 0.12
    across, up = (
        grid.ravel() for grid in np.meshgrid(np.arange(-0.3, 0.3, 0.01), np.arange(-0.11, 0.0, 0.01))
    )
    face = np.column_stack([np.full(len(across), 0.4), across, up])
    label = judged(side(0.01, 2.0), np.concatenate([face, ground]), level_at(0.0))
    assert (label[-len(ground) - len(face) : -len(ground)] == PEDESTAL).all()


def test_no_base_hangs_in_a_rim_that_was_not_seen():
    with refused("interface.too_few_points", "0"):
        hidden_base(NearInterface(np.empty((0, 3)), sheet(0.0), HEIGHT_M))


def test_a_stray_point_in_a_hole_shows_nothing_around_it():
    grid = Grid.over(np.array([-0.5, -0.5]), np.array([0.5, 0.5]), 0.02)
    seen = level(0.5, 0.01)
    seen = seen[seen[:, 0] < 0.0]
    depth = depth_of_holes(grid, np.vstack([seen, [[0.25, 0.0, 0.0]]]))
    places = np.array([[-0.1, 0.0], [0.25, 0.06], [0.25, 0.3]])
    assert depth.ravel()[grid.index(places)] == pytest.approx([0.0, 3.0, 10.0], abs=0.5)
