"""Records from FDSN web services: fetched once with their responses, stored with the ensemble, imported."""

import csv
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from toppling.models.errors import InputError
from toppling.models.files.table import plain

_BEFORE_S = 30.0
"""Time before the origin at which a window begins, s."""
_SLOWEST_KM_S = 2.0
"""Speed of the slowest waves that a window holds."""
_AFTER_S = 120.0
"""Time from their arrival to the end of a window, s."""
_BANDS = ("HN", "HL", "BN", "EN", "HG")
"""Accelerometers' bands, the preferred first."""
_TABLE = "metadata.csv"


@dataclass(frozen=True)
class Source:
    """An earthquake as a service knows it."""

    name: str
    magnitude: float | None
    time: Any
    latitude: float
    longitude: float
    depth_km: float


@dataclass(frozen=True)
class Fetched:
    """Result of a fetch: files, a metadata table for them, and why other stations are missing."""

    files: list[Path]
    table: Path
    missing: list[str]


def utc(text: str, where: str) -> Any:
    """Time of a text such as 2019-07-06T03:19:23.

    Raises InputError if it is none.
    """
    from obspy import UTCDateTime

    try:
        return UTCDateTime(text)
    except (TypeError, ValueError) as error:
        raise InputError(
            "fetch.time_unreadable",
            f"{text!r} is no time",
            where=where,
            expected="2019-07-06T03:19:23",
            remedy="give date and time in UTC",
        ) from error


@contextmanager
def _answering(service: str, what: str, expected: str, remedy: str) -> Iterator[None]:
    """Say what a service does not answer; ObsPy raises what it pleases."""
    try:
        yield
    except Exception as error:
        raise InputError(
            "fetch.no_answer", f"{what} ({_brief(error)})", where=service, expected=expected, remedy=remedy
        ) from error


def connect(service: str) -> Any:
    """Client of a service, by ObsPy's short name for it or by its address.

    Raises InputError if there is no such service, or it does not answer.
    """
    from obspy.clients.fdsn import Client

    remedy = "name one that ObsPy knows (EARTHSCOPE, SCEDC, GEONET, INGV ...) or give its address"
    with _answering(service, "no answer", "an FDSN web service", remedy):
        return Client(service, timeout=60)


def find_event(client: Any, event_id: str) -> Source:
    """Origin and magnitude of an event by its id at the service.

    Raises InputError if the service does not know it.
    """
    remedy = "look the id up in the service's catalogue"
    with _answering(client.base_url, f"no event {event_id!r}", "an event id of this service", remedy):
        event = client.get_events(eventid=event_id)[0]
    origin = event.preferred_origin() or event.origins[0]
    magnitude = event.preferred_magnitude() or (event.magnitudes[0] if event.magnitudes else None)
    name = event.event_descriptions[0].text if event.event_descriptions else event_id
    return Source(
        name=name,
        magnitude=float(magnitude.mag) if magnitude else None,
        time=origin.time,
        latitude=float(origin.latitude),
        longitude=float(origin.longitude),
        depth_km=float(origin.depth or 0.0) / 1000,
    )


def fetch(
    client: Any,
    folder: Path,
    *,
    event: Source | None = None,
    radius_km: float | None = None,
    stations: Sequence[str] = (),
    window: tuple[Any, Any] | None = None,
    advance: Callable[[int], None] = lambda _: None,
) -> Fetched:
    """Fetch three components and their responses of every station asked for.

    folder: Where the files go: miniSEED and StationXML by station, and a metadata table.
    event: sets the window and gives magnitude and distance.
    radius_km: all stations so near to the event's epicentre.
    stations: as `NET.STA`.
    window: start and end where no event is given.
    advance: Called with the number of stations before the first, then with 0 after each.
    Raises InputError if the service knows none of the stations, or none has data.
    """
    inventory = _inventory(client, event, radius_km, stations, window)
    found = [(network.code, station) for network in inventory for station in network]
    if stations:  # services combine every network with every station
        found = [
            (code, station)
            for code, station in found
            if any(fnmatchcase(f"{code}.{station.code}", pair) for pair in stations)
        ]
    elif event is not None and radius_km is not None:
        found = [(code, station) for code, station in found if _epicentral_km(event, station) <= radius_km]
    advance(len(found))
    folder.mkdir(parents=True, exist_ok=True)
    asked = _Asked(client, folder, inventory, event, window)
    rows, files, missing = [], [], []
    for network, station in found:
        try:
            row, written = _station(asked, network, station)
            rows.append(row)
            files.extend(written)
        except _NothingError as reason:
            missing.append(f"{network}.{station.code}: {reason}")
        advance(0)
    return Fetched(files, _write_table(rows, asked, missing), missing)


@dataclass(frozen=True)
class _Asked:
    """Request to a service, and the folder for its answers."""

    client: Any
    folder: Path
    inventory: Any
    event: Source | None
    window: tuple[Any, Any] | None


