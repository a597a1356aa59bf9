"""From counts to m/s2 by StationXML: which channel and epoch is meant, in which unit, and what its response does."""

import copy
import io
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from toppling.models.errors import InputError, refusals
from toppling.models.files.documents import listed
from toppling.models.files.given import LONGEST_NAME, bytes_given
from toppling.models.motions.formats.component import no_record, refuse_file
from toppling.models.motions.formats.units import Quantity, Unit, known_names, unit_of
from toppling.models.terminal import standard_error_to

_FLATNESS_BAND_HZ = (0.1, 20.0)
"""Band in which a response is looked at."""
_FLATNESS = 0.05
"""An accelerometer whose response varies less than this share over the band is divided by its sensitivity."""
SAME_GAIN = 1.25
"""Factor within which two statements of an instrument's sensitivity, and those of its channels, lie."""
_OBSPY_NAMES: dict[Quantity, str] = {"acceleration": "M/S**2", "velocity": "M/S", "displacement": "M"}
_OBSPY_OUTPUTS: dict[Quantity, str] = {"acceleration": "ACC", "velocity": "VEL", "displacement": "DISP"}
"""ObsPy only warns of units that it does not know and scales some of those it knows: it is given these alone."""


_no_response = refusals(
    expected="the response of this channel at the time of the record, with level=response",
    remedy="give the StationXML of this channel and time, or a metadata table with the column 'unit' (--metadata)",
)


@dataclass(frozen=True, eq=False)
class Converted:
    """Samples in m/s2 where `known`, else as they were; `no_unit` says why, if more can be said than silence."""

    values: NDArray[np.float64]
    known: bool = False
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    no_unit: InputError | None = None


def responses(path: Path) -> Any:
    """Inventory of a StationXML file.

    Raises InputError if it is not readable, with its name.
    """
    import obspy

    content = bytes_given(path, no_record).rstrip(b"\0\x1a\x0c \t\r\n")
    if b"<!DOCTYPE" in content or b"<!ENTITY" in content:
        what, expected = (
            "declares entities, which may name other files",
            "StationXML without a document type declaration",
        )
        refuse_file("document.has_entities", path, what, expected, "fetch it again with level=response")
    try:
        return obspy.read_inventory(io.BytesIO(content), format="STATIONXML")
    except Exception as error:
        what, expected = f"not readable as StationXML ({error})", "StationXML with the channels' responses"
        refuse_file("document.unreadable", path, what, expected, "fetch it again with level=response")


def is_station_xml(head: str) -> bool:
    """Whether this is how StationXML begins, with or without a prefix of its namespace."""
    return "FDSNStationXML" in head and "<" in head


def in_m_s2(trace: Any, inventory: Any, path: Path) -> Converted:
    """Acceleration from a trace's counts.

    Raises InputError if the channel's response is incomplete, contradicts itself or is in a unit outside of the
    closed list.
    """
    values = np.asarray(trace.data, float)
    try:
        channel = _channel_of(trace.stats, inventory, path)
    except InputError as error:
        return Converted(values, no_unit=error)
    try:
        return _converted(trace, values, channel.response, path)
    except InputError:
        raise
    except (ArithmeticError, LookupError, TypeError, ValueError, AttributeError) as error:
        _refuse_response("response.incomplete", f"the response of {trace.id} is incomplete ({error})", path)


def _converted(trace: Any, values: NDArray[np.float64], response: Any, path: Path) -> Converted:
    unit = _input_unit(response, trace.id, path)
    _refuse_what_is_not_evaluated(response, unit, trace.id, path)
    known = _in_si(response)
    sensitivity, warned = _checked_sensitivity(known, unit, trace, path)
    top = min(_FLATNESS_BAND_HZ[1], 0.4 / trace.stats.delta)
    if unit.quantity == "acceleration" and sensitivity is not None:
        flat = _is_flat(known, sensitivity, top)
        if flat is not False:
            per_m_s2 = sensitivity / unit.factor
            note = f"divided by the sensitivity, {per_m_s2:.6g} counts per m/s2"
            end = "" if flat else "; that its response is flat could not be checked"
            return Converted(values / per_m_s2, True, (note + end,), warned)
    work = trace.copy()
    work.stats.response = known
    nyquist = 0.5 / trace.stats.delta
    band = (0.01, 0.02, 0.8 * nyquist, 0.95 * nyquist)
    with _messages() as messages:
        try:
            work.remove_response(
                output="ACC", pre_filt=band, water_level=None, hide_sensitivity_mismatch_warning=True
            )
        except Exception as error:
            _refuse_response("response.not_removable",
                f"the response of {trace.id} cannot be removed ({error})", path)  # fmt: skip
    note = f"response removed between {band[1]:g} and {band[2]:g} Hz"
    warned = (*warned, *(f"of the response of {trace.id}: {text}" for text in messages))
    return Converted(np.asarray(work.data, float) * unit.factor, True, (note,), warned)


