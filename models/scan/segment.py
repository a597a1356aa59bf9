"""Segmentation: the rock is what stands on the pedestal, above the narrowing or crevice.

Two passes. The coarse one sweeps a horizontal plane down through the surfels and keeps the peaks that rise
far
above the level at which they join something else; the fine one cuts the surface around the chosen peak
along the
loop that is short and concave (a minimum cut between peak and surroundings, after Boykov and Kolmogorov
2004, with
the convexity of Stein, Schoeler, Papon and Woergoetter 2014 as capacity).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components, maximum_flow
from scipy.spatial import cKDTree

from toppling.models.errors import InputError
from toppling.models.scan.surfels import Surfels, orient, roughness, thin
from toppling.models.scan.word import Word

ROCK, PEDESTAL, NEITHER = 0, 1, 2

COARSE_SURFELS = 25_000
FINE_VOXELS_PER_HEIGHT = 100
LEAST_PEAK_VOXELS = 6
"""A peak lower than this many coarse voxels is roughness."""
CLUTTER_ROUGHNESS = 0.6
"""Median thickness over width above which a neighbourhood is clutter."""
LEAST_SURFELS_ABOVE = 50
"""Fewer patches above an interface that the user names are no rock."""
LEAST_CONCAVE_SHARE = 0.3
"""Share of the coarse cut's edges that must run through a crease: a hummock's foot has none."""
RIVAL_SHARE = 0.6
"""A second thing of this share of the first one's height may be the rock that is meant."""
NEAR_HEIGHTS = 1.5
"""A top farther from where the user points than this many of its heights is not meant."""
SURFACE_ROUGHNESS = 0.4
"""Thickness over width above which a neighbourhood is a bush's, not a surface's."""
SHEET_ROUGHNESS = 0.3
"""The same for fine voxels among clutter, which are a surface's below this: the ground below a bush, a wall's edge."""
FEWEST_OF_A_SURFACE = 100
"""Fewer points among clutter are clutter."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """Something that stands on something: a peak, the surfels cut off with it, and how it was cut."""

    height_m: float
    top_m: NDArray[np.float64]
    rock: NDArray[np.bool_]
    concave_share: float


@dataclass(frozen=True, eq=False)
class Segmentation:
    """Labels of all points and of the surfels around the rock.

    Parameters
    ----------
    label : (n,) int8 array
        Per point: 0 rock, 1 pedestal, 2 neither.
    surfels : Surfels
        Around the rock, at a hundredth of its height.
    surfel_label : (k,) int8 array
    concave_share : float
        Share of the cut that runs through concave creases: 1 is a clear crevice, near 0 no rock.
    others : list of (x, y, z, height)
        Other things that stand there, metres.
    """

    label: NDArray[np.int8]
    surfels: Surfels
    surfel_label: NDArray[np.int8]
    concave_share: float
    others: list[tuple[float, float, float, float]]


def segment(
    points_m: NDArray[np.float64],
    origin_m: NDArray[np.float64],
    near_m: NDArray[np.float64] | None = None,
    word: Word | None = None,
) -> Segmentation:
    """Split a cloud into rock, pedestal and neither.

    Parameters
    ----------
    points_m : (n, 3) array
    origin_m : (3,) array
        Survey coordinates of the points' origin, in which places are told to the user.
    near_m : (2,) array, optional
        x, y in the points' frame, near the top of the rock that is meant, where several stand.
    word : Word, optional
        The interface as the user knows it: the rock is what stands on it.

    Raises
    ------
    InputError
        If nothing in the cloud stands on anything, two things stand there equally, or none near where the user
        points.
    """
    coarse = _coarse_surfels(points_m)
    if word is not None:
        return _refine(points_m, coarse, _standing_on(coarse, word, near_m), [], word)
    candidates = find_candidates(coarse)
    chosen = _choose(candidates, near_m, origin_m)
    return _refine(points_m, coarse, chosen, [c for c in candidates if c is not chosen])


def _standing_on(surfels: Surfels, word: Word, near_m: NDArray[np.float64] | None) -> Candidate:
    """Cut off what stands on the interface that the user names: where they point, or else nearest to its anchors."""
    edges = _neighbourhood(surfels.points_m, surfels.voxel_m)
    points = surfels.points_m
    height = word.interface.flat(points)[:, 2]
    above = height > 2.0 * surfels.voxel_m
    inside = edges[above[edges].all(axis=1)]
    graph = coo_matrix((np.ones(len(inside)), inside.T), shape=(len(points),) * 2)
    part = connected_components(graph, directed=False)[1]
    if near_m is None:
        away = np.median([np.linalg.norm(points - anchor, axis=1) for anchor in word.anchors_m], axis=0)
    else:
        away = np.hypot(*(points[:, :2] - near_m).T)
    large = above & (np.bincount(part)[part] >= LEAST_SURFELS_ABOVE)
    if not large.any():
        raise InputError(
            "nothing stands above the interface that is given",
            where=f"the interface's {word.kind}",
            expected="a plane below the rock, above the rest",
            remedy="check its height and slope; azimuths are counted from east to north",
        )
    chosen = part == part[large][np.argmin(away[large])]
    peak = int(np.argmax(np.where(chosen, height, -np.inf)))
    seeds = _component_of(peak, chosen & (height > 0.4 * height[peak]), edges)
    axis = np.median(points[seeds, :2], axis=0)
    reach = 1.2 * height[peak] + np.quantile(np.hypot(*(points[seeds, :2] - axis).T), 0.95)
    far = (np.hypot(*(points[:, :2] - axis).T) > reach) | (height < -2.0 * surfels.voxel_m)
    far &= ~seeds
    if not far.any():
        raise InputError(
            "nothing lies below the interface that is given",
            where=f"the interface's {word.kind}",
            expected="a plane below the rock, above the rest",
            remedy="check its height; a cloud cropped to the rock shows no pedestal to stand on",
        )
    rock, concave_share = _minimum_cut(surfels, edges, seeds, far, height)
    rock = _component_of(peak, rock, edges)
    return Candidate(float(np.ptp(points[rock, 2])), points[peak], rock, concave_share)


def _coarse_surfels(points_m: NDArray[np.float64]) -> Surfels:
    sample = points_m[:: max(1, len(points_m) // 2_000_000)]
    voxel = float(np.ptp(sample, axis=0).max()) / 150
    thinned, _ = thin(sample, voxel)
    for _ in range(6):
        if 0.7 * COARSE_SURFELS < len(thinned) < 1.4 * COARSE_SURFELS or len(thinned) > 0.5 * len(sample):
            break
        voxel *= np.sqrt(
            len(thinned) / COARSE_SURFELS
        )  # a surface's voxels go with the inverse square of their size
        thinned, _ = thin(sample, voxel)
    return orient(thinned, voxel)


def find_candidates(surfels: Surfels) -> list[Candidate]:
    """Find what stands on something in the cloud, the highest first."""
    edges = _neighbourhood(surfels.points_m, surfels.voxel_m)
    found: list[Candidate] = []
    for peak, level in _peaks(surfels, edges):
        candidate = _cut_off(surfels, edges, peak, level)
        if candidate is not None and not any(
            (candidate.rock & other.rock).sum() > 0.5 * min(candidate.rock.sum(), other.rock.sum())
            for other in found
        ):
            found.append(candidate)
    return sorted(found, key=lambda each: -each.height_m)


def _neighbourhood(points_m: NDArray[np.float64], voxel_m: float) -> NDArray[np.int64]:
    """Pairs (m, 2) of neighbouring surfels, each once."""
    distance, near = cKDTree(points_m).query(points_m, 13)
    start = np.repeat(np.arange(len(points_m)), 12)
    end, length = near[:, 1:].ravel(), distance[:, 1:].ravel()
    keep = (length < 3.0 * voxel_m) & (end < len(points_m))
    return np.unique(np.sort(np.column_stack([start[keep], end[keep]]), axis=1), axis=0)


def _peaks(surfels: Surfels, edges: NDArray[np.int64]) -> list[tuple[int, float]]:
    """Peaks and the level at which each joins something of its size, the most prominent first."""
    z = surfels.points_m[:, 2]
    order = np.argsort(-z)
    rank = np.empty(len(z), np.int64)
    rank[order] = np.arange(len(z))
    upper_first = np.where((rank[edges[:, 0]] < rank[edges[:, 1]])[:, None], edges, edges[:, ::-1])
    upper_first = upper_first[np.argsort(rank[upper_first[:, 1]], kind="stable")]
    root = list(range(len(z)))
    size = [1] * len(z)
    saddle: dict[int, float] = {}

    def find(node: int) -> int:
        while root[node] != node:
            root[node] = root[root[node]]
            node = root[node]
        return node

    least = LEAST_PEAK_VOXELS * surfels.voxel_m
    for upper, lower in upper_first.tolist():
        a, b = find(upper), find(lower)
        if a == b:
            continue
        level = z[lower]
        for one, other in ((a, b), (b, a)):
            grown = size[other] > 0.3 * size[one] or z[other] - level > 0.3 * (z[one] - level)
            if z[one] - level > least and grown and size[other] > 20:
                saddle.setdefault(one, level)
        if rank[a] > rank[b]:
            a, b = b, a
        root[b] = a
        size[a] += size[b]
    for node in range(len(z)):
        if root[node] == node and size[node] > 50 and node not in saddle:
            members = np.array([find(other) == node for other in range(len(z))])
            if z[node] - z[members].min() > least:
                saddle[node] = float(z[members].min())
    return sorted(saddle.items(), key=lambda item: item[1] - z[item[0]])[:12]


def _cut_off(surfels: Surfels, edges: NDArray[np.int64], peak: int, level: float) -> Candidate | None:
    """Cut a peak off its surroundings; None if what comes off is no rock."""
    points = surfels.points_m
    height = points[peak, 2] - level
    high = (points[:, 2] > level + 0.4 * height) & (np.hypot(*(points[:, :2] - points[peak, :2]).T) < height)
    seeds = _component_of(peak, high, edges)
    axis = np.median(points[seeds, :2], axis=0)
    reach = 1.2 * height + np.quantile(np.hypot(*(points[seeds, :2] - axis).T), 0.95)
    far = (np.hypot(*(points[:, :2] - axis).T) > reach) | (points[:, 2] < level - height)
    far &= ~seeds
    if not far.any():
        return None
    rock, concave_share = _minimum_cut(surfels, edges, seeds, far)
    rock = _component_of(peak, rock, edges)
    if rock.sum() < 50 or np.median(surfels.roughness[rock]) > SURFACE_ROUGHNESS:
        return None
    return Candidate(float(np.ptp(points[rock, 2])), points[peak], rock, concave_share)


def _component_of(member: int, among: NDArray[np.bool_], edges: NDArray[np.int64]) -> NDArray[np.bool_]:
    inside = edges[among[edges].all(axis=1)]
    graph = coo_matrix((np.ones(len(inside)), inside.T), shape=(len(among),) * 2)
    component = connected_components(graph, directed=False)[1]
    return (component == component[member]) & among


def _minimum_cut(
    surfels: Surfels,
    edges: NDArray[np.int64],
    seeds: NDArray[np.bool_],
    far: NDArray[np.bool_],
    height_m: NDArray[np.float64] | None = None,
) -> tuple[NDArray[np.bool_], float]:
    """Surfels on the seeds' side of the cheapest cut, and the share of the cut edges that are concave.

    Where heights over a known interface are given, edges through it cost next to nothing.
    """
    count = len(surfels.points_m)
    bend = _bend(surfels, edges)
    capacity = np.rint(10 + 1000 / (1 + np.exp(-(bend + 0.25) / 0.08))).astype(np.int32)
    if height_m is not None:
        capacity[(height_m[edges] > 0.0).sum(axis=1) == 1] = 1
    source, sink = count, count + 1
    big = np.int32(10_000_000)
    start = np.concatenate([edges[:, 0], edges[:, 1], np.full(seeds.sum(), source), np.flatnonzero(far)])
    end = np.concatenate([edges[:, 1], edges[:, 0], np.flatnonzero(seeds), np.full(far.sum(), sink)])
    value = np.concatenate([capacity, capacity, np.full(seeds.sum() + far.sum(), big)])
    graph = coo_matrix((value, (start, end)), shape=(count + 2,) * 2).tocsr()
    flow = maximum_flow(graph, source, sink).flow
    left = (graph - flow).tocsr()
    left.data = np.maximum(left.data, 0)
    left.eliminate_zeros()
    reached = _reachable(left, source)[:count]
    cut = reached[edges[:, 0]] != reached[edges[:, 1]]
    return reached, float((bend[cut] < -0.25).mean()) if cut.any() else 1.0


def _reachable(graph: coo_matrix, start: int) -> NDArray[np.bool_]:
    from scipy.sparse.csgraph import breadth_first_order

    reached = np.zeros(graph.shape[0], bool)
    reached[breadth_first_order(graph, start, return_predecessors=False)] = True
    return reached


def _bend(surfels: Surfels, edges: NDArray[np.int64]) -> NDArray[np.float64]:
    """How the surface bends between neighbours: positive convex, negative concave, about the angle."""
    a, b = edges.T
    along = surfels.points_m[b] - surfels.points_m[a]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    return np.einsum("ij,ij->i", surfels.normals[b] - surfels.normals[a], along)


def _choose(
    candidates: list[Candidate], near_m: NDArray[np.float64] | None, origin_m: NDArray[np.float64]
) -> Candidate:
    """Pick the one thing that stands there, or the one nearest to where the user points."""
    standing = [c for c in candidates if c.concave_share > LEAST_CONCAVE_SHARE]
    if not standing:
        raise InputError(
            "nothing in the cloud stands on anything",
            where="segmentation",
            expected="a rock above a crevice or narrowing, seen from several sides with some of its pedestal",
            remedy="crop the cloud to the rock and its pedestal, and check that z points up",
        )
    if near_m is not None:
        return _nearest(standing, near_m, origin_m)
    rivals = [c for c in standing[1:] if c.height_m > RIVAL_SHARE * standing[0].height_m]
    if rivals:
        raise InputError(
            f"{1 + len(rivals)} things of like size stand there, tops at x, y: "
            + _tops([standing[0], *rivals], origin_m),
            where="segmentation",
            expected="one rock, or a word on which one",
            remedy="name one by --near X Y in survey coordinates, as printed here, or crop the cloud",
        )
    return standing[0]


def _nearest(
    standing: list[Candidate], near_m: NDArray[np.float64], origin_m: NDArray[np.float64]
) -> Candidate:
    """Pick what stands nearest to where the user points, if that is near."""
    away = [float(np.hypot(*(c.top_m[:2] - near_m))) for c in standing]
    first = int(np.argmin(away))
    if away[first] > NEAR_HEIGHTS * standing[first].height_m:
        raise InputError(
            f"the nearest thing that stands there has its top {away[first]:.3g} m away and is "
            f"{standing[first].height_m:.2g} m high",
            where="--near",
            expected=f"a place within {NEAR_HEIGHTS} heights of a top; those found, at x, y: "
            + _tops(standing, origin_m),
            remedy="name one of them by --near X Y in survey coordinates; if yours is not among them, crop the cloud "
            "to it and its pedestal",
        )
    return standing[first]


def _tops(candidates: list[Candidate], origin_m: NDArray[np.float64]) -> str:
    """Where things stand, survey coordinates."""
    return "; ".join(
        "{:.1f}, {:.1f} ({:.2g} m high)".format(*(c.top_m + origin_m)[:2], c.height_m) for c in candidates
    )


def _refine(
    points_m: NDArray[np.float64],
    coarse: Surfels,
    chosen: Candidate,
    others: list[Candidate],
    word: Word | None = None,
) -> Segmentation:
    """Cut again at a hundredth of the rock's height, and label every point."""
    rock = coarse.points_m[chosen.rock]
    axis, height = rock[:, :2].mean(axis=0), chosen.height_m
    reach = np.hypot(*(rock[:, :2] - axis).T).max() + 0.5 * height
    around = (np.hypot(*(points_m[:, :2] - axis).T) < reach) & (
        points_m[:, 2] > rock[:, 2].min() - 0.7 * height
    )
    voxel = height / FINE_VOXELS_PER_HEIGHT
    thinned, index = thin(points_m[around], voxel)
    surfels = orient(thinned, voxel)
    edges = _neighbourhood(surfels.points_m, voxel)
    _, near = cKDTree(coarse.points_m).query(surfels.points_m, 8)
    votes = chosen.rock[near].mean(axis=1)
    if word is None:
        fine_rock, concave_share = _minimum_cut(surfels, edges, votes == 1.0, votes == 0.0)
    else:
        over = word.interface.flat(surfels.points_m)[:, 2]
        seeds, far = (votes == 1.0) & (over > 2.0 * voxel), (votes == 0.0) | (over < -2.0 * voxel)
        fine_rock, concave_share = _minimum_cut(surfels, edges, seeds, far, over)
    surfel_label = np.where(fine_rock, ROCK, PEDESTAL).astype(np.int8)
    label = np.full(len(points_m), PEDESTAL, np.int8)
    nearest = (
        np.where(index >= 0, index, cKDTree(surfels.points_m).query(points_m[around])[1])
        if (index < 0).any()
        else index
    )
    label[around] = surfel_label[nearest]
    label[_clutter(points_m, coarse, chosen.rock, voxel)] = NEITHER
    return Segmentation(
        label,
        surfels,
        surfel_label,
        concave_share,
        [
            (float(other.top_m[0]), float(other.top_m[1]), float(other.top_m[2]), other.height_m)
            for other in others
        ],
    )


