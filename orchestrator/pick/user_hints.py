"""Validation of a page's hints, which are untrusted, and the data that the page displays."""

import dataclasses
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from toppling.models.arrays import Array, Indices, at_most
from toppling.models.errors import InputError
from toppling.models.files.documents import TEXT, Kind, check_shape, choice, is_number, shown
from toppling.models.hidden_base.inspection import LEAST_PLACES, Inspection, inspection_of
from toppling.models.hidden_base.intervals import base_sentences, volume_text
from toppling.models.lengths import METRES
from toppling.models.scan.hints_file import KINDS, Hints
from toppling.models.scan.interface_hint import InterfaceHint, hint_of
from toppling.models.scan.placement import upward
from toppling.models.scan.segment import NEITHER, ROCK
from toppling.models.scan.surfels import SAMPLED_POINTS, SHOWN_POINTS, around, shade, thinned
from toppling.models.scan.survey import CachedScan, Survey

_MOST_PLACES = 1000
"""Maximum number of places of each kind."""

_Place = tuple[float, ...]


@dataclass(frozen=True)
class UserHints:
    """Hints on a scan, survey coordinates in metres, angles in degrees.

    units, up, base: as the options of `toppling scan`; `up` may be three numbers, separated by commas.
    length: two places of the model, in its own coordinates, and the metres between them.
    point, outline, touch, daylight, pull: as the options of `toppling scan`.
    """

    units: str | None = None
    up: str | None = None
    length: tuple[_Place, _Place, float] | None = None
    near: _Place | None = None
    plane: _Place | None = None
    point: tuple[_Place, ...] = ()
    outline: tuple[_Place, ...] = ()
    touch: tuple[_Place, ...] = ()
    daylight: tuple[_Place, ...] = ()
    pull: tuple[_Place, ...] = ()
    base: str | None = None
    touch_only: bool = False

    @classmethod
    def of(cls, content: Any) -> "UserHints":
        """Hints from a page's JSON; InputError for unknown names, or values of a wrong type or length."""
        check_shape(content, _SHAPE, "the page")
        if unknown := [name for name in content if f"{name}?" not in _SHAPE]:
            raise InputError(
                "hint.unknown",
                f"{shown(unknown[0])} is no hint",
                where="the page",
                expected=f"hints by the names of options: {', '.join(cls.__dataclass_fields__)}",
                remedy="load the page again",
            )
        if content.get("up"):
            upward(content["up"])
        return cls(**{name: _as_tuple(value) for name, value in content.items()})

    @property
    def of_the_cloud(self) -> "UserHints":
        """Hints that change the coordinates of the cloud."""
        return UserHints(self.units, self.up, self.length)

    @property
    def of_the_split(self) -> "UserHints":
        """Hints that change the rock and its interface, and not only the base."""
        points = self.point if len(self.point) >= LEAST_PLACES else ()
        return dataclasses.replace(
            self.of_the_cloud, near=self.near, plane=self.plane, point=points, outline=self.outline
        )

    def hints(self) -> Hints:
        """Hints as a dictionary for reading and writing, without points that are too few for an interface."""
        return cast(Hints, dataclasses.asdict(self) | {"point": self.of_the_split.point})

    def hint(self) -> InterfaceHint | None:
        """Hint on the interface; None while there are too few points."""
        return hint_of(self.plane, self.of_the_split.point, self.outline)

    def inspection(self) -> Inspection:
        """Hints on the base."""
        pulls = [(pull[0], pull[1]) for pull in self.pull]
        return inspection_of(None, pulls, self.touch, self.daylight, self.base, self.touch_only)


def numbers(count: int) -> Kind:
    """Kind of a list of finite numbers."""
    return Kind(
        f"a list of {count} numbers",
        lambda value: isinstance(value, list) and len(value) == count and all(map(is_number, value)),
    )


def _places(count: int) -> Kind:
    place = numbers(count)
    return Kind(
        f"up to {_MOST_PLACES} lists of {count} numbers",
        lambda value: isinstance(value, list) and len(value) <= _MOST_PLACES and all(map(place.holds, value)),
    )


_LENGTH = Kind(
    "two places and the length between them",
    lambda value: (
        isinstance(value, list) and len(value) == 3
        and all(map(numbers(3).holds, value[:2])) and is_number(value[2])
    ),
)  # fmt: skip
_SHAPE = {
    "units?": choice(*METRES).or_null(), "up?": TEXT.or_null(), "length?": _LENGTH.or_null(),
    "near?": numbers(2).or_null(), "plane?": numbers(5).or_null(), "point?": _places(3), "outline?": _places(3),
    "touch?": _places(3), "daylight?": _places(3), "pull?": _places(2), "base?": choice(*KINDS).or_null(),
    "touch_only?": Kind("true or false", lambda value: isinstance(value, bool)),
}  # fmt: skip
"""Kinds of the hints; the upward axis is checked by its parser."""