def _channel_of(stats: Any, inventory: Any, path: Path) -> Any:
    """Channel of an inventory with a response, of a trace's codes and time."""
    asked = stats.network, stats.station, stats.location, stats.channel
    name, every = (
        ".".join(asked),
        [((n.code, s.code, c.location_code, c.code), c) for n in inventory for s in n for c in s],
    )
    named = [(codes, c) for codes, c in every if codes == asked]
    found = [c for _, c in named if c.is_active(time=stats.starttime) and c.response is not None]
    if not found:
        nearest = named or [(codes, c) for codes, c in every if codes[:2] == asked[:2]] or every
        there = dict.fromkeys(
            f"{'.'.join(codes)} from {_day(c.start_date, 'the beginning')} to {_day(c.end_date, 'today')}"
            + ("" if c.response else " without its response")
            for codes, c in nearest
        )
        of = f"the StationXML has no response of {name} at {stats.starttime}"
        raise _no_response("response.missing", f"{of}: it has {listed(list(there)) or 'nothing'}", path)
    stated = [c.response.instrument_sensitivity for c in found if c.response.instrument_sensitivity]
    gains = [part.value for part in stated if part.value is not None]
    if gains and not np.allclose(gains, gains[0], rtol=1e-6):
        given = ", ".join(f"{gain:g}" for gain in gains)
        what = f"the StationXML has {name} twice at {stats.starttime}, sensitivities {given}"
        raise _no_response("response.given_twice", what, path)
    return found[0]


def _day(time: Any, otherwise: str) -> str:
    return str(time.date) if time is not None and time.year < 2200 else otherwise


def _refuse_response(
    code: str, what: str, path: Path, expected: str = "StationXML with a whole response"
) -> NoReturn:
    remedy = "fetch the StationXML with level=response, or correct it"
    refuse_file(code, path, what, expected, remedy)


def _input_unit(response: Any, name: str, path: Path) -> Unit:
    """Unit of the ground motion, which the sensitivity and the first stage state."""
    stages = response.response_stages
    first = min(stages, key=lambda stage: stage.stage_sequence_number) if stages else None
    sensitivity = response.instrument_sensitivity
    named = [part.input_units.strip() for part in (sensitivity, first) if part and part.input_units]
    if not any(named):
        _refuse_response("response.unit_missing",
            f"the StationXML does not say in which unit the response of {name} is", path)  # fmt: skip
    units = []
    for name_of_unit in filter(None, named):
        unit = unit_of(name_of_unit)
        if unit is None:
            _refuse_response("response.unit_unknown",
                f"the StationXML gives the response of {name} in {name_of_unit!r}, which is no unit of ground motion",
                path, expected=f"{known_names()}, or the same of velocity or displacement")  # fmt: skip
        units.append(unit)
    if units[0] != units[-1]:
        _refuse_response("response.unit_contradicted",
            f"the response of {name} is in {named[0]!r} and its first stage in {named[-1]!r}",
            path)  # fmt: skip
    return units[0]


def _refuse_what_is_not_evaluated(response: Any, unit: Unit, name: str, path: Path) -> None:
    from obspy.core.inventory.response import PolynomialResponseStage

    stages = response.response_stages
    if response.instrument_polynomial or any(isinstance(stage, PolynomialResponseStage) for stage in stages):
        _refuse_response("response.polynomial", f"the response of {name} is a polynomial", path,
            "poles and zeros, coefficients or a gain")  # fmt: skip
    stated = response.instrument_sensitivity
    if not stages and (unit.quantity != "acceleration" or stated is None or stated.value is None):
        sensor = f"a sensor of {unit.quantity}" if stated else "without a sensitivity"
        _refuse_response("response.stages_missing",
            f"the StationXML has no stages of the response of {name}, {sensor}", path)  # fmt: skip


