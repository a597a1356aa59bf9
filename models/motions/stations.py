"""From channels to records: which belong together, which way they point, where they begin and end."""

import re
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from toppling.models.errors import InputError, counted
from toppling.models.motions.formats.component import DOWN, UP, Component, bearing, code_direction
from toppling.models.motions.motion import Motion

_LEAST_ANGLE_DEG = 30.0
"""Two horizontals closer than this to one line cannot be resolved into x and y."""
SAME_SHAKING_S = 60.0
"""Channels of one station that start farther apart than this belong to different records."""
_STEP_TOLERANCE = 1e-3
"""Share by which the time steps of the components of one record may differ."""
_COMMON_LENGTH = 0.8
"""Components that share less than this of the longest are not cut to what they share, but refused."""
_NAME = re.compile(
    r"^(?P<series>.*?)[._\- ]*"
    r"(?P<label>(?:[A-Z][GHLN])?[ENZ]|NS\d?|EW\d?|UD\d?|UP|DWN|(?<![A-Z\d])(?:EO|[NS]\d{1,2}[EW])|VERT(?:ICAL)?|[LTV]|H1|H2|\d{3})$",
    re.IGNORECASE,
)


@dataclass(frozen=True, eq=False)
class Triple:
    """Two horizontal channels and, if there is one, the vertical."""

    first: Component
    second: Component
    vertical: Component | None = None

    @property
    def channels(self) -> tuple[Component, ...]:
        """All channels, horizontals first."""
        return tuple(c for c in (self.first, self.second, self.vertical) if c is not None)


def grouped(components: Iterable[Component]) -> list[list[Component]]:
    """Channels by station: by what the header says, by the file's name where it says nothing."""
    groups: dict[tuple, list[Component]] = defaultdict(list)
    series: dict[Path, str] = {}  # all columns of a file are of the same
    for component in components:
        of_file = series.setdefault(component.path, _name_series(component)[0])
        groups[_key(component, of_file)].append(component)
    return [part for group in groups.values() for part in _apart(group)]


def triple(group: Sequence[Component]) -> Triple:
    """Find the horizontals and the vertical of one station.

    Horizontals that no bearing distinguishes are in the order of their labels: X before Y, H1 before H2.

    Raises InputError if there are not exactly two horizontal channels and at most one vertical.
    """
    vertical = [c for c in group if _direction(c) in (UP, DOWN)]
    horizontal = [c for c in group if _direction(c) not in (UP, DOWN)]
    if not _may_be_record(group):
        raise InputError(
            "record.channels_unmatched",
            f"{counted(len(group), 'channel')} ({', '.join(c.label or c.path.name for c in group)}):"
            f" {len(horizontal)} horizontal and {len(vertical)} vertical",
            where=", ".join(dict.fromkeys(str(c.path) for c in group)),
            expected="two horizontal channels and one vertical",
            remedy="give the missing files, or name h1, h2 and v in the metadata table"
            if len({c.path for c in group}) > 1 or len(group) < 3
            else "export each channel as a file of its own, and name them h1, h2 and v in the metadata table",
        )
    if not any(isinstance(_direction(c), float) for c in horizontal):
        horizontal.sort(key=lambda c: c.label or _name_series(c)[1])
    return Triple(*horizontal, *vertical)


def oriented(channels: Triple) -> tuple[Motion, tuple[float, float] | None, tuple[str, ...]]:
    """Motion in x east, y north, z up from three channels.

    Horizontals of known bearing are resolved, at any angle between them from 30 degrees up; of unknown
    bearing, the first is x and the second y.

    Returns azimuths: azimuths of the recorded horizontals, degrees counter-clockwise from x; None where unknown.
    Raises InputError if time steps differ, the components have no time in common or share too little of it, or the
    horizontals lie along one line.
    """
    step, series, history = _aligned(channels)
    bearings = _direction(channels.first), _direction(channels.second)
    azimuths = None
    names = {
        _name_series(c)[0] for c in (channels.first, channels.second) if c.direction is None and not c.label
    }
    if isinstance(bearings[0], float) and isinstance(bearings[1], float) and len(names) < 2:
        azimuths = ((90.0 - bearings[0]) % 360.0, (90.0 - bearings[1]) % 360.0)
        angle = np.deg2rad(azimuths)
        if abs(np.sin(angle[1] - angle[0])) < np.sin(np.deg2rad(_LEAST_ANGLE_DEG)):
            channels.first.refuse("record.horizontals_parallel",
                f"the horizontals point to {bearings[0]:g} and {bearings[1]:g} degrees, nearly on one line",
                f"at least {_LEAST_ANGLE_DEG:g} degrees between them",
                "correct the azimuths in the header or in the metadata table")  # fmt: skip
        axes = np.column_stack([np.cos(angle), np.sin(angle)])
        x, y = np.linalg.solve(axes, series[:2])
        history.append(
            f"horizontals at {bearings[0]:g} and {bearings[1]:g} degrees from north turned to x and y"
        )
    else:
        x, y = series[0], series[1]
        history.append("azimuths unknown: first horizontal as x, second as y")
    if channels.vertical is None:
        z = np.zeros_like(x)
        history.append("no vertical component: zero")
    else:
        z = series[2]
        if _direction(channels.vertical) == DOWN:
            z = -z
            history.append("vertical is positive down in the file: sign turned")
    return Motion(np.column_stack([x, y, z]), step), azimuths, tuple(history)


