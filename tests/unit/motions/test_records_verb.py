"""`toppling records` as it is typed, and records fetched from a service that answers as those of FDSN do."""

import json

import numpy as np
import obspy
import pytest
from click.testing import CliRunner
from motion_samples import STEP_S, WRITERS, shaking, tabled
from obspy.core.event import Catalog, Event, EventDescription, Magnitude, Origin
from obspy.core.inventory import Channel, Inventory, Network, Response, Station
from refusals import states

from toppling.models.motions.ensemble import Ensemble
from toppling.orchestrator.cli import cli
from toppling.orchestrator.verbs.records import show_table


def run(*arguments, expect=0):
    result = CliRunner().invoke(cli, ["records", *map(str, arguments)])
    if expect == 0:
        assert result.exception is None, result.output
    return result


def given(tmp_path, name):
    folder = tmp_path / "in"
    folder.mkdir()
    WRITERS[name](folder, shaking())
    return folder


def test_import_reads_what_it_can_and_ends_with_what_it_left_out(tmp_path):
    folder = given(tmp_path, "peer")
    (folder / "broken.AT2").write_text("PEER NGA STRONG MOTION DATABASE RECORD\nx\n")
    result = run("import", folder, "--out", tmp_path / "out")
    assert "1 record from 4 files" in result.output
    assert "broken.AT2" in result.output
    ensemble = Ensemble.load(tmp_path / "out")
    (row,) = ensemble.catalog.to_pylist()
    assert row["event"] == "Testquake"
    assert len(row["files"]) == 3
    wanted = (
        "record_id event station magnitude distance_km time_step_s pga_m_s2 ground_accelerates_toward_deg"
    )
    assert set(wanted.split()) <= set(row)


def test_a_table_that_is_wider_than_the_page_shortens_no_number(capsys):
    show_table(["event", *"abcdefghijklm"], [["word " * 12, *["123.456789"] * 13]], (0,))
    assert capsys.readouterr().out.count("123.456789") == 13


def test_import_takes_what_files_lack_from_the_table_and_suggests_a_table(tmp_path):
    folder = given(tmp_path, "columns")
    with_table = run("import", folder, "--out", tmp_path / "a", "--metadata", folder / "table.csv", "--json")
    assert json.loads(with_table.stdout)["records"] == ["A"]
    without = run("import", folder, "--out", tmp_path / "b", expect=1)
    assert without.exception.code == "record.none_found"
    assert "looks like a metadata table" in without.output
    assert not (tmp_path / "b").exists()


def test_import_replaces_an_ensemble_only_when_asked(tmp_path):
    folder = given(tmp_path, "esm")
    run("import", folder, "--out", tmp_path / "out")
    again = run("import", folder, "--out", tmp_path / "out", expect=1)
    assert again.exception.code == "ensemble.exists"
    run("import", folder, "--out", tmp_path / "out", "--replace")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("made") / "ensemble"
    result = run("synthesise", "--count", "6", "--seed", "3", "--out", folder)
    assert "target" in result.output
    return folder


def test_a_selection_of_a_weighted_ensemble_retains_its_weights(made, tmp_path):
    rows = Ensemble.load(made).catalog.to_pylist()
    table = tmp_path / "deaggregation.csv"
    head = "magnitude_low,magnitude_high,distance_low_km,distance_high_km,contribution"
    middle = sorted(row["magnitude"] for row in rows)[3]
    table.write_text(f"{head}\n0,{middle},0,999,1\n{middle},9,0,999,9\n")
    run("select", made, "--out", tmp_path / "weighted", "--deaggregation", table)
    run("select", tmp_path / "weighted", "--out", tmp_path / "near", "--distance", "0", "999")
    weighted, near = (Ensemble.load(tmp_path / name) for name in ("weighted", "near"))
    assert len(set(weighted.catalog["weight"].to_pylist())) == 2
    assert near.catalog["weight"] == weighted.catalog["weight"]


