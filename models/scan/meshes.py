"""Meshes of photogrammetry as clouds: points on them, which of these could be seen, and what shows of their frame."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from toppling.models.arrays import Array, Flags, Indices
from toppling.models.errors import InputError
from toppling.models.files.mesh_files import MESH_FORMATS, read_header, read_triangles
from toppling.models.lengths import METRES, NAMES
from toppling.models.scan import o3d
from toppling.models.scan.placement import AXES, Placement
from toppling.models.scan.surfels import scene_of_rays

UPWARD_Y = (".glb", ".gltf")
"""Formats in which y is up by their rule."""
_POINTS_PER_TRIANGLE, FEWEST, _MOST = 4, 1_000_000, 4_000_000
"""Points on a mesh: half of them spread evenly over its area, half over its triangles, so where it has its detail."""
_WIDEST, _NARROWEST = 200.0, 0.3
"""Extents, in metres, beyond which a mesh is hardly a rock and its ground: other units are likelier."""
_OPEN_FRACTION = 0.05
"""Fraction of a mesh's area: with less left over it is closed, and no opening shows where up is."""
_TILTED_DEG, _NEAR_AXIS_DEG = 45.0, 25.0
"""An open surface faces up in the mean: farther from z than this, z is not up; nearer to an axis, that axis is."""
_TURNED_OVER = 0.5
"""A surface of ground and rock that faces downward by more than this, cosine to up, is turned over."""


def is_mesh(path: Path) -> bool:
    """Whether a file holds triangles, by its name, or in a PLY by its header."""
    suffix = path.suffix.lower()
    if suffix != ".ply" or not path.is_file():
        return suffix in MESH_FORMATS and suffix != ".ply"
    return any(element.name == "face" and element.count > 0 for element in read_header(path).elements)


def mesh_as_in_file(path: Path) -> tuple[Array, Indices]:
    """Vertices (n, 3) of triangles in the file's own axes and unit, and triangles (m, 3).

    Raises InputError as of `read_triangles`.
    """
    vertices, faces = read_triangles(path)
    used = np.zeros(len(vertices), bool)
    used[faces] = True
    if not used.all():  # such as what is left at 0, 0, 0 of a model that was cut
        vertices, faces = vertices[used], (np.cumsum(used) - 1)[faces]
    if path.suffix.lower() in UPWARD_Y:
        vertices = vertices[:, [0, 2, 1]] * (1.0, 1.0, -1.0)
    return vertices, faces


def check_frame(
    vertices: Array, faces: Indices, path: Path, placement: Placement, *, unit_given: bool
) -> None:
    """Refuse a mesh that shows that it is not in metres with z up, unless the user says what it is: all at once.

    Raises InputError with the options to give.
    """
    usual = "y" if path.suffix.lower() in UPWARD_Y else "z"  # unless somebody says otherwise
    sideways = None if placement.says_up else _sideways(vertices, faces, usual)
    sized = None if placement.says_scale or unit_given else _sized(vertices)
    found = {
        as_it_is: warning
        for as_it_is, warning in ((f"--up {usual}", sideways), ("--units m", sized))
        if warning is not None
    }
    if found:
        raise InputError(
            "mesh.frame_unstated",
            "; ".join(what for what, _ in found.values()),
            where=str(path),
            expected=f"a mesh in metres with {usual} up, or options that say what it is in",
            remedy=f"give {' '.join(option for _, option in found.values())}; {' '.join(found)} keeps it as it is, and "
            "control points (--gcp) say both",
        )
    if placement.by.startswith("--gcp"):
        facing = _facing(vertices @ placement.turn.T, faces)
        if facing is not None and facing[2] < -_TURNED_OVER:
            raise InputError(
                "mesh.faces_downward",
                f"its surface faces downward once it is placed by {placement.by.partition(':')[0]}",
                where=str(path),
                expected="ground and rock that face upward",
                remedy="check the control points: east and north exchanged turn a model over; or its triangles are "
                "turned inside out: mend them in the program that made it",
            )


def facing_up(vertices: Array, faces: Indices, placement: Placement) -> Indices:
    """Triangles (m, 3) of an open surface turned so that it faces toward what the user says is up."""
    facing = _facing(vertices @ placement.turn.T, faces)
    return faces[:, ::-1] if facing is not None and facing[2] < -_TURNED_OVER else faces


def _facing(vertices: Array, faces: Indices) -> Array | None:
    """Unit vector toward which an open surface faces in the mean; None for one that is closed."""
    area = 0.5 * _crossed(vertices[faces])
    total, whole = area.sum(axis=0), float(np.linalg.norm(area, axis=1).sum())
    size = float(np.linalg.norm(total))
    return total / size if size > _OPEN_FRACTION * whole else None


def _sideways(vertices: Array, faces: Indices, usual: str) -> tuple[str, str] | None:
    facing = _facing(vertices, faces)
    if facing is None:
        return None
    off = _angle_deg(facing, AXES[usual])
    if off < _TILTED_DEG:
        return None
    if off > 180.0 - _NEAR_AXIS_DEG:
        return (
            f"it looks -{usual} up, or inside out: its surface faces -{usual} in the mean, not {usual}",
            f"--up -{usual} if it is upside down, --up {usual} if its triangles are turned inside out",
        )
    axis = min(AXES, key=lambda name: _angle_deg(facing, AXES[name]))
    if _angle_deg(facing, AXES[axis]) < _NEAR_AXIS_DEG:
        return f"it looks {axis} up: its surface faces {axis} in the mean, not {usual}", f"--up {axis}"
    xyz = ",".join(f"{x:.2f}" for x in facing)
    what = (
        f"its surface faces {xyz} in the mean, {off:.0f} degrees from {usual} (what is up differs from {xyz} by the "
        "slope of the ground)"
    )
    return what, f"--up {xyz}"


