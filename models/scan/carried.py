"""Things that a plane carries: what stands on a dressed or worn flat top, however it is shaped above.

The sweep of `candidates` finds what has a narrowing or joins its surroundings below; a statue on its plinth, or a block
on a ledge, widens toward its base and is hidden from it by shrubs that overhang. Here the planes come first.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from toppling.models.joined import joined_parts
from toppling.models.scan.candidates import (
    LEAST_PEAK_VOXELS,
    LEAST_SURFELS,
    Candidate,
    component_of,
    cut_between,
    neighbourhood,
)
from toppling.models.scan.doubt import sectors
from toppling.models.scan.interface import Interface, fitted_plane
from toppling.models.scan.surfels import Surfels

_LEVEL, _LIKE = 0.8, 0.97
"""Cosines: of a patch's normal to the vertical where something can stand, and between neighbours in one plane."""
_LEAST_OF_A_PLANE = 80
"""Fewer patches are no plane that carries anything."""
_FLAT_VOXELS = 1.0
"""Root mean square distance of a plane's patches from it, in their width."""
_FOOT_VOXELS, _BESIDE_VOXELS, _ABOVE_VOXELS = 6.0, 6.0, 2.0
_SECTORS, _SURROUNDED = 24, 0.6
"""Share of the directions around its foot in which the plane must be seen beside a thing that it carries."""
_CREASED = 0.2
"""Share of the cut's edges that must run through a crease, where a plane around it tells of the thing as well."""
_OF_THE_RELIEF = 0.3
"""One thing alone that has this share of the cloud's relief is meant, whatever planes carry."""
_TALLER = 2.0
"""A thing that a plane carries is meant before others if it is so many times as high as they are."""
_OF_A_STACK = 0.5
"""Of two things one upon the other the upper is meant if it has this share of the height of both."""
_WITHIN = 0.13
"""Its foot must lie this share of the height of both above theirs: a statue's lies .21, on 48 rocks .04 at most."""


def _find_carried(surfels: Surfels) -> list[Candidate]:
    """What the planes of a cloud carry, the highest first; of what stands upon another, the upper one.

    surfels: of the whole cloud.
    """
    edges = neighbourhood(surfels.points_m, surfels.voxel_m)
    found: list[Candidate] = []
    for plane in _level_planes(surfels, edges):
        found += _on_plane(surfels, edges, plane)
    found.sort(key=lambda each: -each.height_m)
    kept: list[Candidate] = []
    for each in found:
        below = [k for k, other in enumerate(kept) if (each.rock & other.rock).sum() > 0.5 * each.rock.sum()]
        if not below:
            kept.append(each)
        elif each.height_m > _OF_A_STACK * kept[below[0]].height_m:
            kept[below[0]] = each
    return kept


def carried_instead(
    surfels: Surfels, standing: list[Candidate], near_m: NDArray[np.float64] | None
) -> Candidate | None:
    """What a plane carries, if that is much higher than all that stands otherwise; None if it is not.

    surfels: of the whole cloud.
    standing: what was found to stand there, the highest first.
    near_m: (2,), x, y of the top of what is meant: only what covers it counts.
    """
    relief = float(np.ptp(surfels.points_m[:, 2]))
    highest = standing[0].height_m if standing else 0.0
    if _TALLER * highest > relief or (len(standing) == 1 and highest > _OF_THE_RELIEF * relief):
        return None
    for each in _find_carried(surfels):
        rock = surfels.points_m[each.rock, :2]
        covers = near_m is None or ((near_m > rock.min(axis=0)) & (near_m < rock.max(axis=0))).all()
        if covers and each.height_m > _TALLER * highest:
            return each
    return None


