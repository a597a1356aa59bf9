"""Rocks of random shape, size, pedestal and survey, by a generator unlike the library's: nothing was tuned on them."""

from __future__ import annotations

from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from toppling.models.scan import virtual

HEIGHTS_M = (0.7, 1.5, 3.0, 6.0, 12.0)
PEDESTALS = ("uneven ground", "cliff", "neck")
LEAST_ARM = 0.06
"""From the centre of mass to the nearest edge of the base, in heights: less would hardly stand."""


def blind_rock(seed: int) -> tuple[virtual.Truth, str, list[virtual.Station]]:
    """A rock on a pedestal, what kind of pedestal, and its survey."""
    random = np.random.default_rng(seed)
    height = float(random.choice(HEIGHTS_M) * random.uniform(0.8, 1.2))
    rock = superellipsoid(random, height)
    while _arm_m(*rock) < LEAST_ARM * height:
        rock = superellipsoid(random, height)
    base = 1.02 * float(np.hypot(*rock[0][_flat(rock[0])][:, :2].T).max())
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


def superellipsoid(random: np.random.Generator, height_m: float) -> virtual.Mesh:
    """Between ball and box, rough, leaning and turned, its foot flattened to a base at height 0."""
    sphere = trimesh.creation.icosphere(subdivisions=6)
    up, round_ = random.uniform(0.35, 1.0, 2)
    width = height_m * random.uniform(0.35, 0.9)
    depth = width * random.uniform(0.6, 1.0)
    latitude = np.arcsin(np.clip(sphere.vertices[:, 2], -1.0, 1.0))
    longitude = np.arctan2(sphere.vertices[:, 1], sphere.vertices[:, 0])
    across = _power(np.cos(latitude), up)
    points = 0.5 * np.column_stack(
        [
            width * across * _power(np.cos(longitude), round_),
            depth * across * _power(np.sin(longitude), round_),
            height_m * _power(np.sin(latitude), up),
        ]
    )
    waves = np.cos(points @ random.normal(0.0, 6.0 / height_m, (3, 8)) + random.uniform(0.0, 2 * np.pi, 8))
    points *= 1.0 + random.uniform(0.01, 0.05) * (waves / np.arange(2, 10)).sum(axis=1, keepdims=True)
    turn = random.uniform(0.0, 2 * np.pi)
    c, s = np.cos(turn), np.sin(turn)
    points[:, :2] = points[:, :2] @ np.array([[c, s], [-s, c]]) + points[:, 2:] * random.uniform(
        -0.15, 0.15, 2
    )
    points[:, 2] = np.maximum(points[:, 2] - points[:, 2].min() - height_m * random.uniform(0.06, 0.25), 0.0)
    return points, np.asarray(sphere.faces, np.int64)


def _power(values: NDArray[np.float64], exponent: float) -> NDArray[np.float64]:
    return np.asarray(np.sign(values) * np.abs(values) ** exponent)


def _flat(points_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    return np.asarray(points_m[:, 2] == 0.0)


def _arm_m(points_m: NDArray[np.float64], faces: NDArray[np.int64]) -> float:
    hull = ConvexHull(points_m[_flat(points_m), :2])
    com = trimesh.Trimesh(points_m, faces, process=False).center_mass
    return -float((hull.equations[:, :2] @ com[:2] + hull.equations[:, 2]).max())
