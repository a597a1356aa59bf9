"""Headers of keys and values: ESM ASCII (Europe), UNAM's standard file (Mexico), CWB (Taiwan)."""

import re
from contextlib import suppress
from dataclasses import replace
from datetime import datetime
from itertools import zip_longest

import numpy as np
from numpy.typing import NDArray

from toppling.models.files.table import is_numeral
from toppling.models.motions.formats.component import Component, bearing, code_direction
from toppling.models.motions.formats.record_text import PRINTED_TIME_S, Counted, RecordText
from toppling.models.motions.formats.units import acceleration_m_s2, counted_unit
from toppling.models.motions.place import at_depth, place_in_name

_PROCESSED = {**dict.fromkeys(("", "none", "raw"), False), **dict.fromkeys(("manual", "automatic"), True)}
"""First words of ESM's PROCESSING, and whether the agency has corrected the record then."""
_UNAM_SAMPLES = re.compile(r"DATOS DE ACELERACION\s*(?::|$)")


class esm:  # noqa: N801  (a reader, as the modules are)
    """ESM ASCII, one component a file."""

    NAME = "ESM ASCII"

    @staticmethod
    def recognises(head: str) -> bool:
        """Whether the first key is the event's name, in any case."""
        upper = head.lstrip().upper()
        return bool(re.match(r"EVENT_NAME\s*:", upper)) and "SAMPLING_INTERVAL_S" in upper

    @staticmethod
    def read(file: RecordText) -> list[Component]:
        """Read one component."""
        lines = file.lines
        first = next(
            (i for i, line in enumerate(lines) if is_numeral(line.strip().replace(",", "."))), len(lines)
        )
        header = {
            key.strip().upper(): value.strip()
            for key, _, value in (line.partition(":") for line in lines[:first])
        }
        if header.get("DATA_TYPE", "").upper() != "ACCELERATION":
            what = f"DATA_TYPE is {header.get('DATA_TYPE', 'missing')}"
            file.refuse("record.not_acceleration", 0, what, "ACCELERATION", "give the file of acceleration")
        unit = acceleration_m_s2(header.get("UNITS", ""))
        if unit is None:
            file.refuse("record.unit_unknown", 0, f"UNITS is {header.get('UNITS')!r}", "cm/s^2")
        step = _number(file, header, "SAMPLING_INTERVAL_S")
        count = int(_number(file, header, "NDATA"))
        file.check_duration(0, _optional(header.get("DURATION_S")), count, step)
        found = file.counted(0, count, first)
        peak_cm_s2 = _optional(header.get("PGA_CM/S^2"))
        stream = header.get("STREAM", "")
        return [
            file.channel(
                first,
                found,
                unit,
                file.positive(0, step, "SAMPLING_INTERVAL_S"),
                direction=code_direction(stream[-1:]),
                file_format=esm.NAME,
                corrected=_PROCESSED.get(re.split(r"\W", header.get("PROCESSING", "").lower())[0]),
                stated_unit_m_s2=unit,
                place=at_depth(_optional(header.get("SENSOR_DEPTH_M")) or 0.0),
                event=header.get("EVENT_ID") or header.get("EVENT_NAME", ""),
                station=".".join(
                    filter(None, (header.get("NETWORK"), header.get("STATION_CODE"), header.get("LOCATION")))
                ),
                label=stream,
                magnitude=_optional(header.get("MAGNITUDE_W") or header.get("MAGNITUDE_L")),
                distance_km=_optional(header.get("EPICENTRAL_DISTANCE_KM")),
                series=stream[:-1],
                stated_peak_m_s2=None if peak_cm_s2 is None else 0.01 * abs(peak_cm_s2),
                start_s=_seconds(header.get("DATE_TIME_FIRST_SAMPLE_YYYYMMDD_HHMMSS", "")),
            )
        ]


