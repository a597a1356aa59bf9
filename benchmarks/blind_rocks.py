"""Rocks of random shape, size, pedestal and survey, by a generator unlike the library's: nothing was tuned on them.

Also such rocks whose base is known and unseen (flat, on three bumps, concave, rounded or wedge-shaped), and what an
inspection of a known rock would tell of its base: touches, daylight, a pull, and all of them; all true.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from toppling.models.arrays import Array
from toppling.models.frames import (
    STANDARD_GRAVITY_M_S2,
    horizontal_unit_vector,
    plane_normal,
    rotation_between,
)
from toppling.models.hidden_base.inspection import Inspection
from toppling.models.pedestal import Pedestal
from toppling.models.scan import virtual
from toppling.models.scene import Scene
from toppling.models.statics import quasi_static_toppling_m_s2, support_polygon_m

HEIGHTS_M = (0.7, 1.5, 3.0, 6.0, 12.0)
PEDESTALS = ("uneven ground", "cliff", "neck")
LEAST_ARM = 0.06
"""From the centre of mass to the nearest edge of the base, in heights: less would hardly stand."""


def blind_rock(seed: int) -> tuple[virtual.Truth, str, list[virtual.Station]]:
    """A rock on a pedestal, what kind of pedestal, and its survey."""
    random = np.random.default_rng(seed)
    height = float(random.choice(HEIGHTS_M) * random.uniform(0.8, 1.2))
    rock = _superellipsoid(random, height)
    while _arm_m(*rock) < LEAST_ARM * height:
        rock = _superellipsoid(random, height)
    base = _reach_m(rock[0])
    kind = str(random.choice(PEDESTALS))
    of_kind: dict[str, Any] = {
        "uneven ground": {},
        "cliff": {
            "cliff_m": base,
            "cliff_azimuth_deg": random.uniform(0.0, 360.0),
            "drop_m": height * random.uniform(0.4, 1.2),
        },
        "neck": {"neck_drop_m": height * random.uniform(0.2, 0.5)},
    }[kind]
    pedestal = virtual.ground(
        height * random.uniform(2.0, 3.5),
        base,
        int(random.integers(1000)),
        bumps_m=height * random.uniform(0.01, 0.08),
        **of_kind,
    )
    truth = virtual.on_slope(rock, pedestal, random.uniform(0.0, 12.0), random.uniform(0.0, 360.0))
    stations = virtual.scan_around(
        truth,
        seed,
        stations=int(random.integers(3, 8)),
        resolution_per_height=random.uniform(0.006, 0.012),
        noise_per_height=random.uniform(1e-4, 8e-4),
        misregistration_per_height=float(random.choice([0.0, 5e-4])),
    )
    return truth, kind, stations


def _superellipsoid(random: np.random.Generator, height_m: float) -> virtual.Mesh:
    """Between ball and box, rough, leaning and turned, its foot flattened to a base at height 0."""
    sphere = trimesh.creation.icosphere(subdivisions=6)
    up, around = random.uniform(0.35, 1.0, 2)
    width = height_m * random.uniform(0.35, 0.9)
    depth = width * random.uniform(0.6, 1.0)
    points = superellipsoid(np.asarray(sphere.vertices), (width, depth, height_m), up, around)
    waves = np.cos(points @ random.normal(0.0, 6.0 / height_m, (3, 8)) + random.uniform(0.0, 2 * np.pi, 8))
    points *= 1.0 + random.uniform(0.01, 0.05) * (waves / np.arange(2, 10)).sum(axis=1, keepdims=True)
    turn = random.uniform(0.0, 2 * np.pi)
    c, s = np.cos(turn), np.sin(turn)
    points[:, :2] = points[:, :2] @ np.array([[c, s], [-s, c]]) + points[:, 2:] * random.uniform(
        -0.15, 0.15, 2
    )
    points[:, 2] = np.maximum(points[:, 2] - points[:, 2].min() - height_m * random.uniform(0.06, 0.25), 0.0)
    return points, np.asarray(sphere.faces, np.int64)


def superellipsoid(places: Array, size_m: tuple[float, float, float], up: float, around: float) -> Array:
    """Places (n, 3) of the unit ball's surface carried onto one between ball and box, by its two exponents."""
    latitude = np.arcsin(np.clip(places[:, 2], -1.0, 1.0))
    longitude = np.arctan2(places[:, 1], places[:, 0])
    across = _power(np.cos(latitude), up)
    return 0.5 * np.column_stack(
        [
            size_m[0] * across * _power(np.cos(longitude), around),
            size_m[1] * across * _power(np.sin(longitude), around),
            size_m[2] * _power(np.sin(latitude), up),
        ]
    )