def _clutter(
    points_m: NDArray[np.float64], coarse: Surfels, rock: NDArray[np.bool_], fine_m: float
) -> NDArray[np.bool_]:
    """Points of a bush or the like: where neighbourhoods are as thick as they are wide, what lies on no surface.

    Not beside the rock, where the two sides of the crevice make one thick neighbourhood.
    """
    _, near = cKDTree(coarse.points_m).query(coarse.points_m, 9)
    thick = np.median(coarse.roughness[near], axis=1) > CLUTTER_ROUGHNESS
    thick &= cKDTree(coarse.points_m[rock]).query(coarse.points_m)[0] > 4 * coarse.voxel_m
    clutter = np.zeros(len(points_m), bool)
    if not thick.any():
        return clutter
    low = coarse.points_m[thick].min(axis=0) - coarse.voxel_m
    high = coarse.points_m[thick].max(axis=0) + coarse.voxel_m
    around = np.flatnonzero(((points_m > low) & (points_m < high)).all(axis=1))
    around = around[thick[cKDTree(coarse.points_m).query(points_m[around])[1]]]
    if len(around) > FEWEST_OF_A_SURFACE:
        around = around[~_on_a_surface(points_m[around], fine_m)]
    clutter[around] = True
    return clutter


def _on_a_surface(points_m: NDArray[np.float64], voxel_m: float) -> NDArray[np.bool_]:
    """Points whose voxel lies with its neighbours in a sheet, such as the ground below a bush."""
    means, voxel = thin(points_m, voxel_m)
    return (voxel >= 0) & (roughness(means)[voxel] < SHEET_ROUGHNESS)


def label_surfels(
    surfels: Surfels, points_m: NDArray[np.float64], label: NDArray[np.int8]
) -> NDArray[np.int8]:
    """Label of the point nearest to each surfel."""
    low, high = surfels.points_m.min(axis=0) - surfels.voxel_m, surfels.points_m.max(axis=0) + surfels.voxel_m
    around = np.flatnonzero(((points_m > low) & (points_m < high)).all(axis=1))
    return label[around[cKDTree(points_m[around]).query(surfels.points_m)[1]]]