class unam:  # noqa: N801
    """UNAM's standard acceleration file, all channels in columns."""

    NAME = "UNAM ASA"

    @staticmethod
    def recognises(head: str) -> bool:
        """Whether the title stands in the header."""
        return "ARCHIVO ESTANDAR DE ACELERACION" in head.upper()

    @staticmethod
    def read(file: RecordText) -> list[Component]:
        """Read all channels."""
        lines = file.lines
        at = next((i for i, line in enumerate(lines) if _UNAM_SAMPLES.match(line)), None)
        if at is None:
            file.refuse("record.no_samples", len(lines) - 1, "no 'DATOS DE ACELERACION:'", "samples")
        header = {
            key.strip(): value.strip() for key, _, value in (line.partition(" : ") for line in lines[:at])
        }
        unit = acceleration_m_s2(header.get("UNIDADES DE LOS DATOS", "").partition("(")[0])
        if unit is None:
            what = f"UNIDADES DE LOS DATOS is {header.get('UNIDADES DE LOS DATOS')!r}"
            file.refuse("record.unit_unknown", at, what, "Gal (cm/s/s)")
        labels = _slashed(header, "ORIENTACION C1-C6 (rumbo;orientacion)")
        steps = _slashed(header, "INTERVALO DE MUESTREO, C1-C6 (s)")
        counts = _slashed(header, "NUM. TOTAL DE MUESTRAS, C1-C6")
        if not labels or not (len(labels) == len(steps) == len(counts)) or len({*counts}) > 1:
            what = f"{len(labels)} orientations, {len(steps)} time steps, counts {', '.join(counts)}"
            file.refuse(
                "record.channels_contradicted", 0, what, "one of each for every channel, and one count"
            )
        words = ((i, lines[i].replace(",", ".").split()) for i in range(at + 1, len(lines)))
        first = next((i for i, row in words if row and all(map(is_numeral, row))), len(lines))
        count = int(RecordText(file.path, [counts[0]]).numbers(0)[0])
        found = file.counted(first, count, first, channels=len(labels))
        if len(found.values) % len(labels):
            file.refuse("record.row_wrong_length", first,
                f"{len(found.values)} numbers of {len(labels)} channels", "whole rows")  # fmt: skip
        table = found.values.reshape(-1, len(labels))
        steps_s = [float(RecordText(file.path, [text]).numbers(0)[0]) for text in steps]
        for step_s, text in zip(steps_s, _slashed(header, "DURACION DEL REGISTRO (s), C1-C6"), strict=False):
            file.check_duration(0, _optional(text), count, step_s)
        peaks = [_optional(text) for text in _slashed(header, "ACEL. MAX.(Gal), C1-C6")]
        moment = re.search(r"\bMw?\s*=\s*(\d\.\d+)", header.get("MAGNITUD(ES)", ""), re.IGNORECASE)
        return [
            file.channel(
                first,
                replace(found, values=table[:, channel]),
                unit,
                file.positive(0, steps_s[channel], "time step"),
                direction=bearing(label),
                file_format=unam.NAME,
                corrected=False,
                stated_unit_m_s2=unit,
                place=place_in_name(header.get("NOMBRE DE LA ESTACION", "")),
                event=f"{header.get('FECHA DEL SISMO [GMT]', '')} {header.get('HORA EPICENTRO (GMT)', '')}".strip(),
                station=header.get("CLAVE DE LA ESTACION", ""),
                label=label,
                magnitude=float(moment[1]) if moment else None,
                stated_peak_m_s2=0.01 * abs(peak) if peak is not None else None,
            )
            for channel, (label, peak) in enumerate(zip_longest(labels, peaks[: len(labels)]))
        ]


