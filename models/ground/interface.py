"""The plane that describes where a rock stands on a surface: for words and frames, not for its contacts."""

from __future__ import annotations

import numpy as np

from toppling.models.compiled import Array, Indices
from toppling.models.errors import InputError
from toppling.models.ground.body import FOUND_WITHIN, RESTING_SHARE, GroundedBody
from toppling.models.pedestal import Pedestal
from toppling.models.rock import Rock, check_triangles

_NARROWEST_SHARE = 1e-3
"""Width of contacts, over the rock's size, below which they lie on a line and give no plane."""

_STEEPEST_DEG = 60.0
"""A plane through contacts that is steeper describes no ground."""


def surface_below(
    rock: Rock, vertices_m: Array, faces: Indices, gravity_m_s2: float, friction: float, where: str
) -> tuple[Rock, Pedestal]:
    """A rock lowered or raised to where it touches a surface, and the surface with the plane of its contacts.

    Parameters
    ----------
    rock : Rock
    vertices_m, faces : (n, 3), (m, 3) arrays
        In the rock's frame. An open surface may be oriented either way.
    gravity_m_s2, friction : float
        With which the rock is let down to find what it stands on.
    where : str
        For messages.

    Raises
    ------
    InputError
        If the surface is none, or the rock is farther from it than a tenth of its size.
    """
    check_triangles(vertices_m, faces, where)
    if len(faces) == 0:
        raise InputError(
            "mesh.empty",
            "holds no triangles",
            where=where,
            expected="the surface below the rock",
            remedy="give it as a triangle mesh",
        )
    faces = _facing_up(np.asarray(vertices_m, float), np.asarray(faces, np.int64))
    level = Pedestal(rock.com_m, np.array([0.0, 0.0, 1.0]), np.asarray(vertices_m, float), faces)
    try:
        body = GroundedBody.of(rock, level, gravity_m_s2, (friction, friction), smooth=True)
        touching = body.touching(body.pose)
    except InputError:
        raise _apart(rock, vertices_m, where) from None
    touched_m = RESTING_SHARE * body.size_m
    shift = body.scene_from_support @ (touching[:3] - body.pose[:3])
    near = body.contacts(body.resting_pose, touched_m)
    if len(near) == 0:  # it has fallen past the surface's edge: what shakes it says so
        near = body.contacts(touching, touched_m)
    places = near["place_m"] @ body.scene_from_support.T + level.point_m
    normal = _plane_through(places, _NARROWEST_SHARE * body.size_m)
    if normal is None:
        mean = (near["normal"] @ body.scene_from_support.T).mean(axis=0)
        normal = mean / np.linalg.norm(mean)
    if normal[2] < np.cos(np.radians(_STEEPEST_DEG)):
        normal = np.array([0.0, 0.0, 1.0])
    return rock.moved(np.eye(3), shift), Pedestal(places.mean(axis=0), normal, level.vertices_m, faces)


def _apart(rock: Rock, vertices_m: Array, where: str) -> InputError:
    own, other = (np.array([box.min(axis=0), box.max(axis=0)]) for box in (rock.vertices_m, vertices_m))
    sizes = [" by ".join(f"{side:.3g}" for side in np.ptp(box, axis=0)) for box in (own, other)]
    off = other.mean(axis=0) - own.mean(axis=0)
    return InputError(
        "rock.apart_from_pedestal",
        f"the rock does not touch the ground: the middle of a ground of {sizes[1]} m lies {off[0]:+.3g} m east, "
        f"{off[1]:+.3g} m north and {off[2]:+.3g} m up from that of a rock of {sizes[0]} m",
        where=where,
        expected=f"a rock no farther from its pedestal's surface, and no deeper in it, than "
        f"{FOUND_WITHIN * rock.half_diagonal_m:.3g} m",
        remedy="give rock and pedestal in one frame and in metres, the rock as it stands",
    )


def _facing_up(vertices_m: Array, faces: Indices) -> Indices:
    """Triangles of an open surface turned so that most of their area faces up; of a closed one outward."""
    corners = vertices_m[faces]
    area = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    closed = (np.unique(ends, axis=0, return_counts=True)[1] == 2).all()
    turned = (
        (area * (corners.mean(axis=1) - vertices_m.mean(axis=0))).sum() < 0.0
        if closed
        else area[:, 2].sum() < 0
    )
    return np.ascontiguousarray(faces[:, ::-1]) if turned else faces


def _plane_through(places: Array, narrowest_m: float) -> Array | None:
    """Upward normal of the plane nearest to places (k, 3); None where they lie on a line."""
    if len(places) < 3:
        return None
    _, size, axes = np.linalg.svd(places - places.mean(axis=0), full_matrices=False)
    if size[1] < narrowest_m:
        return None
    return axes[2] if axes[2, 2] > 0.0 else -axes[2]
