"""Registration: whether clouds show one place, and ICP takes their misfits out (Chen and Medioni 1992)."""

import dataclasses
from dataclasses import dataclass
from functools import cached_property
from itertools import permutations
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from toppling.models.arrays import AT_ONCE, Array, Flags, inside_box
from toppling.models.errors import InputError, refusals
from toppling.models.frames import shifted_and_turned
from toppling.models.scan import o3d
from toppling.models.scan.plausible import MINIMUM_POINTS
from toppling.models.scan.read import Cloud
from toppling.models.scan.surfels import FEW_SAMPLED, SAMPLED

_OVERLAP_FRACTION = 0.02
"""Points of two stations this near, in sizes of a cloud, show the same place."""
_LEAST_OVERLAP, _LEAST_IN_FILE = 0.05, 0.005
"""Share of a file's points, and of one of its stations', that must show a place that another one shows too: strips of
a flight may lie side by side."""


_no_overlap = refusals(
    expected="stations of one survey, registered to one coordinate system, in metres",
    remedy="register the stations, or convert what is not in metres, and export again; or leave this one out",
)


def check_overlap(cloud: Cloud) -> None:
    """Refuse stations that do not show the same place.

    Raises InputError if a file's cloud, or a station of a file, shares next to nothing with the others.
    """
    if not cloud.station.any():
        return  # files of one station are pieces of one model
    ends = np.cumsum([points for _, points in cloud.files])
    parts = np.split(cloud.points_m, ends[:-1])
    if len(parts) > 1:
        names, samples = [name for name, _ in cloud.files], [_some(part, SAMPLED) for part in parts]
        _check(names, samples, _LEAST_OVERLAP)
    names, samples = _stations(cloud)
    if len(samples) > len(parts):
        _check(names, samples, _LEAST_IN_FILE)


def _check(names: list[str], samples: list[Array], least: float) -> None:
    """Refuse the one of several clouds that overlaps the others least, if by less than such a share."""
    sizes, shown, ratios = np.array([_size(sample) for sample in samples]), [], []
    for number, own in enumerate(samples):
        others_m = np.concatenate([*samples[:number], *samples[number + 1 :]])
        usual_m = float(np.median(np.delete(sizes, number)))
        reach_m = _OVERLAP_FRACTION * usual_m
        # Points that show a place of the others, or of theirs that show one of its own.
        shown.append(max(_near(own, others_m, reach_m), _near(others_m, own, reach_m)))
        ratios.append(sizes[number] / usual_m)
    alone = [number for number, share in enumerate(shown) if share < least]
    if not alone:
        return
    alone.sort(key=lambda number: (shown[number], -ratios[number]))
    others = [names[number] for number in alone[1:]]
    also = f"; the same holds for {', '.join(others)}" if others else ""
    ratio = ratios[alone[0]]
    units = "" if 0.4 < ratio < 2.5 else f"; it is {ratio:.3g} times as large: other units?"
    raise _no_overlap("scan.no_overlap", f"does not overlap the other clouds{also}{units}", names[alone[0]])


def _stations(cloud: Cloud) -> tuple[list[str], list[Array]]:
    """Names of the stations, and some points of each."""
    names, samples, start = [], [], 0
    for name, count in cloud.files:
        station = cloud.station[start : start + count]
        sizes = np.bincount(station)
        numbers = np.flatnonzero(sizes)
        for place, number in enumerate(numbers):
            if sizes[number] < MINIMUM_POINTS:
                continue
            names.append(name + (f", station {place + 1} of {len(numbers)}" if len(numbers) > 1 else ""))
            rows = start + np.flatnonzero(station == number)
            samples.append(cloud.points_m[_some(rows, FEW_SAMPLED)])
        start += count
    return names, samples


