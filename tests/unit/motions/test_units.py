"""A unit is one of a closed list, whatever way its name is spelled; everything else is refused by name."""

import re

import pytest
from motion_samples import imported, miniseed, sensitivity, shaking
from obspy.core.inventory import Response
from refusals import left_out

from toppling.models.motions.formats.units import Unit, acceleration_m_s2, counted_unit, unit_of

G = 9.80665
SPELLINGS = [
    "M/S**2", "m/s²", "M/S**2 ", "m/s ^ 2", "m/s/s", "M/SEC**2", "m/(s**2)", "m s-2", "m·s⁻²", "m s^-2",
    "meters per second squared", "metres/sec/sec", "m/s**2.", "[m/s2]", "(m/s/s)", "㎨", "m/sý",
    "m/s**2 - Acceleration in Meters Per Second Per Second",
]  # fmt: skip
ACCELERATIONS = {
    "Gal": 0.01, "GALS": 0.01, "G": G, "g": G, "CM/SEC/SEC": 0.01, "cm/s²": 0.01, "CM/SEC**2": 0.01, "mm/s^2": 1e-3,
    "NM/S**2": 1e-9, "in/s/s": 0.0254, "ft/sec2": 0.3048, **dict.fromkeys(SPELLINGS, 1.0),
    **{f"  {name.upper()}\t": 1.0 for name in SPELLINGS},
}  # fmt: skip
VELOCITIES = {"M/S": 1.0, "cm/sec": 0.01, "nm/s": 1e-9, "kine": 0.01}
NO_MOTION = [
    "PA", "V", "counts", "rad/s", "m/s3", "s", "", "M/S**2 M", "T", "m/", "K", "gg", "mGal", "mg", "%g",
    "g/10", "µm/s²", "um", "dm", "km", "yd",
]  # fmt: skip


def test_accelerations_are_known_however_they_are_written_and_velocities_and_all_else_are_none():
    assert {name: acceleration_m_s2(name) for name in ACCELERATIONS} == pytest.approx(ACCELERATIONS)
    assert {name: unit_of(name) for name in VELOCITIES} == {
        name: Unit("velocity", velocity) for name, velocity in VELOCITIES.items()
    }
    assert [name for name in NO_MOTION if unit_of(name)] == []
    assert [name for name in VELOCITIES if acceleration_m_s2(name)] == []


@pytest.mark.parametrize(
    ("text", "one_m_s2"),
    [("4.7e-06 m/s2", 4.7e-6), ("1e-3 Gal per count", 1e-5), ("0.5 cm / s**2", 0.005), ("2 m/s2/count", 2.0),
     ("1e9 m/s2", None), ("0 g", None), ("two g", None), ("1e-6 m/s2/s", None)],
)  # fmt: skip
def test_a_tables_unit_may_have_a_factor(text, one_m_s2):
    found = counted_unit(text)
    assert (found and found.factor) == (None if one_m_s2 is None else pytest.approx(one_m_s2))


def station_of(
    folder, unit: str, gain: float, stages_unit: str | None = None, stage_gain: float | None = None
):
    """MiniSEED of counts at 200,000 to 1 m/s2, and a StationXML that states a unit and a gain."""
    a = shaking()
    response = sensitivity(unit, gain)
    if stages_unit is not None:
        units = {"input_units": "M/S**2", "output_units": "COUNTS"}
        response = Response.from_paz([], [], stage_gain or gain, 1.0, normalization_factor=1.0, **units)
        response.response_stages[0].input_units = stages_unit
        response.instrument_sensitivity = sensitivity(unit, gain).instrument_sensitivity
    miniseed(folder, a, response)
    return a, imported(folder)


UNKNOWN = "response.unit_unknown"
RESPONSES = [
    *(({"unit": unit}, UNKNOWN, (repr(unit),)) for unit in ("PA", "V", "M/S**2/K", "RAD/S**2")),
    *(({"unit": unit, "stages_unit": unit}, UNKNOWN, (repr(unit),)) for unit in ("PA", "V", "M/S**2/K", "RAD/S**2")),
    ({"stages_unit": "G"}, "response.unit_contradicted", ("'M/S**2'", "'G'")),
    ({"stages_unit": "M/S"}, "response.unit_contradicted", ("'M/S**2'", "'M/S'")),
    ({"stages_unit": "M/S**2", "stage_gain": 2e5 * G}, "response.sensitivity_contradicted",
     ("1.96133e+06 at 1 Hz", "200000")),
    ({"stages_unit": "M/S**2", "stage_gain": -2e5}, "response.sensitivity_contradicted", ("-200000 at 1 Hz",)),
    ({"unit": "M/S"}, "response.stages_missing", ("a sensor of velocity",)),
]  # fmt: skip
"""What a StationXML states of a sensor that nobody can read acceleration by: the code, and what is named."""


@pytest.mark.parametrize(("stated", "code", "named"), RESPONSES)
def test_a_response_in_another_unit_or_against_itself_is_refused_by_what_it_states(
    stated, code, named, tmp_path
):
    _, outcome = station_of(tmp_path, **{"unit": "M/S**2", "gain": 2e5} | stated)
    assert not outcome.records
    left_out(outcome, code, *named)


@pytest.mark.parametrize("value", ["", "counts", "NaN", "0"])
def test_a_sensitivity_that_is_no_number_is_refused(value, tmp_path):
    station_of(tmp_path, "M/S**2", 2e5)
    xml = tmp_path / "XX.TST.xml"
    xml.write_text(xml.read_text().replace("<Value>200000.0</Value>", f"<Value>{value}</Value>"))
    outcome = imported(tmp_path)
    assert not outcome.records
    assert {refusal.reason.code.partition(".")[0] for refusal in outcome.refusals} == {"response"}


@pytest.mark.parametrize("codes", [["00"], ["00", "20"]])
def test_a_response_at_other_locations_is_refused_and_they_are_named(codes, tmp_path):
    """The records have none."""
    miniseed(tmp_path, shaking())
    path = tmp_path / "XX.TST.xml"

    def placed(channel):
        return "".join(channel[0].replace('locationCode=""', f'locationCode="{code}"') for code in codes)

    path.write_text(re.sub("<Channel .*?</Channel>", placed, path.read_text(), flags=re.DOTALL))
    left_out(imported(tmp_path), "response.missing", *(f"XX.TST.{code}.HNE" for code in codes))