def _power(values: Array, exponent: float) -> Array:
    return np.asarray(np.sign(values) * np.abs(values) ** exponent)


def _flat(points_m: Array) -> Array:
    """The base's vertices (n, 2)."""
    return points_m[points_m[:, 2] == 0.0, :2]


def _reach_m(points_m: Array) -> float:
    return 1.02 * float(np.hypot(*_flat(points_m).T).max())


def _arm_m(points_m: Array, faces: NDArray[np.int64]) -> float:
    hull = ConvexHull(_flat(points_m))
    com = trimesh.Trimesh(points_m, faces, process=False).center_mass
    return -float((hull.equations[:, :2] @ com[:2] + hull.equations[:, 2]).max())


BASES = ("flat", "three bumps", "concave", "rounded", "wedge")
ROUGHNESS = (0.001, 0.004)
"""Standard deviation of a base's roughness over its width, drawn between these."""
RELIEF = (0.01, 0.06)
"""Displacement that makes a surface other than flat."""
LEAST_TOPPLING_M_S2 = 0.4
"""A rock that topples under less would hardly stand."""
SHADOW_PER_HEIGHT = 0.05
"""Height up to which a hidden rim is hidden."""
TOUCHES, DAYLIGHTS = 3, 4
OPEN_PER_HEIGHT = (0.006, 0.03)
"""Clearance through which light is seen to pass at the base."""


@dataclass(frozen=True, eq=False)
class BaseRock:
    """A rock on a base of one kind, and its survey.

    half_hidden: whether half of the rim is hidden by rubble that was cleaned out of the cloud.
    """

    truth: virtual.Truth
    kind: str
    half_hidden: bool
    stations: list[virtual.Station]


def base_rock(seed: int) -> BaseRock:
    """The rock of a number: kinds take turns, and every third rim is half hidden."""
    random = np.random.default_rng([28, seed])
    kind, half_hidden = BASES[seed % len(BASES)], seed % 3 == 0
    truth = None
    while truth is None or not _stands(truth):
        truth = _drawn(kind, random)
    stations = virtual.scan_around(
        truth,
        seed,
        stations=int(random.integers(4, 8)),
        resolution_per_height=random.uniform(0.005, 0.01),
        noise_per_height=random.uniform(1e-4, 6e-4),
    )
    if half_hidden:
        azimuth_deg = random.uniform(0.0, 360.0)
        stations = [_without_half_of_the_rim(station, truth, azimuth_deg) for station in stations]
    return BaseRock(truth, kind, half_hidden, stations)


def _drawn(kind: str, random: np.random.Generator) -> virtual.Truth | None:
    """A rock at rest on a base of this kind; None where its weight lies beside all of its base."""
    height = float(random.choice(HEIGHTS_M) * random.uniform(0.8, 1.2))
    points, faces = _superellipsoid(random, height)
    base_m = _reach_m(points)
    slope_deg, downhill_deg = random.uniform(0.0, 6.0), random.uniform(0.0, 360.0)
    ground = virtual.ground(
        height * random.uniform(2.0, 3.0),
        base_m,
        int(random.integers(1000)),
        bumps_m=height * random.uniform(0.01, 0.06),
    )
    down = rotation_between((0.0, 0.0, 1.0), plane_normal(slope_deg, downhill_deg)).T @ np.array(
        [0.0, 0.0, -1.0]
    )
    rested = _at_rest_on(kind, points, faces, down, random)
    return None if rested is None else virtual.on_slope((rested, faces), ground, slope_deg, downhill_deg)