def test_import_resamples_when_asked_and_preserves_frequencies_that_both_steps_resolve(tmp_path):
    folder = given(tmp_path, "peer")
    run("import", folder, "--out", tmp_path / "own")
    run("import", folder, "--out", tmp_path / "finer", "--time-step", 0.0025)
    own, finer = (Ensemble.load(tmp_path / name) for name in ("own", "finer"))
    (name,) = own.record_ids
    assert finer.record(name).motion.time_step_s == 0.0025
    assert any("resampled" in step for step in finer.record(name).history)
    assert not any("resampled" in step for step in own.record(name).history)
    # Velocity has little above a hundred hertz: a finer step shows the same peak.
    assert finer.record(name).intensity["pgv_m_s"] == pytest.approx(
        own.record(name).intensity["pgv_m_s"], rel=0.01
    )


@pytest.mark.parametrize(("peaks", "records"), [("2,4,1", 1), ("2,40,1", 0), ("2,,1", 0)])
def test_peaks_of_the_table_scale_counts_of_their_own_instrument_only(tmp_path, peaks, records):
    time = np.arange(2000) * 0.01
    shape = np.sin(2 * np.pi * time) * np.exp(-((time - 10) ** 2))
    # Counts with an offset; the sensitivity is 1000 counts per m/s2.
    counts = [1000 * peak * shape / np.abs(shape).max() + 7 for peak in (2.0, 4.0, 1.0)]
    np.savetxt(tmp_path / "rec.txt", np.column_stack([time, *counts]), fmt="%.6f")
    tabled([tmp_path / "rec.txt"] * 3, **{"pga_h1,pga_h2,pga_v": peaks})
    options = ("--out", tmp_path / "out", "--metadata", tmp_path / "table.csv")
    result = run("import", tmp_path / "rec.txt", *options, expect=None)
    if records:
        record = Ensemble.load(tmp_path / "out").record("A")
        intensity = record.intensity
        assert intensity["pga_h1_m_s2"] == pytest.approx(2.0, rel=0.01)
        assert intensity["pga_h2_m_s2"] == pytest.approx(4.0, rel=0.01)
        (answer,) = [step for step in record.history if "counts per m/s2" in step]
        assert float(answer.partition(" counts per")[0].split()[-1]) == pytest.approx(1000.0, rel=0.01)
    else:
        assert result.exception.code == "record.none_found"


ORIGIN = obspy.UTCDateTime(2019, 7, 6, 3, 19, 53)
COUNTS = 213945.0  # to 1 m/s2
PLACES = {"NEAR": (35.80, -117.60), "FAR": (36.60, -117.60), "DEAD": (35.81, -117.61)}


def response():
    """An accelerometer of 200 Hz, 70 % damping."""
    omega = 2 * np.pi * 200
    poles = [omega * (-0.7 + 0.714j), omega * (-0.7 - 0.714j)]
    units = {"input_units": "M/S**2", "output_units": "COUNTS"}
    factor = float(np.abs(np.prod(poles)))
    return Response.from_paz([], poles, COUNTS, 1.0, normalization_factor=factor, **units)


def inventory():
    stations = []
    for code, (latitude, longitude) in PLACES.items():
        also = {"sample_rate": 100, "response": response()}
        channels = [
            Channel(f"HN{c}", "", latitude, longitude, 0, 0, azimuth=azimuth, dip=dip, **also)
            for c, azimuth, dip in (("E", 90, 0), ("N", 0, 0), ("Z", 0, -90))
        ]
        stations.append(Station(code, latitude, longitude, 0, channels=channels))
    return Inventory([Network("XX", stations)], source="test")


def waveforms(code, start, end):
    """The burst, 20 s after the origin, on an offset of 5000 counts."""
    count = round((end - start) / STEP_S)
    at = round((ORIGIN + 20 - start) / STEP_S)
    burst = shaking(1000)
    stream = obspy.Stream()
    for axis, letter in enumerate("ENZ"):
        data = np.full(count, 5000.0)
        data[at : at + len(burst)] += burst[:, axis] * COUNTS
        header = {"network": "XX", "station": code, "channel": f"HN{letter}", "starttime": start}
        stream += obspy.Trace(np.round(data).astype(np.int32), header | {"delta": STEP_S})
    return stream