def _in_si(response: Any) -> Any:
    """Response whose unit of ground motion has ObsPy's one name for it in SI; the factor to SI is ours to apply."""
    known = copy.deepcopy(response)
    stages = sorted(known.response_stages, key=lambda stage: stage.stage_sequence_number)
    for part in filter(None, (known.instrument_sensitivity, *stages)):
        for end in ("input_units", "output_units"):
            name = getattr(part, end)
            unit = unit_of(name) if name else None
            setattr(part, end, _OBSPY_NAMES[unit.quantity] if unit else name and name.strip().upper())
    if stages and not stages[0].input_units and known.instrument_sensitivity:
        stages[0].input_units = known.instrument_sensitivity.input_units
    return known


def _checked_sensitivity(
    response: Any, unit: Unit, trace: Any, path: Path
) -> tuple[float | None, tuple[str, ...]]:
    """Sensitivity, and a warning where the stages' gain at its frequency is another."""
    stated = response.instrument_sensitivity
    if stated is None or stated.value is None:
        return None, ()
    value = float(stated.value)
    if not np.isfinite(value) or value == 0:
        _refuse_response("response.sensitivity_unusable", f"the sensitivity of {trace.id} is {value:g}", path)
    nyquist = 0.5 / trace.stats.delta
    frequency = stated.frequency if stated.frequency and 0 < stated.frequency < nyquist else 1.0
    gain = _gain(response, np.array([float(frequency)]), _OBSPY_OUTPUTS[unit.quantity])
    if gain is None or not np.isfinite(gain[0]) or gain[0] == 0:
        return value, ()
    # Without its sign where the phase says none, as near a seismometer's corner.
    sign = np.sign(gain[0].real) if abs(gain[0].real) > 0.9 * abs(gain[0]) else np.sign(value)
    ratio = float(sign * abs(gain[0]) / value)
    stages = f"the stages of {trace.id} multiply to {sign * abs(gain[0]):.6g} at {frequency:g} Hz"
    difference = f"{stages}, its sensitivity is {value:.6g}"
    if not 1 / SAME_GAIN <= ratio <= SAME_GAIN:
        _refuse_response("response.sensitivity_contradicted", difference, path,
            f"a sensitivity within a factor of {SAME_GAIN:g} of what the stages make")  # fmt: skip
    return value, () if abs(ratio - 1) <= _FLATNESS else (difference,)


def _is_flat(response: Any, sensitivity: float, top_hz: float) -> bool | None:
    """Whether a response is its sensitivity in the band of earthquakes; None where it cannot be evaluated."""
    gain = _gain(response, np.geomspace(_FLATNESS_BAND_HZ[0], top_hz, 12), "ACC")
    return None if gain is None else bool(np.abs(np.abs(gain / sensitivity) - 1).max() <= _FLATNESS)


def _gain(response: Any, frequencies_hz: NDArray[np.float64], output: str) -> NDArray[np.complex128] | None:
    """Response at frequencies; None where it cannot be evaluated."""
    with _messages():
        try:
            return response.get_evalresp_response_for_frequencies(
                frequencies_hz, output=output, hide_sensitivity_mismatch_warning=True
            )
        except Exception:
            return None


@contextmanager
def _messages() -> Iterator[list[str]]:
    """Warnings of ObsPy, and output of evalresp, which is C: collected, because neither names the file."""
    messages: list[str] = []
    with warnings.catch_warnings(record=True) as caught, tempfile.TemporaryFile() as printed:
        warnings.simplefilter("always")
        collects = False
        try:
            with standard_error_to(printed.fileno()) as collects:
                yield messages
        finally:
            if collects:
                printed.seek(0)
                text = printed.read(10 * LONGEST_NAME).decode(errors="replace")
                unique = dict.fromkeys(str(warning.message) for warning in caught)
                messages.extend(
                    " ".join(message.split())[:LONGEST_NAME] for message in (text, *unique) if message.strip()
                )
