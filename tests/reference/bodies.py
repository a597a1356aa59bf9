"""Rounded bodies and ground as meshes: (n, 3) vertices in metres and (m, 3) triangles."""

import math

import numpy as np


def revolved(profile, sides):
    """A body of revolution about z: rings at (radius, height), closed by its lowest and highest points."""
    around = 2.0 * np.pi * np.arange(sides) / sides
    rings = [np.column_stack([r * np.cos(around), r * np.sin(around), 0 * around + z]) for r, z in profile]
    vertices = np.vstack([[[0.0, 0.0, 0.0]], *rings, [[0.0, 0.0, profile[-1][1]]]])
    here, after = np.arange(sides), (np.arange(sides) + 1) % sides
    faces = [np.column_stack([0 * here, 1 + after, 1 + here])]
    for k in range(len(profile) - 1):
        a, b = 1 + k * sides + here, 1 + k * sides + after
        faces += [np.column_stack([a, b, b + sides]), np.column_stack([a, b + sides, a + sides])]
    last = 1 + (len(profile) - 1) * sides
    faces.append(np.column_stack([last + here, last + after, 0 * here + len(vertices) - 1]))
    return vertices, np.vstack(faces)


def round_cap(edge_m, radius_m=0.65, half_width_m=0.3, height_m=1.0):
    """A cylinder on a spherical cap."""
    rim = math.asin(half_width_m / radius_m)
    angles = np.linspace(0.0, rim, max(2, math.ceil(radius_m * rim / edge_m)) + 1)[1:]
    profile = [(radius_m * math.sin(t), radius_m * (1.0 - math.cos(t))) for t in angles]
    return revolved([*profile, (half_width_m, height_m)], math.ceil(2.0 * np.pi * half_width_m / edge_m))


def height_field(height_at, ticks_m):
    """Square cells over the ticks along x and y, halved, at the height of a function of x and y."""
    x, y = (grid.ravel() for grid in np.meshgrid(ticks_m, ticks_m, indexing="ij"))
    n = len(ticks_m)
    i = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    faces = np.vstack([np.column_stack([i, i + n, i + n + 1]), np.column_stack([i, i + n + 1, i + 1])])
    return np.column_stack([x, y, height_at(x, y)]), faces
