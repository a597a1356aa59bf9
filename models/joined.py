"""What is joined with what: parts of points, faces or patches."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from toppling.models.arrays import Indices


def joined_parts(pairs: Indices, count: int) -> Indices:
    """Number (count,) of the part in which each lies, of those joined by pairs (k, 2)."""
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1])