class cwb:  # noqa: N801
    """Taiwan's free-field files: time, up, north, east in columns."""

    NAME = "CWB"

    @staticmethod
    def recognises(head: str) -> bool:
        """Whether the header announces the sequence of its columns."""
        return "#StationCode:" in head.replace(" ", "") and "#SampleRate(Hz):" in head.replace(" ", "")

    @staticmethod
    def read(file: RecordText) -> list[Component]:
        """Read the three components."""
        lines = file.lines
        header = {
            key.replace(" ", ""): value.strip()
            for key, _, value in (line[1:].partition(":") for line in lines if line.startswith("#"))
        }
        found = re.findall(r"(Time)|([UNE])\(([+-])\)", header.get("DataSequence", ""))
        order, signs = [time or letter for time, letter, _ in found], [sign for *_, sign in found]
        unit = counted_unit(re.split(r"[.;]?\s+DC", header.get("AmplitudeUnit", ""))[0])
        if sorted(order) != ["E", "N", "Time", "U"] or unit is None or unit.quantity != "acceleration":
            what = f"DataSequence {header.get('DataSequence')!r} in {header.get('AmplitudeUnit')!r}"
            file.refuse("record.layout_unknown", 0, what, "Time U(+); N(+); E(+) in gal")
        first = max(i for i, line in enumerate(lines) if line.startswith("#")) + 1
        table = file.numbers(first)
        rate = file.positive(0, _number(file, header, "SampleRate(Hz)"), "SampleRate(Hz)")
        count = round(_number(file, header, "RecordLength(sec)") * rate)
        rows = len(table) // 4
        if len(table) % 4 or abs(rows - count) > 1:
            what = f"{len(table)} numbers where {count} rows of 4 are announced: truncated"
            file.refuse("record.count_contradicted", len(lines) - 1, what,
                f"{count} rows of time, up, north and east")  # fmt: skip
        table = table.reshape(rows, 4)
        _refuse_gap(file, first, table[:, order.index("Time")], 1 / rate)
        magnitude = next((value for key, value in header.items() if key.startswith("Magnitude")), None)
        return [
            file.channel(
                first,
                Counted(table[:, column]),
                float(f"{sign}1") * unit.factor,
                1 / rate,
                direction=bearing(letter),
                file_format=cwb.NAME,
                corrected=False,
                event=header.get("OriginTime(GMT+08)", ""),
                station=header.get("StationCode", ""),
                label=letter,
                magnitude=_optional(magnitude),
                stated_peak_m_s2=_cwb_peak(header.get(f"AmplitudeMAX.{letter}", ""), unit.factor),
            )
            for column, (letter, sign) in enumerate(zip(order, signs, strict=True))
            if sign
        ]


def _cwb_peak(extremes: str, unit_m_s2: float) -> float | None:
    """Size of the larger of '4.094~ -4.353' in m/s2; None where there are not two."""
    values = [_optional(text.strip()) for text in extremes.split("~")]
    return (
        unit_m_s2 * max(abs(value) for value in values if value is not None) if None not in values else None
    )


def _refuse_gap(file: RecordText, first: int, time: NDArray[np.float64], step: float) -> None:
    """Refuse rows whose times do not go on by the step: printed to a millisecond, they are off by as much."""
    wrong = np.flatnonzero(np.abs(np.diff(time) - step) > max(PRINTED_TIME_S, 0.5 * step))
    if len(wrong):
        before, after = time[wrong[0]], time[wrong[0] + 1]
        what = f"the time goes from {before:g} to {after:g} s where the step is {step:g} s"
        file.refuse("record.step_uneven", first + int(wrong[0]) + 1, what, "equal time steps")


def _slashed(header: dict[str, str], key: str) -> list[str]:
    """Values of '/a/b/c'."""
    return [part.strip() for part in header.get(key, "").lstrip("/").split("/") if part.strip()]


def _number(file: RecordText, header: dict[str, str], key: str) -> float:
    text = header.get(key, "").replace(",", ".")
    if not is_numeral(text):
        file.refuse("record.header_unreadable", 0, f"{key} is {text!r}", "a number")
    return float(text)


def _seconds(text: str) -> float | None:
    """Seconds since 1970 of '20190728_160919.870'; None of what is no time."""
    with suppress(ValueError):
        return datetime.fromisoformat(f"{text.replace('_', 'T')}+00:00").timestamp()
    return None


def _optional(text: str | None) -> float | None:
    """Read a number that may be missing."""
    return float(text) if text and is_numeral(text) else None