def _sized(vertices: Array) -> tuple[str, str] | None:
    size = float(np.ptp(vertices, axis=0).max())
    if _NARROWEST <= size <= _WIDEST:
        return None
    if size < _NARROWEST:
        return (
            f"it is {size:.3g} wide, and no rock with its ground is so small in metres",
            "--length P Q METRES",
        )
    sizes = {unit: size * METRES[unit] for unit in ("mm", "cm", "in", "ft")}
    likely = {unit: wide for unit, wide in sizes.items() if _NARROWEST <= wide <= _WIDEST}
    looks = " or ".join(f"{NAMES[unit]} ({wide:.3g} m)" for unit, wide in likely.items())
    what = f"it looks like {looks or 'another unit than metres'}: it is {size:.5g} wide"
    return what, f"--units {'|'.join(likely) or 'UNIT'}"


def _angle_deg(first: Array, other: object) -> float:
    return float(np.rad2deg(np.arccos(np.clip(np.dot(first, np.asarray(other, float)), -1.0, 1.0))))


def points_on(vertices: Array, faces: Indices) -> tuple[Array, Indices]:
    """Points (n, 3) on triangles, and the triangle of each; a low-discrepancy sequence, the same for the same mesh.

    Examples
    --------
    >>> square = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
    >>> points_on(square, np.array([[0, 1, 2], [0, 2, 3]]))[0].mean(axis=0).round(3).tolist()
    [0.5, 0.5, 0.0]
    """
    corners = vertices[faces]
    area = np.linalg.norm(_crossed(corners), axis=1)
    count = int(np.clip(_POINTS_PER_TRIANGLE * len(faces), FEWEST, _MOST))
    number = np.arange(count)
    share = np.cumsum(0.5 * area / max(area.sum(), np.finfo(float).tiny) + 0.5 / len(faces))
    triangle = np.minimum(np.searchsorted(share, (number + 0.5) / count), len(faces) - 1)
    # Roberts' R2 sequence, folded into the triangle.
    u, v = (number * 0.7548776662466927) % 1.0, (number * 0.5698402909980532) % 1.0
    over = u + v > 1.0
    u, v = np.where(over, 1.0 - u, u)[:, None], np.where(over, 1.0 - v, v)[:, None]
    first, second, third = (corners[:, corner][triangle] for corner in range(3))
    return first * (1.0 - u - v) + second * u + third * v, triangle


def _crossed(corners: Array) -> Array:
    """Twice the area (m, 3) of triangles (m, 3, 3) along their normals."""
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def outward(vertices: Array, faces: Indices) -> Array:
    """Unit normals (m, 3) of triangles, by the order of their corners; 0 of one without area."""
    normals = _crossed(vertices[faces])
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)


Mesh = tuple[Array, Indices]
_LIFT = 2e-5
"""Height above its surface from which a point looks about, over the model's extent. Nearer surfaces touch."""
_ROOM = 0.02
"""Free distance before the next surface, over the model's extent, from which a camera may have been there."""
_DIRECTIONS = 48
_GRAZING = 0.05
_LOWEST = 0.08
"""Rise of a way over its length that leads to the sky; what leads lower without a hit passes below the model."""
_MOST_BURIED, _MOST_TWISTED = 0.5, 0.02
"""More of the points cannot be buried, or of the edges run the same way in two triangles: these do not say which side
is out, and nothing is left out."""


def exposed(points_m: Array, normals: Array, meshes: Sequence[Mesh]) -> Flags:
    """Which points of meshes could have been seen: a way leads from them to the sky, or to room before a surface.

    points_m, normals: (n, 3), on the meshes, z up.
    meshes: of each its vertices (k, 3) and triangles (m, 3).
    """
    everything = np.ones(len(points_m), bool)
    if any(_twisted(faces) > _MOST_TWISTED for _, faces in meshes):
        return everything
    low, high = points_m.min(axis=0), points_m.max(axis=0)
    size, centre = float((high - low).max()), 0.5 * (low + high)
    scene = scene_of_rays(*((vertices - centre, faces) for vertices, faces in meshes))
    seen = _seen(scene, points_m - centre, normals, size)
    return seen if seen.mean() > 1.0 - _MOST_BURIED else everything


def _twisted(faces: Indices) -> float:
    """Share of the edges that two triangles go along in one direction."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    return 1.0 - len(np.unique(edges[:, 0] * (faces.max() + 1) + edges[:, 1])) / len(edges)


def _seen(scene: Any, points: Array, normals: Array, size: float) -> Flags:
    seen = np.zeros(len(points), bool)
    left = np.arange(len(points))
    for direction in _all_around():
        rows = left[normals[left] @ direction > _GRAZING]
        start = points[rows] + _LIFT * size * normals[rows]
        rays = np.concatenate([start, np.broadcast_to(direction, start.shape)], axis=1).astype(np.float32)
        hit = scene.cast_rays(o3d.core.Tensor.from_numpy(rays))
        away = hit["t_hit"].numpy()
        front = hit["primitive_normals"].numpy() @ direction < 0.0
        free = np.isfinite(away) & (away > _ROOM * size) & front
        seen[rows[free | (np.isinf(away) & (direction[2] > _LOWEST))]] = True
        left = left[~seen[left]]
    return seen


def _all_around() -> Array:
    """Unit vectors (n, 3) all around, from the zenith down."""
    number = np.arange(_DIRECTIONS)
    rise = 1.0 - 2.0 * number / (_DIRECTIONS - 1)
    turn = number * np.pi * (3.0 - np.sqrt(5.0))
    return np.column_stack([*(np.sqrt(1.0 - rise**2) * (np.cos(turn), np.sin(turn))), rise])