def _write_table(rows: list[dict[str, Any]], asked: _Asked, missing: list[str]) -> Path:
    if not rows:
        raise InputError(
            "fetch.no_stations",
            f"none of {len(missing)} stations has three components ({'; '.join(missing[:3])})",
            where=asked.client.base_url,
            expected="waveforms of accelerometers",
            remedy="widen the radius or the window, or ask another service",
        )
    table = asked.folder / _TABLE
    with table.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, fieldnames=list(rows[0]))
        writer.writeheader()
        writer.writerows({key: plain(value) for key, value in row.items()} for row in rows)
    return table


class _NothingError(Exception):
    """A station that has nothing to give."""


def _inventory(
    client: Any, event: Source | None, radius_km: float | None, stations: Sequence[str], window: tuple | None
) -> Any:
    asked: dict[str, Any] = {"level": "response", "channel": ",".join(f"{band}?" for band in _BANDS)}
    if stations:
        pairs = [station.split(".") for station in stations]
        if any(len(pair) != 2 for pair in pairs):
            raise InputError(
                "fetch.station_unreadable",
                f"stations {', '.join(stations)}",
                where="--stations",
                expected="NET.STA, separated by commas",
                remedy="for example CI.CLC,CI.CCC",
            )
        networks, codes = (",".join(dict.fromkeys(part)) for part in zip(*pairs, strict=True))
        asked |= {"network": networks, "station": codes}
    elif event is not None and radius_km is not None:
        asked |= _around(client, event, radius_km)
    if window is not None:
        asked |= {"starttime": window[0], "endtime": window[1]}
    elif event is not None:
        asked |= {"starttime": event.time, "endtime": event.time + _AFTER_S}
    remedy = "widen the radius, or check the stations' codes"
    with _answering(client.base_url, "no stations", "stations with accelerometers", remedy):
        return client.get_stations(**asked)


def _around(client: Any, event: Source, radius_km: float) -> dict[str, float]:
    """Query for a circle, or for the box around it where the service knows no circle."""
    from obspy.geodetics import kilometer2degrees

    radius = kilometer2degrees(radius_km)
    if "maxradius" in client.services.get("station", {}):
        return {"latitude": event.latitude, "longitude": event.longitude, "maxradius": radius}
    wide = radius / max(math.cos(math.radians(event.latitude)), 0.01)
    return {
        "minlatitude": event.latitude - radius,
        "maxlatitude": event.latitude + radius,
        "minlongitude": event.longitude - wide,
        "maxlongitude": event.longitude + wide,
    }


def _station(asked: _Asked, network: str, station: Any) -> tuple[dict[str, Any], list[Path]]:
    """Write one station's files; its row of the metadata table, and the files."""
    location, band = _instrument(station)
    event, window, distance = asked.event, asked.window, None
    if event is not None:
        distance = math.hypot(_epicentral_km(event, station), event.depth_km)
        until = event.time + distance / _SLOWEST_KM_S + _AFTER_S
        window = window or (event.time - _BEFORE_S, until)
    assert window is not None  # one of the two is asked for
    try:
        stream = asked.client.get_waveforms(network, station.code, location or "--", f"{band}?", *window)
    except Exception as error:
        raise _NothingError(_brief(error)) from error
    name = ".".join(part for part in (network, station.code, location, band) if part)
    waveform, response = asked.folder / f"{name}.mseed", asked.folder / f"{name}.xml"
    stream.merge(method=-1)
    stream.write(str(waveform), format="MSEED")
    asked.inventory.select(network=network, station=station.code).write(str(response), format="STATIONXML")
    row = {
        "record_id": name,
        "event": event.name if event else "",
        "station": f"{network}.{station.code}",
        "mag": "" if event is None or event.magnitude is None else event.magnitude,
        "dist_km": "" if distance is None else round(distance, 2),
    }
    return row | dict.fromkeys(("h1", "h2", "v"), waveform.name), [waveform, response]


def _instrument(station: Any) -> tuple[str, str]:
    """Location and band code of the station's preferred accelerometer with three components."""
    count: dict[tuple[str, str], set[str]] = {}
    for channel in station:
        count.setdefault((channel.location_code, channel.code[:2]), set()).add(channel.code[2:])
    whole = [key for key, letters in count.items() if len(letters) >= 3 and key[1] in _BANDS]
    if not whole:
        raise _NothingError("no accelerometer with three components")
    return min(whole, key=lambda key: (_BANDS.index(key[1]), key[0]))


def _epicentral_km(event: Source, station: Any) -> float:
    from obspy.geodetics import gps2dist_azimuth

    metres = gps2dist_azimuth(event.latitude, event.longitude, station.latitude, station.longitude)[0]
    return float(metres / 1000)


def _brief(error: Exception) -> str:
    return str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
