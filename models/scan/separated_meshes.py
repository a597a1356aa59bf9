"""Rock and pedestal that the user has brought apart: two meshes that may be taken as they are."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from toppling.models.arrays import Array
from toppling.models.errors import InputError
from toppling.models.hidden_base.from_scan import ContradictionError
from toppling.models.scan.read import Mesh
from toppling.models.scan.survey import Survey
from toppling.models.scene import Scene

_ABOVE_SHARE = 0.1
"""Of the rock's height: what holds a rock that leans rises so far above its foot, and beyond how far it settles."""

_AS_GIVEN = "Rock and pedestal are the two meshes as they were given; no base is drawn and no interval stated"
_LEANS = f"the rock leans: without what touches it above its foot it does not stand. {_AS_GIVEN}"
_TOUCHES = f"the rock stands only where the two meshes touch: their gap is open around it. {_AS_GIVEN}"


@dataclass(frozen=True, eq=False)
class SeparatedMeshes:
    """A closed mesh and the mesh on which it rests, survey coordinates."""

    body: Mesh
    surface: Mesh

    @cached_property
    def scene(self) -> Scene | None:
        """The two as they are; None where they are no rock at rest."""
        try:
            return Scene.from_mesh(self.body, pedestal=self.surface, units="m")
        except InputError:
            return None

    def surveyed(self, survey: Callable[[], Survey], hinted: bool) -> Survey:
        """What a survey makes of their points; or the two as they are, where no base that it draws holds the rock.

        hinted: whether the user knows something of the base, which is not set aside.
        """
        if _rises_beside(self.surface, self.body[0]) and self.scene is not None and self.scene.grounded.leans:
            return _as_given(self.scene, _LEANS)
        try:
            return survey()
        except ContradictionError:
            if hinted or self.scene is None:
                raise
        return _as_given(self.scene, _TOUCHES)


def _as_given(scene: Scene, note: str) -> Survey:
    return Survey(scene, np.zeros(0, np.int8), (note,))


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
