"""Units and coordinate systems that clouds state: read, or refused by name; never silently taken as metres."""

import numpy as np
import pytest
from cloud_samples import las, ply, read
from pyproj import CRS
from refusals import refused

from toppling.models.lengths import US_FOOT_M, metres_in, size_note
from toppling.models.scan.read import read_clouds

POINTS_M = np.random.default_rng(3).uniform(0.0, 12.0, (1500, 3)) + np.array([1000.0, 2000.0, 30.0])
FOOT_PLANE, METRE_PLANE, DEGREES = 2229, 32611, 4326
NAVD88_M, NAVD88_US_FT = 5703, 6360


def scaled(path, metres_per_unit=(1.0, 1.0), **system):
    """A LAS file whose numbers are POINTS_M in units of so many metres, across and upward."""
    across, up = metres_per_unit
    return las(path, POINTS_M / (across, across, up), **system)


def wkt_of(plane, vertical=None, version="WKT2_2019"):
    crs = CRS.from_epsg(plane)
    if vertical is not None:
        crs = CRS.from_user_input(f"EPSG:{plane}+{vertical}")
    return crs.to_wkt(version)


@pytest.mark.parametrize("version", ["WKT1_GDAL", "WKT2_2019"])
@pytest.mark.parametrize("las_version", ["1.2", "1.4"])
@pytest.mark.parametrize(
    ("plane", "vertical", "metres_per_unit"),
    [
        (FOOT_PLANE, NAVD88_US_FT, (US_FOOT_M, US_FOOT_M)),
        (FOOT_PLANE, NAVD88_M, (US_FOOT_M, 1.0)),
        (FOOT_PLANE, None, (US_FOOT_M, US_FOOT_M)),
        (2222, None, (0.3048, 0.3048)),  # Arizona: international feet
        (METRE_PLANE, NAVD88_US_FT, (1.0, US_FOOT_M)),
        (METRE_PLANE, NAVD88_M, (1.0, 1.0)),
    ],
)
def test_units_of_a_coordinate_system_in_words_are_read(
    tmp_path, version, las_version, plane, vertical, metres_per_unit
):
    path = scaled(
        tmp_path / "cloud.las", metres_per_unit, wkt=wkt_of(plane, vertical, version), version=las_version
    )
    np.testing.assert_allclose(read(path), POINTS_M, atol=1e-4)


@pytest.mark.parametrize(
    ("keys", "doubles", "metres_per_unit"),
    [
        ([(1024, 1), (3072, FOOT_PLANE)], (), (US_FOOT_M, US_FOOT_M)),
        ([(1024, 1), (3072, METRE_PLANE), (4099, 9003)], (), (1.0, US_FOOT_M)),
        ([(1024, 1), (3072, METRE_PLANE), (4096, NAVD88_US_FT)], (), (1.0, US_FOOT_M)),
        ([(1024, 1), (3072, 32767), (3076, 9002), (4099, 9001)], (), (0.3048, 1.0)),
        ([(1024, 1), (3072, 32767), (3076, 9002)], (), (0.3048, 0.3048)),
        ([(1024, 1), (3076, 32767), (3077, 0)], (0.9144,), (0.9144, 0.9144)),
        ([(3072, METRE_PLANE)], (), (1.0, 1.0)),
        ([(1025, 1)], (), (1.0, 1.0)),
    ],
)
def test_units_of_geotiff_keys_are_read(tmp_path, keys, doubles, metres_per_unit):
    path = scaled(tmp_path / "cloud.laz", metres_per_unit, keys=keys, doubles=doubles)
    np.testing.assert_allclose(read(path), POINTS_M, atol=1e-4)


@pytest.mark.parametrize(
    ("system", "what"),
    [
        *((system, "coordinates.in_degrees") for system in (
            {"wkt": wkt_of(DEGREES)}, {"wkt": wkt_of(DEGREES, version="WKT1_GDAL")},
            {"keys": [(1024, 2), (2048, DEGREES)]}, {"keys": [(2048, DEGREES)]},
        )),
        ({"wkt": wkt_of(4978)}, "coordinates.geocentric"),
        ({"wkt": 'PROJCS["broken", UNIT["furlong"'}, "coordinates.crs_unknown"),
        ({"keys": [(1024, 1), (3072, 1)]}, "coordinates.crs_unknown"),
        ({"keys": [(1024, 1), (3076, 9102)]}, "coordinates.crs_unknown"),
    ],
)  # fmt: skip
def test_a_system_without_lengths_or_sense_is_refused_and_the_users_word_overrules_it(tmp_path, system, what):
    path = scaled(tmp_path / "cloud.las", **system)
    with refused(what) as error:
        read_clouds([path])
    assert "cloud.las" in error.value.where
    if what != "coordinates.in_degrees":
        np.testing.assert_allclose(read(path, "m"), POINTS_M, atol=1e-4)


@pytest.mark.parametrize(
    "comment",
    [
        "comment units: feet", "comment unit mm", "comment Units are in US Survey Feet", "obj_info units = centimeters",
        "comment coordinates in inches, z up", "comment all values given in millimeters", "comment measured in yards",
        "comment California zone 5, US survey feet", "comment units: cubits", "comment units: degrees",
        "comment units: feet\ncomment unit: m", "comment vertical units: feet", "comment EPSG:2229",
        f"comment crs {wkt_of(FOOT_PLANE, NAVD88_US_FT, 'WKT1_GDAL')}",
        f"comment {wkt_of(METRE_PLANE)}".replace("\n", " "),
    ],
)  # fmt: skip
def test_a_remark_that_states_another_unit_or_a_system_is_refused_until_the_user_says_the_unit(
    tmp_path, comment
):
    path = ply(tmp_path / "cloud.ply", POINTS_M / 0.3048, comment)
    with refused("coordinates.unit_not_metres"):
        read_clouds([path])
    np.testing.assert_allclose(read(path, "ft"), POINTS_M, atol=1e-4)


@pytest.mark.parametrize(
    ("height_m", "volume_m3", "said"),
    [
        (14.05, 583.0, ""),  # the study's rock
        (1.0, 0.2, ""),
        (46.1, 20586.0, "feet (14.1 m)"),  # the study's rock, its feet taken for metres
        (14.05, 3000.0, ""),
        (4.28, 583.0, "flatter than any precarious rock"),  # heights in feet, taken for metres once more
        (46.1, 583.0, "thinner than any"),
        (20.0, 6000.0, "above 5,000 m³"),
    ],
)
def test_sizes_that_no_known_rock_has_are_told(height_m, volume_m3, said):
    assert (said in size_note(height_m, volume_m3)) if said else size_note(height_m, volume_m3) == ""


@pytest.mark.parametrize(
    ("word", "metres"),
    [("us-ft", US_FOOT_M), ("US survey feet", US_FOOT_M), ("Metres", 1.0), ("inches", 0.0254), ("cm", 0.01)],
)
def test_a_unit_has_a_key_and_a_name(word, metres):
    assert metres_in(word) == metres
    for other in ("yards", "dm", "km", "mmHg", "month", ""):
        with refused("units.unknown"):
            metres_in(other)
