"""From clouds to a scene: the whole way of `toppling scan`."""

import io
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from models.scan.base import hidden_base
from models.scan.close import close_rock
from models.scan.crevice import judge_crevice
from models.scan.ground import pedestal_ground
from models.scan.interface import fit_interface
from models.scan.picture import draw_scene
from models.scan.read import Cloud
from models.scan.segment import PEDESTAL, ROCK, Segmentation, label_surfels, segment
from models.scene import Scene

Progress = Callable[[str], None]


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


def survey(cloud: Cloud, progress: Progress = lambda _: None) -> Survey:
    """Segment, close and measure.

    Parameters
    ----------
    cloud : Cloud
    progress : callable
        Told the name of each stage when it begins.

    Raises
    ------
    InputError
        If the cloud shows no rock that stands on a pedestal.
    """
    progress("splitting rock from pedestal")
    parts = segment(cloud.points_m)
    rock_patches, pedestal_patches = parts.surfel_label == ROCK, parts.surfel_label == PEDESTAL
    progress("fitting the interface")
    interface = fit_interface(parts.surfels, rock_patches)
    height = float(np.ptp(parts.surfels.points_m[rock_patches, 2]))
    label, interface = judge_crevice(cloud.points_m, parts.label, interface, height)
    surfel_label = label_surfels(parts.surfels, cloud.points_m, label)
    rock_patches, pedestal_patches = surfel_label == ROCK, surfel_label == PEDESTAL
    progress("closing the rock")
    flat = interface.flat(cloud.points_m)
    base = hidden_base(flat[label == ROCK], flat[label == PEDESTAL], height)
    closed = close_rock(parts.surfels, rock_patches, base, interface)
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
