"""The array that nearly every function takes and returns."""

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_Kind = TypeVar("_Kind", bound=np.generic)


def at_most(rows: NDArray[_Kind], most: int) -> NDArray[_Kind]:
    """Every k-th row, so that no more than so many are left."""
    return rows[:: -(-len(rows) // most) or 1]
