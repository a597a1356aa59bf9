"""What no station saw is said: in the floors of the stated spread, and on the command line."""

import dataclasses

import numpy as np
import pytest

from toppling.models.scan import virtual
from toppling.models.scan.close import ClosedRock
from toppling.models.scan.survey import survey
from toppling.models.scan.uncertainty import bias_floors, cap_share, invention_warning
from toppling.models.scene import Scene


def surface(invented, crown_unseen=0.0):
    return ClosedRock(Scene.block(0.2, 0.3, 0.6).rock, 0.9 - invented, 0.1, invented, crown_unseen)


@pytest.mark.parametrize("height", [0.1, 0.5, 1.3, 2.0])
def test_a_cap_holds_the_share_of_the_ball_that_geometry_says(height):
    # Of a ball of radius 1, a cap of height h has the surface 2 pi h and the volume pi h^2 (3 - h) / 3.
    assert cap_share(height / 2.0) == pytest.approx(height**2 * (3.0 - height) / 4.0)


def test_floors_are_those_of_known_rocks_where_all_was_seen_and_the_caps_where_much_was_not():
    seen, partly = bias_floors(surface(0.0)), bias_floors(surface(0.41, crown_unseen=0.5))
    assert seen == {
        "com_per_height": 0.001,
        "volume_share": 0.003,
        "inertia_share": 0.003,
        "height_share": 0.006,
    }
    assert partly["volume_share"] == pytest.approx(0.367, abs=0.001)
    assert partly["inertia_share"] == pytest.approx(0.367, abs=0.001)
    assert partly["com_per_height"] == pytest.approx(0.2 * 0.367, abs=0.001)
    # A ball's crown, whose normals' upward part is 0.8 and more, is a tenth of its height.
    assert partly["height_share"] == pytest.approx(np.hypot(0.006, 0.05))


@pytest.fixture(scope="module")
def one_sided():
    """A leaning rock seen by three of six stations around it: truth, and what the survey made of it."""
    truth = virtual.on_slope(
        virtual.boulder(2.5, 1.4, 0.9, 7, bumps=0.04, sides=64, lean_m=(0.15, 0.1)),
        virtual.ground(6.0, 0.7, 7, bumps_m=0.1, cells=80),
        8.0,
        120.0,
    )
    seen = virtual.scan_around(truth, 1, stations=6, resolution_per_height=0.02, clutter=False)[:3]
    return truth, survey(virtual.cloud_of(seen, np.zeros(3))[0]).scene


@pytest.mark.slow
def test_the_spread_of_a_rock_seen_from_one_side_covers_its_error(one_sided):
    truth, found = one_sided
    rock, true, spread = found.rock, truth.rock, found.report["uncertainty"]
    assert found.report["surface"]["invented_share"] > 0.3
    # The error is a sixth of the volume: two standard deviations must hold it.
    off = abs(rock.volume_m3 - true.volume_m3)
    assert 0.15 * true.volume_m3 < off < 2.0 * spread["volume_std_m3"]
    assert (np.abs(rock.com_m - true.com_m) < 2.0 * np.array(spread["com_std_m"])).all()
    inertia = np.abs(rock.inertia_per_mass_m2 - true.inertia_per_mass_m2)
    assert (inertia < 2.0 * np.array(spread["inertia_per_mass_std_m2"])).all()


@pytest.mark.parametrize(
    ("invented", "crown_unseen", "told"),
    [(0.41, 0.0, ("41%", "±37%", "guesses")), (0.05, 0.93, ("93%", "crown")), (0.05, 0.0, ())],
)
def test_what_was_not_seen_of_a_rock_is_told_with_how_far_the_rock_may_be_off(invented, crown_unseen, told):
    """By 3 * 0.41^2 - 2 * 0.41^3 of its volume."""
    seen = {"seen_share": 0.85 - invented, "closed_share": 0.15, "invented_share": invented}
    report = {"surface": {**seen, "crown_unseen_share": crown_unseen}}
    said = invention_warning(dataclasses.replace(Scene.block(0.2, 0.3, 0.6), report=report))
    assert [part for part in told if part not in said] == []
    assert bool(said) is bool(told)
