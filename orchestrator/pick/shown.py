"""What a page shows of a scan: points of the cloud, and what came of the hints in plain values."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from toppling.models.arrays import Array, Indices, at_most
from toppling.models.hidden_base.intervals import base_sentences
from toppling.models.scan.segment import NEITHER, ROCK
from toppling.models.scan.survey import Survey
from toppling.models.scan.view import SAMPLED_POINTS, SHOWN_POINTS, around, shade, thinned
from toppling.models.scan.worked_out import WorkedOut

_AROUND_HEIGHTS = 0.4
"""How far around a rock its cloud is shown finer, in its heights."""
_SAME_TOP_PER_HEIGHT = 0.05
"""What has its top so near to the rock's is a part of it."""


@dataclass(frozen=True, eq=False)
class View:
    """Points that a page draws: first those of the whole cloud, then the finer ones around the rock."""

    number: int  # another one where anything of it is another
    counts: tuple[int, int]  # of the whole and of the finer ones
    spacings_m: tuple[float, float]
    content: bytes  # as `_drawn` packs them


def view_of(points_m: Array, label: NDArray[np.int8] | None, number: int) -> View:
    """Choose the points that are drawn.

    points_m: (n, 3).
    label: (n,), 0 rock, 1 pedestal, 2 neither; 2 for all where it is not known yet.
    number: of the view.
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
    """Places (n, 3) of some rows as 4-byte floats, then the brightness and the label of each as a byte."""
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
    """Spacing and points of a cube about a place (3,), as many as the whole cloud's, as `_drawn`."""
    near = thinned(points_m, SHOWN_POINTS // 2, around(points_m, middle_m, reach_m))
    return near.spacing_m, _drawn(points_m, [near.rows], label)


def answer_shown(survey: Survey | None, worked: WorkedOut) -> dict[str, Any]:
    """What came of hints, in the cloud's frame; `survey` is none while the hidden base is not drawn."""
    rock, plane = worked.closed.rock, worked.interface
    pedestal = worked.pedestal
    report = worked.report if survey is None else survey.scene.report
    base = report.get("unseen_base", {})
    return {
        "volume_m3": rock.volume_m3,
        "height_m": rock.height_m,
        "slope_deg": pedestal.slope_deg,
        "downhill_azimuth_deg": pedestal.downhill_azimuth_deg,
        "top_m": _top(worked).tolist(),
        "plane": {"point_m": plane.point_m.tolist(), "normal": plane.normal.tolist(), **report["interface"]},
        "surface": report["surface"],
        "toppling": base.get("toppling"),
        "kinds": base.get("kinds"),
        "contacts": base.get("contacts"),
        "sentences": base_sentences(report),
    }


def _top(worked: WorkedOut) -> Array:
    """The rock's highest patch."""
    patches = worked.observed.surfels.points_m[worked.observed.patches]
    return patches[np.argmax(patches[:, 2])]


def tops(worked: WorkedOut) -> list[dict[str, Any]]:
    """What stands in the cloud as its segmentation has found it, the chosen rock first, in the cloud's frame."""
    top, height = _top(worked), worked.observed.height_m
    own = {"top_m": top.tolist(), "height_m": height}
    others = worked.report["segmentation"]["other_candidates"]
    apart = [each for each in others if np.linalg.norm(top - each["top_m"]) > _SAME_TOP_PER_HEIGHT * height]
    return [own, *apart]