class Service:
    """What ObsPy's client of a service answers: each network with each station, as FDSN's queries mean it."""

    base_url = "a service"

    def __init__(self):
        self.asked, self.services = [], {"station": {"maxradius": {}}}

    def get_events(self, eventid):
        if eventid != "ev1":
            raise ValueError("no data")
        event = Event(
            origins=[Origin(time=ORIGIN, latitude=35.77, longitude=-117.60, depth=8000)],
            magnitudes=[Magnitude(mag=7.1)],
            event_descriptions=[EventDescription("Test Valley")],
        )
        return Catalog([event])

    def get_stations(self, network="XX", station=None, **asked):
        around = {name: asked[name] for name in ("latitude", "longitude", "maxradius") if name in asked}
        networks = []
        for code in network.split(","):
            (found,) = inventory().select(**around).networks
            chosen = [entry for entry in found if station is None or entry.code in station.split(",")]
            networks.append(Network(code, chosen))
        return Inventory(networks, source="test")

    def get_waveforms(self, network, station, location, channel, start, end):
        self.asked.append(f"{network}.{station}")
        if station == "DEAD" or network != "XX":
            raise ValueError("no data")
        return waveforms(station, start, end)


@pytest.fixture
def service(monkeypatch):
    monkeypatch.setattr("obspy.clients.fdsn.Client", lambda *_, **__: Service())
    return "SOMEWHERE"


def fetched(*arguments):
    return CliRunner().invoke(cli, ["records", "fetch", *map(str, arguments)])


def test_an_event_and_a_radius_give_the_near_stations_with_their_response_removed(service, tmp_path):
    result = fetched("--service", service, "--event", "ev1", "--radius", "40", "--out", tmp_path / "e")
    assert result.exception is None, result.output
    assert "no record of XX.DEAD" in result.output
    ensemble = Ensemble.load(tmp_path / "e")
    assert ensemble.record_ids == ["XX.NEAR.HN"]
    record = ensemble.record("XX.NEAR.HN")
    assert (record.event, record.magnitude, record.north_known) == ("Test Valley", 7.1, True)
    # 3.3 km along the meridian and 8 km down
    assert record.distance_km == pytest.approx(np.hypot(0.03 * 110.95, 8.0), rel=1e-3)
    peak = np.hypot(*shaking(1000)[:, :2].T).max()
    # the high-pass takes less than 2 % of a burst of 0.5 Hz and more
    assert record.intensity["pga_m_s2"] == pytest.approx(peak, rel=0.02)
    assert any("counts per m/s2" in step for step in record.history)
    assert sorted(p.suffix for p in (tmp_path / "e" / "raw").iterdir()) == [".csv", ".mseed", ".xml"]


def test_a_list_of_stations_and_a_window_do_without_an_event(service, tmp_path):
    window = ("--start", ORIGIN - 20, "--end", ORIGIN + 60)
    result = fetched("--service", service, "--stations", "XX.NEAR,XX.FAR", *window, "--out", tmp_path / "e")
    assert result.exception is None, result.output
    ensemble = Ensemble.load(tmp_path / "e")
    # both stations of this server record the same shaking: the second is left out as its twin
    assert ensemble.record_ids == ["XX.NEAR.HN"] or ensemble.record_ids == ["XX.FAR.HN"]
    states(result.output, "record.given_twice")
    assert ensemble.record(ensemble.record_ids[0]).magnitude is None


A_DAY = ("--start", "2019-07-06", "--end", "2019-07-07")


@pytest.mark.parametrize(
    ("arguments", "code", "named"),
    [
        (["--event", "ev2", "--radius", "40"], "fetch.no_answer", "'ev2'"),
        (["--stations", "XX.DEAD", *A_DAY], "fetch.no_stations", "DEAD"),
        (["--stations", "CLC", *A_DAY], "fetch.station_unreadable", "CLC"),
    ],
)
def test_what_the_service_does_not_have_is_stated(service, arguments, code, named, tmp_path):
    result = fetched("--service", service, *arguments, "--out", tmp_path / "e")
    states(str(result.exception), code, named)


def test_a_service_that_is_not_there_and_half_a_request_are_refused(tmp_path):
    away = fetched(
        "--service", "http://127.0.0.1:9", "--event", "a", "--radius", "1", "--out", tmp_path / "e"
    )
    assert away.exception.code == "fetch.no_answer"
    assert fetched("--radius", "10", "--out", tmp_path / "e").exit_code == 2
