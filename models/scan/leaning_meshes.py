"""A rock that leans, brought apart from its pedestal by the user: two meshes that are taken as they are."""

from toppling.models.arrays import Array
from toppling.models.errors import InputError
from toppling.models.scan.read import Mesh
from toppling.models.scene import Scene

_ABOVE_SHARE = 0.1
"""Of the rock's height: what holds a rock that leans rises so far above its foot, and beyond how far it settles."""

NOTE = (
    "the rock leans: without what touches it above its foot it does not stand. Rock and pedestal are the two meshes as "
    "they were given; no base is drawn and no interval stated"
)


def leaning_scene(body: Mesh, surface: Mesh) -> Scene | None:
    """The scene of a closed mesh and of the mesh that it leans on, survey coordinates; None where it does not."""
    if not _rises_beside(surface, body[0]):
        return None
    try:
        scene = Scene.from_mesh(body, pedestal=surface)
    except InputError:
        return None
    return scene if scene.grounded.leans else None


def _rises_beside(surface: Mesh, rock_m: Array) -> bool:
    """Whether a pedestal reaches above the foot of a rock's vertices (n, 3), within reach of them.

    To find the contacts of large meshes takes a minute: where nothing can hold the rock they are not looked for.
    """
    low, high = rock_m.min(axis=0), rock_m.max(axis=0)
    margin_m = _ABOVE_SHARE * float(high[2] - low[2])
    vertices, faces = surface
    corners = vertices[faces]
    first, last = corners.min(axis=1), corners.max(axis=1)
    near = (first[:, :2] <= high[:2] + margin_m) & (last[:, :2] >= low[:2] - margin_m)
    return bool((near.all(axis=1) & (last[:, 2] > low[2] + margin_m)).any())
