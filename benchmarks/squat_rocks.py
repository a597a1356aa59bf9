"""A family of virtual rocks from slender to squat, on which `toppling scan` must find the rock without help.

Height over base width .7 to 4, a crevice 1 to 20 % of that width deep, every third rim partly buried, bushes, a fallen
block beside some, sloping ground, mixed pixels, three kinds of pedestal.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from toppling.models.frames import horizontal_unit_vector
from toppling.models.scan import virtual
from toppling.models.scan.segment import NEITHER, PEDESTAL

SLENDERNESS = (0.7, 4.0)
"""Height over base width."""
CREVICE_PER_WIDTH = (0.01, 0.2)
"""Depth of the crevice over the width of the base."""
PEDESTALS = ("ground", "shelf", "cliff")
HEIGHTS_M = (0.8, 14.0)
OUTSIDE_PER_HEIGHT = 0.1
"""Points so near to the contact's rim are beside it."""


@dataclass(frozen=True, eq=False)
class Member:
    """A rock of the family and its survey.

    kind: of the pedestal.
    slenderness: height over base width.
    buried_share: share of the rim that lies under soil.
    """

    truth: virtual.Truth
    stations: list[virtual.Station]
    kind: str
    slenderness: float
    crevice_per_width: float
    buried_share: float

    @property
    def name(self) -> str:
        """Height, its ratio to the base, crevice, pedestal and what is buried, in a few words."""
        buried = f", {self.buried_share:.0%} buried" if self.buried_share else ""
        return (
            f"{self.truth.rock.height_m:.1f} m, {self.slenderness:.2f} of its base, crevice "
            f"{self.crevice_per_width:.1%}, {self.kind}{buried}"
        )


def member(seed: int, resolution_per_height: float | None = None) -> Member:
    """Draw one rock, its pedestal and its survey; every third rim is partly buried."""
    random = np.random.default_rng([28, seed])
    height = float(np.exp(random.uniform(*np.log(HEIGHTS_M))))
    slenderness = float(np.exp(random.uniform(*np.log(SLENDERNESS))))
    crevice = float(np.exp(random.uniform(*np.log(CREVICE_PER_WIDTH))))
    base = height / slenderness
    depth = crevice * base
    rock = _boulder(random, height, base, depth)
    kind = PEDESTALS[int(random.integers(3))]
    rim = 0.5 * base * PLAN_REACH
    widest = float(np.hypot(*rock[0][:, :2].T).max())
    cliff = {
        "cliff_m": rim,
        "cliff_azimuth_deg": random.uniform(0.0, 360.0),
        "drop_m": height * random.uniform(0.3, 1.0),
    }
    shelf = {"neck_drop_m": height * random.uniform(0.1, 0.4)}
    ground, faces = virtual.ground(
        max(2.2 * height, 2.2 * widest),
        rim if kind != "shelf" else random.uniform(1.0, 1.15) * (rim + depth),
        int(random.integers(1000)),
        bumps_m=height * random.uniform(0.01, 0.05),
        **{"ground": {}, "shelf": shelf, "cliff": cliff}[kind],
        cells=320,
    )
    buried = float(random.uniform(0.1, 0.35)) if seed % 3 == 2 else 0.0
    if buried:
        ground = ground + _soil(random, ground, buried, rim, depth, height)
    neighbours = [_fallen_block(random, height, widest)] if random.random() < 0.3 else []
    truth = virtual.on_slope(
        rock, (ground, faces), random.uniform(0.0, 12.0), random.uniform(0.0, 360.0), *neighbours
    )
    stations = virtual.scan_around(
        truth,
        seed,
        stations=int(random.integers(4, 8)),
        resolution_per_height=resolution_per_height or random.uniform(0.006, 0.01),
        noise_per_height=random.uniform(1e-4, 6e-4),
        clutter=False,
        misregistration_per_height=float(random.choice([0.0, 4e-4])),
    )
    bushes = [_bush(random, truth, height, widest) for _ in range(int(random.integers(1, 4)))]
    return Member(
        truth, [_with(bushes, station, random) for station in stations], kind, slenderness, crevice, buried
    )


PLAN_REACH = 1.12
"""Farthest point of a base's rim over half of its width."""


