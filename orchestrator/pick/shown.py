"""What a page shows of a scan: points of the cloud, and what came of the hints in plain values."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from toppling.models.intervals import base_sentences
from toppling.models.scan.segment import NEITHER, ROCK
from toppling.models.scan.survey import Survey
from toppling.models.scan.view import SHOWN_POINTS, around, shade, thinned
from toppling.models.scan.worked_out import WorkedOut

AROUND_HEIGHTS = 0.4
"""How far around a rock its cloud is shown finer, in its heights."""
SAME_TOP_PER_HEIGHT = 0.05
"""What has its top so near to the rock's is a part of it."""


@dataclass(frozen=True, eq=False)
class View:
    """Points that a page draws: first those of the whole cloud, then the finer ones around the rock.

    Parameters
    ----------
    number : int
        Another one where anything of it is another.
    rows : (n,) int array
        Which of the cloud's points.
    counts : pair of int
        Of the whole and of the finer ones.
    spacings_m : pair of float
    content : bytes
        Places (n, 3) as 4-byte floats, brightness and label as a byte each.
    """

    number: int
    rows: NDArray[np.intp]
    counts: tuple[int, int]
    spacings_m: tuple[float, float]
    content: bytes


def view_of(points_m: NDArray[np.float64], label: NDArray[np.int8] | None, number: int) -> View:
    """Choose the points that are drawn.

    Parameters
    ----------
    points_m : (n, 3) array
    label : (n,) int8 array, optional
        0 rock, 1 pedestal, 2 neither; 2 for all where it is not known yet.
    number : int
        Of the view.
    """
    if label is None:
        whole, fine = thinned(points_m), None
        rows = whole.rows
    else:
        rock = points_m[label == ROCK]
        low, high = rock.min(axis=0), rock.max(axis=0)
        reach = 0.5 * float((high - low).max()) + AROUND_HEIGHTS * float(high[2] - low[2])
        near = around(points_m, 0.5 * (low + high), reach)
        whole, fine = thinned(points_m, SHOWN_POINTS // 3), thinned(points_m, SHOWN_POINTS * 2 // 3, near)
        rows = whole.rows[~np.isin(whole.rows, near)]
    finer = np.zeros(0, np.intp) if fine is None else fine.rows
    counts, rows = (len(rows), len(finer)), np.concatenate([rows, finer])
    places = points_m[rows]
    bright = np.concatenate([shade(part) for part in np.split(places, counts[:1]) if len(part)])
    kind = np.full(len(rows), NEITHER, np.int8) if label is None else label[rows]
    content = places.astype("<f4").tobytes() + (255 * bright).astype(np.uint8).tobytes() + kind.tobytes()
    spacings = (whole.spacing_m, whole.spacing_m if fine is None else fine.spacing_m)
    return View(number, rows, counts, spacings, content)


def told(survey: Survey | None, worked: WorkedOut) -> dict[str, Any]:
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
        "contacts": base.get("contacts"),
        "sentences": base_sentences(report),
    }


def _top(worked: WorkedOut) -> NDArray[np.float64]:
    """The rock's highest patch."""
    patches = worked.observed.surfels.points_m[worked.observed.patches]
    return patches[np.argmax(patches[:, 2])]


def tops(worked: WorkedOut) -> list[dict[str, Any]]:
    """What stands in the cloud as its segmentation has found it, the chosen rock first, in the cloud's frame."""
    top, height = _top(worked), worked.observed.height_m
    own = {"top_m": top.tolist(), "height_m": height}
    others = worked.report["segmentation"]["other_candidates"]
    apart = [each for each in others if np.linalg.norm(top - each["top_m"]) > SAME_TOP_PER_HEIGHT * height]
    return [own, *apart]
