"""A virtual terrestrial laser scanner: made-up rocks on pedestals, stations, noise; what tests and the demo scan."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from toppling.models.arrays import Array, Indices
from toppling.models.frames import horizontal_unit_vector, plane_normal, rotation_between
from toppling.models.pedestal import Pedestal
from toppling.models.rock import Rock
from toppling.models.scan import o3d
from toppling.models.scan.crevice import grid_triangles
from toppling.models.scan.meshes import Mesh
from toppling.models.scan.read import Cloud
from toppling.models.scan.segment import NEITHER, PEDESTAL, ROCK
from toppling.models.scan.surfels import scene_of_rays


def lathe(radius_m: Array, height_m: Array, centre_m: Array, sides: int) -> Mesh:
    """Close a stack of horizontal rings: radius (k, sides), height (k,), centre (k, 2)."""
    angle = 2 * np.pi * np.arange(sides) / sides
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    body = np.concatenate(
        [
            radius_m[:, :, None] * ring + centre_m[:, None, :],
            np.broadcast_to(height_m[:, None, None], (*radius_m.shape, 1)),
        ],
        axis=-1,
    )
    rings = len(height_m)
    vertices = np.vstack([body.reshape(-1, 3), [[*centre_m[0], height_m[0]], [*centre_m[-1], height_m[-1]]]])
    number = np.arange(rings * sides).reshape(rings, sides)
    after = np.roll(number, -1, axis=1)
    a, b, c, d = number[:-1], after[:-1], after[1:], number[1:]
    below, above = rings * sides, rings * sides + 1
    faces = np.concatenate(
        [
            np.stack([a, b, c], -1).reshape(-1, 3),
            np.stack([a, c, d], -1).reshape(-1, 3),
            np.stack([after[0], number[0], np.full(sides, below)], -1),
            np.stack([number[-1], after[-1], np.full(sides, above)], -1),
        ]
    )
    return vertices, faces


def boulder(
    height_m: float,
    width_m: float,
    base_m: float,
    seed: int,
    *,
    lean_m: tuple[float, float] = (0.0, 0.0),
    bumps: float = 0.03,
    squareness: float = 0.0,
    nose: float = 0.0,
    nose_azimuth_deg: float = 0.0,
    sides: int = 96,
) -> Mesh:
    """Rough rock, widest at two fifths of its height, standing on a flat base at height 0.

    height_m, width_m, base_m: height, largest width, and width of the base.
    seed: of the bumps.
    lean_m: shift of the middle against the base.
    bumps: amplitude of the bumps in half widths.
    squareness: 0 round, 1 nearly a block.
    nose, nose_azimuth_deg: how far a nose sticks out of the belly, in half widths, and where.
    """
    rng = np.random.default_rng(seed)
    share = 0.5 * (1 - np.cos(np.linspace(0, np.pi, 61)))  # dense at base and top, where the shape turns
    widest = 0.4
    belly = np.where(
        share < widest,
        base_m / width_m + (1 - base_m / width_m) * np.sin(0.5 * np.pi * np.minimum(share / widest, 1)),
        np.maximum(1 - (np.maximum(share - widest, 0.0) / (1 - widest)) ** 2.4, 0.0) ** 0.5,
    )
    belly[-1] = 0.02
    angle = 2 * np.pi * np.arange(sides) / sides
    block = 1.0 / np.maximum(np.abs(np.cos(angle)), np.abs(np.sin(angle)))
    plan = (1 - squareness) + squareness * np.minimum(block, 1.35)
    rough = sum(
        rng.normal() / k * np.cos(k * angle[None, :] + m * np.pi * share[:, None] + rng.uniform(0, 2 * np.pi))
        for k in range(2, 7)
        for m in range(6)
    )
    rough *= bumps * np.minimum(share / 0.02, 1.0)[:, None]
    turn = (angle - np.deg2rad(nose_azimuth_deg) + np.pi) % (2 * np.pi) - np.pi
    beak = nose * np.exp(-((turn / 0.5) ** 2))[None, :] * np.exp(-(((share - widest) / 0.15) ** 2))[:, None]
    beak *= np.minimum(share / 0.1, 1.0)[:, None]
    radius = 0.5 * width_m * np.maximum(belly[:, None] * plan[None, :] * (1 + rough + beak), 0.005)
    lean = np.sin(np.pi * np.minimum(share, 0.5))[:, None] * np.asarray(lean_m)[None, :]
    return lathe(radius, height_m * share, lean, sides)


def ground(
    reach_m: float,
    contact_m: float,
    seed: int,
    *,
    cliff_m: float = np.inf,
    cliff_azimuth_deg: float = 0.0,
    drop_m: float = 0.0,
    bumps_m: float = 0.0,
    neck_drop_m: float = 0.0,
    cells: int = 200,
) -> Mesh:
    """Pedestal over its interface plane: flat where the rock stands, uneven beyond, ending at a cliff.

    reach_m: half of its extent.
    contact_m: radius within which it is flat.
    seed: of the bumps.
    cliff_m, cliff_azimuth_deg, drop_m: distance of the straight cliff edge from the origin, the azimuth it looks
    toward, and its height.
    bumps_m: amplitude of the bumps at the far end.
    neck_drop_m: depth to which the surface falls around the contact: an hour-glass' lower half.
    """
    rng = np.random.default_rng(seed)
    along = np.linspace(-reach_m, reach_m, cells)
    if np.isfinite(cliff_m):
        along[np.argmin(np.abs(along - cliff_m))] = cliff_m
    u, v = np.meshgrid(along, np.linspace(-reach_m, reach_m, cells), indexing="ij")
    away = np.clip((np.hypot(u, v) - contact_m) / (0.5 * reach_m), 0.0, 1.0)
    waves = sum(
        np.cos((2 * np.pi / reach_m) * (k * (u * np.cos(t) + v * np.sin(t))) + p) / k
        for k, t, p in zip(
            range(1, 6), rng.uniform(0, 2 * np.pi, 5), rng.uniform(0, 2 * np.pi, 5), strict=True
        )
    )
    h = bumps_m * away * waves
    if neck_drop_m:
        beyond = np.clip((np.hypot(u, v) - 1.08 * contact_m) / contact_m, 0.0, None)
        h = h - neck_drop_m * (1 - np.exp(-1.2 * beyond))
    if np.isfinite(cliff_m):
        h = np.where(u > cliff_m, h - drop_m, h)
    turn = np.deg2rad(cliff_azimuth_deg)
    x, y = u * np.cos(turn) - v * np.sin(turn), u * np.sin(turn) + v * np.cos(turn)
    return np.column_stack([x.ravel(), y.ravel(), h.ravel()]), grid_triangles(u.shape)


DEMO_ORIGIN_M = np.array([331_000.0, 3_777_000.0, 480.0])
_MIXED_FRACTION = 0.3
"""Fraction of the beams at a range jump whose footprint falls on both surfaces."""


@dataclass(frozen=True, eq=False)
class Body:
    """A mesh that the scanner sees, and its true label (0 rock, 1 pedestal, 2 neither)."""

    vertices_m: Array
    faces: Indices
    label: int


@dataclass(frozen=True, eq=False)
class Station:
    """A tripod position and what was seen from it."""

    position_m: Array  # (3,)
    points_m: Array  # (n, 3)
    label: NDArray[np.int8]  # (n,): truth: 0 rock, 1 pedestal, 2 neither


@dataclass(frozen=True, eq=False)
class Truth:
    """A known rock on a known pedestal."""

    rock: Rock
    pedestal: Pedestal  # the interface plane with the surface's triangles
    neighbours: tuple[Body, ...] = field(default=())  # whatever else stands there

    @property
    def bodies(self) -> tuple[Body, ...]:
        """Everything that the scanner can see."""
        assert self.pedestal.vertices_m is not None
        assert self.pedestal.faces is not None
        return (
            Body(self.rock.vertices_m, self.rock.faces, ROCK),
            Body(self.pedestal.vertices_m, self.pedestal.faces, PEDESTAL),
            *self.neighbours,
        )


def scan_from(
    bodies: Sequence[Body],
    position_m: Array,
    target_m: Array,
    radius_m: float,
    resolution_deg: float,
    range_noise_m: float,
    rng: np.random.Generator,
) -> Station:
    """Scan a ball of `radius_m` around a target from one position.

    Rays go out on a grid of azimuth and elevation; ranges carry normal noise; at range jumps between neighbouring rays
    some ranges fall between the two surfaces (mixed pixels).
    """
    aim = target_m - position_m
    distance = float(np.linalg.norm(aim))
    half = np.rad2deg(np.arcsin(min(0.999, radius_m / distance)))
    azimuth0, elevation0 = np.rad2deg(np.arctan2(aim[1], aim[0])), np.rad2deg(np.arcsin(aim[2] / distance))
    steps = np.arange(-half, half, resolution_deg)
    elevation = np.clip(elevation0 + steps, -89.0, 89.0)
    azimuth = azimuth0 + steps / np.cos(np.deg2rad(elevation0))
    level = np.cos(np.deg2rad(elevation))[:, None, None]
    rays = level * horizontal_unit_vector(azimuth)[None] + np.sin(np.deg2rad(elevation))[:, None, None] * [
        0,
        0,
        1.0,
    ]
    ranges, label = _cast(bodies, position_m, rays)
    ranges = ranges + rng.normal(0.0, range_noise_m, ranges.shape)
    finite = np.where(np.isfinite(ranges), ranges, 0.0)
    jump = np.abs(np.diff(finite, axis=1)) > 20 * range_noise_m + 0.01 * distance
    jump &= np.isfinite(ranges[:, 1:]) & np.isfinite(ranges[:, :-1])
    mixed = jump & (rng.random(jump.shape) < _MIXED_FRACTION)
    share = rng.random(jump.shape)
    ranges[:, 1:] = np.where(mixed, share * finite[:, 1:] + (1 - share) * finite[:, :-1], ranges[:, 1:])
    seen = np.isfinite(ranges)
    points = position_m + ranges[seen][:, None] * rays[seen]
    return Station(position_m, points, label[seen])


def _cast(bodies: Sequence[Body], position_m: Array, rays: Array) -> tuple[Array, NDArray[np.int8]]:
    """First ranges (infinite where nothing is hit) and the labels of what was hit."""
    # Relative to the station: the ray caster computes in single precision.
    scene = scene_of_rays(*((body.vertices_m - position_m, body.faces) for body in bodies))
    starts_and_rays = np.concatenate([np.zeros_like(rays), rays], axis=-1).astype(np.float32)
    hit = scene.cast_rays(o3d.core.Tensor.from_numpy(starts_and_rays), nthreads=1)
    ranges = hit["t_hit"].numpy().astype(float)
    numbers = hit["geometry_ids"].numpy()
    label = np.full(ranges.shape, NEITHER, np.int8)
    for number, body in enumerate(bodies):
        label[numbers == number] = body.label
    return ranges, label


def scan_around(
    truth: Truth,
    seed: int,
    stations: int = 6,
    resolution_per_height: float = 0.006,
    noise_per_height: float = 0.0004,
    clutter: bool = True,
    misregistration_per_height: float = 0.0,
) -> list[Station]:
    """Scan a truth from stations around it, three heights (or widths) away, some of them raised.

    resolution_per_height: spacing of the points on the rock, in rock heights.
    noise_per_height: standard deviation of the range, in rock heights.
    clutter: whether a bush stands beside the rock.
    misregistration_per_height: standard deviation of each station's shift along each axis, in rock heights.
    """
    rng = np.random.default_rng(seed)
    height = truth.rock.height_m
    # A rock wider than high is scanned from as far as one as high as it is wide.
    size = max(height, float(np.ptp(truth.rock.vertices_m[:, :2], axis=0).max()))
    target = truth.rock.com_m - [0, 0, 0.25 * height]
    seen = []
    for k in range(stations):
        direction = horizontal_unit_vector(360.0 * (k + 0.6 * rng.random()) / stations)
        raised = [0, 0, (0.15 + 0.7 * (k % 3) + 0.2 * rng.random()) * size]
        position = target + (2.6 + 0.8 * rng.random()) * size * direction + raised
        distance = float(np.linalg.norm(target - position))
        step = np.rad2deg(resolution_per_height * height / distance)
        station = scan_from(truth.bodies, position, target, 1.5 * size, step, noise_per_height * height, rng)
        shift = rng.normal(0.0, misregistration_per_height * height, 3)
        points, label = station.points_m + shift, station.label
        if clutter:
            bush = _bush(truth, rng, count=300)
            points, label = np.vstack([points, bush]), np.append(label, np.full(len(bush), NEITHER, np.int8))
        seen.append(Station(position, points, label))
    return seen


def _bush(truth: Truth, rng: np.random.Generator, count: int) -> Array:
    height = truth.rock.height_m
    bottom_m = truth.rock.com_m + 1.1 * height * horizontal_unit_vector(200.0)
    bottom_m[2] = truth.pedestal.point_m[2] + 0.12 * height
    return bottom_m + rng.normal(0.0, 1.0, (count, 3)) * [0.1 * height, 0.1 * height, 0.06 * height]


def cloud_of(stations: Sequence[Station], origin_m: Array) -> tuple[Cloud, NDArray[np.int8]]:
    """Cloud of several stations, as if it had been read from files, and the truth's labels."""
    points = np.concatenate([station.points_m for station in stations])
    number = np.repeat(np.arange(len(stations), dtype=np.int32), [len(s.points_m) for s in stations])
    files = tuple((f"station{k + 1}", len(s.points_m)) for k, s in enumerate(stations))
    return Cloud(points, origin_m, number, files), np.concatenate([station.label for station in stations])