def _boulder(random: np.random.Generator, height: float, base: float, depth: float) -> virtual.Mesh:
    """Rough rock on a flat base at height 0: a crevice around the base, sides that bulge, a domed or flat top."""
    sides, rings = 144, 120
    opening = min(depth * random.uniform(0.4, 1.5), 0.25 * height)
    shape, belly, top = random.uniform(0.5, 1.0), random.uniform(0.0, 0.35), random.uniform(2.0, 6.0)
    z = np.concatenate([opening * np.linspace(0.0, 1.0, 20) ** 2, np.geomspace(opening, height, rings)[1:]])
    z = np.unique(np.concatenate([z, height * (1 - 0.1 * np.linspace(0, 1, 30) ** 2)]))
    share = np.clip((z - opening) / (height - opening), 0.0, 1.0)
    radius = 0.5 * base + depth * np.minimum(z / opening, 1.0) ** shape
    swell = 1.0 + belly * np.sin(np.pi * np.minimum(share / 0.9, 1.0)) ** 1.5
    radius = radius * swell * np.maximum(1 - share**top, 0.0) ** (1 / top)
    angle = 2 * np.pi * np.arange(sides) / sides
    square = random.uniform(2.0, 4.0)
    plan = (np.abs(np.cos(angle)) ** square + np.abs(np.sin(angle)) ** square) ** (-1 / square)
    plan = np.roll(plan, int(random.integers(sides)))
    plan *= PLAN_REACH / plan.max()
    rough = sum(
        random.normal()
        / k
        * np.cos(k * angle[None, :] + m * np.pi * share[:, None] + random.uniform(0, 2 * np.pi))
        for k in range(2, 8)
        for m in range(6)
    )
    rough = rough * random.uniform(0.01, 0.03) * np.minimum(share / 0.1, 1.0)[:, None]
    outline = np.maximum(radius[:, None] * plan[None, :] * (1 + rough), 0.003 * height)
    lean = 0.08 * base * random.normal(size=2)
    return virtual.lathe(outline, z, np.sin(0.5 * np.pi * share)[:, None] * lean, sides)


def _soil(
    random: np.random.Generator,
    ground: NDArray[np.float64],
    share: float,
    rim: float,
    depth: float,
    height: float,
) -> NDArray[np.float64]:
    """What soil adds to the ground beside a share of the rim: a wedge that thins away from the rock."""
    away = np.hypot(*ground[:, :2].T) - 0.9 * rim
    turn = np.arctan2(ground[:, 1], ground[:, 0]) - random.uniform(0.0, 2 * np.pi)
    turn = np.abs((turn + np.pi) % (2 * np.pi) - np.pi)
    across = np.clip((share * np.pi - turn) / 0.3 + 0.5, 0.0, 1.0)
    deep = height * random.uniform(0.01, 0.04)
    along = np.clip(away / (0.1 * rim), 0.0, 1.0) * np.exp(-np.maximum(away - depth, 0.0) / (6 * deep))
    return np.column_stack([np.zeros((len(ground), 2)), deep * across * along])


def _fallen_block(random: np.random.Generator, height: float, widest: float) -> virtual.Body:
    """A small boulder near by, no rock that is meant."""
    size = height * random.uniform(0.15, 0.4)
    vertices, faces = virtual.boulder(size, size * 1.2, size * 0.9, int(random.integers(1000)))
    place = (widest + random.uniform(0.8, 2.0) * size) * horizontal_unit_vector(random.uniform(0.0, 360.0))
    return virtual.Body(vertices + place - [0.0, 0.0, 0.05 * size], faces, NEITHER)


def _bush(
    random: np.random.Generator, truth: virtual.Truth, height: float, widest: float
) -> NDArray[np.float64]:
    """Centre and half widths (2, 3) of a bush beside the rock."""
    size = height * random.uniform(0.04, 0.12)
    centre = (widest + random.uniform(1.0, 4.0) * size) * horizontal_unit_vector(random.uniform(0.0, 360.0))
    normal = truth.pedestal.normal
    centre[2] = -(normal[:2] @ centre[:2]) / normal[2] + size
    return np.stack([centre, size * np.array([1.0, 1.0, 0.6])])


def _with(
    bushes: list[NDArray[np.float64]], station: virtual.Station, random: np.random.Generator
) -> virtual.Station:
    leaves = np.concatenate([centre + random.normal(0.0, 1.0, (300, 3)) * half for centre, half in bushes])
    return virtual.Station(
        station.position_m,
        np.vstack([station.points_m, leaves]),
        np.append(station.label, np.full(len(leaves), NEITHER, np.int8)),
    )


def outside_the_contact(
    member: Member, points_m: NDArray[np.float64], label: NDArray[np.int8]
) -> NDArray[np.bool_]:
    """Points of rock and pedestal within a tenth of the rock's height of the contact's rim."""
    truth = member.truth
    reach = OUTSIDE_PER_HEIGHT * truth.rock.height_m
    vertices = truth.rock.vertices_m
    over = (vertices - truth.pedestal.point_m) @ truth.pedestal.normal
    rim = vertices[over < 1e-9 * truth.rock.height_m]
    near = cKDTree(rim).query(points_m, distance_upper_bound=reach)[0] < reach
    return near & (label <= PEDESTAL)
