"""Whether a rock has stayed over the part of its ground that its shake looks at.

A shake on one plane knows the ground only where its mesh is that plane; a shake on a surface, only where there is one.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial import ConvexHull

from toppling.models.compiled import Array, Flags, Indices
from toppling.models.ground.kind import FLAT_DEG, FLAT_SHARE
from toppling.models.kept import kept
from toppling.models.scene import Scene
from toppling.workers.contact.contact_points import contact_of
from toppling.workers.observation import END_WITHIN_HEIGHTS
from toppling.workers.outcome import ShakeResult

FALLS_AWAY, NO_WAY_ON = "falls_away", "no_way_on"
"""Where a base came to: over ground that falls away from the plane, on which it may be shaken anew; to where the
ground was not scanned, or rises from the plane: a surface's contacts do not stand every impact against a wall."""

_SPACING_SHARE, _SLIPPED_SHARE = 0.01, 0.01
"""Of R: between two places of the border; a base so little over it has not left, as one that slipped so far stands."""


class _Extent(NamedTuple):
    base_body_m: Array  # (k, 3): corners of what touches at rest, counter-clockwise seen from above
    border_m: Array  # (n, 2): places, support frame, at which the ground leaves the plane, or ends
    ends_there: Flags  # at which of these there is no way on
    clearance_m: float  # from the base as it stands in the scene to the border
    size_m: float


def left_ground(
    scene: Scene, result: ShakeResult, time_s: Array, pose: Array, *, on_plane: bool
) -> str | None:
    """Where the base first came to on its way, poses (n, 7) in the support frame; None if it left nowhere.

    One that topples is followed to its point of no return: from there it falls wherever it is.

    on_plane: whether it is shaken on the interface plane; on a surface it may only leave the scan.
    """
    if scene.pedestal.is_plane or result.ended_by in ("speed_limit", "slid_off"):
        return None
    if result.topple_time_s is not None:
        pose = pose[time_s <= result.topple_time_s]
    extent = _extent_of(scene, on_plane)
    if len(extent.border_m) == 0:
        return None
    first = contact_of(scene).start_pose
    cosine = np.minimum(np.abs(pose[:, 3:] @ first[3:]), 1.0)
    farthest_m = np.linalg.norm(extent.base_body_m, axis=1).max()
    most_m = np.linalg.norm(pose[:, :2] - first[:2], axis=1) + 2.0 * np.sqrt(1.0 - cosine**2) * farthest_m
    places = _places_m(extent.base_body_m, pose[most_m > extent.clearance_m])
    start = _places_m(extent.base_body_m, first[None])[0]
    moved_m = np.linalg.norm(places - start, axis=2).max(axis=1)
    looked_at = start
    for here in places[moved_m > extent.clearance_m]:
        if np.abs(here - looked_at).max() < 0.5 * _SLIPPED_SHARE * extent.size_m:
            continue
        looked_at = here
        reached = _within(_shrunk(here, _SLIPPED_SHARE * extent.size_m), extent.border_m)
        if reached.any():
            return NO_WAY_ON if extent.ends_there[reached].any() else FALLS_AWAY
    return None


def _places_m(base_body_m: Array, pose: Array) -> Array:
    """Places (n, k, 2) in the support's plane of points of the rock in poses (n, 7)."""
    x, y, z, w = pose[:, 3:].T
    rows = np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
            [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        ]
    )
    return np.asarray(pose[:, None, :2] + np.einsum("ijn,kj->nki", rows, base_body_m))


def _shrunk(corners_m: Array, by_m: float) -> Array:
    inward = corners_m.mean(axis=0) - corners_m
    far = np.linalg.norm(inward, axis=1)[:, None]
    return np.asarray(corners_m + inward * np.minimum(by_m / np.maximum(far, 1e-300), 0.9))


def _within(corners_m: Array, places_m: Array) -> Flags:
    """Which places (n, 2) lie within a convex polygon (k, 2), counter-clockwise."""
    near = ((places_m > corners_m.min(axis=0)) & (places_m < corners_m.max(axis=0))).all(axis=1)
    edge = np.roll(corners_m, -1, axis=0) - corners_m
    away = places_m[near][:, None] - corners_m
    near[near] = (edge[:, 0] * away[..., 1] - edge[:, 1] * away[..., 0] > 0.0).all(axis=1)
    return np.asarray(near)


