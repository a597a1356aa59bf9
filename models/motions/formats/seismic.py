"""Formats that ObsPy reads: K-NET, KiK-net, SAC, miniSEED and Kinemetrics, with StationXML where samples are counts."""

import io
import re
import warnings
from contextlib import suppress
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from toppling.models.errors import InputError
from toppling.models.files.given import text_of
from toppling.models.files.guarded import read_guarded
from toppling.models.motions.formats.component import (
    DOWN,
    UP,
    Component,
    bearing,
    check_samples,
    check_time_step,
    refuse_file,
)
from toppling.models.motions.formats.record_text import RecordText
from toppling.models.motions.formats.response import Converted, in_m_s2
from toppling.models.motions.measures import STANDARD_G_M_S2
from toppling.models.motions.place import BOREHOLE, FREE_FIELD, Place, at_depth, place_in_name

_NAME = "ObsPy"
FORMATS = ("MSEED", "SAC", "KINEMETRICS_EVT", "KNET")
"""Formats that are parsed, in ObsPy's order. Left to guess, ObsPy also tries PICKLE, which runs what the file says, and
formats whose files name others to be read (CSS, Q)."""
_KNET_DURATION_AT = 11
"""Line of the duration in K-NET's header, from 0."""
_NO_HEIGHT_M = -9999.0
"""K-NET's height of a station that is not known."""
_SAC_QUANTITIES = {5: "unknown", 6: "displacement", 7: "velocity", 8: "acceleration", 50: "volts"}
"""Quantities of SAC's `idep`."""
_SAME_STEP = 1e-6
"""Share by which the steps of two pieces of one trace may differ."""
_EPISENSOR = 32
"""Kinemetrics' number of its accelerometer."""
_KNET_UNIT = re.compile(rb"^Scale Factor\s+[\d.]+\s*\(gal\)\s*/", re.IGNORECASE | re.MULTILINE)
"""ObsPy takes the factor for one of gal, whatever unit is stated."""


def read(path: Path, inventory: Any | None) -> list[Component] | None:
    """Read every trace of a file, in m/s2; None if ObsPy knows no such format.

    inventory: responses for samples in counts.
    """
    import obspy

    headers, samples = read_guarded("toppling.models.motions.formats.seismic:parse", path, ["obspy"])
    if headers is None:
        return None
    traces = []
    for header, values in zip(headers, samples, strict=True):
        header["starttime"] = obspy.UTCDateTime(ns=header["starttime"])
        traces.append(obspy.Trace(values, header=header))
    return [_component(trace, messages, path, inventory) for trace, messages in _joined(traces, path)]


def parse(path: Path) -> tuple[list[dict[str, Any]] | None, list[np.ndarray]]:
    """Headers and samples of a file's traces, None if no format is recognised; called in the guarded process.

    ObsPy reads most formats in C.
    """
    import obspy

    content = path.read_bytes()
    with warnings.catch_warnings(record=True) as complaints:
        warnings.simplefilter("always")
        try:
            text = text_of(content)
            plain = content if text is None else text.encode()
            of = {name: io.BytesIO(plain if name == "KNET" else content) for name in FORMATS}
            file_format = next((name for name in FORMATS if recogniser(name)(of[name])), None)
            if file_format is None:
                return None, []
            of[file_format].seek(0)
            stream = obspy.read(
                of[file_format], format=file_format, apply_calib=False, check_compression=False
            )
        except MemoryError:
            raise
        except Exception as error:
            _unreadable(path, error)
    if file_format == "KNET" and not _KNET_UNIT.search(plain):
        refuse_file("record.unit_unknown", path, "the scale factor is not in gal",
            "'Scale Factor 2000(gal)/8388608'")  # fmt: skip
    messages = [str(item.message) for item in complaints if item.category.__module__.startswith("obspy")]
    if messages:
        _unreadable(path, messages[0])
    for trace in stream:
        if np.ma.isMaskedArray(trace.data):
            refuse_file("record.samples_missing", path, f"samples of {trace.id} are missing", "all samples")
        if trace.data.dtype.kind not in "iuf":
            refuse_file("record.no_samples", path, f"{trace.id} holds no numbers", "samples",
                "give the record's file")  # fmt: skip
    headers = [_header(trace.stats) for trace in stream]
    if file_format == "KINEMETRICS_EVT":
        whole = max(float(np.abs(trace.data).max(initial=0.0)) for trace in stream) > np.iinfo(np.int16).max
        for header, trace in zip(headers, stream, strict=True):
            header |= _of_kinemetrics(trace.stats.kinemetrics_evt, whole)
    return headers, [trace.data for trace in stream]


def _of_kinemetrics(header: Any, whole: bool) -> dict[str, Any]:
    """Metadata of a channel in a Kinemetrics file: its name, if any, and one count of an EpiSensor in m/s2.

    whole: whether samples have 24 bits, which the header's calibration is for.
    """
    name = str(header.get("chan_id") or "").strip()
    stated: dict[str, Any] = {"channel": name} if name else {}
    sensitivity_v_g, full_scale_v = (
        float(header.get(f"chan_{key}") or 0) for key in ("sensitivity", "fullscale")
    )
    if whole and header.get("chan_sensortype") == _EPISENSOR and sensitivity_v_g > 0 and full_scale_v > 0:
        stated["count_m_s2"] = STANDARD_G_M_S2 * full_scale_v / (2**23 * sensitivity_v_g)
    return stated


