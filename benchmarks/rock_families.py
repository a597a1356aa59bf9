"""Rocks of eight families at rest on sloping ground, and their survey by few stations among plants, with gaps.

Nothing of the library's priors was set on the families in `TESTED`; those in `LEARNT` set them.
"""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

import manifold3d
import numpy as np
import trimesh
from blind_rocks import superellipsoid, waves

from toppling.models.arrays import Array
from toppling.models.frames import (
    STANDARD_GRAVITY_M_S2,
    horizontal_unit_vector,
    plane_normal,
    rotation_between,
)
from toppling.models.hidden_base.unseen_base import least_feet
from toppling.models.pedestal import Pedestal
from toppling.models.relief import contact_feet_m
from toppling.models.rock import Rock
from toppling.models.scan import virtual
from toppling.models.scan.interface import Interface
from toppling.models.statics import at_rest, quasi_static_toppling_m_s2

LEARNT = ("weathered", "mushroom", "blobs", "egg")
TESTED = ("dents", "slab", "pillar", "tilted")
LEAST_TOPPLING_M_S2 = 0.6
"""A rock that topples under less would hardly stand."""
AZIMUTHS_DEG = np.arange(0.0, 360.0, 15.0)


@dataclass(frozen=True, eq=False)
class FamilyRock:
    """A known rock and its survey."""

    family: str
    truth: virtual.Truth
    stations: list[virtual.Station]
    toppling_m_s2: Array  # toward AZIMUTHS_DEG, over the pedestal with its bumps

    @property
    def name(self) -> str:
        """What a table says of it."""
        return f"{self.family}, {self.truth.rock.height_m:.1f} m, {len(self.stations)} stations"


def family_rock(family: str, seed: int) -> FamilyRock:
    """The rock of a number: drawn until one stands with some reserve."""
    random = np.random.default_rng([70, seed, (*LEARNT, *TESTED).index(family)])
    while True:
        height_m = float(np.exp(random.uniform(np.log(0.7), np.log(6.0))))
        slope_deg = float(random.uniform(10.0, 18.0) if family == "tilted" else random.uniform(0.0, 6.0))
        downhill_deg = float(random.uniform(0.0, 360.0))
        plane = Pedestal(np.zeros(3), plane_normal(slope_deg, downhill_deg))
        tilt = rotation_between((0.0, 0.0, 1.0), plane.normal)
        vertices, faces = _BODIES[family](random)
        rough = random.uniform(0.0005, 0.006) * _waves(vertices, 12.0, random)
        vertices = vertices * (1.0 + rough[:, None])
        rock = Rock.from_triangles(height_m * (vertices - [0.0, 0.0, vertices[:, 2].min()]) @ tilt.T, faces)
        rest = at_rest(rock, plane, STANDARD_GRAVITY_M_S2)
        if rest is None:
            continue
        rock = rock.moved(*rest)
        limits = np.array(quasi_static_toppling_m_s2(rock, plane, STANDARD_GRAVITY_M_S2, AZIMUTHS_DEG))[:, 1]
        if limits.min() > LEAST_TOPPLING_M_S2 and np.isfinite(limits).all():
            break
    interface = Interface.through(plane.point_m, plane.normal)
    over = rock.vertices_m @ tilt
    foot = over[over[:, 2] < 0.03 * rock.height_m, :2]
    middle = foot.mean(axis=0)
    reach = float(np.linalg.norm(foot - middle, axis=1).max())
    ground = virtual.ground(
        3.0 * rock.height_m + reach,
        1.3 * reach,
        int(random.integers(1000)),
        bumps_m=rock.height_m * random.uniform(0.01, 0.05),
    )
    shifted = ground[0] + [*middle, 0.0]
    truth = virtual.Truth(rock, Pedestal(plane.point_m, plane.normal, shifted @ tilt.T, ground[1]))
    feet = interface.flat(contact_feet_m(rock, truth.pedestal))
    few = least_feet(feet, feet[:0], interface.flat(rock.com_m[None])[0], 1e-5 * rock.height_m)
    on_feet = dataclasses.replace(rock, feet_m=interface.scene(few))
    over_bumps = quasi_static_toppling_m_s2(on_feet, truth.pedestal, STANDARD_GRAVITY_M_S2, AZIMUTHS_DEG)
    return FamilyRock(family, truth, _survey(truth, random), np.array(over_bumps)[:, 1])


