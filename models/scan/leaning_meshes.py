"""A rock that leans, brought apart from its pedestal by the user: two meshes that are taken as they are."""

from pathlib import Path

from toppling.models.errors import InputError
from toppling.models.files.mesh_files import MESH_FORMATS, read_triangles
from toppling.models.scan.parts import Part
from toppling.models.scene import Scene

NOTE = (
    "the rock leans: without what touches it above its foot it does not stand. Rock and pedestal are the two meshes as "
    "they were given; no base is drawn and no interval stated"
)


def leaning_scene(rock: Part | None, pedestal: Part | None) -> Scene | None:
    """The scene of a closed mesh and of the mesh that it leans on; None where they are something else."""
    files = [None if part is None else part.file for part in (rock, pedestal)]
    if not all(file is not None and _may_be_mesh(file) for file in files):
        return None
    try:
        body, surface = (read_triangles(file) for file in files if file is not None)
        scene = Scene.from_mesh(body, pedestal=surface)
        return scene if scene.grounded.leans else None
    except InputError:
        return None


def _may_be_mesh(file: Path) -> bool:
    return file.suffix.lower() in MESH_FORMATS and file.is_file()
