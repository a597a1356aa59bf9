"""Made-up rocks and pedestals for the virtual scanner.

Each rock's flat base lies on the interface plane, and the part of the pedestal's surface below the base is that plane.
"""

import numpy as np

from toppling.models.arrays import Array, Indices
from toppling.models.scan.crevice import grid_triangles

Mesh = tuple[Array, Indices]


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
