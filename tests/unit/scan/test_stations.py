"""Stations that do not fit: each is told by itself, and one that is off is refused by its file's name."""

import dataclasses

import numpy as np
import pytest
from refusals import refused
from scipy.spatial.transform import Rotation

from toppling.models.scan.read import Cloud
from toppling.models.scan.register import check_fit, check_overlap, register
from toppling.models.scan.survey import survey


@pytest.fixture(scope="module")
def cloud(bare):
    return bare[1]


def with_a_station_off(cloud, number, shift_m):
    points = cloud.points_m.copy()
    points[cloud.station == number] += shift_m
    return Cloud(points, cloud.origin_m, cloud.station, cloud.files)


@pytest.mark.parametrize("off_m", [[9.0, 2.0, 1.6], [-331_000.0, -3_777_000.0, -480.0]])
def test_the_station_of_a_file_that_shows_another_place_is_named(cloud, off_m):
    """Such as a scan of an E57 whose pose is missing among others that have theirs."""
    single = with_a_station_off(cloud, 3, off_m)
    single = dataclasses.replace(single, files=(("all.e57", len(single.points_m)),))
    with refused("scan.no_overlap") as error:
        check_overlap(single)
    assert error.value.where == "all.e57, station 4 of 5"
    check_overlap(dataclasses.replace(cloud, files=single.files))


def test_stations_that_fit_are_listed_separately(cloud):
    same, result = register(cloud)
    check_fit(same, result)
    assert len(result["of_stations"]) == 5
    # Range noise of 0.8 mm, averaged over the points of a voxel.
    assert max(of_station["residual_m"] for of_station in result["of_stations"]) < 0.002
    # What one station alone sees of rock and ground beside what others see is not paired.
    assert min(of_station["paired_share"] for of_station in result["of_stations"]) > 0.6


def test_a_station_that_is_too_far_off_to_be_brought_back_is_refused_by_its_file(cloud):
    with refused("scan.station_off", "station 3 of 5") as error:
        survey(with_a_station_off(cloud, 2, [0.15, 0.15, 0.15]))
    assert error.value.where == "station3"


@pytest.mark.parametrize("turn_deg", [30.0, 90.0, 180.0])
def test_a_station_that_is_turned_about_the_rock_is_refused(cloud, turn_deg):
    """Such as one whose pose has lost its turn: where ground is level it lies on that of the others."""
    points = cloud.points_m.copy()
    turned = Rotation.from_euler("z", turn_deg, degrees=True)
    points[cloud.station == 4] = turned.apply(points[cloud.station == 4])
    with refused("scan.station_off", "station 5 of 5"):
        check_fit(*register(dataclasses.replace(cloud, points_m=points)))


def two_of(cloud, turn_deg=0.0, noise_m=0.0):
    """The first and the last but one station, the second turned about the rock."""
    first, second = (cloud.points_m[cloud.station == number] for number in (0, 3))
    second = Rotation.from_euler("z", turn_deg, degrees=True).apply(second)
    points = np.concatenate([first, second])
    points += np.random.default_rng(2).normal(0.0, noise_m, points.shape)
    files = (("one", len(first)), ("other", len(second)))
    return Cloud(points, cloud.origin_m, np.repeat([0, 1], [len(first), len(second)]).astype(np.int32), files)


@pytest.mark.parametrize("turn_deg", [30.0, 90.0, 180.0])
def test_a_station_turned_about_the_rock_is_refused(cloud, turn_deg):
    with refused("scan.station_off") as error:
        check_fit(*register(two_of(cloud, turn_deg)))
    assert error.value.where == "one and other"


@pytest.mark.parametrize("noise_m", [0.0, 0.01])
@pytest.mark.parametrize("turn_deg", [0.0, 3.0])
def test_two_stations_that_fit_or_are_brought_back_are_taken(cloud, turn_deg, noise_m):
    check_fit(*register(two_of(cloud, turn_deg, noise_m)))


def test_a_close_view_and_a_view_of_another_part_are_taken(cloud):
    """The third station saw the rock alone, the fourth a quarter of the ground alone."""
    near = np.linalg.norm(cloud.points_m - [0.0, 0.0, 1.0], axis=1) < 0.9
    corner = (cloud.points_m[:, :2] > 0.8).all(axis=1)
    selected = np.select([cloud.station == 2, cloud.station == 3], [near, corner], True)
    numbers = cloud.station[selected]
    files = tuple((f"station{k + 1}", int((numbers == k).sum())) for k in range(5))
    check_fit(*register(Cloud(cloud.points_m[selected], cloud.origin_m, numbers, files)))
