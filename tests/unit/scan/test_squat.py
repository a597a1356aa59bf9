"""Rocks from slender to squat are found without help, or the refusal says what would help."""

import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from refusals import refused

from toppling.models.scan import virtual
from toppling.models.scan.segment import PEDESTAL, ROCK, segment

SEEDS = {1: "squat, on a shelf", 9: "squat, deep crevice, at a cliff"}
"""Members of the family in which the program before this one found nothing at this resolution."""


@pytest.fixture
def squat_rocks(monkeypatch):
    folder = Path(__file__).parents[3] / "benchmarks"
    monkeypatch.syspath_prepend(str(folder))
    yield import_module("squat_rocks")
    sys.modules.pop("squat_rocks", None)


def bare_slope(rng, reach_m, count):
    plane = rng.uniform(-reach_m, reach_m, (count, 2))
    return np.column_stack([plane, 0.1 * plane[:, 0] + rng.normal(0.0, 0.003, count)])


@pytest.mark.thorough
@pytest.mark.parametrize("seed", SEEDS, ids=SEEDS.values())
def test_a_rock_wider_than_high_is_found_without_help(squat_rocks, seed):
    drawn = squat_rocks.member(seed, resolution_per_height=0.012)
    cloud, label = virtual.cloud_of(drawn.stations, virtual.DEMO_ORIGIN_M)
    found = segment(cloud.points_m, cloud.origin_m).label
    # Strays and what the crevice's judgement settles later: two points in a hundred of the rock.
    assert (found[label == ROCK] == ROCK).mean() > 0.98
    assert (found[label == PEDESTAL] == PEDESTAL).mean() > 0.98


def test_a_cloud_without_a_peak_is_refused_with_its_own_numbers():
    points = bare_slope(np.random.default_rng(0), 5.0, 40_000)
    origin = np.array([1000.0, 2000.0, 300.0])
    with refused("scan.nothing_stands", "100"):  # an easting of this cloud
        segment(points, origin)


@pytest.mark.thorough
def test_a_rock_that_is_small_in_its_cloud_is_found_where_the_user_points():
    rock = virtual.boulder(1.0, 0.8, 0.6, 3, bumps=0.02, sides=64)
    truth = virtual.on_slope(rock, virtual.ground(3.0, 0.4, 3, bumps_m=0.03), 3.0, 40.0)
    cloud, label = virtual.cloud_of(
        virtual.scan_around(truth, seed=1, stations=5, resolution_per_height=0.02), virtual.DEMO_ORIGIN_M
    )
    rng = np.random.default_rng(4)
    far = rng.uniform(-80.0, 80.0, (200_000, 2))
    far = far[np.hypot(*far.T) > 2.5]
    normal = truth.pedestal.normal
    plain = np.column_stack([far, -(far @ normal[:2]) / normal[2] - 0.05 + rng.normal(0.0, 0.01, len(far))])
    points = np.vstack([cloud.points_m, plain])
    with refused("scan.nothing_stands"):
        segment(points, virtual.DEMO_ORIGIN_M)
    top = truth.rock.vertices_m[np.argmax(truth.rock.vertices_m[:, 2]), :2]
    found = segment(points, virtual.DEMO_ORIGIN_M, near_m=top).label[: len(label)]
    assert (found[label == ROCK] == ROCK).mean() > 0.95
