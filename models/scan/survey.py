"""From clouds to a scene: the whole way of `toppling scan`."""

import io
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, cKDTree

from models.errors import InputError
from models.rock import Rock
from models.scan.base import CORES_OF_HOLES, hidden_base, holds
from models.scan.close import close_rock
from models.scan.crevice import judge_crevice
from models.scan.ground import pedestal_ground
from models.scan.interface import Interface, fit_interface
from models.scan.picture import draw_scene
from models.scan.read import Cloud
from models.scan.segment import PEDESTAL, ROCK, Segmentation, label_surfels, segment
from models.scene import Scene

Progress = Callable[[str], None]

OVERLAP_SHARE = 0.02
"""Points of two stations this near, in sizes of a cloud, show the same place."""
LEAST_OVERLAP = 0.05
"""Share of a station's points that must show a place that another one shows too."""


@dataclass(frozen=True, eq=False)
class Survey:
    """What a scan became.

    Parameters
    ----------
    scene : Scene
    label : (n,) int8 array
        Per input point: 0 rock, 1 pedestal, 2 neither.
    segmentation : Segmentation
    """

    scene: Scene
    label: NDArray[np.int8]
    segmentation: Segmentation


def survey(
    cloud: Cloud, progress: Progress = lambda _: None, near_m: tuple[float, float] | None = None
) -> Survey:
    """Segment, close and measure.

    Parameters
    ----------
    cloud : Cloud
    progress : callable
        Told the name of each stage when it begins.
    near_m : pair of float, optional
        Survey coordinates x, y near the top of the rock that is meant, where several stand.

    Raises
    ------
    InputError
        If the cloud shows no rock that stands on a pedestal.
    """
    progress("splitting rock from pedestal")
    check_overlap(cloud)
    parts = segment(cloud.points_m, None if near_m is None else np.asarray(near_m) - cloud.origin_m[:2])
    rock_patches, pedestal_patches = parts.surfel_label == ROCK, parts.surfel_label == PEDESTAL
    progress("fitting the interface")
    interface = fit_interface(parts.surfels, rock_patches)
    height = float(np.ptp(parts.surfels.points_m[rock_patches, 2]))
    label, interface = judge_crevice(cloud.points_m, parts.label, interface, height)
    surfel_label = label_surfels(parts.surfels, cloud.points_m, label)
    rock_patches, pedestal_patches = surfel_label == ROCK, surfel_label == PEDESTAL
    progress("closing the rock")
    flat = interface.flat(cloud.points_m)
    rock_flat, pedestal_flat = flat[label == ROCK], flat[label == PEDESTAL]
    base = hidden_base(rock_flat, pedestal_flat, height, CORES_OF_HOLES[0])
    closed = close_rock(parts.surfels, rock_patches, base, interface)
    pierced = _pierced(closed.rock, interface)
    if not holds(base, pierced):
        # The rock stood when it was scanned: its feet are as wide as that takes.
        wider = (hidden_base(rock_flat, pedestal_flat, height, core) for core in CORES_OF_HOLES[1:])
        base = next((each for each in wider if holds(each, pierced)), base)
        closed = close_rock(parts.surfels, rock_patches, base, interface)
    check_can_stand(closed.rock, interface)
    progress("meshing the pedestal")
    ground = pedestal_ground(parts.surfels, pedestal_patches, closed.rock, interface)
    report = {
        "interface": {
            "roughness_m": interface.roughness_m,
            "outline_m": ground.outline_m.tolist(),
            "edges_m": [edge.tolist() for edge in ground.edges_m],
        },
        "surface": {
            "seen_share": closed.seen_share,
            "closed_share": closed.closed_share,
            "invented_share": closed.invented_share,
        },
        "segmentation": {
            "rock_points": int((label == ROCK).sum()),
            "pedestal_points": int((label == PEDESTAL).sum()),
            "concave_share_of_cut": parts.concave_share,
            "resolution_m": parts.surfels.voxel_m,
            "other_candidates": [{"top_m": [*other[:3]], "height_m": other[3]} for other in parts.others],
        },
        "files": [{"name": name, "points": points} for name, points in cloud.files],
    }
    scene = Scene(closed.rock, ground.pedestal, origin_m=cloud.origin_m, report=report)
    return Survey(scene, label, parts)


def check_overlap(cloud: Cloud) -> None:
    """Refuse stations that do not show the same place.

    Raises
    ------
    InputError
        If a file's cloud shares next to nothing with the others.
    """
    ends = np.cumsum([points for _, points in cloud.files])
    parts = np.split(cloud.points_m, ends[:-1])
    if len(parts) < 2:
        return
    samples = [part[:: max(1, len(part) // 20_000)] for part in parts]
    sizes = [
        float(np.linalg.norm(np.ptp(np.quantile(sample, [0.02, 0.98], axis=0), axis=0))) for sample in samples
    ]
    for number, (name, _) in enumerate(cloud.files):
        others = np.concatenate([sample for other, sample in enumerate(samples) if other != number])
        distance, _ = cKDTree(others).query(samples[number])
        typical = float(np.median([size for other, size in enumerate(sizes) if other != number]))
        if (distance < OVERLAP_SHARE * typical).mean() < LEAST_OVERLAP:
            ratio = sizes[number] / typical
            units = "" if 0.4 < ratio < 2.5 else f"; it is {ratio:.3g} times as large: other units?"
            raise InputError(
                f"does not overlap the other clouds{units}",
                where=name,
                expected="stations of one survey, registered to one coordinate system, in metres",
                remedy="register the stations, or convert this file's units to metres, and export again",
            )


def check_can_stand(rock: Rock, interface: Interface) -> None:
    """Refuse a rock that could not stand: the split must be wrong.

    Raises
    ------
    InputError
        If the centre of mass lies outside everything within 2 % of the height of the interface.
    """
    flat = interface.flat(rock.vertices_m)
    support = flat[flat[:, 2] < 0.02 * rock.height_m, :2]
    pierced = _pierced(rock, interface)
    hull = ConvexHull(support)
    outside = float((hull.equations[:, :2] @ pierced + hull.equations[:, 2]).max())
    if outside > 0.0:
        raise InputError(
            f"the centre of mass lies {outside:.3g} m outside any support the rock could have",
            where="statics",
            expected="a rock that stands: its centre of mass above its base",
            remedy="look for a second support or a wrong split in the cloud; name the rock by --near X Y",
        )


def _pierced(rock: Rock, interface: Interface) -> NDArray[np.float64]:
    """Where the vertical through the centre of mass meets the interface plane, u and v."""
    com = interface.flat(rock.com_m[None])[0]
    down = np.array([0.0, 0.0, -1.0]) @ interface.axes
    return com[:2] - down[:2] / down[2] * com[2]


def save_survey(result: Survey, folder: str | os.PathLike[str]) -> Path:
    """Write the scene's folder with `labels.npz` and `scene.png` in it; complete or not at all.

    Raises
    ------
    FileExistsError
        If the folder exists already.
    """
    target = Path(folder)
    if target.exists():
        msg = f"{target} exists already: choose another name, or remove it first"
        raise FileExistsError(msg)
    labels = io.BytesIO()
    np.savez_compressed(labels, label=result.label)
    staging = target.with_name(f".{target.name}.{os.getpid()}.scan")
    result.scene.save(staging)
    (staging / "labels.npz").write_bytes(labels.getvalue())
    draw_scene(result.scene, staging / "scene.png")
    staging.rename(target)
    return target
