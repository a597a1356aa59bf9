"""What of a scan is worked out apart from its page, in a process that keeps the cloud."""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from toppling.models.hidden_base.inspection import Inspection
from toppling.models.scan.candidates import LEAST_CONCAVE_SHARE, find_candidates, surfels_of
from toppling.models.scan.interface_hint import InterfaceHint
from toppling.models.scan.read import Cloud
from toppling.models.scan.register import Registered, registered
from toppling.models.scan.survey import work_out
from toppling.models.scan.worked_out import WorkedOut
from toppling.models.scene import Scene
from toppling.orchestrator.pick.shown import View, view_of

_Note = Callable[[str], None]

_KNOWN: dict[Path, Registered] = {}
"""The cloud of this process, by its folder."""


@dataclass(frozen=True, eq=False)
class Stored:
    """A cloud whose arrays lie in a folder, mapped by every process that needs them, so that memory has them once."""

    folder: Path
    rest: Cloud

    @classmethod
    def of(cls, cloud: Cloud, folder: Path) -> "Stored":
        """Write a cloud into a folder that does not exist."""
        folder.mkdir()
        for name in ("points_m", "station", "label"):
            if (values := getattr(cloud, name)) is not None:
                np.save(folder / f"{name}.npy", values)
        none = cloud.points_m[:0]
        return cls(folder, dataclasses.replace(cloud, points_m=none, station=cloud.station[:0], label=None))

    def cloud(self) -> Cloud:
        """The cloud, mapped."""
        arrays: dict[str, Any] = {
            path.stem: np.asarray(np.load(path, mmap_mode="r")) for path in self.folder.glob("*.npy")
        }
        return dataclasses.replace(self.rest, **arrays)


@dataclass(frozen=True, eq=False)
class _Split:
    """What a split became: the cloud as registered, what was worked out, a label for each point, notes, the view."""

    registered: Stored
    worked: WorkedOut
    label: NDArray[np.int8]
    notes: tuple[str, ...]
    view: View


def split(
    stored: Stored,
    near_m: tuple[float, float] | None,
    hint: InterfaceHint | None,
    bootstrap: int,
    inspection: Inspection,
    number: int,
    note: _Note,
) -> _Split:
    """Register a cloud, once, and split it; `number` is the view's."""
    cloud = _cloud(stored, note)
    worked, label, notes = work_out(cloud, note, near_m, hint, bootstrap, inspection)
    note("showing the rock")
    moved = Stored(stored.folder / "registered", stored.rest)
    fitted = moved if moved.folder.exists() else stored
    return _Split(fitted, worked, label, notes, view_of(cloud.cloud.points_m, label, number))


def _cloud(stored: Stored, note: _Note) -> Registered:
    if stored.folder not in _KNOWN:
        note("registering stations")
        read = stored.cloud()
        _KNOWN.clear()
        fitted = registered(read)
        if fitted.cloud is not read:
            kept = Stored.of(fitted.cloud, stored.folder / "registered")
            fitted = dataclasses.replace(fitted, cloud=kept.cloud())
        _KNOWN[stored.folder] = fitted
    return _KNOWN[stored.folder]


def draw(worked: WorkedOut, note: _Note) -> tuple[Scene, WorkedOut]:
    """Draw the hidden base."""
    note("drawing the hidden base")
    return worked.scene()


def look_around(stored: Stored, _: _Note) -> list[dict[str, Any]]:
    """What stands in a cloud."""
    points = stored.cloud().points_m
    return [
        {"top_m": each.top_m.tolist(), "height_m": each.height_m}
        for each in find_candidates(points, surfels_of(points))
        if each.concave_share > LEAST_CONCAVE_SHARE
    ]
