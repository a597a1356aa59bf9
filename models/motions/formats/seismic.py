"""What ObsPy reads: K-NET and KiK-net, SAC, miniSEED and more, with StationXML where samples are counts."""

import io
import warnings
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from toppling.models.errors import InputError
from toppling.models.guarded import read_guarded
from toppling.models.motions.formats.component import DOWN, UP, Component, bearing, exactly, positive, refuse

NAME = "ObsPy"
FORMATS = (
    "MSEED", "SAC", "GSE2", "SEISAN", "SACXY", "GSE1", "SLIST", "TSPAIR", "WIN", "AH", "KINEMETRICS_EVT", "GCF",
    "KNET", "REFTEK130",
)  # fmt: skip
"""Formats that are parsed, in ObsPy's order. Left to guess, ObsPy also tries PICKLE, which runs what the file says, and
formats whose files name others to be read (CSS, Q)."""
KNET_DURATION_LINE = 12
MOST_SAMPLES = 10**9
FLATNESS_BAND_HZ = (0.1, 20.0)
FLATNESS = 0.05
"""An accelerometer whose response varies less than this share over the band is divided by its sensitivity."""


def read(path: Path, inventory: Any | None) -> list[Component] | None:
    """Read every trace of a file, in m/s2; None if ObsPy knows no such format.

    Parameters
    ----------
    path : Path
    inventory : obspy.Inventory or None
        Responses for samples in counts.
    """
    import obspy

    told, samples = read_guarded("toppling.models.motions.formats.seismic:parse", path, ["obspy"])
    if told is None:
        return None
    traces = []
    for header, values in zip(told, samples, strict=True):
        header["starttime"] = obspy.UTCDateTime(ns=header["starttime"])
        traces.append(obspy.Trace(values, header=header))
    stream = obspy.Stream(traces)
    _refuse_gaps(stream, path)
    return [_component(trace, path, inventory) for trace in stream]


def parse(path: Path) -> tuple[list[dict[str, Any]] | None, list[np.ndarray]]:
    """Headers and samples of a file's traces, None if no format is recognised; called in the guarded process.

    ObsPy reads most formats in C.
    """
    import obspy

    content = path.read_bytes()
    with warnings.catch_warnings(record=True) as complaints:
        warnings.simplefilter("always")
        try:
            file_format = next((name for name in FORMATS if _recogniser(name)(io.BytesIO(content))), None)
            if file_format is None:
                return None, []
            stream = obspy.read(
                io.BytesIO(content), format=file_format, apply_calib=False, check_compression=False
            )
        except MemoryError:
            raise
        except Exception as error:
            _unreadable(path, error)
    doubt = [str(item.message) for item in complaints if item.category.__module__.startswith("obspy")]
    if doubt:
        _unreadable(path, ValueError(doubt[0]))
    for trace in stream:
        if np.ma.isMaskedArray(trace.data):
            refuse(f"samples of {trace.id} are missing", path, expected="all samples")
        if trace.data.dtype.kind not in "iuf":
            refuse(f"{trace.id} holds no numbers", path, expected="samples", remedy="give the record's file")
    return [_header(trace.stats) for trace in stream], [trace.data for trace in stream]


def _header(stats: Any) -> dict[str, Any]:
    """What is used of a trace's header, as JSON says it."""
    header = {key: stats[key] for key in ("network", "station", "location", "channel")}
    header |= {
        "sampling_rate": float(stats.sampling_rate),
        "calib": float(stats.calib),
        "_format": stats["_format"],
    }
    header["starttime"] = stats.starttime.ns
    for name in ("knet", "sac"):
        if name in stats:
            header[name] = {key: _plain(value) for key, value in stats[name].items()}
    return header


def _plain(value: Any) -> str | float:
    """Value of a header as JSON says it: SAC's are NumPy's numbers, K-NET's are times too."""
    return float(value) if isinstance(value, int | float | np.number) else str(value)


@cache
def _recogniser(file_format: str) -> Any:
    """ObsPy's function that tells by its content whether a file is of a format."""
    (found,) = entry_points(group=f"obspy.plugin.waveform.{file_format}", name="isFormat")
    return found.load()


def responses(paths: list[Path]) -> Any | None:
    """One inventory of all StationXML files among `paths`; None if there is none."""
    import obspy

    together = None
    for path in paths:
        content = path.read_bytes()
        if b"<!DOCTYPE" in content or b"<!ENTITY" in content:
            raise InputError(
                "declares entities, which may name other files",
                where=str(path),
                expected="StationXML without a document type declaration",
                remedy="fetch it again with level=response",
            )
        try:
            inventory = obspy.read_inventory(io.BytesIO(content), format="STATIONXML")
        except Exception as error:
            raise InputError(
                f"not readable as StationXML ({error})",
                where=str(path),
                expected="StationXML with the channels' responses",
                remedy="fetch it again with level=response",
            ) from error
        together = inventory if together is None else together + inventory
    return together


def is_station_xml(head: str) -> bool:
    """Whether this is how StationXML begins."""
    return "<FDSNStationXML" in head


def _unreadable(path: Path, error: Exception) -> NoReturn:
    refuse(f"ObsPy cannot read it ({error})", path, expected="a whole file of a format that ObsPy knows")


def _refuse_gaps(stream: Any, path: Path) -> None:
    if len(stream) == 0:
        refuse("no samples", path, expected="a record")
    gaps = stream.get_gaps()
    if gaps:
        network, station, _, channel, start, end, seconds, _ = gaps[0]
        refuse(
            f"{network}.{station} {channel} has a gap of {seconds:g} s from {start} to {end}",
            path,
            expected="one unbroken record a channel",
            remedy="cut the record before or after the gap",
        )


