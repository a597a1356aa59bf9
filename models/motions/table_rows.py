"""A row of the metadata table: its files, and what it says where they are silent."""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from toppling.models.motions.formats.component import UP, Component
from toppling.models.motions.metadata import Entry
from toppling.models.motions.stations import Triple, triple

_SAME_INSTRUMENT = 1.25
"""Factor within which the sensitivities of one instrument's channels lie."""

_SAME_UNIT = 1e-3
"""Share by which two statements of one unit differ at most: g is 9.81 or 980 gal to some."""

_SAME_STEP = 0.02
"""Share by which two statements of one time step differ at most: tables round it."""


def rows_given(table: Sequence[Entry], files: Sequence[Path]) -> list[tuple[Entry, list[Path]]]:
    """Rows of the table with those of their files that are given.

    Raises InputError if there are rows, and none of them names a file that is given.
    """
    place = {path.resolve(): path for path in files}
    rows = [
        (entry, paths)
        for entry in table
        if (paths := [place[found] for file in entry.files if (found := file.resolve()) in place])
    ]
    if table and not rows:
        looked_for = table[0].files[0]
        table[0].refuse(
            "metadata.no_file_given",
            f"none of the {len(table)} rows of the metadata table names a file that is given:"
            f" the first looks for {looked_for}",
            "paths relative to the folder of the table",
            "give this file or its folder too" if looked_for.exists() else "correct the paths in the table",
        )
    return rows


def channels_of_row(entry: Entry, here: Sequence[Path], channels: dict[Path, list[Component]]) -> Triple:
    """Channels of a metadata table's row, of whose files `here` were given, with what the row says of them.

    Raises InputError if a file that the row names was not given or not read, is named twice, or contradicts the
    row.
    """
    named = sum(map(bool, entry.names))
    if 1 < len(entry.files) < named:
        entry.refuse("metadata.file_repeated", f"the row names {len(entry.files)} files in {named} columns",
            "a file of its own for every component, or one file that holds all",
            "correct h1, h2 and v: two of them name the same file")  # fmt: skip
    given = {path.resolve(): path for path in here}
    parts: list[list[Component]] = []
    for file in entry.files:
        path = given.get(file.resolve())
        if path is None or path not in channels:
            entry.refuse(
                "metadata.file_not_given",
                f"{file} is not among the files given" if path is None else f"{path} could not be read",
                "every file that the row names",
                "give the file or its folder too" if path is None else "see what is said of this file",
            )
        parts.append(channels[path])
    together = triple(parts[0]) if len(parts) == 1 else Triple(*(_one(part, entry) for part in parts))
    return _completed(together, entry)


def _one(components: list[Component], entry: Entry) -> Component:
    if len(components) != 1:
        entry.refuse("metadata.several_channels", f"{components[0].path} holds {len(components)} channels",
            "one channel a file where h1, h2 and v are different files",
            "name the same file in h1, h2 and v")  # fmt: skip
    return components[0]


def _completed(channels: Triple, entry: Entry) -> Triple:
    """Channels with what the table says where the file is silent.

    Raises InputError if the table contradicts a header: a vertical as h1 or h2, a horizontal as v, another unit.
    """
    for name, component in zip(("h1", "h2", "v"), channels.channels, strict=False):
        _refuse_other_direction(name, component, entry)
        _refuse_other_unit(component, entry)

    def complete(component: Component, bearing: float | None) -> Component:
        values, known = component.acceleration_m_s2, component.unit_known
        if not known and entry.unit_m_s2 is not None:
            values, known = values * entry.unit_m_s2, True
        return replace(
            component,
            acceleration_m_s2=values,
            unit_known=known,
            time_step_s=_step(component, entry),
            direction=float(bearing % 360) if bearing is not None else component.direction,
            corrected=entry.corrected if entry.corrected is not None else component.corrected,
        )

    vertical = channels.vertical
    if vertical is not None:
        vertical = complete(vertical, None)
        if not isinstance(vertical.direction, str):
            vertical = replace(vertical, direction=UP)
    first, second = (
        complete(channels.first, entry.h1_azimuth_deg),
        complete(channels.second, entry.h2_azimuth_deg),
    )
    completed = Triple(first, second, vertical)
    return completed if completed.first.unit_known else _scaled_to_peaks(completed, entry)


def _refuse_other_direction(name: str, component: Component, entry: Entry) -> None:
    direction = component.direction
    if not isinstance(direction, float if name == "v" else str):
        return
    points = direction if isinstance(direction, str) else f"{direction:g} degrees from north"
    entry.refuse("metadata.direction_contradicted",
        f"the row names {component.path.name} in column {name}, and the file says that it points {points}",
        "two horizontals in h1 and h2, the vertical in v", "correct h1, h2 and v")  # fmt: skip


def _refuse_other_unit(component: Component, entry: Entry) -> None:
    by_name, by_row = component.stated_unit_m_s2, entry.unit_m_s2
    if by_name is None or by_row is None or math.isclose(by_name, by_row, rel_tol=_SAME_UNIT):
        return
    entry.refuse("record.unit_contradicted",
        f"the unit is {by_row:g} m/s2 by the row, and {by_name:g} m/s2 by {component.path.name}",
        "one unit of the samples",
        "correct the column 'unit', or leave it empty where the file states one")  # fmt: skip


def _scaled_to_peaks(channels: Triple, entry: Entry) -> Triple:
    """Counts, in a unit that nobody names: without their mean, scaled to the peaks that the table states.

    The channels of one instrument have nearly one sensitivity: the same scale of all shows that the peaks are
    those of these samples. Counts are as the instrument gave them, unless the table says otherwise.

    Raises InputError if the scales differ, by which the peaks are of other samples.
    """
    parts, scales = channels.channels, []
    centred = [c.acceleration_m_s2 - c.acceleration_m_s2.mean() for c in parts]
    for values, peak in zip(centred, entry.peaks_m_s2, strict=False):
        about_mean = float(np.abs(values).max())
        if not peak or peak < 0 or about_mean == 0:
            return channels
        scales.append(peak / about_mean)
    if max(scales) > _SAME_INSTRUMENT * min(scales):
        listed = ", ".join(f"{scale:.4g}" for scale in scales)
        entry.refuse("metadata.peaks_contradicted",
            f"the peaks that the table states scale the channels by {listed} m/s2",
            f"one scale within a factor of {_SAME_INSTRUMENT:g}, as one instrument has",
            "state the samples' unit in the column 'unit', or give the StationXML")  # fmt: skip
    note = (
        "mean removed, scaled to the peaks of the metadata table,"
        f" {1 / np.mean(scales):.6g} counts per m/s2 on average"
    )
    scaled = [
        replace(
            component,
            acceleration_m_s2=values * scale,
            unit_known=True,
            corrected=bool(component.corrected),
            notes=(*component.notes, note),
        )
        for component, values, scale in zip(parts, centred, scales, strict=True)
    ]
    return Triple(*scaled)


def _step(component: Component, entry: Entry) -> float:
    """Time step by the file, or by the table where the file has no times.

    Raises InputError if both state one, and they differ.
    """
    by_file, by_row = component.time_step_s, entry.time_step_s
    if not math.isfinite(by_file):
        return by_row if by_row and by_row > 0 else math.nan
    if by_row and not math.isclose(by_file, by_row, rel_tol=_SAME_STEP):
        entry.refuse("record.step_contradicted",
            f"the time step is {by_row:g} s by the row, and {by_file:g} s by {component.path.name}",
            "one time step of the samples",
            "correct the column 'dt' or the file, or leave 'dt' empty where the file states it")  # fmt: skip
    return by_file