def _survey(truth: virtual.Truth, random: np.random.Generator) -> list[virtual.Station]:
    """Three to five stations at the height of a tripod, without grazing returns and with plants about the rock."""
    rock, count = truth.rock, int(random.integers(3, 6))
    size = max(rock.height_m, float(np.ptp(rock.vertices_m[:, :2], axis=0).max()))
    target = rock.com_m - [0.0, 0.0, 0.2 * rock.height_m]
    plants = _plants(truth, random)
    noise_m = rock.height_m * random.uniform(3e-4, 1.2e-3)
    found = []
    for number in range(count):
        direction = horizontal_unit_vector(360.0 * (number + 0.5 * random.random()) / count)
        up = max(1.6, 0.35 * rock.height_m) - target[2] + rock.vertices_m[:, 2].min()
        position = target + random.uniform(2.2, 3.4) * size * direction + [0.0, 0.0, up]
        step = np.rad2deg(
            random.uniform(0.007, 0.01) * rock.height_m / float(np.linalg.norm(target - position))
        )
        seen = virtual.scan_from(truth.bodies, position, target, 1.5 * size, step, noise_m, random)
        points, label = seen.points_m, seen.label
        lost = np.zeros(len(points), bool)
        for _ in range(6):  # dark or wet patches that hardly return anything
            middle = points[random.integers(len(points))]
            away = np.linalg.norm(points - middle, axis=1)
            lost |= (away < 0.08 * rock.height_m) & (random.random(len(points)) < 0.7)
        points, label = points[~lost], label[~lost]
        leaves = plants[random.random(len(plants)) < 0.5]
        found.append(
            virtual.Station(
                position,
                np.vstack([points, leaves + random.normal(0.0, noise_m, leaves.shape)]),
                np.append(label, np.full(len(leaves), 2, np.int8)),
            )
        )
    return found


def _plants(truth: virtual.Truth, random: np.random.Generator) -> Array:
    """Bushes a half to one height from the rock's middle, as points."""
    rock, normal = truth.rock, truth.pedestal.normal
    radius = float(np.linalg.norm((rock.vertices_m - rock.com_m)[:, :2], axis=1).max())
    found = []
    for _ in range(int(random.integers(1, 4))):
        foot = rock.com_m + (radius + random.uniform(0.1, 0.5) * rock.height_m) * horizontal_unit_vector(
            random.uniform(0.0, 360.0)
        )
        foot[2] = -(foot[:2] @ normal[:2]) / normal[2] + 0.08 * rock.height_m
        found.append(foot + random.normal(size=(500, 3)) * rock.height_m * [0.07, 0.07, 0.05])
    return np.vstack(found)


def _waves(points: Array, number: float, random: np.random.Generator) -> Array:
    """Waves (n,) of several lengths over places of size one, standard deviation about one."""
    return waves(points, (0.3 * number, 2.0 * number), 30, random)


def _ball() -> virtual.Mesh:
    ball = trimesh.creation.icosphere(subdivisions=4)
    return np.asarray(ball.vertices, float), np.asarray(ball.faces, np.int64)


def _superellipsoid(
    random: np.random.Generator, size: tuple[float, float], square: tuple[float, float]
) -> virtual.Mesh:
    """Between ball and box, one high, its foot cut off."""
    points, faces = _ball()
    points = superellipsoid(points, (*size, 1.0), *random.uniform(*square, 2))
    points *= 1.0 + random.uniform(0.01, 0.05) * _waves(points, 4.0, random)[:, None]
    points[:, 2] += 0.04 * random.normal() * points[:, 0]
    floor = points[:, 2].min() + random.uniform(0.05, 0.2)
    low = points[:, 2] < floor
    points[low, 2] = floor + random.uniform(0.005, 0.03) * _waves(points[low], 6.0, random)
    return points, faces


