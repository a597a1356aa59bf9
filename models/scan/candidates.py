"""Candidates: peaks of a thinned cloud, each cut off its surroundings along the loop that is short and concave."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, diags
from scipy.sparse.csgraph import breadth_first_order, maximum_flow
from scipy.sparse.linalg import eigsh
from scipy.spatial import cKDTree

from toppling.models.arrays import Array, Flags, Indices, bounds_of, distinct, inside_cylinder
from toppling.models.scan.interface import SECTORS, Interface, fitted_plane, sectors
from toppling.models.scan.surfels import LEVEL, SAMPLED_POINTS, Surfels, orient, thin
from toppling.models.shapes import joined_parts
from toppling.models.smooth_mesh import CREASE_DEG

_COARSE_SURFELS = 25_000
LEAST_PEAK_VOXELS = 6
"""A peak lower than this many coarse voxels is roughness."""
_ZOOMED = 3
_ZOOMED_SHARE = 0.4
"""Number of the highest candidates, and their least height over the highest one's, that are resampled from near by."""
_ZOOMS = 3
_BESIDE_HEIGHTS = 0.25
"""How far around a candidate is looked at from near by, in its heights."""
_FINEST_VOXELS_PER_HEIGHT = 80
_TRIED_HEIGHTS = (1.0, 0.7, 0.45)
"""Heights that a thing may have, over its drop to where it joins another."""
CREASE = -0.25
"""Bend between neighbours below which a crease runs between them."""
_OF_A_CREASE, _OF_A_BULGE = 10, 1000
"""Prices of an edge through the sharpest crease and across a bulge."""
_LIKE_COST, _OTHER_SHARE = 1.25, 0.7
"""A cut is the rival of a cheaper one that costs at most so much less, if the two share less of their surfels."""
_OF_A_STACK = 0.5
"""Least share of a stack's height that its upper thing has."""
_ONE_LINE = 0.9
"""Share of the surfels of both from which on two cuts follow one line, of which the cheaper counts."""
_AROUND = 0.4
"""Share of the directions about its middle in which the line must show along which a thing is cut off."""
JOINED_VOXELS = 3.0
"""Patches so near to each other are neighbours."""
_MEETS_VOXELS = 2.0
"""Distance from a known interface within which rock and pedestal meet in patches."""
LEAST_CONCAVE_SHARE = 0.3
"""Share of the cut's edges that must run through a crease: a hummock's foot has none."""
_SHARP = -0.8
"""Lower quartile of the bend along the crease between two bodies, some 45 degrees: where blobs grew together, .6."""
_PART_SHARE = 0.03
"""Least share of a rock's patches that a part of it has: of its volume about half a percent."""
_BELT_WIDTHS = 0.25
"""Widest unseen belt in a surface, over the width of the part beyond it."""
LEAST_SURFELS = 50
"""Fewer patches are no rock."""
_ALIKE = 0.97
"""Cosine between the normals of neighbours in one plane."""
_LEAST_OF_A_PLANE, _FLAT_VOXELS = 80, 1.0
"""Patches of a plane that carries something, and their distance from it, root mean square, in their width."""
_LOW_VOXELS, _BESIDE_VOXELS, _ABOVE_VOXELS, _SURROUNDED = 6.0, 6.0, 2.0, 0.6
"""Thresholds for things on a plane: heights of the foot and of what is off the plane, distance in which it shows beside
its foot, and the share of the directions in which it does."""
_BELOW_SHARE = 0.25
"""Least share of the directions in which a plane that carries a thing goes on below it, where little of it shows."""
JOINED_SPACINGS, _NEIGHBOURS = 1.8, 12
"""Patches of a rock so near, over the distance to the fourth neighbour, hang together; of so many that are nearest."""
SURFACE_ROUGHNESS = 0.4
"""Thickness over width above which a neighbourhood is a bush's, not a surface's."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """Something that stands on something: a peak, the surfels cut off with it, and how it was cut."""

    height_m: float
    top_m: Array
    surfels: Surfels
    rock: Flags
    concave_share: float  # of the edges that are cut
    cost: float  # of the cut, over the root of the number of surfels: short and creased is cheap
    loop_m: Array  # (k, 3): the patches beyond the edges that are cut, of what it stands on
    carried: bool  # whether these face up, as those of a neck do not
    rivals: tuple["Candidate", ...] = ()  # cuts of like cost that leave much less or much more
    hidden: bool = False  # whether most of where it parts from what is below was not seen

    def shared(self, other: "Candidate") -> float:
        """Surfels of both over those of either; by their places where they are not the same cloud's."""
        if self.surfels is other.surfels:
            return float((self.rock & other.rock).sum() / (self.rock | other.rock).sum())
        nearest = cKDTree(other.surfels.points_m).query(self.surfels.points_m)[1]
        there = other.rock[nearest]
        return float((self.rock & there).sum() / max((self.rock | there).sum(), 1))

    def share_around(self, places_m: Array) -> Array:
        """Share (k,) of the patches about each place that are its own."""
        return np.asarray(self.rock[cKDTree(self.surfels.points_m).query(places_m, 8)[1]].mean(axis=1))