def _at_rest_on(
    kind: str, points_m: Array, faces: NDArray[np.int64], down: Array, random: np.random.Generator
) -> Array | None:
    """The rock with its base shaped, so that it touches the plane at three points around its weight's line."""
    flat = _flat(points_m)
    hull = ConvexHull(flat)
    width_m = float(np.sqrt(hull.volume))
    relief_m = (
        width_m * random.uniform(*RELIEF) * _shape(kind, points_m[:, :2], hull, flat.mean(axis=0), random)
    )
    relief_m += (
        width_m * random.uniform(*ROUGHNESS) * waves(points_m[:, :2] / width_m, (4.0, 30.0), 40, random)
    )
    fades = np.exp(-points_m[:, 2] / (0.15 * float(np.ptp(points_m[:, 2]))))
    shaped = points_m + np.column_stack([np.zeros((len(points_m), 2)), fades * relief_m])
    for _ in range(12):  # the weight's line moves a little with the base
        com_m = trimesh.Trimesh(shaped, faces, process=False).center_mass
        projected_com = com_m[:2] - down[:2] / down[2] * com_m[2]
        low = shaped[shaped[:, 2] < 0.1 * np.ptp(shaped[:, 2])]
        lower = ConvexHull(low)
        facing = lower.equations[lower.equations[:, 2] < -1e-9]
        height_m = -(projected_com @ facing[:, :2].T + facing[:, 3]) / facing[:, 2]
        a, b, c, d = facing[height_m.argmax()]
        corner = low[lower.simplices[lower.equations[:, 2] < -1e-9][height_m.argmax()], :2]
        if not _encloses(corner, projected_com):
            return None
        shaped[:, 2] += (shaped[:, 0] * a + shaped[:, 1] * b + d) / c * fades
    # What is left after the last pass is a millionth: set exactly.
    shaped[:, 2] -= shaped[:, 2].min()
    return shaped


def _shape(
    kind: str, places_m: Array, hull: ConvexHull, centre_m: Array, random: np.random.Generator
) -> Array:
    """What makes a base other than flat: heights (n,) between 0 and about 1."""
    reach = -(hull.equations[:, :2] @ centre_m + hull.equations[:, 2])
    share = ((places_m - centre_m) @ hull.equations[:, :2].T / reach).max(axis=1).clip(max=1.0)
    turn = random.uniform(0.0, 2.0 * np.pi)
    along = (places_m - centre_m) @ [np.cos(turn), np.sin(turn)] / np.sqrt(hull.volume)
    if kind == "concave":
        return 1.0 - share**2
    if kind == "rounded":
        return share ** random.uniform(1.5, 4.0)
    if kind == "wedge":
        return np.clip(along - random.uniform(-0.1, 0.25), 0.0, None) * 2.0
    if kind == "three bumps":
        angle = turn + 2.0 * np.pi / 3.0 * (np.arange(3) + random.uniform(-0.25, 0.25, 3))
        foot = centre_m + (reach.min() * random.uniform(0.4, 0.95, (3, 1))) * np.column_stack(
            [np.cos(angle), np.sin(angle)]
        )
        away = np.linalg.norm(places_m[:, None] - foot, axis=2).min(axis=1) / np.sqrt(hull.volume)
        return 1.0 - np.exp(-((away / random.uniform(0.08, 0.2)) ** 2))
    return np.zeros(len(places_m))


