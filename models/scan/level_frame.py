"""Whether z points upward in a cloud: what was made level, at several heights, dips alike in a frame that is tilted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from toppling.models.arrays import Array
from toppling.models.frames import slope_of_normal
from toppling.models.scan.doubt import Doubt, direction_told
from toppling.models.scan.surfels import Surfels

_MOST_DIP_DEG, _LEAST_DIP_DEG = 12.0, 1.5
"""Dips of levels that are told: steeper ones were not made level, a gentler one hardly matters."""
_ALIKE_DEG = 1.0
"""Between the normals of two levels: natural ground does not keep a dip so well from one height to another."""
_LEAST_SHARE = 0.1
"""Of the patches that lie about level, in one level."""
_WIDE_VOXELS, _APART_VOXELS = 8.0, 6.0
"""How wide a level is (standard deviation of its patches' places), and how far over another."""
_TRIALS, _PLANES, _ROUNDS = 200, 4, 12
_REFINED = 20
"""Of the trials, those with most patches: a plane through one patch and its normal is degrees off where a wide level
is uneven, and ends in a part of it."""
_NEAR_VOXELS, _ABOUT_VOXELS, _TURNED_DEG = 0.5, 2.0, 8.0
"""How far off a plane, and turned from it, its patches lie; how far off others about it do."""
_EVEN_SHARE = 0.8
"""Of the patches about a plane that lie on it, where it was made: ground is uneven."""


@dataclass(frozen=True, eq=False)
class _Level:
    """A plane that many patches lie on."""

    middle_m: Array  # (3,)
    normal: Array  # (3,), upward
    off_m: float  # root mean square distance of its patches
    even_share: float  # of the patches about it that lie on it
    wide_m: float  # standard deviation of their places across


def tilted_frame(surfels: Surfels, rock: NDArray[np.bool_]) -> Doubt | None:
    """A doubt where planes about the rock at different heights dip alike: paving, steps and plinths are made level.

    Parameters
    ----------
    surfels : Surfels
        Patches about the rock.
    rock : (n,) bool array
        Which of them are the rock's.
    """
    level = ~rock & (surfels.normals[:, 2] > np.cos(np.deg2rad(_MOST_DIP_DEG)))
    planes = _planes(surfels.points_m[level], surfels.normals[level], surfels.voxel_m)
    if not planes:
        return None
    first = planes[0]
    like = [each for each in planes if each.normal @ first.normal > np.cos(np.deg2rad(_ALIKE_DEG))]
    heights_m = [float((each.middle_m - first.middle_m) @ first.normal) for each in like]
    apart_m = max(heights_m) - min(heights_m)
    dip_deg, toward_deg = slope_of_normal(first.normal)
    if apart_m < _APART_VOXELS * surfels.voxel_m or dip_deg < _LEAST_DIP_DEG:
        return None
    off_m = max(each.off_m for each in like)
    return Doubt(
        "frame",
        f"levels {apart_m:.2g} m apart about the rock, each a plane within {off_m:.1g} m, dip alike, by "
        f"{dip_deg:.1f} degrees toward {direction_told(toward_deg)}: if they were made level, as paving, steps or a "
        "plinth, z does not point upward in this cloud, and the rock is taken to lean by as much. Then give --up "
        "{:.4f},{:.4f},{:.4f}".format(*first.normal),
    )


def _planes(points_m: Array, normals: Array, voxel_m: float) -> list[_Level]:
    """Planes that are even, wide and hold a share of patches (n, 3), those with most first."""
    random, found = np.random.default_rng(11), []
    left = np.arange(len(points_m))
    least = max(3.0, _LEAST_SHARE * len(points_m))
    for _ in range(_PLANES):
        if len(left) < least:
            break
        on, level = _largest(points_m[left], normals[left], voxel_m, random)
        if on.sum() < least:
            break
        if level.even_share > _EVEN_SHARE and level.wide_m > _WIDE_VOXELS * voxel_m:
            found.append(level)
        left = left[~on]
    return found


def _largest(
    points_m: Array, normals: Array, voxel_m: float, random: np.random.Generator
) -> tuple[NDArray[np.bool_], _Level]:
    """Patches (n,) on the plane that holds most of them, of those through some, and that plane."""

    def on_plane(middle_m: Array, normal: Array, voxels: float = _NEAR_VOXELS) -> NDArray[np.bool_]:
        near = np.abs((points_m - middle_m) @ normal) < voxels * voxel_m
        return np.asarray(near & (normals @ normal > np.cos(np.deg2rad(_TURNED_DEG))))

    def refined(start: int) -> tuple[NDArray[np.bool_], _Level]:
        middle_m, normal, spread_m = points_m[start], normals[start], np.zeros(3)
        for _ in range(_ROUNDS):
            on = points_m[on_plane(middle_m, normal)]
            if len(on) < 3:
                break
            middle_m = on.mean(axis=0)
            _, spread_m, axes = np.linalg.svd(on - middle_m, full_matrices=False)
            spread_m, normal = spread_m / np.sqrt(len(on)), axes[2] * (np.sign(axes[2, 2]) or 1.0)
        about, last = on_plane(middle_m, normal, _ABOUT_VOXELS), on_plane(middle_m, normal)
        share = float(last.sum() / max(about.sum(), 1))
        return last, _Level(middle_m, normal, float(spread_m[2]), share, float(spread_m[1]))

    tried = random.integers(0, len(points_m), _TRIALS)
    held = [int(on_plane(points_m[number], normals[number]).sum()) for number in tried]
    starts = tried[np.argsort(held, kind="stable")[::-1][:_REFINED]]
    return max((refined(start) for start in starts), key=lambda found: int(found[0].sum()))
