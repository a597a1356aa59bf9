"""A record is the ground's motion unless its file states that its sensor is below the ground or in a structure."""

import re

import numpy as np
import obspy
import pyarrow.parquet as pq
import pytest
from motion_samples import WRITERS, imported, shaking
from refusals import left_out, states

from toppling.models.files.digest import write_table
from toppling.models.motions.ensemble import CATALOG, MOTIONS, Ensemble
from toppling.models.motions.place import BOREHOLE, FREE_FIELD, Place, at_depth, place_in_name, place_in_words


def edited(folder, name, changes):
    """Files of a format with their text changed: patterns, and what takes their place."""
    for path in WRITERS[name](folder, shaking()):
        text = path.read_text()
        for pattern, new in changes:
            text = re.sub(pattern, new, text)
        path.write_text(text)
    return folder


def left_out_at(outcome, place):
    assert len(outcome.refusals) == (place is not None)
    if place is not None:
        left_out(outcome, "record.not_free_field", place)


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("Downhole - Depth 100 ft", Place(30.48)), ("44 m below ground surface", Place(44.0)),
        ("Left Abutment", Place(0.0, "on the abutment of a dam or bridge")), ("1st Floor, East wall", FREE_FIELD),
        ("Deck, midspan", Place(0.0, "on a bridge")), ("Free-field near left abutment", FREE_FIELD),
        ("building location description", None), ("", None),
    ],
)  # fmt: skip
def test_a_sensors_location_is_understood_by_its_words(text, place):
    assert place_in_words(text) == place_in_words(text.upper()) == place


@pytest.mark.parametrize(
    ("name", "free"),
    [
        ("CA:Alhambra;LACPW, 12th Fl", False), ("Hollywood Storage Bldg Basement", False),
        ("CIRES Pozo 30 m", False), ("EDIFICIO X, SÓTANO", False),
        ("Millikan Library - Roof", False), ("Treasure Island Downhole", False),
        ("Long Valley Dam (crest of dam)", False), ("Roofing Road", True), ("Basement Road", True),
        ("Dam Road", True), ("Crest Drive School", True), ("Carbon Canyon Dam", True),
        ("12th Floor Street Parking", True), ("San Francisco, 1295 Shafter, F", True),
        ("Los Angeles - 116th St. School", True), ("", True),
    ],
)  # fmt: skip
def test_a_stations_name_states_a_location_at_its_end_alone(name, free):
    assert place_in_name(name).free_field == free


def test_three_metres_below_the_surface_part_a_vault_from_a_borehole():
    """COSMOS, table 6: near-surface vaults are 1 to 2 m deep; what is 3 m or more from the surface is no surface."""
    assert [at_depth(d).free_field for d in (0.0, 2.0, 3.0, 150.0, -1.0, -30.0)] == [
        True, True, False, False, True, False,
    ]  # fmt: skip
    assert str(at_depth(217.5)) == "217.5 m below the surface"


def kik_net(folder):
    """Channels 1 to 3 at 502.5 m, at the foot of a borehole, and 4 to 6 at 720 m, the surface."""
    heights, directions = {"1": 502.5, "2": 720}, {"1": "123", "2": "456"}
    for place in heights:
        for path in WRITERS["knet"](folder, shaking(seed=int(place))):
            text = re.sub(r"Station Height\(m\).*", f"Station Height(m) {heights[place]}", path.read_text())
            for letters, number in zip(("N-S", "E-W", "U-D"), directions[place], strict=True):
                text = text.replace(letters, number)
            path.write_text(text)
            path.rename(path.with_suffix(path.suffix + place))
    return folder


def test_kik_nets_channels_1_to_3_are_in_the_borehole_by_the_difference_of_heights_or_by_their_number(
    tmp_path,
):
    found = imported(kik_net(tmp_path))
    (record,), (refusal,) = found.records, found.refusals
    assert all(file.endswith("2") for file in record.files)
    states(str(refusal.reason), "record.not_free_field", "217.5 m below the surface", "--place any")
    both = imported(tmp_path, place="any").records
    assert {entry.place for entry in both} == {Place(217.5), FREE_FIELD}
    for path in tmp_path.glob("*2"):
        path.unlink()
    alone = imported(tmp_path)
    assert not alone.records
    left_out(alone, "record.not_free_field", BOREHOLE)


def of_smc(integers):
    return "smc", [
        (rf"\A((?:.*\n){{{11 + n // 8}}}.{{{10 * (n % 8)}}}).{{10}}", rf"\g<1>{value:10d}")
        for n, value in integers.items()
    ]


def of_cosmos(kind, location):
    """The type of the station, and the sensor's location."""
    of_type = (r"(Integer-header.*\n.*\n.{64}).{8}", rf"\g<1>{kind:8d}")
    return "cosmos_v2", [("(Sta Chan.*)", rf"\1 Location:{location}"), of_type]


