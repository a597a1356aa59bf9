"""From clouds to a scene: the whole way of `toppling scan`."""

import dataclasses
import io
import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from models.errors import InputError
from models.rock import Rock
from models.scan.base import near_the_interface
from models.scan.crevice import BAND_PER_HEIGHT, check_seen, judge_crevice
from models.scan.ground import kept_of, pedestal_ground
from models.scan.interface import Interface, fit_interface
from models.scan.measure import (
    SeenRock,
    close_standing,
    confidence,
    outside_support_m,
    slenderness,
    uncertainty,
)
from models.scan.picture import draw_scene
from models.scan.read import Cloud
from models.scan.register import register
from models.scan.segment import NEITHER, PEDESTAL, ROCK, Segmentation, label_surfels, segment
from models.scan.word import Word, check_near
from models.scene import Scene

Progress = Callable[[str], None]

STAGES = 5

OVERLAP_SHARE = 0.02
"""Points of two stations this near, in sizes of a cloud, show the same place."""
LEAST_OVERLAP = 0.05
"""Share of a station's points that must show a place that another one shows too."""
LENGTHS_M = (0.3048, 0.0254, 0.01, 0.001)
"""Foot, inch, centimetre, millimetre."""
FITS_BETTER = 0.2
"""Share of the points that conversion must bring into place to give a file away."""
UPWARD = 0.3
"""Cosine to the interface's normal above which a patch of the pedestal can carry a rock."""
ROCK_HEIGHTS_M = (0.02, 100.0)
"""From stones on a laboratory's shaking table to the tallest balanced rocks: beyond, the units are others."""


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
    cloud: Cloud,
    progress: Progress = lambda _: None,
    near_m: tuple[float, float] | None = None,
    word: Word | None = None,
    bootstrap: int = 0,
) -> Survey:
    """Register, segment, close and measure.

    Parameters
    ----------
    cloud : Cloud
    progress : callable
        Told the name of each of the `STAGES` when it begins, and "resampling" after each realisation.
    near_m : pair of float, optional
        Survey coordinates x, y near the top of the rock that is meant, where several stand.
    word : Word, optional
        The interface as the user knows it, survey coordinates.
    bootstrap : int
        How often the rock is closed anew from resampled points, for the uncertainty in the report.

    Raises
    ------
    InputError
        If the cloud shows no rock that stands on a pedestal, or one of a size that no rock has.
    """
    progress("registering stations")
    check_overlap(cloud)
    near = None if near_m is None else _inside_cloud(near_m, cloud)
    cloud, registration = register(cloud)
    if word is not None:
        word = word.moved(cloud.origin_m)
        check_near(word, cloud.points_m.min(axis=0), cloud.points_m.max(axis=0), cloud.origin_m)
    progress("splitting rock from pedestal")
    parts = segment(cloud.points_m, cloud.origin_m, near, word)
    progress("fitting the interface")
    seen, label, interface = _judged(cloud, parts, word)
    check_size(seen.height_m)
    progress("closing the rock")
    closed, core = close_standing(seen, interface)
    check_can_stand(closed.rock, interface)
    progress("meshing the pedestal")
    pedestal = label_surfels(parts.surfels, cloud.points_m, label) == PEDESTAL
    ground = pedestal_ground(parts.surfels, pedestal, closed.rock, interface)
    scene = Scene(closed.rock, ground.pedestal, origin_m=cloud.origin_m)
    report = {
        "interface": {
            "given_by": "fit" if word is None else word.kind,
            "roughness_m": interface.roughness_m,
            "outline_m": ground.outline_m.tolist(),
            "edges_m": [edge.tolist() for edge in ground.edges_m],
        },
        "surface": {
            "seen_share": closed.seen_share,
            "closed_share": closed.closed_share,
            "invented_share": closed.invented_share,
        },
        "slenderness": slenderness(scene),
        "segmentation": {
            "rock_points": int((label == ROCK).sum()),
            "pedestal_points": int((label == PEDESTAL).sum()),
            "neither_points": int((label == NEITHER).sum()),
            "resolution_m": parts.surfels.voxel_m,
            "confidence": confidence(parts, cloud.points_m, label, interface, seen.height_m),
            "other_candidates": [{"top_m": [*other[:3]], "height_m": other[3]} for other in parts.others],
        },
        "pedestal": kept_of(ground, seen.pedestal_m, interface),
        "registration": registration,
        "files": [{"name": name, "points": points} for name, points in cloud.files],
    }
    if bootstrap:
        resampled = partial(progress, "resampling")
        report["uncertainty"] = uncertainty(seen, interface, core, bootstrap, resampled)
    return Survey(dataclasses.replace(scene, report=report), label, parts)


def _inside_cloud(near_m: tuple[float, float], cloud: Cloud) -> NDArray[np.float64]:
    """x, y near the rock's top in the cloud's frame, refused where the cloud shows nothing."""
    near = np.asarray(near_m, float) - cloud.origin_m[:2]
    low, high = cloud.points_m[:, :2].min(axis=0), cloud.points_m[:, :2].max(axis=0)
    if not ((near >= low) & (near <= high)).all():
        raise InputError(
            "{:.2f}, {:.2f} lies outside the cloud".format(*near_m),
            where="--near",
            expected="survey coordinates from {:.2f}, {:.2f}".format(*(low + cloud.origin_m[:2]))
            + " to {:.2f}, {:.2f}".format(*(high + cloud.origin_m[:2])),
            remedy="give x and y of the rock's top in the coordinates of the clouds, in metres",
        )
    return near