def _weathered(random: np.random.Generator) -> virtual.Mesh:
    return _superellipsoid(random, (random.uniform(0.4, 0.9), random.uniform(0.4, 0.8)), (0.35, 0.8))


def _slab(random: np.random.Generator) -> virtual.Mesh:
    return _superellipsoid(random, (random.uniform(0.7, 1.1), random.uniform(0.28, 0.4)), (0.3, 0.6))


def _pillar(random: np.random.Generator) -> virtual.Mesh:
    return _superellipsoid(random, (random.uniform(0.25, 0.4), random.uniform(0.25, 0.35)), (0.3, 0.6))


def _egg(random: np.random.Generator) -> virtual.Mesh:
    points, faces = _ball()
    points = 0.5 * points * [random.uniform(0.8, 1.2), random.uniform(0.7, 1.0), 1.0]
    points *= 1.0 + random.uniform(0.005, 0.02) * _waves(points, 5.0, random)[:, None]
    return points, faces


def _dents(random: np.random.Generator) -> virtual.Mesh:
    points, faces = _ball()
    for _ in range(int(random.integers(12, 25))):
        direction = random.normal(size=3)
        direction /= np.linalg.norm(direction)
        level = random.uniform(0.75, 0.95)
        points = points - np.maximum(points @ direction - level, 0.0)[:, None] * direction * random.uniform(
            0.8, 1.3
        )
    return 0.55 * points * [random.uniform(0.6, 1.0), random.uniform(0.6, 0.9), 1.0], faces


def _blobs(random: np.random.Generator) -> virtual.Mesh:
    body = manifold3d.Manifold()
    for number in range(3):
        ball = manifold3d.Manifold.sphere(1.0, 48).scale(tuple(random.uniform(0.25, 0.4, 3)))
        body += ball.translate((*random.uniform(-0.15, 0.15, 2), 0.3 * (number - 1)))
    mesh = body.refine_to_length(0.06).to_mesh64()
    points = np.array(mesh.vert_properties[:, :3], float)
    points *= 1.0 + random.uniform(0.005, 0.02) * _waves(points, 5.0, random)[:, None]
    return points, np.array(mesh.tri_verts, np.int64)


def _mushroom(random: np.random.Generator) -> virtual.Mesh:
    share = 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, 41)))
    stem, neck = random.uniform(0.3, 0.55), random.uniform(0.25, 0.45)
    cap = np.sqrt(np.maximum(1.0 - ((share - neck - 0.15) / (0.85 - neck)) ** 2, 0.0))
    radius = np.where(share < neck, stem + 0.15 * (share / neck) ** 2, np.maximum(cap, 0.0))
    radius = np.maximum(
        0.5 * random.uniform(0.7, 1.0) * np.convolve(np.pad(radius, 2, "edge"), np.ones(5) / 5.0, "valid"),
        0.005,
    )
    radius[-1] = 0.005
    sides = 60
    angle = 2.0 * np.pi * np.arange(sides) / sides
    around = (
        1.0
        + 0.06 * np.cos(2.0 * angle + random.uniform(0.0, 6.0))
        + 0.05 * np.cos(3.0 * angle + random.uniform(0.0, 6.0))
    )
    points, faces = virtual.lathe(radius[:, None] * around, share, np.zeros((41, 2)), sides)
    points += random.uniform(0.005, 0.015) * np.column_stack([_waves(points, 6.0, random) for _ in range(3)])
    return points, faces


_BODIES: dict[str, Callable[[np.random.Generator], virtual.Mesh]] = {
    "weathered": _weathered, "mushroom": _mushroom, "blobs": _blobs, "egg": _egg,
    "dents": _dents, "slab": _slab, "pillar": _pillar, "tilted": _weathered,
}  # fmt: skip
