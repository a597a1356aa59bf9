"""A surface that a cloud shows twice is named with the distance of the two; noise, relief, ledges and steps are one."""

import re

import numpy as np
import patches
import pytest
from refusals import refused

from toppling.models.scan.one_block import doubled, layers

RADIUS_M, REACHES_M = 1.0, (0.05, 0.12)
POINTS = 25_000


def ball(noise_m=8e-4, relief_m=0.0, seed=1, points=POINTS):
    """Points on a ball, each with noise along the ray."""
    random = np.random.default_rng(seed)
    way = random.normal(size=(points, 3))
    way /= np.linalg.norm(way, axis=1)[:, None]
    waves = np.sin(15.0 * way[:, 0]) * np.sin(15.0 * way[:, 1])
    return way * (RADIUS_M + relief_m * waves + random.normal(0.0, noise_m, points))[:, None]


def shown(points_m, step_m=0.0):
    return layers(ball(0.0, seed=2, points=150), points_m, REACHES_M, step_m)


@pytest.mark.parametrize("noise_m", [8e-4, 4e-3, 3e-2])
@pytest.mark.parametrize("relief_m", [0.0, 0.03])
def test_a_surface_seen_once_is_one_layer_however_noisy_or_rough(noise_m, relief_m):
    assert shown(ball(noise_m, relief_m))[0] < 0.03


@pytest.mark.parametrize("off_m", [0.02, 0.03, 0.06])
def test_a_copy_of_a_surface_lies_as_far_from_it_as_it_was_shifted(off_m):
    shift = off_m * np.array([2.0, -2.0, 1.0]) / 3.0
    share, apart_m = shown(np.vstack([ball(), ball(seed=3) + shift]))
    assert share > 0.3  # a shift along the surface does not show
    assert apart_m == pytest.approx(off_m, rel=0.15)


def test_the_two_levels_of_a_ledge_are_no_layers():
    random = np.random.default_rng(4)
    flat = random.uniform(-1.0, 1.0, (POINTS, 2))
    step = 0.03 * (np.floor(flat[:, 0] / 0.15) % 2)
    share, _ = layers(
        np.column_stack([flat, step])[:200], np.column_stack([flat, step]), REACHES_M, step_m=0.0
    )
    assert share < 0.03


def test_levels_a_step_of_the_coordinates_apart_are_no_layers():
    flat = np.random.default_rng(5).uniform(-1.0, 1.0, (POINTS, 2))
    height = np.random.default_rng(6).choice([0.0, 0.02], POINTS)
    level = np.column_stack([flat, height])
    assert layers(level[:100], level, REACHES_M, step_m=0.0)[0] > 0.9
    assert layers(level[:100], level, REACHES_M, step_m=0.02)[0] == 0.0


def seen_twice(off_m):
    """What is said of a ball of .8 m and its copy so far off."""
    observed = patches.seen_of(patches.ball_at((0.0, 0.0, 0.4)), patches.ground(0.62))
    fine = 0.4 * ball(1e-3 if off_m > 0.01 else 2e-4) + [0.0, 0.0, 0.4]
    assert doubled(observed, fine, 0.0) is None
    return doubled(observed, np.vstack([fine, fine + np.array([off_m, 0.0, 0.0])]), 0.0)


def test_a_rock_that_was_seen_twice_is_named_with_the_distance_and_what_to_do():
    doubt = seen_twice(0.0058)
    assert doubt is not None
    assert doubt.kind == "doubled"
    assert re.search(r"seen twice, about 0\.00(5[4-9]|6) m apart", doubt.sentence)
    assert "leave one of the two out" in doubt.sentence


def test_layers_so_far_apart_that_no_interval_holds_are_refused():
    with refused("scan.surface_doubled"):
        seen_twice(0.03)