def of_csmip(behind):
    return "csmip_v1", [(r"(?m)^(CHAN [^(\n]*?) *(\(.*)?$", rf"\1{behind}")]


def instead(name, old, new):
    return name, [(old or r"\A", new)]


ROOF, FLOOR_5 = "sensor on the roof of a building", "sensor on floor 5 of a building"
STATED = [
    (of_smc({18: 1, 24: 12}), "sensor on floor 12 of a building"), (of_smc({18: 4}), "sensor on a structure"),
    (of_smc({18: 1, 24: 1}), "sensor on floor 1 of a building"), (of_smc({18: 2, 26: 3}), "sensor on a bridge"),
    (of_smc({18: 3, 27: 2}), "sensor on a dam"), (of_smc({18: 3, 27: 0}), None), (of_smc({18: 2, 26: 0}), None),
    (of_smc({}), None), (of_cosmos(4, "Basement NW corner"), "sensor in the basement of a building"),
    (of_cosmos(5, ""), None), (of_cosmos(10, ""), "sensor in a building"), (of_cosmos(10, "Ground level"), None),
    (of_cosmos(12, "Crest, center"), "sensor on or in a dam"), (of_cosmos(50, "Surface"), None),
    (of_cosmos(50, "Downhole, 30 m"), "30 m below the surface"), (of_cosmos(50, ""), str(BOREHOLE)),
    (of_cosmos(-999, ""), None), (of_csmip("     Location: Roof"), ROOF), (of_csmip("              Roof"), ROOF),
    (of_csmip("  (Sta Chn:  3)      Location: Roof"), ROOF),
    (instead("esm", "DATA_TYPE", "SENSOR_DEPTH_M: 46.0\nDATA_TYPE"), "46 m below the surface"),
    (instead("esm", "DATA_TYPE", "SENSOR_DEPTH_M: 0.0\nDATA_TYPE"), None),
    (instead("geonet_v2a", "\nFarm\n", "\nBNZ Harbour Quays, Level 5\n"), FLOOR_5),
    (instead("geonet_v2a", "\nFarm\n", "\nRoofing Road\n"), None),
    (instead("columns", "", "Sensor location: roof\nunits: m/s2\n"), ROOF),
    (instead("columns", "", "Sensor depth: 30 m\nunits: m/s2\n"), "30 m below the surface"),
    (instead("columns", "", "# Location: borehole 30 m\n# Depth: 9 km\n"), "30 m below the surface"),
    (instead("columns", "", "# Depth: 30 m\n"), "30 m below the surface"),
    (instead("columns", "", "# Depth: 9 km\n# Instrument: K2, ground floor\n"), None),
]  # fmt: skip
"""What each format says of its sensor's place in its own way, and what is understood; None of the free field."""


@pytest.mark.parametrize(("stated", "what"), STATED)
def test_a_place_that_a_header_states_is_left_out_unless_any_is_asked_for(stated, what, tmp_path):
    edited(tmp_path, *stated)
    left_out_at(imported(tmp_path), what)
    (record,) = imported(tmp_path, place="any").records
    assert record.north_known


@pytest.mark.parametrize(
    ("depth_m", "site", "what"),
    [
        (0.0, "", None), (1.5, "Roofing Road", None), (150.0, "", "150 m below the surface"),
        (-30.0, "", "sensor 30 m above the ground"),
        (0.0, "VA Hospital, 5th Floor", "sensor on floor 5 of a building"),
    ],
)  # fmt: skip
def test_stationxml_states_the_depth_of_a_channel_or_a_place_in_its_sites_name(tmp_path, depth_m, site, what):
    WRITERS["miniseed"](tmp_path, shaking())
    (path,) = tmp_path.glob("*.xml")
    inventory = obspy.read_inventory(str(path))
    inventory[0][0].site.name = site
    for channel in inventory[0][0]:
        channel.depth = depth_m
    inventory.write(str(path), format="STATIONXML")
    left_out_at(imported(tmp_path), what)


def test_the_catalogue_records_the_place_and_an_older_catalogue_is_of_the_free_field(tmp_path):
    ensemble = Ensemble.write(tmp_path / "both", imported(kik_net(tmp_path), place="any").records)
    assert sorted(ensemble.catalog["sensor_depth_m"].to_pylist()) == [0.0, 217.5]
    assert {ensemble.record(name).place for name in ensemble.record_ids} == {Place(217.5), FREE_FIELD}
    before = tmp_path / "before"
    before.mkdir()
    table = pq.read_table(ensemble.folder / CATALOG).drop_columns(["sensor_depth_m", "structure"])
    write_table(table, before / CATALOG)
    (before / MOTIONS).write_bytes((ensemble.folder / MOTIONS).read_bytes())
    again = Ensemble.load(before)
    assert {again.record(name).place for name in again.record_ids} == {FREE_FIELD}
    assert np.array_equal(again.catalog["sha"].to_pylist(), ensemble.catalog["sha"].to_pylist())
