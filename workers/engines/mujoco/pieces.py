"""Rocks and ground as convex pieces, which is what this engine collides."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import linprog
from scipy.spatial import ConvexHull, QhullError

from toppling.models.compiled import Array, Indices
from toppling.models.ground.mesh import ContactMesh

_FILLED_SHARE = 1e-3
"""Share of a piece's volume by which the hull of joined cells may exceed the cells."""

_STEEP = 0.1
"""Upward part of a triangle's normal up to which the ground lies behind it, not below it."""


def ground_pieces(ground: ContactMesh, depth_m: float) -> list[Array]:
    """Convex pieces, each of (n, 3) points: columns below triangles that face up, plates behind the others.

    Parameters
    ----------
    ground : ContactMesh
        Support frame.
    depth_m : float
        How far columns reach below the lowest vertex; plates are a tenth as thick.
    """
    corners = ground.vertices_m[ground.faces]
    below = corners.copy()
    rises = ground.normals[:, 2] > _STEEP
    below[..., 2] = corners[..., 2].min() - depth_m
    below[~rises] = corners[~rises] - 0.1 * depth_m * ground.normals[~rises, None, :]
    # A plate has the sign of no group but its own plane's.
    group = np.where(rises, -1, np.unique(ground.normals.round(6), axis=0, return_inverse=True)[1])
    return _joined(np.concatenate([corners, below], axis=1), ground.edge_of, group)


def rock_pieces(rock: ContactMesh) -> list[Array] | None:
    """Convex pieces of a rock, each of (n, 3) points: its hull, or wedges that meet in a point that sees all of it.

    None where no point does.
    """
    corners = rock.vertices_m[rock.faces]
    centre = _sees_all(rock)
    if centre is None:
        return None
    cells = np.concatenate([corners, np.broadcast_to(centre, (len(corners), 1, 3))], axis=1)
    return _joined(cells, rock.edge_of, np.zeros(len(corners), np.int64))


def hollow_m(rock: ContactMesh, within_m: float) -> float:
    """How far a rock's surface lies within its convex hull at most; the true depth is larger by up to `within_m`.

    A triangle is divided while its deepest place may be deeper: that is at most as deep, below any one face of the
    hull, as the lowest of its corners.
    """
    planes = np.unique(ConvexHull(rock.vertices_m).equations, axis=0)
    waiting, deepest = [rock.vertices_m[rock.faces]], 0.0
    while waiting:
        part = waiting.pop()
        corners, rest = part[:200], part[200:]
        below = -(corners @ planes[:, :3].T + planes[:, 3])  # (triangles, 3, planes)
        deepest = max(deepest, below.min(axis=2).max(), below.mean(axis=1).min(axis=1).max())
        a, b, c = np.moveaxis(corners[below.max(axis=1).min(axis=1) > deepest + within_m], 1, 0)
        d, e, f = (a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0
        parts = np.concatenate(
            [np.stack(corners_m, axis=1) for corners_m in ((a, d, f), (d, b, e), (f, e, c), (d, e, f))]
        )
        waiting += [left for left in (rest, parts) if len(left)]
    return float(deepest)


def _sees_all(rock: ContactMesh) -> Array | None:
    """The point farthest inside all planes of a rock's triangles; None where they leave no room."""
    offset = (rock.normals * rock.vertices_m[rock.faces[:, 0]]).sum(axis=1)
    planes = np.column_stack([rock.normals, np.ones(len(offset))])
    solved = linprog(
        [0.0, 0.0, 0.0, -1.0], A_ub=planes, b_ub=offset, bounds=[(None, None)] * 3 + [(0.0, None)]
    )
    if solved.status != 0 or solved.x[3] <= 1e-3 * np.abs(rock.vertices_m).max():
        return None
    return np.asarray(solved.x[:3])


def _joined(cells: Array, edge_of: Indices, group: Indices) -> list[Array]:
    """Points of convex pieces: neighbouring cells (m, k, 3) of one group, joined while their hull is not larger."""
    pieces = {
        number: _Piece(cell, volume, neighbours)
        for number, (cell, neighbours) in enumerate(zip(cells, _neighbours(edge_of), strict=True))
        if (volume := _volume(cell)) > 0.0
    }
    owner = list(range(len(cells)))
    fresh = set(pieces)
    while fresh:  # in rounds, so that pieces grow alike and few hulls are large
        grown: set[int] = set()
        for number in sorted(fresh):
            if number not in pieces or number in grown:
                continue
            for other in sorted({owner[k] for k in pieces[number].neighbours} - {number} - grown):
                if other not in pieces or group[other] != group[number]:
                    continue
                both = pieces[number].joined(pieces[other])
                if both is not None:
                    pieces[number] = both
                    del pieces[other]
                    owner = [number if part == other else part for part in owner]
                    grown.add(number)
                    break
        fresh = grown
    return [piece.points[ConvexHull(piece.points).vertices] for piece in pieces.values()]


class _Piece(NamedTuple):
    points: Array
    volume: float
    neighbours: list[int]  # triangles beside its own

    def joined(self, other: _Piece) -> _Piece | None:
        """Both as one, if that is convex."""
        points = np.unique(np.vstack([self.points, other.points]), axis=0)
        volume = self.volume + other.volume
        if _volume(points) > (1.0 + _FILLED_SHARE) * volume:
            return None
        return _Piece(points, volume, self.neighbours + other.neighbours)


def _neighbours(edge_of: Indices) -> list[list[int]]:
    """Triangles that share an edge with each."""
    at_edge: dict[int, list[int]] = {}
    for triangle, edges in enumerate(edge_of):
        for edge in edges:
            at_edge.setdefault(int(edge), []).append(triangle)
    return [
        [other for edge in edges for other in at_edge[int(edge)] if other != triangle]
        for triangle, edges in enumerate(edge_of)
    ]


def _volume(points: Array) -> float:
    try:
        return float(ConvexHull(points).volume)
    except QhullError:
        return 0.0