def _some(rows: NDArray, count: int) -> NDArray:
    return rows[:: max(1, len(rows) // count)]


def _size(points: Array) -> float:
    return float(np.linalg.norm(np.ptp(np.quantile(points, [0.02, 0.98], axis=0), axis=0)))


def _near(points: Array, others: Array, reach_m: float) -> float:
    """Share of the points that have one of the others within reach."""
    distance, _ = cKDTree(others).query(points, distance_upper_bound=reach_m)
    return float(np.isfinite(distance).mean())


_TOLERATED = 0.4
"""Share of copies below which they stay: coordinates in steps as wide as the points' spacing make a fifth of the points
copies, and patches of a surface are judged by how many points they have."""
_SAMPLED_IN = np.uint64(32)
"""Interval of keys by which the fraction of copies is found, where there are enough: sorting all takes seconds."""
_MIXERS = (0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB)
"""Odd factors that spread the bits of a coordinate (Steele, Lea and Flood 2014)."""


def copies(points_m: Array) -> Flags | None:
    """Which points (n, 3) equal an earlier one in every bit; None if so few do that they stay.

    Examples
    --------
    >>> copies(np.array([[0.0, 1.0, 2.0], [2.0, 1.0, 0.0], [0.0, 1.0, 2.0], [0.0, 1.0, 2.0]])).tolist()
    [False, False, True, True]
    """
    keys = _keys(points_m)
    some = keys[keys % _SAMPLED_IN == 0]  # copies of one point have one key: all or none of them
    if len(some) > SAMPLED and _share(some) < 0.5 * _TOLERATED:
        return None
    if _share(keys) < _TOLERATED:
        return None
    order = np.argsort(keys, kind="stable")
    again = np.zeros(len(points_m), bool)
    again[order[1:]] = keys[order[1:]] == keys[order[:-1]]
    return again


def _share(keys: NDArray[np.uint64]) -> float:
    """Share of the keys that equal another one before them."""
    in_order = np.sort(keys)
    return float((in_order[1:] == in_order[:-1]).sum() / max(len(keys), 1))


def _keys(points_m: Array) -> NDArray[np.uint64]:
    """A number of 64 bits for each point: sorting one is far quicker than sorting rows of three."""
    keys = np.empty(len(points_m), np.uint64)
    for start in range(0, len(points_m), AT_ONCE):
        bits = np.ascontiguousarray(points_m[start : start + AT_ONCE]).view(np.uint64)
        key = np.zeros(len(bits), np.uint64)
        for axis, factor in enumerate(_MIXERS):
            key += bits[:, axis]
            key *= np.uint64(factor)
            key ^= key >> np.uint64(31)
        keys[start : start + AT_ONCE] = key
    return keys


def without(cloud: Cloud, again: Flags | None) -> Cloud:
    """The cloud without these points, told for each file."""
    if again is None:
        return cloud
    ends = np.cumsum([points for _, points in cloud.files])
    left_out = [int(part.sum()) for part in np.split(again, ends[:-1])]
    unique = ~again
    return dataclasses.replace(
        cloud,
        points_m=cloud.points_m[unique],
        station=cloud.station[unique],
        files=tuple(
            (name, points - less) for (name, points), less in zip(cloud.files, left_out, strict=True)
        ),
        sources=tuple(source.with_less(less) for source, less in zip(cloud.sources, left_out, strict=False)),
        label=None if cloud.label is None else cloud.label[unique],
    )


_VOXELS_PER_EXTENT = 250
_POINTS_PER_STATION = 500_000
"""More points of a station are not needed for the means of its voxels."""
_SAMPLES = 4000
"""Points of a station that are compared with each other station."""
_REACH_VOXELS = (6.0, 6.0, 4.0, 4.0, 3.0, 3.0, 2.0, 2.0, 2.0)
"""Distance up to which two points may show the same place, by iteration."""
_LEAST_PAIRS = 100
_SAME_DIRECTION = 0.9
"""Cosine between the normals of points that show the same place."""
_WORTH = 0.95
"""A registration that leaves more than this share of the residual is not applied: it would follow the noise."""
_NEARBY_VOXELS = 10.0
"""Points of a station this near to another's should show places that it shows too."""
_OFF = 0.35, 3.5
"""A station does not fit where what it leaves is above the first of a voxel, and above the second times what it leaves
by itself."""
_WEAK = 1e-3
"""Directions in which the pairs hold the stations by less than this share of the best held one stay as they are."""


@dataclass(frozen=True, eq=False)
class _Thinned:
    points: Array
    normals: Array

    @cached_property
    def tree(self) -> cKDTree:
        return cKDTree(self.points)


@dataclass(frozen=True, eq=False)
class Registered:
    """A cloud with its stations registered and without copies of points, which no hint changes."""

    cloud: Cloud
    report: dict[str, Any]  # how the stations fit
    bounds_m: Array  # (2, 3): lowest and highest survey coordinates of the clouds as read


def registered(cloud: Cloud) -> Registered:
    """Register the stations of a cloud, with copies of points in place: tiles overlap by them alone.

    Raises
    ------
    InputError
        If stations do not overlap or do not fit, or few points are left without copies.
    """
    check_overlap(cloud)
    again = copies(cloud.points_m)
    if again is not None and (left := int((~again).sum())) < MINIMUM_POINTS:
        raise InputError(
            "cloud.too_few_points",
            f"{left} of {len(again)} points are different ones, the others copies of them",
            where=", ".join(name for name, _ in cloud.files),
            expected=f"at least {MINIMUM_POINTS} different points",
            remedy="check that the export was complete, with all decimals of the coordinates",
        )
    fitted, report = register(cloud)
    check_fit(fitted, report)
    return Registered(without(fitted, again), report, cloud.bounds_m)


def register(cloud: Cloud) -> tuple[Cloud, dict[str, Any]]:
    """Move each station rigidly to where it fits the others best; the mean station stays where it is.

    Returns Cloud: the same one where it has one station only or nothing is gained.
    Returns dict: residual (robust standard deviation of the point-to-plane distances) before and after, shift and
    turn of each station; `of_stations`: the residual of each, the share of its points near to others' that show the
    same place, none where nothing is near, and, of two, what it leaves by itself (`own_m`). A residual is none where no
    two stations show a common place.
    """
    count = int(cloud.station.max()) + 1
    if count < 2:
        return cloud, {"stations": 1}
    members = [np.flatnonzero(cloud.station == k) for k in range(count)]
    low, high = np.quantile(cloud.points_m[:: max(1, len(cloud.points_m) // 100_000)], [0.02, 0.98], axis=0)
    voxel = float((high - low).max()) / _VOXELS_PER_EXTENT
    every = max(1, len(cloud.points_m) // (count * _POINTS_PER_STATION))
    samples = (cloud.points_m[rows[::every]] for rows in members)
    stations = [_thinned(sample[inside_box(sample, low, high)], voxel) for sample in samples]
    pose = [np.eye(4) for _ in stations]
    centre, size = 0.5 * (low + high), 0.5 * float((high - low).max())
    before = _residual(stations, pose, _REACH_VOXELS[-1] * voxel)
    for reach in _REACH_VOXELS:
        step = _step(stations, pose, reach * voxel, centre, size)
        pose = [_moved(twist, centre, size) @ old for twist, old in zip(step, pose, strict=True)]
    after = _residual(stations, pose, _REACH_VOXELS[-1] * voxel)
    report: dict[str, Any] = {"stations": count, "voxel_m": voxel, "residual_before_m": before}
    if before is None or after is None or not after < _WORTH * before:
        report["of_stations"] = _fits(stations, [np.eye(4) for _ in stations], voxel)
        return cloud, {**report, "residual_m": before, "applied": False}
    points = np.empty_like(cloud.points_m)
    for rows, own in zip(members, pose, strict=True):
        # R p + t = R (p + R' t)
        points[rows] = shifted_and_turned(cloud.points_m[rows], -own[:3, 3] @ own[:3, :3], own[:3, :3].T)
    shift = [(own[:3, :3] @ centre + own[:3, 3] - centre).tolist() for own in pose]
    turn = [float(np.rad2deg(Rotation.from_matrix(own[:3, :3]).magnitude())) for own in pose]
    report |= {"residual_m": after, "applied": True, "shift_m": shift, "turn_deg": turn}
    report["of_stations"] = _fits(stations, pose, voxel)
    return dataclasses.replace(cloud, points_m=points), report


def check_fit(cloud: Cloud, registration: dict[str, Any]) -> None:
    """Refuse a station that lies where the others are but shows other places than they do: it is off.

    registration: what `register` says.
    Raises InputError if a station leaves far more than it leaves by itself; of two nobody can say which is off.
    """
    every = enumerate(registration.get("of_stations", []))
    off = [(_misfit(fit, registration["voxel_m"]), k) for k, fit in every if fit["paired_share"] is not None]
    two = len(off) == 2
    if len(off) < 2 or (min if two else max)(off)[0] < 1.0:
        return
    number = max(off)[1]
    files = list(dict.fromkeys(name for name, _ in cloud.files))
    if not two:
        ends = np.cumsum([points for _, points in cloud.files])
        files = [cloud.files[int(np.searchsorted(ends, np.argmax(cloud.station == number), "right"))][0]]
    which = f"station {number + 1} of {registration['stations']} does not fit the others"
    raise InputError(
        "scan.station_off",
        f"{'the two stations do not fit each other' if two else which}: "
        f"{registration['of_stations'][number]['paired_share']:.0%} of its points near others' show the same place",
        where=" and ".join(files),
        expected="stations registered to each other, with what is left small enough to be taken out here",
        remedy="register this station anew, convert it to metres if it is in another unit, or leave it out; of two, a "
        "third station tells which is off",
    )


def _misfit(fit: dict[str, float | None], voxel_m: float) -> float:
    """What a station leaves over what is tolerated: above 1 it is off."""
    left_m, own_m = fit["residual_m"], fit["own_m"]
    if left_m is None or own_m is None:
        return np.inf
    return min(left_m / (_OFF[0] * voxel_m), left_m / max(_OFF[1] * own_m, 1e-12))


def _thinned(points: Array, voxel_m: float) -> _Thinned:
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points)).voxel_down_sample(voxel_m)
    if len(cloud.points) < _LEAST_PAIRS:
        return _Thinned(np.empty((0, 3)), np.empty((0, 3)))
    cloud.estimate_covariances(o3d.geometry.KDTreeSearchParamKNN(12))
    variance, axes = np.linalg.eigh(np.asarray(cloud.covariances))
    flat = variance[:, 0] < 0.05 * variance[:, 1]  # surfaces, not bushes and edges
    return _Thinned(np.asarray(cloud.points)[flat], axes[flat, :, 0])


def _pairs(
    stations: list[_Thinned], pose: list[Array], reach_m: float
) -> list[tuple[int, int, Array, Array, Array]]:
    """Points of one station, normals of another and the distances between them, for all pairs of stations."""
    placed = _placed(stations, pose)
    found = []
    for a, b in permutations(range(len(placed)), 2):
        if not len(placed[a].points) or not len(placed[b].points):
            continue
        step = max(1, len(placed[a].points) // _SAMPLES)
        points, normals = placed[a].points[::step], placed[a].normals[::step]
        # The other station's tree is in its own frame, and made once.
        turn, shift = pose[b][:3, :3], pose[b][:3, 3]
        distance, near = stations[b].tree.query((points - shift) @ turn, distance_upper_bound=reach_m)
        met = np.isfinite(distance)
        met[met] = np.abs(np.einsum("ij,ij->i", normals[met], placed[b].normals[near[met]])) > _SAME_DIRECTION
        if met.sum() < _LEAST_PAIRS:
            continue
        normal = placed[b].normals[near[met]]
        gap = np.einsum("ij,ij->i", points[met] - placed[b].points[near[met]], normal)
        found.append((a, b, points[met], normal, gap))
    return found


def _placed(stations: list[_Thinned], pose: list[Array]) -> list[_Thinned]:
    return [
        _Thinned(station.points @ p[:3, :3].T + p[:3, 3], station.normals @ p[:3, :3].T)
        for station, p in zip(stations, pose, strict=True)
    ]


def _fits(stations: list[_Thinned], pose: list[Array], voxel_m: float) -> list[dict[str, float | None]]:
    """How well each station fits all others together."""
    placed = _placed(stations, pose)
    found: list[dict[str, float | None]] = []
    for number, station in enumerate(placed):
        points = np.concatenate([other.points for k, other in enumerate(placed) if k != number])
        normals = np.concatenate([other.normals for k, other in enumerate(placed) if k != number])
        step = max(1, len(station.points) // _SAMPLES)
        own, facing = station.points[::step], station.normals[::step]
        if len(own) and len(points):
            distance, near = cKDTree(points).query(own, distance_upper_bound=_NEARBY_VOXELS * voxel_m)
            nearby = np.isfinite(distance)
        if not len(own) or not len(points) or nearby.sum() < _LEAST_PAIRS:
            found.append({"residual_m": None, "paired_share": None})
            continue
        normal = normals[near[nearby]]
        met = distance[nearby] < _REACH_VOXELS[-1] * voxel_m
        met &= np.abs(np.einsum("ij,ij->i", facing[nearby], normal)) > _SAME_DIRECTION
        gap = np.abs(np.einsum("ij,ij->i", own[nearby] - points[near[nearby]], normal))[met]
        found.append(
            {
                "residual_m": 1.4826 * float(np.median(gap)) if met.any() else None,
                "own_m": _own_residual_m(station),
                "paired_share": float(met.mean()),
            }
        )
    return found


def _own_residual_m(station: _Thinned) -> float:
    """Robust standard deviation of the distances of a station's points from the planes of those beside them."""
    step = max(1, len(station.points) // _SAMPLES)
    points = station.points[::step]
    neighbour = cKDTree(station.points).query(points, 2)[1][:, 1]
    gap = np.einsum("ij,ij->i", points - station.points[neighbour], station.normals[neighbour])
    return 1.4826 * float(np.median(np.abs(gap)))


def _residual(stations: list[_Thinned], pose: list[Array], reach_m: float) -> float | None:
    gaps = [np.abs(pair[4]) for pair in _pairs(stations, pose, reach_m)]
    return 1.4826 * float(np.median(np.concatenate(gaps))) if gaps else None


def _step(stations: list[_Thinned], pose: list[Array], reach_m: float, centre: Array, size: float) -> Array:
    """Small motions (stations, 6) that close the gaps: turns (times size) and shifts, least squares of least norm."""
    count = 6 * len(stations)
    normal_matrix, right = np.zeros((count, count)), np.zeros(count)
    for a, b, points, normal, gap in _pairs(stations, pose, reach_m):
        spread = 1.4826 * float(np.median(np.abs(gap))) + 1e-12
        weight = np.where(np.abs(gap) < 4.7 * spread, (1 - (gap / (4.7 * spread)) ** 2) ** 2, 0.0)
        row = np.hstack([np.cross((points - centre) / size, normal), normal])
        slots = np.concatenate([6 * a + np.arange(6), 6 * b + np.arange(6)])
        both = np.hstack([row, -row])
        normal_matrix[np.ix_(slots, slots)] += both.T @ (weight[:, None] * both)
        right[slots] -= both.T @ (weight * gap)
    return (np.linalg.pinv(normal_matrix, rcond=_WEAK, hermitian=True) @ right).reshape(-1, 6)


def _moved(motion: Array, centre: Array, size: float) -> Array:
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_rotvec(motion[:3] / size).as_matrix()
    matrix[:3, 3] = centre - matrix[:3, :3] @ centre + motion[3:]
    return matrix
