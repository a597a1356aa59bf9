"""Export of a scene for other programs: glTF, PLY or OBJ."""

from pathlib import Path

import numpy as np
import trimesh

from toppling.models.errors import InputError
from toppling.models.scene import Scene
from toppling.results.drawing.style import PEDESTAL_COLOUR, ROCK_COLOUR

_EXPORTS = (".glb", ".gltf", ".ply", ".obj")
_Y_UP = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""Rotation by -90 degrees about x, from z up to glTF's y up."""


def export_scene(scene: Scene, path: Path) -> None:
    """Write rock and pedestal as one glTF, PLY or OBJ file, in the scene's local frame.

    In PLY and OBJ z is up, as in the scene. glTF prescribes y up (specification 2.0, section 3.4): there x is east, y
    up and z south. Every format is a single file.

    Raises InputError if the file's extension is another.
    """
    if path.suffix.lower() not in _EXPORTS:
        raise InputError(
            "scene.format_unknown",
            f"cannot export to '{path.suffix}'",
            where=str(path),
            expected=" or ".join(_EXPORTS),
            remedy="name the file by the format that you want",
        )
    meshes = _meshes(scene)
    if path.suffix.lower() in (".glb", ".gltf"):
        parts = trimesh.Scene()
        for name, mesh in meshes:
            parts.add_geometry(mesh, node_name=name, geom_name=name, transform=_Y_UP)
        parts.export(path, **({"embed_buffers": True} if path.suffix.lower() == ".gltf" else {}))
    else:
        trimesh.util.concatenate([mesh for _, mesh in meshes]).export(path)


def _meshes(scene: Scene) -> list[tuple[str, trimesh.Trimesh]]:
    surfaces = [
        ("rock", scene.rock.vertices_m, scene.rock.faces, ROCK_COLOUR),
        ("pedestal", *scene.pedestal_triangles(), PEDESTAL_COLOUR),
    ]
    meshes = []
    for name, vertices, faces, colour in surfaces:
        rgb = [int(colour[i : i + 2], 16) for i in (1, 3, 5)]
        meshes.append((name, trimesh.Trimesh(vertices, faces, face_colors=rgb, process=False)))
    return meshes
