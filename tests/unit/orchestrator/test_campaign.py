import dataclasses
import textwrap
import tomllib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from refusals import refused

from toppling.orchestrator.campaign import KEYS, Campaign
from toppling.orchestrator.keys import REQUIRED

GOOD = {
    "scene": "scenes/echo",
    "ensemble": "ensembles/quakes",
    "pga_m_s2": {"start": 1, "stop": 19, "step": 1},
    "azimuth_deg": [0, 45, 90],
    "friction": [1.0, [0.8, 0.6]],
}


def campaign(**changes):
    return Campaign.of({**GOOD, **changes}, Path("here"), where="c.toml")


def test_folders_are_relative_to_the_file(tmp_path):
    path = tmp_path / "c.toml"
    path.write_text('scene="a/b"\nensemble="../e"\npga_m_s2=[1]\nazimuth_deg=[0]\nfriction=[0.8]\n')
    read = Campaign.read(path)
    assert (read.scene, read.ensemble) == (tmp_path / "a/b", tmp_path / "../e")


def read_again(value, folder, **stated):
    """A campaign as a run's folder has it, beside its own scene and ensemble."""
    again = Campaign.of(tomllib.loads(value.to_toml(**stated)), folder)
    assert (again.scene, again.ensemble) == (folder / "scene", folder / "ensemble")
    return dataclasses.replace(again, scene=value.scene, ensemble=value.ensemble)


@pytest.mark.parametrize(("mark", "ends"), [("\ufeff", "\n"), ("\ufeff", "\r\n"), ("", "\r\n")])
def test_what_editors_on_windows_put_around_a_text_changes_nothing(tmp_path, mark, ends):
    lines = ['scene="a"', 'ensemble="e"', "pga_m_s2=[1]", "azimuth_deg=[0]", "friction=[0.8]", ""]
    path = tmp_path / "c.toml"
    path.write_bytes((mark + ends.join(lines)).encode())
    assert Campaign.read(path).pga_m_s2 == (1.0,)
    path.write_bytes((mark + ends.join(lines)).encode("utf-16"))
    with refused("file.not_utf8", "16"):
        Campaign.read(path)


def test_values_are_read_in_all_of_their_spellings(monkeypatch):
    monkeypatch.setenv("HOME", "/home/me")
    assert campaign(ensemble="~/quakes").ensemble == Path("/home/me/quakes")
    assert campaign().pga_m_s2 == tuple(float(level) for level in range(1, 20))  # a range with its stop
    assert campaign(pga_m_s2={"start": 0.1, "stop": 0.3, "step": 0.1}).pga_m_s2 == (0.1, 0.2, 0.3)
    assert campaign().friction == ((1.0, 1.0), (0.8, 0.6))
    single = campaign(pga_m_s2=5, azimuth_deg=90, friction=0.8)
    assert single == campaign(pga_m_s2=[5], azimuth_deg=[90], friction=[0.8])


numbers = st.floats(0.01, 99, allow_nan=False)


@settings(max_examples=40)
@given(
    levels=st.lists(numbers, min_size=1, max_size=5, unique=True),
    azimuths=st.lists(st.floats(0, 359.9), min_size=1, max_size=5, unique=True),
    friction=st.lists(
        numbers.map(lambda static: [static, static / 2]), min_size=1, max_size=3, unique_by=tuple
    ),
    realisations=st.integers(1, 10_000),
    records=st.none() | st.lists(st.text(min_size=1).filter(str.isprintable), min_size=1, unique=True),
)
def test_what_is_written_reads_back_as_the_same_campaign(levels, azimuths, friction, realisations, records):
    content = dict(GOOD, pga_m_s2=levels, azimuth_deg=azimuths, friction=friction, realisations=realisations)
    if records is not None:
        content["records"] = records
    single = Campaign.of(content, Path())
    assert read_again(single, Path()) == single


DRAWN = {"friction": [0.5, 1.0], "restitution": [0.0, 0.3], "yaw_deg": 5.0, "either_sense": True}
BAND = {"band_hz": 25.0, "above_band": [0.0, 0.6]}


