"""Directions as people say them."""

import pytest
from refusals import refused

from toppling.models.frames import WINDS, apart_deg, azimuth_of, compass_deg


@pytest.mark.parametrize("bearing", [0, 22.5, 40, 90, 135, 180, 222, 270, 315, 359])
def test_a_bearing_is_the_same_direction_however_it_is_stated(bearing):
    north, east = "N" if bearing <= 90 or bearing >= 270 else "S", "E" if bearing <= 180 else "W"
    fold = bearing if bearing <= 180 else 360 - bearing
    quadrant = f"{north}{fold if fold <= 90 else 180 - fold}{east}"
    expected = float(compass_deg(bearing))  # the conversion is its own inverse
    assert azimuth_of(f"compass:{bearing}") == azimuth_of(quadrant) == azimuth_of(f"{expected}") == expected


def test_the_sixteen_winds_go_round_clockwise_from_north():
    assert [float(compass_deg(azimuth_of(wind))) for wind in WINDS] == [22.5 * k for k in range(16)]


@pytest.mark.parametrize(
    "text", ["", "N95E", "N40", "compass:400", "compass:", "nan", "inf", "40deg", "E40N", "X"]
)
def test_what_is_no_direction_is_refused(text):
    with refused("azimuth.unreadable"):
        azimuth_of(text)


def test_azimuths_differ_by_the_shorter_arc():
    assert apart_deg([350, 10, 180, -90], [10, 350, 0, 270]).tolist() == [20, 20, 180, 0]