def _name_series(component: Component) -> tuple[str, str]:
    """Series and component label that a file's name holds, such as ('..._HWA036', 'E')."""
    match = _NAME.match(component.path.stem)
    suffix = bearing(component.path.suffix.lstrip("."))
    if component.path.suffix and suffix is not None:
        return component.path.stem, component.path.suffix.lstrip(".")
    if match is None and component.direction is not None:
        # Files that are numbered, and say which way they point.
        return component.path.stem.rstrip("0123456789._- "), ""
    return (match["series"], match["label"]) if match else (component.path.stem, "")


def _direction(component: Component) -> float | str | None:
    """Direction by header, then by the file's name; a label such as HNE counts by its last letter."""
    if component.direction is not None or component.label:
        return component.direction
    return code_direction(_name_series(component)[1])


def _key(component: Component, series: str) -> tuple:
    if component.station:
        return component.file_format, component.event, component.station, component.series, component.place
    return component.file_format, str(component.path.parent), series, component.place


def _apart(group: list[Component]) -> list[list[Component]]:
    """Tell apart records of one station and event that are given twice: by file, start, folder or name."""
    if len(group) <= 3:
        return [group]
    for key in (lambda c: c.path, lambda c: c.path.parent, lambda c: (c.path.parent, _name_series(c)[0])):
        parts: dict[object, list[Component]] = defaultdict(list)
        for component in group:
            parts[key(component)].append(component)
        if len(parts) > 1 and all(map(_may_be_record, parts.values())):
            return list(parts.values())
    return _by_start(group)


def _may_be_record(group: Sequence[Component]) -> bool:
    """Whether channels are two horizontals, and a vertical if there is one."""
    vertical = sum(_direction(component) in (UP, DOWN) for component in group)
    return len(group) - vertical == 2 and vertical <= 1


def _by_start(group: list[Component]) -> list[list[Component]]:
    if any(c.start_s is None for c in group):
        return [group]
    ordered = sorted(group, key=lambda c: c.start_s or 0.0)
    parts = [[ordered[0]]]
    for component in ordered[1:]:
        if (component.start_s or 0.0) - (parts[-1][-1].start_s or 0.0) > SAME_SHAKING_S:
            parts.append([])
        parts[-1].append(component)
    return parts


def _aligned(channels: Triple) -> tuple[float, np.ndarray, list[str]]:
    """Cut channels to their common span: time step, channels (k, n), and what was done."""
    parts = channels.channels
    _refuse_lost_rows(parts)
    step = parts[0].time_step_s
    for component in parts[1:]:
        if abs(component.time_step_s / step - 1) > _STEP_TOLERANCE:
            component.refuse("record.step_contradicted",
                f"the time step is {component.time_step_s:g} s, that of {parts[0].path.name} is {step:g} s",
                "one time step for all components", "resample the components to one step first")  # fmt: skip
    silent = [c for c in parts if c.start_s is None]
    latest = max((c.start_s for c in parts if c.start_s is not None), default=0.0)
    skip = [round((latest - (latest if c.start_s is None else c.start_s)) / step) for c in parts]
    if any(skip) and silent:
        silent[0].refuse("record.start_missing",
            "the file does not say when it begins, and the others begin at different times",
            "the time of the first sample in the file of every component",
            "cut all components to one beginning first")  # fmt: skip
    count = min(len(c.acceleration_m_s2) - s for c, s in zip(parts, skip, strict=True))
    if count < 2:
        parts[0].refuse("record.no_common_time", "the components have no time in common",
            "components of one shaking",
            "name the components that belong together in the metadata table")  # fmt: skip
    history = []
    lengths = [len(c.acceleration_m_s2) for c in parts]
    if count < _COMMON_LENGTH * max(lengths):
        parts[lengths.index(min(lengths))].refuse("record.lengths_differ",
            f"components of {', '.join(map(str, lengths))} samples share {count}: one seems truncated",
            f"components that share {_COMMON_LENGTH:.0%} of the longest",
            "fetch the short one again, or cut all to one length first")  # fmt: skip
    if len(set(lengths)) > 1 or any(skip):
        history.append(f"components of {', '.join(map(str, lengths))} samples cut to the {count} they share")
    series = np.stack([c.acceleration_m_s2[s : s + count] for c, s in zip(parts, skip, strict=True)])
    return step, series, history


def _refuse_lost_rows(parts: Sequence[Component]) -> None:
    """Refuse a component that lacks what its header counts where another has as much: its rows are shifted."""
    whole = max((len(c.acceleration_m_s2) for c in parts if not c.missing), default=0)
    for component in parts:
        count = len(component.acceleration_m_s2)
        if component.missing and whole >= count + component.missing:
            component.refuse(
                "record.count_contradicted",
                f"{count} samples, where its header counts {count + component.missing} and another component has them",
                "components of which none lacks lines",
                "fetch the file again",
            )
