"""Connected components of points, faces or patches."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from toppling.models.arrays import Indices


def joined_parts(pairs: Indices, count: int) -> Indices:
    """Index (count,) of the connected component of each node, by edges (k, 2)."""
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1])