def _as_tuple(value: Any) -> Any:
    """Lists as tuples, and numbers as floats."""
    if isinstance(value, list):
        return tuple(map(_as_tuple, value))
    return float(value) if is_number(value) else value


_AROUND_HEIGHTS = 0.4
"""Distance around a rock within which its cloud is shown more finely, in heights of the rock."""
_SAME_TOP_PER_HEIGHT = 0.05
"""Distance between tops, in heights of the rock, below which a candidate is the rock itself."""


@dataclass(frozen=True, eq=False)
class View:
    """Points that a page draws: first those of the whole cloud, then finer ones around the rock."""

    number: int  # changes with the content
    counts: tuple[int, int]  # numbers of coarse and of fine points
    spacings_m: tuple[float, float]
    content: bytes  # packed by `_drawn`


def view_of(points_m: Array, label: NDArray[np.int8] | None, number: int) -> View:
    """Select the points to draw.

    points_m: (n, 3).
    label: (n,), 0 rock, 1 pedestal, 2 neither; None (2 for all) before the split.
    number: number of the view.
    """
    whole, fine = thinned(points_m, SHOWN_POINTS if label is None else SHOWN_POINTS // 3), None
    rows, finer = whole.rows, np.zeros(0, np.intp)
    if label is not None:
        rock = np.flatnonzero(label == ROCK)
        some = points_m[at_most(rock, SAMPLED_POINTS)]
        low, high = some.min(axis=0), some.max(axis=0)
        middle, reach = (
            0.5 * (low + high),
            0.5 * float((high - low).max()) + _AROUND_HEIGHTS * float(high[2] - low[2]),
        )
        fine = thinned(points_m, SHOWN_POINTS * 2 // 3, around(points_m, middle, reach))
        rows = rows[(np.abs(points_m[rows] - middle) >= reach).any(axis=1)]
        finer = fine.rows
    counts = (len(rows), len(finer))
    content = _drawn(points_m, [rows, finer], label)
    spacings = (whole.spacing_m, whole.spacing_m if fine is None else fine.spacing_m)
    return View(number, counts, spacings, content)


def _drawn(points_m: Array, parts: list[Indices], label: NDArray[np.int8] | None) -> bytes:
    """Pack selected points (n, 3) as 4-byte floats, followed by a byte for brightness and one for the label of each."""
    rows = np.concatenate(parts)
    kind = np.full(len(rows), NEITHER, np.int8) if label is None else label[rows]
    bright = [
        shade(points_m[part], None if label is None else label[part] == ROCK) for part in parts if len(part)
    ]
    shades = (255 * np.concatenate(bright)).astype(np.uint8) if bright else np.zeros(0, np.uint8)
    return points_m[rows].astype("<f4").tobytes() + shades.tobytes() + kind.tobytes()


def detail(
    points_m: Array, label: NDArray[np.int8] | None, middle_m: Array, reach_m: float
) -> tuple[float, bytes]:
    """Spacing and packed points of a cube about a place (3,), as many as of the whole cloud."""
    if not len(rows := around(points_m, middle_m, reach_m)):
        return 0.0, b""
    near = thinned(points_m, SHOWN_POINTS // 2, rows)
    return near.spacing_m, _drawn(points_m, [near.rows], label)


def answer_shown(survey: Survey | None, result: CachedScan) -> dict[str, Any]:
    """Results of hints in the cloud's frame; `survey` is None while the hidden base is not drawn."""
    rock, plane = result.closed.rock, result.interface
    pedestal = result.pedestal
    report = result.report if survey is None else survey.scene.report
    base = report.get("unseen_base", {})
    return {
        "volume": volume_text(report, rock.volume_m3),
        "height_m": rock.height_m,
        "slope_deg": pedestal.slope_deg,
        "downhill_azimuth_deg": pedestal.downhill_azimuth_deg,
        "top_m": _top(result).tolist(),
        "plane": {"point_m": plane.point_m.tolist(), "normal": plane.normal.tolist(), **report["interface"]},
        "surface": report["surface"],
        "toppling": base.get("toppling"),
        "level": base.get("level"),
        "contacts": base.get("contacts"),
        "next": base.get("next_observations", []),
        "sentences": base_sentences(report),
    }


def _top(result: CachedScan) -> Array:
    """Highest patch of the rock."""
    patches = result.observed.surfels.points_m[result.observed.patches]
    return patches[np.argmax(patches[:, 2])]


def tops(result: CachedScan) -> list[dict[str, Any]]:
    """Rocks found by the segmentation, the selected one first, in the cloud's frame."""
    top, height = _top(result), result.observed.height_m
    own = {"top_m": top.tolist(), "height_m": height}
    others = result.report["segmentation"]["other_candidates"]
    apart = [
        other for other in others if np.linalg.norm(top - other["top_m"]) > _SAME_TOP_PER_HEIGHT * height
    ]
    return [own, *apart]
