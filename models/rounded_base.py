"""A rounded base, and what a finer mesh of it would change."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from toppling.models.arrays import Array
from toppling.models.frames import STANDARD_GRAVITY_M_S2
from toppling.models.pedestal import Pedestal
from toppling.models.rock import Rock
from toppling.models.smooth_mesh import MOST_FACES, Patches, SmoothMesh, patches_of, smooth_mesh_of
from toppling.models.statics import quasi_static_toppling_m_s2

_CHANGE_FRACTION = 0.02
"""Largest change of the least toppling acceleration, at any azimuth, that one refinement may make."""

_CHECKED_FACES = 60_000
"""Maximum number of faces of a halved mesh for which the change by refinement is computed."""

_AZIMUTHS_DEG = (0.0, 72.0, 144.0, 216.0, 288.0)

_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class RoundedBase:
    """A rounded base, and what the mesh of it is worth.

    rolls: whether it touches with the smooth surface through its vertices, or with its triangles.
    """

    rock: Rock
    rolls: bool

    @property
    def patches(self) -> Patches:
        """The smooth surface."""
        found = patches_of(self.rock)
        assert found is not None  # else the rock has no rounded base
        return found

    @cached_property
    def change(self) -> float:
        """Largest share by which halving its edges changes a least toppling acceleration, over azimuths.

        Zero where the mesh is too fine to be halved.
        """
        mesh = smooth_mesh_of(self.rock) if self.rolls else SmoothMesh.of(self.rock)
        assert mesh is not None
        if mesh.faces_when_halved > _CHECKED_FACES:
            return 0.0
        finer = mesh.halved()
        if not self.rolls:
            return _change(_over_facets_m_s2(self.rock), _over_facets_m_s2(_rock_of(finer)))
        rock = dataclasses.replace(self.rock, vertices_m=finer.vertices_m, faces=finer.faces)
        return _change(_rolling_m_s2(self.rock), _rolling_m_s2(rock))

    @property
    def is_coarse(self) -> bool:
        """Whether that is more than answers may be off by."""
        return self.change > _CHANGE_FRACTION

    @property
    def sentence(self) -> str:
        """For pages and plans."""
        if self.rolls:
            found = f"its base is rounded: it rolls on the smooth surface through the {len(self.patches.corners)} faces"
            found += f"' corners; one refinement changes the least acceleration that topples it by {self.change:.1%}"
            return found + (". Give a finer mesh" if self.is_coarse else "")
        return (
            "its base is rounded, and its triangles are coarse: with edges half as long it topples at an acceleration "
            f"{self.change:.0%} lower, and about twice that with a smooth base. "
            "Scene.from_mesh(mesh, refine=True) refines it"
        )


def rounded_base_of(rock: Rock) -> RoundedBase | None:
    """The rounded base of a rock, which rolls unless it is curved in one direction only; None if nothing is rounded."""
    if not SmoothMesh.of(rock).rounded.any():
        return None
    return RoundedBase(rock, rolls=patches_of(rock) is not None)


def refined(rock: Rock) -> Rock:
    """A rock whose rounded base has triangles that are fine enough for its least toppling acceleration.

    Its edges are halved until one halving more changes that by less than 2 %, or makes more than 20,000 faces.
    """
    mesh = SmoothMesh.of(rock)
    if not mesh.rounded.any():
        return rock
    now = _over_facets_m_s2(rock)
    while mesh.faces_when_halved <= _CHECKED_FACES:
        mesh = mesh.halved()
        finer = _rock_of(mesh)
        then = _over_facets_m_s2(finer)
        if _change(now, then) < _CHANGE_FRACTION or len(mesh.faces) > MOST_FACES:
            break
        rock, now = finer, then
    return rock


def _rock_of(mesh: SmoothMesh) -> Rock:
    return Rock.from_triangles(mesh.vertices_m, mesh.faces, where="the refined rock")


def _change(now_m_s2: Array, then_m_s2: Array) -> float:
    known = np.isfinite(now_m_s2) & np.isfinite(then_m_s2) & (now_m_s2 > 0.0) & (then_m_s2 > 0.0)
    return float((np.abs(now_m_s2 - then_m_s2)[known] / now_m_s2[known]).max(initial=0.0))


def _over_facets_m_s2(rock: Rock) -> Array:
    """Least toppling accelerations on a level plane of a rock that tips over its facets."""
    return np.array(quasi_static_toppling_m_s2(rock, _level(rock), STANDARD_GRAVITY_M_S2, _AZIMUTHS_DEG))[
        :, 1
    ]


def _rolling_m_s2(rock: Rock) -> Array:
    """Least toppling accelerations on a level plane of a rock that rolls on the smooth surface of its base."""
    from toppling.models.ground.body import GroundedBody
    from toppling.models.tipping import limits_on_surface  # which compile

    body = GroundedBody.of(rock, _level(rock), STANDARD_GRAVITY_M_S2, (1.0, 1.0), smooth=True)
    return np.array([limits.tips_m_s2 for limits in limits_on_surface(body, _AZIMUTHS_DEG)])


def _level(rock: Rock) -> Pedestal:
    return Pedestal(np.array([0.0, 0.0, rock.vertices_m[:, 2].min()]), _UP)
