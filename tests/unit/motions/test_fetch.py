"""Records are fetched from a service that answers as those of FDSN do."""

import numpy as np
import obspy
import pytest
from click.testing import CliRunner
from motion_samples import STEP_S, shaking
from obspy.core.event import Catalog, Event, EventDescription, Magnitude, Origin
from obspy.core.inventory import Channel, Inventory, Network, Response, Station
from refusals import tells

from toppling.models.motions.ensemble import Ensemble
from toppling.orchestrator.cli import cli

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


def events():
    event = Event(
        origins=[Origin(time=ORIGIN, latitude=35.77, longitude=-117.60, depth=8000)],
        magnitudes=[Magnitude(mag=7.1)],
        event_descriptions=[EventDescription("Test Valley")],
    )
    return Catalog([event])


class Service:
    """What ObsPy's client of a service answers: each network with each station, as FDSN's queries mean it."""

    base_url = "a service"

    def __init__(self):
        self.asked, self.services = [], {"station": {"maxradius": {}}}

    def get_events(self, eventid):
        if eventid != "ev1":
            raise ValueError("no data")
        return events()

    def get_stations(self, network="XX", station=None, **asked):
        around = {name: asked[name] for name in ("latitude", "longitude", "maxradius") if name in asked}
        networks = []
        for code in network.split(","):
            (found,) = inventory().select(**around).networks
            chosen = [one for one in found if station is None or one.code in station.split(",")]
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


def run(*arguments):
    return CliRunner().invoke(cli, ["records", "fetch", *map(str, arguments)])


def test_an_event_and_a_radius_give_the_near_stations_with_their_response_removed(service, tmp_path):
    result = run("--service", service, "--event", "ev1", "--radius", "40", "--out", tmp_path / "e")
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
    result = run("--service", service, "--stations", "XX.NEAR,XX.FAR", *window, "--out", tmp_path / "e")
    assert result.exception is None, result.output
    ensemble = Ensemble.load(tmp_path / "e")
    # both stations of this server record the same shaking: the second is left out as its twin
    assert ensemble.record_ids == ["XX.NEAR.HN"] or ensemble.record_ids == ["XX.FAR.HN"]
    tells(result.output, "record.given_twice")
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
def test_what_the_service_does_not_have_is_said(service, arguments, code, named, tmp_path):
    result = run("--service", service, *arguments, "--out", tmp_path / "e")
    tells(str(result.exception), code, named)


def test_a_service_that_is_not_there_and_half_a_request_are_refused(tmp_path):
    away = run("--service", "http://127.0.0.1:9", "--event", "a", "--radius", "1", "--out", tmp_path / "e")
    assert away.exception.code == "fetch.no_answer"
    assert run("--radius", "10", "--out", tmp_path / "e").exit_code == 2