def on_slope(
    rock: Mesh, pedestal: Mesh, slope_deg: float, downhill_azimuth_deg: float, *neighbours: Body
) -> Truth:
    """Rock and pedestal, made over a level plane, tilted together to an interface that slopes."""
    normal = plane_normal(slope_deg, downhill_azimuth_deg)
    turn = rotation_between((0.0, 0.0, 1.0), normal)
    return Truth(
        Rock.from_triangles(rock[0] @ turn.T, rock[1]),
        Pedestal(np.zeros(3), normal, pedestal[0] @ turn.T, pedestal[1]),
        tuple(Body(body.vertices_m @ turn.T, body.faces, body.label) for body in neighbours),
    )


def two_rocks_side_by_side(seed: int) -> Truth:
    """Two boulders of like size a width apart: which one is meant only the user knows."""
    rock = boulder(2.0, 1.3, 1.0, seed, bumps=0.02)
    vertices, faces = boulder(1.9, 1.2, 1.0, seed + 1, bumps=0.02)
    pedestal = ground(6.0, 3.0, seed, bumps_m=0.1)
    return on_slope(rock, pedestal, 3.0, 40.0, Body(vertices + np.array([2.0, 0.0, 0.0]), faces, NEITHER))


def echo_cliffs_like(seed: int) -> Truth:
    """Rock like the Echo Cliffs one: 14 m tall, 10 m wide, 4 m over the cliff's edge, slope 5 degrees.

    The sizes are the study's (`Veeraraghavan, Hudnut and Krishnan 2017`); the shape is made up.
    """
    downhill = 135.0
    lean = -0.25 * horizontal_unit_vector(downhill)
    rock = boulder(
        13.9,
        8.6,
        4.1,
        seed,
        lean_m=(float(lean[0]), float(lean[1])),
        bumps=0.025,
        nose=0.37,
        nose_azimuth_deg=downhill,
    )
    pedestal = ground(
        28.0, 2.6, seed, cliff_m=2.15, cliff_azimuth_deg=downhill, drop_m=16.0, bumps_m=0.5, cells=240
    )
    return on_slope(rock, pedestal, 5.0, downhill)


def demo_scan(seed: int = 0) -> tuple[list[Station], Truth]:
    """Scan the rock like Echo Cliffs from six stations: what `toppling demo` begins with."""
    truth = echo_cliffs_like(seed)
    return scan_around(truth, seed), truth