@kept
def _extent_of(scene: Scene, on_plane: bool) -> _Extent:
    contact, rock, pedestal = contact_of(scene), scene.rock, scene.pedestal
    assert pedestal.vertices_m is not None
    assert pedestal.faces is not None
    size_m, off_m = contact.half_diagonal_m, FLAT_SHARE * rock.height_m
    gaps_m = contact.gaps_m(contact.start_pose)
    base = contact.points_body_m[gaps_m <= gaps_m.min() + off_m]
    # One that stands on a point or a line is as wide as what counts as a slip.
    around = 2.0 * _SLIPPED_SHARE * size_m * np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    if len(base) < 3 or np.linalg.matrix_rank(base - base[0], tol=1e-3 * size_m) < 2:
        base = (base[:, None] + around @ contact.support_from_body).reshape(-1, 3)
    start = _places_m(base, contact.start_pose[None])[0]
    corners = ConvexHull(start).vertices
    ground_m = (pedestal.vertices_m - contact.origin_m) @ contact.scene_from_support
    spacing_m = _SPACING_SHARE * size_m
    ends = _sampled(_boundary_m(ground_m, pedestal.faces, off_m), spacing_m)
    outline = ((rock.hull_vertices_m - contact.origin_m) @ contact.scene_from_support)[:, :2]
    beside_m = _apart_m(outline[ConvexHull(outline).vertices], ends)
    is_far = beside_m > END_WITHIN_HEIGHTS * rock.height_m
    border, ends_there = ends[is_far], is_far[is_far]
    if on_plane:
        parts = _contours_m(ground_m, pedestal.faces, off_m, tilts=not scene.is_drawn_over_plane)
        rises, falls = (_sampled(each, spacing_m) for each in parts)
        border = np.vstack([border, rises, ends[~is_far], falls])
        ends_there = np.arange(len(border)) < len(ends_there) + len(rises)
    outside = ~_within(start[corners], border)  # what lies below the rock it stands on
    border, ends_there = border[outside], ends_there[outside]
    clearance_m = float(_apart_m(start[corners], border).min(initial=np.inf))
    return _Extent(base[corners], border, ends_there, clearance_m, size_m)


def _apart_m(corners_m: Array, places_m: Array) -> Array:
    """Distances (n,) of places (n, 2) from the sides of a polygon (k, 2)."""
    edge = np.roll(corners_m, -1, axis=0) - corners_m
    away = places_m[:, None] - corners_m
    share = np.clip((away * edge).sum(axis=2) / (edge * edge).sum(axis=1), 0.0, 1.0)
    return np.asarray(np.linalg.norm(away - share[..., None] * edge, axis=2).min(axis=1))


def _boundary_m(ground_m: Array, faces: Indices, off_m: float) -> Array:
    """Edges (n, 2, 2) in the support's plane at which the ground's mesh ends there."""
    _, welded = np.unique(ground_m.round(9), axis=0, return_inverse=True)
    half = np.sort(welded.ravel()[faces][:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    _, first, count = np.unique(half, axis=0, return_index=True, return_counts=True)
    ends = ground_m[faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)[first[count == 1]]]
    return np.asarray(ends[(np.abs(ends[..., 2]) <= off_m).any(axis=1)][..., :2])


def _contours_m(ground_m: Array, faces: Indices, off_m: float, *, tilts: bool) -> list[Array]:
    """Segments (n, 2, 2) in the support's plane along which the ground rises from the plane, and falls from it.

    By its height, and, where asked for, by the normal of its triangles.
    """
    corners, found = ground_m[faces], []
    for level_m in (off_m, -off_m):
        over = corners[..., 2] - level_m
        following, after = np.roll(corners, -1, axis=1), np.roll(over, -1, axis=1)
        crosses = (over > 0.0) != (after > 0.0)
        passed = crosses.any(axis=1)
        share = (over / np.where(crosses, over - after, 1.0))[..., None]
        cut = (corners + share * (following - corners))[passed][crosses[passed]]
        found.append(cut.reshape(-1, 2, 3)[..., :2])
    if tilts:
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        size = np.linalg.norm(normal, axis=1)
        steep = normal[:, 2] < np.cos(np.radians(FLAT_DEG)) * size
        beside = steep & (size > 0.0) & (np.abs(corners[..., 2]) <= off_m).any(axis=1)
        rises = corners[..., 2].max(axis=1) > -corners[..., 2].min(axis=1)
        for k, those in enumerate((beside & rises, beside & ~rises)):
            edges = corners[those][:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2, 3)
            found[k] = np.vstack([found[k], edges[(np.abs(edges[..., 2]) <= off_m).all(axis=1)][..., :2]])
    return found


def _sampled(segments_m: Array, spacing_m: float) -> Array:
    """Places (n, 2) along segments (k, 2, 2), none farther from the next than so much."""
    way = segments_m[:, 1] - segments_m[:, 0]
    parts = np.maximum(np.ceil(np.linalg.norm(way, axis=1) / spacing_m).astype(int), 1)
    which = np.repeat(np.arange(len(parts)), parts + 1)
    step = np.arange(len(which)) - np.repeat(np.cumsum(parts + 1) - parts - 1, parts + 1)
    return np.asarray(segments_m[which, 0] + (step / parts[which])[:, None] * way[which])
