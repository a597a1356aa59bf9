"""What was seen of blocks, balls and the ground about them, as patches with their normals."""

import numpy as np

from toppling.models.scan.interface import Interface
from toppling.models.scan.surfels import Surfels
from toppling.models.scan.uncertainty import ObservedRock

VOXEL_M = 0.02
LEVEL = Interface(np.zeros(3), np.array([0.0, 0.0, 1.0]), np.eye(3), 0.0)


def wall(corner, along, up, normal):
    across, rise = np.linalg.norm(along), np.linalg.norm(up)
    s, t = np.meshgrid(*(np.arange(0.5 * VOXEL_M, value, VOXEL_M) / value for value in (across, rise)))
    points = np.asarray(corner) + s.reshape(-1, 1) * np.asarray(along) + t.reshape(-1, 1) * np.asarray(up)
    return points, np.tile(normal, (len(points), 1)).astype(float)


def box(low, high, sides="ewns"):
    (x, y, z), (a, b, c) = low, high
    parts = [wall((x, y, c), (a - x, 0, 0), (0, b - y, 0), (0, 0, 1))]
    faces = {
        "e": ((a, y, z), (0, b - y, 0), (1, 0, 0)),
        "w": ((x, y, z), (0, b - y, 0), (-1, 0, 0)),
        "n": ((x, b, z), (a - x, 0, 0), (0, 1, 0)),
        "s": ((x, y, z), (a - x, 0, 0), (0, -1, 0)),
    }
    parts += [
        wall(corner, along, (0, 0, c - z), normal)
        for side, (corner, along, normal) in faces.items()
        if side in sides
    ]
    return tuple(map(np.concatenate, zip(*parts, strict=True)))


def ground(hole=0.26):
    points, normals = wall((-1.5, -1.5, 0.0), (3, 0, 0), (0, 3, 0), (0, 0, 1))
    outside = np.abs(points[:, :2]).max(axis=1) > hole
    return points[outside], normals[outside]


def seen_of(rock, rest):
    points = np.concatenate([rock[0], rest[0]])
    normals = np.concatenate([rock[1], rest[1]])
    patches = np.arange(len(points)) < len(rock[0])
    surfels = Surfels(points, normals, np.zeros(len(points)), VOXEL_M)
    height = float(np.ptp(rock[0][:, 2]))
    return ObservedRock(rock[0], rest[0], rock[0], rest[0], surfels, patches, height, None)


def together(*parts):
    return tuple(map(np.concatenate, zip(*parts, strict=True)))


BLOCK = box((-0.25, -0.25, 0.0), (0.25, 0.25, 1.0))


def face(u, v, origin, normal, step_m=0.012):
    """Patches of a rectangle, so many metres along two axes from a corner."""
    a, b = np.meshgrid(*(np.arange(0.0, np.linalg.norm(value), step_m) for value in (u, v)))
    directions = [np.asarray(value) / np.linalg.norm(value) for value in (u, v)]
    points = np.asarray(origin) + a.reshape(-1, 1) * directions[0] + b.reshape(-1, 1) * directions[1]
    return points, np.tile(np.asarray(normal, float) / np.linalg.norm(normal), (len(points), 1))


def level(half_m, step_m, height_m=0.0):
    """Points (n, 3) of a level square about the origin."""
    along = np.arange(-half_m, half_m, step_m)
    x, y = (grid.ravel() for grid in np.meshgrid(along, along))
    return np.column_stack([x, y, np.full(len(x), height_m)])


def upward(points, voxel_m=VOXEL_M):
    return Surfels(points, np.tile([0.0, 0.0, 1.0], (len(points), 1)), np.zeros(len(points)), voxel_m)