def upper_of(surfels: Surfels, chosen: Candidate) -> Candidate | None:
    """What a level top within a thing carries, where that is most of its height: a statue, and not its plinth with it.

    surfels: of the whole cloud.
    chosen: None is told of one that was cut off along no line, as the largest of many boulders.
    """
    if not len(chosen.loop_m):
        return None
    own = cKDTree(chosen.surfels.points_m[chosen.rock])
    reach_m = _BESIDE_VOXELS * max(surfels.voxel_m, chosen.surfels.voxel_m)
    foot_m = np.median(chosen.loop_m[:, 2]) + _WITHIN * chosen.height_m
    for each in _find_carried(surfels):
        upper = each.height_m > _OF_A_STACK * chosen.height_m and np.median(each.loop_m[:, 2]) > foot_m
        if upper and (own.query(surfels.points_m[each.rock])[0] < reach_m).all():
            return each
    return None


def _level_planes(surfels: Surfels, edges: NDArray[np.int64]) -> list[Interface]:
    """Planes of patches that something can stand on, the widest first."""
    level = surfels.normals[:, 2] > _LEVEL
    alike = np.einsum("ij,ij->i", surfels.normals[edges[:, 0]], surfels.normals[edges[:, 1]]) > _LIKE
    inside = edges[level[edges].all(axis=1) & alike]
    count = len(level)
    part = joined_parts(inside, count)
    sizes = np.bincount(part[level], minlength=part.max() + 1)
    planes = []
    for number in np.argsort(-sizes)[:12]:
        if sizes[number] < _LEAST_OF_A_PLANE:
            break
        plane = fitted_plane(surfels.points_m[part == number])
        if plane.roughness_m < _FLAT_VOXELS * surfels.voxel_m:
            planes.append(plane)
    return planes


def _on_plane(surfels: Surfels, edges: NDArray[np.int64], plane: Interface) -> list[Candidate]:
    """What stands on a plane with the plane seen around it."""
    points, voxel = surfels.points_m, surfels.voxel_m
    flat = plane.flat(points)
    height = flat[:, 2]
    top = (np.abs(height) < _ABOVE_VOXELS * voxel) & (surfels.normals @ plane.normal > _LEVEL)
    above = height > _ABOVE_VOXELS * voxel
    inside = edges[above[edges].all(axis=1)]
    part = joined_parts(inside, len(points))
    sizes = np.bincount(part[above], minlength=part.max() + 1)
    found = []
    for number in np.argsort(-sizes)[:3]:
        if sizes[number] < LEAST_SURFELS:
            break
        thing = above & (part == number)
        foot = thing & (height < _FOOT_VOXELS * voxel)
        if height[thing].max() < LEAST_PEAK_VOXELS * voxel or not foot.any() or not top.any():
            continue
        away, _ = cKDTree(flat[foot, :2]).query(flat[top, :2])
        beside = flat[top][away < _BESIDE_VOXELS * voxel, :2] - flat[foot, :2].mean(axis=0)
        if len(np.unique(sectors(beside, _SECTORS))) < _SURROUNDED * _SECTORS:
            continue
        peak = int(np.argmax(np.where(thing, height, -np.inf)))
        seeds, far = thing_and_rest(surfels, edges, thing, peak, height)
        candidate = cut_between(surfels, edges, seeds, far, peak, height) if far.any() else None
        if candidate is not None and candidate.concave_share > _CREASED:
            found.append(candidate)
    return found


def thing_and_rest(
    surfels: Surfels,
    edges: NDArray[np.int64],
    thing: NDArray[np.bool_],
    peak: int,
    height_m: NDArray[np.float64],
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which patches are surely of a thing on a plane, and which surely are not: seeds of the cut between them.

    edges: (m, 2).
    thing: (k,), patches joined above the plane.
    peak: one of them.
    height_m: (k,), over the plane.
    """
    points = surfels.points_m
    seeds = component_of(peak, thing & (height_m > 0.4 * height_m[peak]), edges)
    axis = np.median(points[seeds, :2], axis=0)
    reach = 1.2 * height_m[peak] + np.quantile(np.hypot(*(points[seeds, :2] - axis).T), 0.95)
    far = (np.hypot(*(points[:, :2] - axis).T) > reach) | (height_m < -_ABOVE_VOXELS * surfels.voxel_m)
    return seeds, far & ~seeds