def _component(trace: Any, path: Path, inventory: Any | None) -> Component:
    stats = trace.stats
    values = np.asarray(trace.data, dtype=float)
    bad = np.flatnonzero(~np.isfinite(values))
    if len(bad):
        refuse(f"sample {int(bad[0])} of {trace.id} is not finite", path, expected="finite samples")
    step = positive(float(stats.delta), "time step", path, 0)
    own = stats.get("knet") or stats.get("sac") or {}
    if "duration" in own:
        exactly(values, _counted(float(own["duration"]), step, path), path, KNET_DURATION_LINE)
    values, note, known = _in_m_s2(trace, values, inventory, path)
    return Component(
        acceleration_m_s2=values,
        time_step_s=round(step, 9),
        direction=_direction(stats, inventory),
        path=path,
        line=0,
        file_format=stats.get("_format", NAME),
        corrected=False,
        unit_known=known,
        event=f"{own['evot']}" if "evot" in own else "",
        station=".".join(part for part in (stats.network, stats.station, stats.location) if part),
        label=stats.channel,
        series=_series(stats),
        magnitude=float(own["mag"]) if "mag" in own else None,
        start_s=float(stats.starttime.timestamp),
        notes=(note,) if note else (),
    )


def _counted(duration_s: float, step_s: float, path: Path) -> int:
    """Samples that K-NET's header announces: its files lack the end, or lines in between, where there are others."""
    count = duration_s / step_s
    if not 0 < count < MOST_SAMPLES:
        refuse(
            f"the header's duration is {duration_s:g} s",
            path,
            KNET_DURATION_LINE,
            expected="the duration of the samples",
        )
    return round(count)


def _series(stats: Any) -> str:
    """Instrument of a station: KiK-net's 1 (borehole) or 2 (surface), SEED's band and instrument codes."""
    if stats.get("_format") == "KNET":
        return stats.channel.lstrip("ENSUDW")
    return stats.channel[:2] if len(stats.channel) == 3 else ""


def _in_m_s2(
    trace: Any, values: np.ndarray, inventory: Any | None, path: Path
) -> tuple[np.ndarray, str, bool]:
    stats = trace.stats
    kind = stats.get("_format", "")
    if kind == "KNET":
        return values * stats.calib, f"calibration {stats.calib:.6g} m/s2 per count", True
    if kind == "SAC":  # the header names the quantity but never its unit
        if int(stats.sac.get("idep", 8)) not in {5, 8}:
            refuse(
                f"idep is {stats.sac.idep}: not acceleration",
                path,
                expected="acceleration (idep 8)",
                remedy="differentiate it to acceleration first",
            )
        return values, "", False
    if inventory is None:
        return values, "", False
    return _without_response(trace, inventory, path)


def _without_response(trace: Any, inventory: Any, path: Path) -> tuple[np.ndarray, str, bool]:
    try:
        response = inventory.get_response(trace.id, trace.stats.starttime)
    except Exception:
        return np.asarray(trace.data, float), "", False
    sensitivity = response.instrument_sensitivity
    units = (sensitivity.input_units or "").upper() if sensitivity else ""
    top = min(FLATNESS_BAND_HZ[1], 0.4 / trace.stats.delta)
    flat = (
        _is_flat(response, sensitivity.value, top) if units in {"M/S**2", "M/S^2", "M/S/S", "M/S2"} else False
    )
    if flat is not False:
        values = np.asarray(trace.data, float) / sensitivity.value
        note = f"divided by the sensitivity, {sensitivity.value:.6g} counts per m/s2"
        return values, note if flat else f"{note}; that its response is flat could not be checked", True
    work = trace.copy()
    nyquist = 0.5 / trace.stats.delta
    band = (0.01, 0.02, 0.8 * nyquist, 0.95 * nyquist)
    try:
        work.remove_response(inventory=inventory, output="ACC", pre_filt=band, water_level=None)
    except Exception as error:
        refuse(
            f"the response of {trace.id} cannot be removed ({error})",
            path,
            expected="StationXML with a whole response",
            remedy="fetch the StationXML with level=response",
        )
    return np.asarray(work.data, float), f"response removed between {band[1]:g} and {band[2]:g} Hz", True


def _is_flat(response: Any, sensitivity: float, top_hz: float) -> bool | None:
    """Whether a response is its sensitivity in the band of earthquakes; None where it cannot be evaluated."""
    try:
        frequencies = np.geomspace(FLATNESS_BAND_HZ[0], top_hz, 12)
        gain = np.abs(response.get_evalresp_response_for_frequencies(frequencies, output="ACC"))
    except Exception:
        return None
    return bool(np.abs(gain / sensitivity - 1).max() <= FLATNESS)


def _direction(stats: Any, inventory: Any | None) -> float | str | None:
    if inventory is not None:
        try:
            orientation = inventory.get_orientation(
                f"{stats.network}.{stats.station}.{stats.location}.{stats.channel}", stats.starttime
            )
            if orientation["dip"] is not None and abs(orientation["dip"]) > 45:
                return UP if orientation["dip"] < 0 else DOWN
            if orientation["azimuth"] is not None:
                return float(orientation["azimuth"])
        except Exception:
            pass
    sac = stats.get("sac")
    if sac and "cmpinc" in sac and "cmpaz" in sac:
        if abs(float(sac["cmpinc"]) - 90) > 45:
            return UP if float(sac["cmpinc"]) < 45 else DOWN
        return float(sac["cmpaz"]) % 360
    if stats.get("_format") == "KNET":
        return bearing(stats.channel.rstrip("12"))
    return bearing(stats.channel[-1:]) if stats.channel[-1:] in {"N", "E", "Z"} else None