def _header(stats: Any) -> dict[str, Any]:
    """Entries of a trace's header that are used, in types of JSON."""
    header = {key: stats[key] for key in ("network", "station", "location", "channel")}
    header |= {"sampling_rate": float(stats.sampling_rate), "calib": float(stats.calib)}
    header |= {"_format": stats["_format"], "starttime": stats.starttime.ns}
    for name in ("knet", "sac"):
        if name in stats:
            header[name] = {key: _plain(value) for key, value in stats[name].items()}
    return header


def _plain(value: Any) -> str | float:
    """Value of a header as JSON says it: SAC's are NumPy's numbers, K-NET's are times too."""
    return float(value) if isinstance(value, int | float | np.number) else str(value)


@cache
def recogniser(file_format: str) -> Any:
    """ObsPy's function that tells by its content whether a file is of a format."""
    (found,) = entry_points(group=f"obspy.plugin.waveform.{file_format}", name="isFormat")
    return found.load()


def _unreadable(path: Path, error: object) -> NoReturn:
    refuse_file("record.damaged", path, f"ObsPy cannot read it ({error})",
        "a whole file of a format that ObsPy knows")  # fmt: skip


def _joined(stream: Any, path: Path) -> list[tuple[Any, tuple[str, ...]]]:
    """Traces by channel, joined from their pieces in a file, and warnings of that.

    Samples that came twice are merged if they are the same; pieces that meet within half a sample are joined.
    """
    if len(stream) == 0:
        refuse_file("record.no_samples", path, "no samples")
    pieces: dict[str, list[Any]] = {}
    for trace in stream:
        check_time_step(float(trace.stats.delta), str(path))  # by which pieces and responses divide
        pieces.setdefault(trace.id, []).append(trace)
    joined = []
    for traces in pieces.values():
        traces.sort(key=lambda trace: trace.stats.starttime)
        whole, *pieces_after = traces
        messages = [_append(whole, piece, path) for piece in pieces_after]
        joined.append((whole, tuple(filter(None, messages))))
    return joined


def _append(whole: Any, piece: Any, path: Path) -> str:
    """Append a piece to the trace that begins before it; returns a warning, empty where it fits."""
    step = whole.stats.delta
    if abs(piece.stats.delta / step - 1) > _SAME_STEP:
        what = f"{whole.id} has time steps of {step:g} and {piece.stats.delta:g} s"
        refuse_file("record.step_contradicted", path, what, "one time step")
    place = round((piece.stats.starttime - whole.stats.starttime) / step)
    overlap = len(whole.data) - place
    edges = sorted([whole.stats.endtime, piece.stats.starttime])
    where = f"from {edges[0]} to {edges[1]}"
    if overlap < 0:
        what = f"{whole.id} has a gap of {-overlap * step:g} s {where}"
        refuse_file("record.gap", path, what, "one unbroken record a channel",
            "cut the record before or after the gap")  # fmt: skip
    twice = min(overlap, len(piece.data))
    if not np.array_equal(whole.data[place : place + twice], piece.data[:twice]):
        what = f"{whole.id} overlaps itself by {twice * step:g} s with other samples {where}"
        refuse_file("record.overlap", path, what, "one unbroken record a channel",
            "leave one of the two pieces out")  # fmt: skip
    whole.data = np.concatenate([whole.data, piece.data[twice:]])
    return f"{twice} samples of {whole.id} came twice, the same: merged" if twice else ""


def _component(trace: Any, messages: tuple[str, ...], path: Path, inventory: Any | None) -> Component:
    stats = trace.stats
    values = np.asarray(trace.data, dtype=float)
    check_samples(values, stats.channel, str(path))  # before a removed response spreads what is not finite
    own = stats.get("knet") or stats.get("sac") or {}
    if "duration" in own:
        counted = round(float(own["duration"]) * stats.sampling_rate, 3)
        RecordText(path, ()).exactly(_KNET_DURATION_AT, values, counted)
    found = _in_m_s2(trace, values, inventory, path)
    direction, contradiction = _direction(stats, inventory)
    height_m = float(own.get("stel", _NO_HEIGHT_M))
    return Component(
        acceleration_m_s2=found.values,
        time_step_s=round(float(stats.delta), 9),
        direction=direction,
        path=path,
        line=0,
        file_format=stats.get("_format", _NAME),
        corrected=False,
        unit_known=found.known,
        event=f"{own['evot']}" if "evot" in own else "",
        station=".".join(part for part in (stats.network, stats.station, stats.location) if part),
        label=stats.channel,
        series=_series(stats),
        magnitude=float(own["mag"]) if "mag" in own else None,
        stated_peak_m_s2=0.01 * abs(float(own["accmax"])) if "accmax" in own else None,
        place=_place(stats, inventory),
        elevation_m=height_m if height_m > _NO_HEIGHT_M else None,
        start_s=float(stats.starttime.timestamp),
        notes=found.notes,
        warnings=(*messages, *found.warnings, *contradiction),
        no_unit=found.no_unit,
    )