def _judged(
    cloud: Cloud, parts: Segmentation, word: Word | None
) -> tuple[SeenRock, NDArray[np.int8], Interface]:
    """What was seen of rock and pedestal, the label of each point, and the interface."""
    rock = parts.surfel_label == ROCK
    interface = fit_interface(parts.surfels, rock) if word is None else word.interface
    height = float(np.ptp(parts.surfels.points_m[rock, 2]))
    label, interface = judge_crevice(cloud.points_m, parts.label, interface, height, refit=word is None)
    surfels, surfel_label = parts.surfels, label_surfels(parts.surfels, cloud.points_m, label)
    rock = surfel_label == ROCK
    top = (surfel_label == PEDESTAL) & (surfels.normals @ interface.normal > UPWARD)
    top &= np.abs(interface.flat(surfels.points_m)[:, 2]) < BAND_PER_HEIGHT * height
    check_seen(int(top.sum()), "pedestal's top", given=word is not None)
    standing, below = cloud.points_m[label == ROCK], cloud.points_m[label == PEDESTAL]
    low, lit = near_the_interface(interface.flat(standing), interface.flat(below), height)
    seen = SeenRock(standing, below, standing[low], below[lit], surfels, rock, height, word)
    return seen, label, interface


def check_overlap(cloud: Cloud) -> None:
    """Refuse stations that do not show the same place, or show it in other units.

    Raises
    ------
    InputError
        If a file's cloud shares next to nothing with the others, or fits them better in another unit of length.
    """
    ends = np.cumsum([points for _, points in cloud.files])
    parts = np.split(cloud.points_m, ends[:-1])
    if len(parts) < 2:
        return
    samples = [part[:: max(1, len(part) // 20_000)] for part in parts]
    sizes = [_size(sample) for sample in samples]
    for number, (name, _) in enumerate(cloud.files):
        others = np.concatenate([sample for other, sample in enumerate(samples) if other != number])
        typical = float(np.median([size for other, size in enumerate(sizes) if other != number]))
        ratio = sizes[number] / typical
        units = f"; it is {ratio:.3g} times as large: other units?"
        if _near(samples[number], others, OVERLAP_SHARE * typical) < LEAST_OVERLAP:
            raise _no_overlap(f"does not overlap the other clouds{'' if 0.4 < ratio < 2.5 else units}", name)
        if _fits_in_other_units(samples[number], others, ratio, typical, cloud.origin_m):
            raise _no_overlap(f"does not fit the other clouds{units}", name)


def _fits_in_other_units(
    points: NDArray[np.float64],
    others: NDArray[np.float64],
    ratio: float,
    size_m: float,
    origin_m: NDArray[np.float64],
) -> bool:
    """Whether a station of a telltale size shows the others' place clearly better after conversion.

    A wide view and a close one differ in size too, but there one of the two lies on the other as it is.
    """
    for unit in (*LENGTHS_M, *(1.0 / unit for unit in LENGTHS_M)):
        if 0.75 < ratio * unit < 1.33:
            converted = (points + origin_m) * unit - origin_m
            reach = OVERLAP_SHARE * size_m * min(1.0, ratio)
            as_is = max(_near(points, others, reach), _near(others, points, reach))
            if max(_near(converted, others, reach), _near(others, converted, reach)) > as_is + FITS_BETTER:
                return True
    return False


def _size(points: NDArray[np.float64]) -> float:
    return float(np.linalg.norm(np.ptp(np.quantile(points, [0.02, 0.98], axis=0), axis=0)))


def _near(points: NDArray[np.float64], others: NDArray[np.float64], reach_m: float) -> float:
    """Share of the points that have one of the others within reach."""
    distance, _ = cKDTree(others).query(points, distance_upper_bound=reach_m)
    return float(np.isfinite(distance).mean())


def _no_overlap(what: str, name: str) -> InputError:
    return InputError(
        what,
        where=name,
        expected="stations of one survey, registered to one coordinate system, in metres",
        remedy="register the stations, or convert this file's units to metres, and export again",
    )


def check_size(height_m: float) -> None:
    """Refuse a rock that is not in metres.

    Raises
    ------
    InputError
        If its height is none of a rock that is worth shaking.
    """
    least, most = ROCK_HEIGHTS_M
    if not least <= height_m <= most:
        raise InputError(
            f"the rock is {height_m:.4g} m high",
            where="units",
            expected=f"a rock of {least} to {most:.0f} m: coordinates in metres",
            remedy="convert the clouds from millimetres, feet or whatever they are in, and export again",
        )


def check_can_stand(rock: Rock, interface: Interface) -> None:
    """Refuse a rock that could not stand: the split must be wrong.

    Raises
    ------
    InputError
        If the centre of mass lies outside everything within 2 % of the height of the interface.
    """
    outside = outside_support_m(rock, interface)
    if outside > 0.0:
        raise InputError(
            f"the centre of mass lies {outside:.3g} m outside any support the rock could have",
            where="statics",
            expected="a rock that stands: its centre of mass above its base",
            remedy="look for a second support or a wrong split in the cloud; name the rock by --near X Y",
        )


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
    try:
        result.scene.save(staging)
        (staging / "labels.npz").write_bytes(labels.getvalue())
        draw_scene(result.scene, staging / "scene.png")
        staging.rename(target)
    except BaseException:
        shutil.rmtree(staging, ignore_errors=True)
        raise
    return target
