"""A rock's side that no station saw, closed level by level as the outlines that were seen go on."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import open3d as o3d
from scipy.spatial import QhullError

from toppling.models.arrays import Array
from toppling.models.hidden_base.sides_seen import LEVELS, SidesSeen
from toppling.models.hidden_base.unseen_side import UnseenSide
from toppling.models.scan.surfels import LEVEL

_LEAST_PATCHES = 40
_NEIGHBOURS = 9


def side_gone_on(base: UnseenSide, flat_m: Array, normals: Array, step_m: float) -> tuple[Array, Array]:
    """Places (k, 3) of the side above an unseen rim, u, v, h, and their outward normals, about a step apart.

    base: over whose unseen range the side is closed.
    flat_m, normals: (n, 3), of the rock's patches.
    """
    upright = normals[:, 2] < LEVEL
    side, sides = flat_m[upright], SidesSeen.of(flat_m, normals, base.middle_m)
    levels = np.linspace(side[:, 2].min(), side[:, 2].max(), LEVELS + 1)
    height_m, rings, ways = np.diff(levels)[0], [], []
    for low_m, high_m in pairwise(levels):
        patches = side[(side[:, 2] >= low_m) & (side[:, 2] < high_m)]
        around = _unseen(patches, normals[upright], sides.led_down(0.5 * (low_m + high_m)))
        if around is None:
            continue
        turn = np.arange(0.0, 2.0 * np.pi, step_m / around.radius_m)
        out = np.column_stack([np.cos(turn), np.sin(turn)])
        far = around.middle_m + 2.0 * around.radius_m * out
        places = around.middle_m + (far - around.middle_m) / around.share_out(far)[:, None]
        inside = around.in_range(far) & base.in_range(places)
        for up in np.arange(low_m, high_m, min(step_m, height_m)):
            rings.append(np.column_stack([places, np.full(len(places), up)])[inside])
            ways.append(out[inside])
    if not rings or not sum(map(len, rings)):
        return np.zeros((0, 3)), np.zeros((0, 3))
    places, way = np.vstack(rings), np.vstack(ways)
    return places, _outward(places, way)


def _unseen(patches_m: Array, normals: Array, led_down: Array) -> UnseenSide | None:
    """How the outline of a level goes on; None where it was seen around, or too little of it."""
    if len(patches_m) < _LEAST_PATCHES:
        return None
    try:
        return UnseenSide.of(patches_m * [1.0, 1.0, 0.0], normals, led_down)
    except QhullError:
        return None


def _outward(places_m: Array, way: Array) -> Array:
    """Normals (k, 3) of planes through the neighbourhood of each place, on the side of a horizontal way (k, 2)."""
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(places_m))
    cloud.estimate_normals(o3d.geometry.KDTreeSearchParamKNN(_NEIGHBOURS))
    normals = np.array(cloud.normals)
    sense = np.sign((normals[:, :2] * way).sum(axis=1))
    return normals * np.where(sense == 0.0, 1.0, sense)[:, None]