def surfels_of(points_m: Array, finest_m: float = 0.0) -> Surfels:
    """Thin a cloud to about `_COARSE_SURFELS` patches, or fewer where its points or `finest_m` give no more."""
    sample = points_m[:: max(1, len(points_m) // SAMPLED_POINTS)]
    voxel = max(float(np.diff(bounds_of(sample), axis=0).max()) / 150, finest_m)
    thinned, _ = thin(sample, voxel)
    for _ in range(6):
        enough = 0.7 * _COARSE_SURFELS < len(thinned) < 1.4 * _COARSE_SURFELS or len(thinned) > 0.5 * len(
            sample
        )
        if enough or (voxel == finest_m and len(thinned) < _COARSE_SURFELS):
            break
        # A surface's voxels go with the inverse square of their size.
        voxel = max(voxel * np.sqrt(len(thinned) / _COARSE_SURFELS), finest_m)
        thinned, _ = thin(sample, voxel)
    return orient(thinned, voxel)


def find_candidates(points_m: Array, coarse: Surfels) -> list[Candidate]:
    """Find what stands on something in the cloud, the highest first: what rises, and closes at a crease.

    Peaks are cut off their surroundings as if they had several heights, and so is what level planes carry; of cuts that
    overlap the cheapest counts, and others of like cost are its rivals. Of a stack the upper one counts that a level
    plane within it carries: a statue and not its plinth with it. The cuts of the highest are compared from near by, as
    the whole cloud's patches may be too wide for their crevice.
    """
    seen, support = seen_and_support(coarse)
    edges = np.vstack([seen, support])
    cuts = [
        _cut_at(coarse, edges, peak, share * (coarse.points_m[peak, 2] - level))
        for peak, level in _peaks(coarse, edges)
        for share in _TRIED_HEIGHTS
    ]
    on_planes = [cut for plane in _level_planes(coarse, edges) for cut in _on_plane(coarse, edges, plane)]
    closed = [
        candidate
        for candidate in [*cuts, *on_planes]
        if candidate and (candidate.hidden or _closes(candidate))
    ]
    part = joined_parts(seen, len(coarse.points_m))
    for above in (part == number for number in distinct(part[support[:, 0]])):
        if cut := cut_between(coarse, edges, above, ~above, highest(above, coarse.points_m[:, 2])):
            level = np.full(len(cut.loop_m), cut.loop_m[:, 2].max())
            closed.append(replace(cut, hidden=True, loop_m=np.column_stack([cut.loop_m[:, :2], level])))
    found: list[list[Candidate]] = []  # each thing's cuts, that which counts first
    for candidate in sorted(closed, key=lambda candidate: (candidate.hidden, candidate.cost)):
        own = next((k for k, cuts in enumerate(found) if (candidate.rock & cuts[0].rock).any()), None)
        if own is None:
            found.append([candidate])
        elif candidate.hidden:
            whole, upper = found[own][0].rock, candidate.rock
            if (upper & whole).sum() > max(_ONE_LINE * upper.sum(), _PART_SHARE * whole.sum()):
                found[own][1:] = [cut for cut in found[own][1:] if cut.shared(candidate) < _ONE_LINE]
                if _is_another(candidate, found[own]):
                    found[own].append(candidate)
        elif candidate in on_planes and _is_upper(candidate, found[own][0]):
            found[own] = [candidate]
        elif found[own][0] not in on_planes and _is_another(candidate, found[own]):
            found[own].append(candidate)
    found.sort(key=lambda cuts: -cuts[0].height_m)
    large = [cuts for cuts in found[:_ZOOMED] if cuts[0].height_m > _ZOOMED_SHARE * found[0][0].height_m]
    near_by = [_seen_near_by(points_m, cuts) for cuts in large]
    things = [thing for thing, _ in near_by] + [_best_parted(cuts) for cuts in found[len(large) :]]
    for thing in (thing for _, beside in near_by for thing in beside):
        if all(thing.shared(other) < 1.0 - _ONE_LINE for other in things):
            things.append(thing)
    return sorted(things, key=lambda candidate: -candidate.height_m)


def _is_another(cut: Candidate, others: Iterable[Candidate]) -> bool:
    """Whether a cut leaves much less or more than each of some others; beside a neck, if it is another line at all."""
    return all(
        cut.shared(other)
        < (_ONE_LINE if cut.carried > other.carried or cut.hidden or other.hidden else _OTHER_SHARE)
        for other in others
    )


def _best_parted(cuts: list[Candidate]) -> Candidate:
    """Of the cuts of one thing the first, or a cheaper one about as high or higher, with the rivals of that.

    A part that is cheaper to cut off than the whole stands upon the rest: either may be meant.
    """
    whole = [cut for cut in cuts if cut.height_m > _ONE_LINE * cuts[0].height_m]
    return with_rivals(min(whole, key=lambda cut: cut.cost), cuts)


def with_rivals(thing: Candidate, cuts: list[Candidate]) -> Candidate:
    """A thing with those of some cuts that cost like it and leave much less or much more than it and each other.

    What is cut off along a neck may be one with what is below: then a higher cut that follows what carries both is a
    rival at any cost, and so are both where it was not seen how they part.
    """
    for cut in cuts:
        below = cut.carried > thing.carried and _ONE_LINE * cut.height_m > thing.height_m
        like = cut.cost < _LIKE_COST * thing.cost or below or cut.hidden or thing.hidden
        if like and _is_another(cut, (thing, *thing.rivals)):
            thing = replace(thing, rivals=(*thing.rivals, cut))
    return thing


def _is_upper(thing: Candidate, other: Candidate) -> bool:
    """Whether a thing is the upper part of another, and not a small one that lies upon it."""
    own = float((thing.rock & other.rock).sum() / thing.rock.sum())
    return own > _ONE_LINE and _OF_A_STACK * other.height_m < thing.height_m < other.height_m


def _closes(thing: Candidate) -> bool:
    """Whether what parts a thing from the rest goes around it: a cut through creases, or a gap over what is lower."""
    if thing.concave_share < LEAST_CONCAVE_SHARE or not len(thing.loop_m):
        return False
    rock, rest = thing.surfels.points_m[thing.rock], thing.surfels.points_m[~thing.rock]
    away_m, over = cKDTree(rock[:, :2]).query(rest[:, :2])
    beside = rest[(away_m < JOINED_VOXELS * thing.surfels.voxel_m) & (rest[:, 2] < rock[over, 2])]
    parted_m = np.vstack([thing.loop_m, beside])[:, :2]
    return len(np.unique(sectors(parted_m - rock[:, :2].mean(axis=0)))) > _AROUND * SECTORS


def _seen_near_by(points_m: Array, cuts: list[Candidate]) -> tuple[Candidate, list[Candidate]]:
    """Cut a thing again with as many patches around it alone as the whole cloud had, as long as that is finer.

    cuts: the thing's, that which counts first; prices compare among patches of one width.
    Returns it with its rivals, and what from afar was one with it and stands beside it.
    """
    beside: list[Candidate] = []
    for _ in range(_ZOOMS):
        rock = np.vstack([cut.surfels.points_m[cut.rock] for cut in cuts])
        axis, height, coarse_m = rock[:, :2].mean(axis=0), cuts[0].height_m, cuts[0].surfels.voxel_m
        reach = np.hypot(*(rock[:, :2] - axis).T).max() + _BESIDE_HEIGHTS * height
        around = inside_cylinder(points_m, axis, reach, rock[:, 2].min() - _BESIDE_HEIGHTS * height)
        around = around[:: max(1, len(around) // SAMPLED_POINTS)]
        surfels = surfels_of(points_m[around], height / _FINEST_VOXELS_PER_HEIGHT)
        if surfels.voxel_m > 0.9 * coarse_m:
            break  # nothing to be seen that was not seen before
        edges, z = surface_edges(surfels), surfels.points_m[:, 2]
        rim = np.hypot(*(surfels.points_m[:, :2] - axis).T) > reach - 3.0 * surfels.voxel_m
        rim |= z < rock[:, 2].min() - _BESIDE_HEIGHTS * height + 3.0 * surfels.voxel_m
        found: list[Candidate] = []
        for cut in cuts:
            # The thing itself, but for where its line runs: about where it was seen from afar.
            own, away_m = cut.share_around(surfels.points_m), cKDTree(cut.loop_m).query(surfels.points_m)[0]
            own[away_m < 3.0 * coarse_m] = 0.5
            parts, far = bodies(surfels, edges, own == 1.0), (own == 0.0) | rim
            tall = [part for part in parts[1:] if np.ptp(z[part]) > _ZOOMED_SHARE * height]
            # The whole and, of several bodies, each that may be the rock: what creases join goes where it is cheaper.
            seeds = [own == 1.0, parts[0], *tall] if len(parts) > 1 else [own == 1.0]
            peaks = [highest(part, z) for part in [parts[0], *seeds[1:]]]
            finer = [
                cut_between(surfels, edges, part, far, top) for part, top in zip(seeds, peaks, strict=True)
            ]
            found += [
                replace(thing, hidden=True, loop_m=cut.loop_m) if cut.hidden else thing
                for thing in finer[:2]
                if thing is not None
            ]
            beside += [other for other in finer[2:] if other and finer[1] and other.shared(finer[1]) == 0.0]
            if cut is cuts[0]:
                tried = [_cut_at(surfels, edges, peaks[0], share * height, rim) for share in _TRIED_HEIGHTS]
        if not found:
            break
        thing = _best_parted([*found, *(cut for cut in tried if cut is not None and _closes(cut))])
        cuts = [thing, *thing.rivals]
    return _best_parted(cuts), beside


def bodies(surfels: Surfels, edges: Indices, among: Flags) -> list[Flags]:
    """Parts (n,) of some patches that no crease runs through, the largest first; all of them where none is large.

    What stands beside a rock, or leans on it, is parted from it by a crease all around where they touch.
    """
    smooth = among.copy()
    smooth[edges[bend(surfels, edges) < CREASE]] = False
    part = joined_parts(edges[smooth[edges].all(axis=1)], len(smooth))
    sizes = np.bincount(part[smooth], minlength=part.max() + 1)
    return [smooth & (part == n) for n in np.argsort(-sizes) if sizes[n] >= LEAST_SURFELS] or [among]


def parted(surfels: Surfels, edges: Indices, rock: Flags) -> tuple[list[Flags], list[Flags]]:
    """Bodies (n,) that touch each other in a rock, the largest first, and parts of them beyond a blunter crease.

    Where two bodies touch, the crease between them is sharp; it may be as blunt where one body narrows or is cracked.
    """
    part = _narrowest(surfels, edges, rock)
    rest = rock & ~part
    if min(part.sum(), rest.sum()) < max(_PART_SHARE * rock.sum(), LEAST_SURFELS):
        return [rock], []
    bends = bend(surfels, edges[rock[edges].all(axis=1) & (part[edges].sum(axis=1) == 1)])
    if np.quantile(bends, 0.25) > _SHARP:
        return [rock], [min(part, rest, key=np.sum)] if np.median(bends) < CREASE else []
    sides = parted(surfels, edges, part), parted(surfels, edges, rest)
    found, parts = (first + second for first, second in zip(*sides, strict=True))
    return sorted(found, key=np.sum, reverse=True), parts


def _narrowest(surfels: Surfels, edges: Indices, rock: Flags) -> Flags:
    """One side (n,) of the cut through some patches that is cheapest for what it leaves on its smaller side.

    It is about where the second eigenvector of the graph of the patches steps (Shi and Malik 2000).
    """
    edges = edges[rock[edges].all(axis=1)]
    component = joined_parts(edges, len(rock))
    largest = rock & (component == np.bincount(component[rock]).argmax())
    patches, edges = np.flatnonzero(largest), edges[largest[edges].all(axis=1)]
    price, count = _capacity(surfels, edges), len(patches)
    if count < 2 * LEAST_SURFELS:
        return np.zeros_like(rock)
    one_way = coo_matrix((price / price.mean(), np.searchsorted(patches, edges).T), (count, count))
    adjacent = one_way + one_way.T
    laplacian = (diags(np.asarray(adjacent.sum(axis=1)).ravel()) - adjacent).tocsc()
    start = np.random.default_rng(1).normal(size=count)
    values, vectors = eigsh(laplacian, 2, sigma=-1e-5, tol=1e-3, v0=start)
    order = patches[np.argsort(vectors[:, np.argmax(values)])]
    rank = np.empty(len(rock), np.int64)
    rank[order] = np.arange(count)
    first, last = np.sort(rank[edges], axis=1).T
    cut = np.cumsum(np.bincount(first, price, count) - np.bincount(last, price, count))
    smaller = np.minimum(np.arange(1, count + 1), np.arange(count)[::-1])
    at = 1 + int(np.where(smaller >= LEAST_SURFELS, cut / np.sqrt(np.maximum(smaller, 1)), np.inf).argmin())
    seeds, far = np.zeros_like(rock), np.zeros_like(rock)
    seeds[order[: at // 2]], far[order[(at + count) // 2 :]] = True, True
    return minimum_cut(surfels, edges, seeds, far)


def neighbourhood(points_m: Array, voxel_m: float) -> Indices:
    """Pairs (m, 2) of neighbouring surfels, each once."""
    distance, near = cKDTree(points_m).query(points_m, 13)
    start = np.repeat(np.arange(len(points_m)), 12)
    end, length = near[:, 1:].ravel(), distance[:, 1:].ravel()
    keep = (length < JOINED_VOXELS * voxel_m) & (end < len(points_m))
    lower, upper = np.minimum(start[keep], end[keep]), np.maximum(start[keep], end[keep])
    # One number for each pair: rows are slow to sort.
    return np.column_stack(np.divmod(distinct(lower * len(points_m) + upper), len(points_m)))


def surface_edges(surfels: Surfels) -> Indices:
    """Pairs (m, 2) of neighbouring surfels, each once, also across what nobody saw."""
    return np.vstack(seen_and_support(surfels))


def seen_and_support(surfels: Surfels) -> tuple[Indices, Indices]:
    """Pairs (m, 2) of neighbours on a surface, and of patches that hang in the air with those that they stand on.

    A part of the cloud that stands apart goes on in another one if the nearest patches of the two lie in each other's
    planes all around it, with no crease between: a rock's crown above an unseen belt, but neither a branch above a rock
    nor a rock on ground. Any other part stands on what was seen below it.
    """
    points, edges = surfels.points_m, neighbourhood(surfels.points_m, surfels.voxel_m)
    part = joined_parts(edges, len(points))
    sizes = np.bincount(part)
    large, found, support = np.flatnonzero(sizes >= LEAST_SURFELS), [edges], [edges[:0]]
    for number in large[np.argsort(-sizes[large])][1:]:
        own, middle = part == number, points[part == number].mean(axis=0)
        if np.median(surfels.roughness[own]) > SURFACE_ROUGHNESS:
            continue
        reach_m = _BELT_WIDTHS * float(np.ptp(points[own], axis=0).max())
        other = (sizes[part] > sizes[number]) & (
            np.linalg.norm(points - middle, axis=1) < reach_m / _BELT_WIDTHS
        )
        if not other.any():
            continue
        pair = _facing(points, np.flatnonzero(own), np.flatnonzero(other))
        along = np.diff(points[pair], axis=1)[:, 0]
        away_m = np.linalg.norm(along, axis=1)
        off = np.abs(np.einsum("ijk,ik->ij", surfels.normals[pair], along / away_m[:, None])).max(axis=1)
        pair = pair[(off < np.sin(np.deg2rad(CREASE_DEG))) & (away_m < reach_m)]
        if len(np.unique(sectors(points[pair[:, 0]] - middle))) > _AROUND * SECTORS:
            found.append(pair)
        else:
            support.append(_support(surfels, np.flatnonzero(own), np.flatnonzero(part != number)))
    return np.vstack(found), np.vstack(support)


def _support(surfels: Surfels, own: Indices, other: Indices) -> Indices:
    """Pairs (m, 2) of patches of a part below most of which others were seen, and of the highest of these."""
    points, reach_m = surfels.points_m, _MEETS_VOXELS * surfels.voxel_m
    away_m, over = cKDTree(points[own, :2]).query(points[other, :2])
    lower = other[(away_m < reach_m) & (points[other, 2] < points[own[over], 2])]
    if not len(lower) or np.median(cKDTree(points[lower, :2]).query(points[own, :2])[0]) > reach_m:
        return np.empty((0, 2), np.int64)
    top = lower[points[lower, 2] > points[lower, 2].max() - JOINED_VOXELS * surfels.voxel_m]
    return np.column_stack([own[cKDTree(points[own]).query(points[top])[1]], top])


def _facing(points: Array, own: Indices, other: Indices) -> Indices:
    """Pairs (m, 2) of patches of two parts that are the nearest to each other."""
    there = other[cKDTree(points[other]).query(points[own])[1]]
    back = own[cKDTree(points[own]).query(points[there])[1]]
    return np.column_stack([own, there])[back == own]


def _peaks(surfels: Surfels, edges: Indices) -> list[tuple[int, float]]:
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
        for first, other in ((a, b), (b, a)):
            grown = size[other] > 0.3 * size[first] or z[other] - level > 0.3 * (z[first] - level)
            if z[first] - level > least and grown and size[other] > 20:
                saddle.setdefault(first, level)
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


def _cut_at(
    surfels: Surfels, edges: Indices, peak: int, height: float, border: Flags | bool = False
) -> Candidate | None:
    """Cut a peak off as if it were so high; the border is no part of it."""
    points = surfels.points_m
    level = points[peak, 2] - height
    high = (points[:, 2] > level + 0.4 * height) & (np.hypot(*(points[:, :2] - points[peak, :2]).T) < height)
    other = (points[:, 2] < level - height) | border
    seeds, far = _seeds_and_far(points, edges, peak, high, other, height)
    return cut_between(surfels, edges, seeds, far, peak) if far.any() else None


def cut_between(
    surfels: Surfels, edges: Indices, seeds: Flags, far: Flags, peak: int, heights_m: Array | None = None
) -> Candidate | None:
    """What the cheapest cut between seeds and what is far leaves around the peak; None if that is no rock."""
    cut_off = minimum_cut(surfels, edges, seeds, far, heights_m)
    rock, share = _component_of(peak, cut_off, edges), _concave_share(surfels, edges, cut_off)
    if rock.sum() < LEAST_SURFELS or np.median(surfels.roughness[rock]) > SURFACE_ROUGHNESS:
        return None
    points = surfels.points_m
    height_m = float(np.ptp(points[rock, 2]))
    if height_m < surfels.voxel_m:  # a part of a level face
        return None
    cut = edges[rock[edges[:, 0]] != rock[edges[:, 1]]]
    loop = np.where(rock[cut[:, 0]], cut[:, 1], cut[:, 0])
    carried = not len(loop) or float(surfels.normals[loop, 2].mean()) > 0.0
    cost = float(_capacity(surfels, cut).sum() / (_OF_A_BULGE * np.sqrt(rock.sum())))
    return Candidate(height_m, points[peak], surfels, rock, share, cost, points[loop], carried)


def _level_planes(surfels: Surfels, edges: Indices) -> list[Interface]:
    """Planes of neighbouring patches that something can stand on, the widest first."""
    level = surfels.normals[:, 2] > LEVEL
    alike = np.einsum("ij,ij->i", surfels.normals[edges[:, 0]], surfels.normals[edges[:, 1]]) > _ALIKE
    part = joined_parts(edges[level[edges].all(axis=1) & alike], len(level))
    sizes = np.bincount(part[level], minlength=part.max() + 1)
    planes = []
    for number in np.argsort(-sizes)[:12]:
        if sizes[number] < _LEAST_OF_A_PLANE:
            break
        own = part == number
        plane = fitted_plane(surfels.points_m[own])
        if plane.roughness_m < _FLAT_VOXELS * surfels.voxel_m:
            planes.append(plane)
    return planes


def _on_plane(surfels: Surfels, edges: Indices, plane: Interface) -> list[Candidate]:
    """What stands on a plane with the plane seen around it, or going on below it in a quarter of the directions."""
    points, voxel = surfels.points_m, surfels.voxel_m
    flat = plane.flat(points)
    height = flat[:, 2]
    top = (np.abs(height) < _ABOVE_VOXELS * voxel) & (surfels.normals @ plane.normal > LEVEL)
    above = height > _ABOVE_VOXELS * voxel
    inside = edges[above[edges].all(axis=1)]
    part = joined_parts(inside, len(points))
    sizes = np.bincount(part[above], minlength=part.max() + 1)
    found = []
    for number in np.argsort(-sizes)[:3]:
        if sizes[number] < LEAST_SURFELS:
            break
        thing = above & (part == number)
        bottom = thing & (height < _LOW_VOXELS * voxel)
        if height[thing].max() < LEAST_PEAK_VOXELS * voxel or not bottom.any() or not top.any():
            continue
        away, _ = cKDTree(flat[bottom, :2]).query(flat[top, :2])
        middle, reach = flat[bottom, :2].mean(axis=0), np.zeros(SECTORS)
        own, offset = flat[thing, :2] - middle, flat[top, :2] - middle
        np.maximum.at(reach, sectors(own), np.hypot(*own.T))
        below = np.hypot(*offset.T) < reach[sectors(offset)] - JOINED_VOXELS * voxel
        hidden = len(np.unique(sectors(offset[away < _BESIDE_VOXELS * voxel]))) < _SURROUNDED * SECTORS
        if hidden and len(np.unique(sectors(offset[below]))) < _BELOW_SHARE * SECTORS:
            continue
        peak = highest(thing, height)
        seeds, far = thing_and_rest(surfels, edges, thing, peak, height)
        candidate = cut_between(surfels, edges, seeds, far, peak, height) if far.any() else None
        if candidate is not None:
            on_plane = plane.onto(candidate.loop_m)
            found.append(replace(candidate, hidden=True, loop_m=on_plane) if hidden else candidate)
    return found


def highest(among: Flags, heights_m: Array) -> int:
    """Number of the highest of some patches."""
    return int(np.argmax(np.where(among, heights_m, -np.inf)))


def thing_and_rest(
    surfels: Surfels, edges: Indices, thing: Flags, peak: int, height_m: Array
) -> tuple[Flags, Flags]:
    """Which patches are surely of a thing on a plane, and which surely are not: seeds of the cut between them.

    edges: (m, 2).
    thing: (k,), patches joined above the plane.
    peak: one of them.
    height_m: (k,), over the plane.
    """
    high, below = thing & (height_m > 0.4 * height_m[peak]), height_m < -_ABOVE_VOXELS * surfels.voxel_m
    return _seeds_and_far(surfels.points_m, edges, peak, high, below, height_m[peak])


def _seeds_and_far(
    points: Array, edges: Indices, peak: int, high: Flags, other: Flags, height_m: float
) -> tuple[Flags, Flags]:
    """What is high and joined with a peak, and what is far beside that in its height or known to be another's."""
    seeds = _component_of(peak, high, edges)
    axis = np.median(points[seeds, :2], axis=0)
    reach = 1.2 * height_m + np.quantile(np.hypot(*(points[seeds, :2] - axis).T), 0.95)
    return seeds, ((np.hypot(*(points[:, :2] - axis).T) > reach) | other) & ~seeds


def _component_of(member: int, among: Flags, edges: Indices) -> Flags:
    """Which of some surfels are joined with one of them."""
    inside = edges[among[edges].all(axis=1)]
    component = joined_parts(inside, len(among))
    return (component == component[member]) & among


def joined_rock(points_m: Array, rock: Flags, seeds: Flags) -> Flags:
    """Which patches (n,) of a rock hang together with its seeds, at the spacing of the patches about each.

    Mixed pixels between a rock and what lies behind it, and tips of plants, are strewn more widely than what they
    touch; a side that was seen from afar is sparse throughout. Parts of a rock between which nobody saw it are parts
    nevertheless.
    """
    number, selected = np.flatnonzero(rock), np.zeros(len(rock), bool)
    away_m, near = cKDTree(points_m[rock]).query(points_m[rock], min(_NEIGHBOURS, len(number)))
    spacing_m = away_m[:, min(4, away_m.shape[1] - 1)]
    joined = away_m < JOINED_SPACINGS * np.minimum(spacing_m[:, None], spacing_m[near])
    first, other = np.nonzero(joined)
    part = joined_parts(np.column_stack([first, near[first, other]]), len(number))
    large = np.bincount(part) >= LEAST_SURFELS
    selected[number] = (large & (np.bincount(part, seeds[rock]) > 0.0))[part]
    return selected


def minimum_cut(
    surfels: Surfels, edges: Indices, seeds: Flags, far: Flags, height_m: Array | None = None
) -> Flags:
    """Surfels on the seeds' side of the cheapest cut.

    Where heights over a known interface are given, edges that rise through it cost little more than a crease: rock and
    pedestal meet there. Edges along it do not, for the ground goes on beside the rock.
    """
    count, value = len(surfels.points_m), _capacity(surfels, edges, height_m)
    source, sink = count, count + 1
    big = np.int32(10_000_000)
    start = np.concatenate([edges[:, 0], edges[:, 1], np.full(seeds.sum(), source), np.flatnonzero(far)])
    end = np.concatenate([edges[:, 1], edges[:, 0], np.flatnonzero(seeds), np.full(far.sum(), sink)])
    value = np.concatenate([value, value, np.full(seeds.sum() + far.sum(), big)])
    graph = coo_matrix((value, (start, end)), shape=(count + 2,) * 2).tocsr()
    flow = maximum_flow(graph, source, sink).flow
    left = (graph - flow).tocsr()
    left.data = np.maximum(left.data, 0)
    left.eliminate_zeros()
    reached = np.zeros(count + 2, bool)
    reached[breadth_first_order(left, source, return_predecessors=False)] = True
    return reached[:count]


def _capacity(surfels: Surfels, edges: Indices, height_m: Array | None = None) -> NDArray[np.int32]:
    """Price (m,) of each edge; heights over a known interface as of the cut."""
    price = np.rint(_OF_A_CREASE + _OF_A_BULGE / (1 + np.exp(-(bend(surfels, edges) - CREASE) / 0.08)))
    if height_m is not None:
        rise_m = np.abs(np.diff(height_m[edges], axis=1)[:, 0])
        steep = rise_m > 0.5 * np.linalg.norm(np.diff(surfels.points_m[edges], axis=1)[:, 0], axis=1)
        away = np.abs(height_m[edges].mean(axis=1)) / surfels.voxel_m
        meets = steep & (away < _MEETS_VOXELS)
        price[meets] = np.minimum(price[meets], np.rint(_OF_A_CREASE * (1.0 + away[meets])))
    return price.astype(np.int32)


def _concave_share(surfels: Surfels, edges: Indices, rock: Flags) -> float:
    """Share of the edges between a rock and the rest that run through a crease."""
    cut = edges[rock[edges[:, 0]] != rock[edges[:, 1]]]
    return float((bend(surfels, cut) < CREASE).mean()) if len(cut) else 1.0


def bend(surfels: Surfels, edges: Indices) -> Array:
    """How the surface bends between neighbours: positive convex, negative concave, about the angle."""
    a, b = edges.T
    along = surfels.points_m[b] - surfels.points_m[a]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    return np.einsum("ij,ij->i", surfels.normals[b] - surfels.normals[a], along)