def _place(stats: Any, inventory: Any | None) -> Place:
    """Place by KiK-net's channel (1 to 3 are at the base of the borehole, 4 to 6 at the surface), StationXML or SAC."""
    if stats.get("_format") == "KNET":
        return BOREHOLE if _series(stats) == "1" else FREE_FIELD
    if inventory is not None:
        with suppress(Exception):  # ObsPy raises Exception itself where it has no such channel
            codes = stats.network, stats.station, stats.location, stats.channel
            station = inventory.select(*codes, time=stats.starttime)[0][0]
            depth = at_depth(float(station[0].depth or 0.0))
            return place_in_name(station.site.name or "") if depth.free_field else depth
    return at_depth(float((stats.get("sac") or {}).get("stdp", 0.0)))


def _series(stats: Any) -> str:
    """Instrument of a station: KiK-net's 1 (borehole) or 2 (surface), SEED's band and instrument codes."""
    if stats.get("_format") == "KNET":
        return stats.channel.lstrip("ENSUDW")
    return stats.channel[:2] if len(stats.channel) == 3 else ""


def _in_m_s2(trace: Any, values: np.ndarray, inventory: Any | None, path: Path) -> Converted:
    stats = trace.stats
    kind = stats.get("_format", "")
    if kind == "KNET":
        return Converted(values * stats.calib, True, (f"calibration {stats.calib:.6g} m/s2 per count",))
    if count := stats.get("count_m_s2"):
        return Converted(values * count, True, (f"calibration {count:.6g} m/s2 per count",))
    if kind != "SAC":
        return Converted(values) if inventory is None else in_m_s2(trace, inventory, path)
    quantity = _SAC_QUANTITIES.get(int(stats.sac.get("idep", 5)), "of another quantity")
    if quantity not in {"acceleration", "unknown"}:
        what = f"idep is {stats.sac.idep:g}: the samples are {quantity}, not acceleration"
        refuse_file("record.not_acceleration", path, what, "acceleration (idep 8)",
            "differentiate it to acceleration first")  # fmt: skip
    silent = InputError(
        "record.unit_unknown",
        "SAC does not say in which unit its samples are",
        where=str(path),
        expected="a unit in the metadata table",
        remedy="give a metadata table with the column 'unit' (--metadata)",
    )
    return Converted(values, no_unit=silent)


def _direction(stats: Any, inventory: Any | None) -> tuple[float | str | None, tuple[str, ...]]:
    """Direction by StationXML, by SAC's header, by the channel's code, and a warning of a contradiction.

    SAC counts an inclination from the vertical, SEED a dip from the horizontal, and files have one where the other
    belongs: whether a channel is vertical is decided by its code where that says so.
    """
    code = stats.channel[-1:] if len(stats.channel) in (1, 3) else ""
    if stats.get("_format") == "KNET":
        return bearing(stats.channel.rstrip("12")), ()
    if stats.get("_format") == "KINEMETRICS_EVT":
        return (None if stats.channel.isdecimal() else bearing(stats.channel)), ()
    stated = _stated_direction(stats, inventory)
    by_code = bearing(code) if code in {"N", "E", "Z"} else None
    agree = stated is None or isinstance(stated[0], str) == (code == "Z")
    if stated is None or agree or code not in {"N", "E", "Z", "1", "2"}:
        return (stated[0] if stated else by_code), ()
    direction, azimuth, source = stated
    instead = UP if code == "Z" else azimuth if azimuth or code == "N" else by_code
    points = direction if isinstance(direction, str) else f"to {direction:g} degrees"
    return instead, (f"{source} points {points} against the channel code {stats.channel}: the code decides",)


def _stated_direction(stats: Any, inventory: Any | None) -> tuple[float | str, float | None, str] | None:
    """Direction, azimuth, and who states them; None where nobody does."""
    if inventory is not None:
        with suppress(Exception):  # ObsPy raises Exception itself where it has no such channel
            codes = (stats.network, stats.station, stats.location, stats.channel)
            found = inventory.get_orientation(".".join(codes), stats.starttime)
            azimuth = None if found["azimuth"] is None else float(found["azimuth"]) % 360
            if found["dip"] is not None and abs(found["dip"]) > 45:
                return (UP if found["dip"] < 0 else DOWN), azimuth, f"dip {found['dip']:g} of the StationXML"
            if azimuth is not None:
                return azimuth, azimuth, "the StationXML"
    sac = stats.get("sac")
    if not sac or "cmpinc" not in sac or "cmpaz" not in sac:
        return None
    inclination, azimuth = float(sac["cmpinc"]), float(sac["cmpaz"]) % 360
    source = f"cmpinc {inclination:g}"
    if abs(inclination - 90) > 45:
        return (UP if inclination < 45 else DOWN), azimuth, source
    return azimuth, azimuth, source