REFUSED = {
    "campaign.value_unusable": [
        {"unmeasured": {"friction": [1.0, 0.5]}}, {"unmeasured": {"restitution": [0.0, 1.2]}},
        {"unmeasured": {"yaw_deg": -1}}, {"unmeasured": {**BAND, "band_hz": 0.0}},
        {"unmeasured": {**BAND, "above_band": [0.6, 0.0]}}, {"unmeasured": {"either_sense": 1}},
        {"unmeasured": {"friction": 0.5}}, {"unmeasured": [0.5, 1.0]}, {"friction": []}, {"friction": "0.8"},
        {"realisations": 4.0}, {"realisations": "4"}, {"friction": [True]}, {"pga_m_s2": [0]}, {"pga_m_s2": [981]},
        {"pga_m_s2": [float("nan")]}, {"preset": "standart"}, {"azimuth_deg": [360]}, {"restitution": [1.5]},
        {"realisations": 0}, {"realisations": 1.5}, {"preset": "best"}, {"records": []},
        {"peak_displacement_m": -1}, {"scene": 3}, {"precision": 5}, {"precision": 0.0}, {"precision": "5%"},
        {"precision": 0.1, "target": "medain"}, {"precision": 0.1, "target": {}},
        {"precision": 0.1, "target": {"measure": "pgv"}},
    ],
    "campaign.keys_incomplete": [
        {"unmeasured": {"band_hz": 25.0}}, {"unmeasured": {"above_band": [0.0, 0.6]}}, {"target": "p05"},
        {"precision": 0.1, "target": {"at": 1.2}},
    ],
    "campaign.key_unknown": [
        {"unmeasured": {"gravity": [9, 10]}}, {"pga": [1.0]}, {"pgv_m_s": [0.1]}, {"pga_g": [0.3]},
        {"gravity": 1.6}, {"azimut": [0]},
    ],
    "engine.contact_unknown": [{"unmeasured": DRAWN, "engine": "mujoco", "friction": [0.8]}],
    "contact.property_out_of_range": [{"friction": [-0.1]}],
    "campaign.friction_order": [{"friction": [[0.5, 0.9]]}],
    "campaign.list_empty": [{"pga_m_s2": []}, {"azimuth_deg": "north"}],
    "campaign.value_repeated": [{"pga_m_s2": [1, 1.0]}, {"records": ["R1", "R1"]}],
    "campaign.range_empty": [
        {"pga_m_s2": {"start": 2, "stop": 1, "step": 1}}, {"pga_m_s2": {"start": 1, "stop": 2, "step": -1}},
    ],
    "campaign.range_unreadable": [{"pga_m_s2": {"start": 1, "stop": 2}}],
    "campaign.no_levels_to_choose": [{"precision": 0.1, "pga_m_s2": "recorded"}],
    "campaign.keys_exclude_each_other": [{"precision": 0.1, "target": {"of": "p05", "hazard": "a.csv"}}],
}  # fmt: skip


@pytest.mark.parametrize(
    ("code", "change"), [(code, value) for code, all_of in REFUSED.items() for value in all_of]
)
def test_a_wrong_value_is_refused_with_its_place(code, change):
    with refused(code) as error:
        campaign(**change)
    assert error.value.where.startswith("c.toml")
    assert any(key in str(error.value) for key in change)


TARGETS = [
    "p95",
    {"of": "p05", "measure": "pga_m_s2"},
    {"measure": "pgv_m_s", "at": 1.2},
    {"hazard": "a.csv"},
]


@pytest.mark.parametrize(
    "stated",
    [
        *({"precision": 0.05, "target": target} for target in TARGETS),
        *(
            {"pga_m_s2": "recorded", "unmeasured": drawn, "realisations": 5, "first_realisation": 4}
            for drawn in (DRAWN, BAND, {"yaw_deg": 3}, {"friction": [0.6, 0.6]}, {})
        ),
    ],
)
def test_what_is_asked_for_and_what_realisations_draw_is_written_as_it_is_read(stated):
    single = campaign(**stated)
    assert read_again(single, Path("here"), hazard="a.csv" if "a.csv" in str(stated) else None) == single
    assert bool(single.pga_m_s2) is ("pga_m_s2" not in stated)


@pytest.mark.parametrize("missing", sorted(GOOD))
def test_a_missing_key_is_named(missing):
    with refused("campaign.key_missing", missing):
        Campaign.of({key: value for key, value in GOOD.items() if key != missing}, Path())


def in_docs(key):
    default = "required" if key.default is REQUIRED else f"default: {key.otherwise}"
    more = f" ([more]({key.page}))" if key.page else ""
    text = f"- `{key.name}` ({default}): {key.help}: {key.values}{more}."
    return textwrap.fill(text, 118, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False)


def test_a_bearing_is_an_azimuth_of_a_campaign():
    assert campaign(azimuth_deg=["N", "N40E", 180, "compass:180"]).azimuth_deg == (90.0, 50.0, 180.0, 270.0)


def test_every_key_is_a_field_with_its_default_and_stands_in_the_documentation_as_declared():
    fields = {field.name: field.default for field in dataclasses.fields(Campaign)}
    assert {key.name for key in KEYS} == {*fields, "scenes"}
    for key in KEYS:
        if key.name == "scenes":
            continue
        assert (key.default is REQUIRED) == (fields[key.name] is dataclasses.MISSING)
        assert key.default is REQUIRED or key.default == fields[key.name]
    docs = Path(__file__).parents[3] / "docs"
    assert "\n".join(map(in_docs, KEYS)) in (docs / "campaign_keys.md").read_text()


@pytest.mark.parametrize("key", [key for key in KEYS if key.example], ids=lambda key: key.name)
def test_the_example_of_every_key_is_read(key):
    also = {"target": {"precision": 0.1}, "engine": {"friction": [0.8]}}.get(key.name, {})
    read = campaign(**also, **tomllib.loads(key.line.removeprefix("# ")))
    assert key.name in ("restitution",) or getattr(read, key.name) != key.default