def waves(places: Array, numbers: tuple[float, float], count: int, random: np.random.Generator) -> Array:
    """So many waves (n,), their numbers within a range, over places (n, 2 or 3): standard deviation 1."""
    directions = random.normal(size=(places.shape[1], count)) * random.uniform(*numbers, count)
    phase = random.uniform(0.0, 2.0 * np.pi, count)
    return np.asarray(np.cos(places @ directions + phase).sum(axis=1) / np.sqrt(0.5 * count))


def _encloses(corner: Array, point: Array) -> bool:
    side = np.cross(np.roll(corner, -1, axis=0) - corner, point - corner)
    return bool((side > 0).all() or (side < 0).all())


def _without_half_of_the_rim(
    station: virtual.Station, truth: virtual.Truth, azimuth_deg: float
) -> virtual.Station:
    """A station that rubble, cleaned out of the cloud since, kept from seeing half of the rim."""
    offset = station.points_m - truth.pedestal.point_m
    over, height = offset @ truth.pedestal.normal, truth.rock.height_m
    low = truth.rock.vertices_m[
        truth.rock.vertices_m @ truth.pedestal.normal
        < 0.1 * height + truth.pedestal.point_m @ truth.pedestal.normal
    ]
    centre = low.mean(axis=0)
    beyond = (station.points_m - centre) @ horizontal_unit_vector(azimuth_deg)
    away = np.linalg.norm((station.points_m - centre)[:, :2], axis=1)
    hidden = (beyond > 0) & (np.abs(over) < SHADOW_PER_HEIGHT * height) & (away < 0.6 * height)
    return replace(station, points_m=station.points_m[~hidden], label=station.label[~hidden])


def _stands(truth: virtual.Truth) -> bool:
    plane = Pedestal(truth.pedestal.point_m, truth.pedestal.normal)
    limits = quasi_static_toppling_m_s2(truth.rock, plane, 9.81, np.arange(0.0, 360.0, 30.0))
    return min(limit for _, limit in limits) > LEAST_TOPPLING_M_S2


def true_hints(true: Scene) -> dict[str, Inspection]:
    """Inspections of a rock, by what they tell, survey coordinates."""
    corners = support_polygon_m(true.rock, true.pedestal) + true.origin_m
    touching = _spread(corners, TOUCHES)
    clearance = (true.rock.vertices_m - true.pedestal.point_m) @ true.pedestal.normal / true.rock.height_m
    low, high = OPEN_PER_HEIGHT
    free = _spread(true.rock.vertices_m[(clearance > low) & (clearance < high)], DAYLIGHTS)
    # On the pedestal, below the rock, where the light falls.
    free = free - np.outer((free - true.pedestal.point_m) @ true.pedestal.normal, true.pedestal.normal)
    pulls = (_pull(true, 0.0), _pull(true, 90.0))
    return {
        "touches": Inspection(touching),
        "touches and nowhere else": Inspection(corners, touch_only=True),
        "daylight": Inspection(open_m=free + true.origin_m),
        "a pull": Inspection(pulls=pulls[:1]),
        "touches, daylight and pulls": Inspection(touching, free + true.origin_m, pulls),
    }


def _pull(true: Scene, toward_deg: float) -> tuple[float, float]:
    """Azimuth of a pull and the largest force over the weight that the rock bears."""
    against = (toward_deg + 180.0) % 360.0
    ((_, borne),) = quasi_static_toppling_m_s2(true.rock, true.pedestal, STANDARD_GRAVITY_M_S2, [against])
    return toward_deg, borne / STANDARD_GRAVITY_M_S2


def _spread(places_m: Array, count: int) -> Array:
    """So many of the places, each as far from the others as it can be."""
    chosen = [int(np.argmax(np.linalg.norm(places_m - places_m.mean(axis=0), axis=1)))]
    while len(chosen) < min(count, len(places_m)):
        away = np.linalg.norm(places_m[:, None] - places_m[chosen], axis=2).min(axis=1)
        chosen.append(int(away.argmax()))
    return places_m[chosen]
