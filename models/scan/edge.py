"""The edge at which a pedestal ends below a rock that hangs over it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from toppling.models.arrays import Array
from toppling.models.compiled import Flags, Indices

_LINES = 16
"""Of an edge that tell on which side a place lies."""


@dataclass(frozen=True, eq=False)
class Edge:
    """Where the pedestal ends, by lines along its edge."""

    lines: Array  # (k, 4): places u, v on the interface plane and the unit normals outward there
    blur_m: float  # lines nearer to a place than this have the same say about it

    @property
    def clear_m(self) -> float:
        """Gap between the pedestal's end and what hangs beside it, where nobody saw it."""
        return 0.04 * self.blur_m

    def outside_m(self, flat_m: Array) -> Array:
        """Distances (...) of places (..., 2 or 3), u and v, beyond the edge; negative on the pedestal."""
        places = flat_m[..., :2].reshape(-1, 2)
        say, at, outward = self._near(places)
        beyond = ((places[:, None] - at) * outward).sum(axis=2)
        return np.asarray((say * beyond).sum(axis=1) / say.sum(axis=1)).reshape(flat_m.shape[:-1])

    def outward(self, flat_m: Array) -> Array:
        """Unit vectors (n, 3) out of the cliff's face below the edge at places (n, 2 or 3)."""
        say, _, outward = self._near(flat_m[:, :2])
        way = (say[..., None] * outward).sum(axis=1)
        way /= np.linalg.norm(way, axis=1)[:, None]
        return np.column_stack([way, np.zeros(len(way))])

    def _near(self, places: Array) -> tuple[Array, Array, Array]:
        """Lines around each place (n, 2): their say (n, k), places (n, k, 2) and outward normals (n, k, 2)."""
        away, nearest = cKDTree(self.lines[:, :2]).query(
            places, list(range(1, min(_LINES, len(self.lines)) + 1))
        )
        lines = self.lines[nearest]
        return 1.0 / (away**2 + self.blur_m**2), lines[..., :2], lines[..., 2:]

    def carries(self, over_m: Array) -> Flags:
        """Whether the pedestal lies below places (n, 3) of the rock: u, v and the height over it."""
        return np.asarray(
            (self.outside_m(over_m) < 2.0 * self.clear_m) & (over_m[:, 2] > -0.01 * self.clear_m)
        )


def up_to_edge(vertices_m: Array, faces: Indices, outside_m: Array) -> tuple[Array, Indices]:
    """The part of a mesh within an edge, cut where distances (n,) of its vertices beyond the edge cross zero."""
    out = outside_m > 0.0
    beyond = out[faces].sum(axis=1)
    parts, cuts, begin = [faces[beyond == 0]], [np.zeros((0, 3))], len(vertices_m)
    for lone in (False, True):  # the corner that is alone on its side of the edge first
        mixed = faces[beyond == (1 if lone else 2)]
        first = (out[mixed] == lone).argmax(axis=1)
        a, b, c = (mixed[np.arange(len(mixed)), (first + k) % 3] for k in range(3))
        for end in (b, c):
            low, high = np.minimum(a, end), np.maximum(a, end)
            share = outside_m[low] / (outside_m[low] - outside_m[high])
            cuts.append(vertices_m[low] + share[:, None] * (vertices_m[high] - vertices_m[low]))
        ab, ac = (begin + k * len(a) + np.arange(len(a)) for k in range(2))
        begin += 2 * len(a)
        new = [(ab, b, c), (ab, c, ac)] if lone else [(a, ab, ac)]
        parts += [np.stack(each, axis=-1) for each in new]
    used, numbers = np.unique(np.concatenate(parts), return_inverse=True)
    places, joined = np.unique(np.vstack([vertices_m, *cuts])[used], axis=0, return_inverse=True)
    return places, joined.ravel()[numbers].reshape(-1, 3).astype(np.int64)
