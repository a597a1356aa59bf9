"""Shaking beyond what was ever recorded: records scaled until velocity or displacement is no earthquake's.

Scaling a record to a level of PGA multiplies its PGV and PGD as well. Few records reach 3 m/s, and the largest
displacements of shaking, without the fling of a fault, are some metres (Chi-Chi 1999, TCU068 and TCU052); far beyond
them a motion is a computation, not an observation.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from toppling.models.motions.quality import TOLD_PGV_M_S

LARGEST_PGD_M = 4.0
LARGEST_FACTOR = 100.0
"""On a record's acceleration: beyond it noise is scaled, and a weak earthquake's spectrum."""

LIMITS_WORDS = (
    f"PGV above {TOLD_PGV_M_S:g} m/s, PGD above {LARGEST_PGD_M:g} m, or scaled above {LARGEST_FACTOR:g}-fold"
)


def is_beyond(factor: ArrayLike, pgv_m_s: ArrayLike, pgd_m: ArrayLike) -> NDArray[np.bool_]:
    """Whether motions after scaling by some factors are beyond nature; what is not known (NaN) is not."""
    limits = ((factor, LARGEST_FACTOR), (pgv_m_s, TOLD_PGV_M_S), (pgd_m, LARGEST_PGD_M))
    return np.logical_or.reduce([np.asarray(value, float) > limit for value, limit in limits])


def words(factor: float, pgv_m_s: float, pgd_m: float) -> str:
    """A motion after scaling, in words.

    Examples
    --------
    >>> words(42.3, 7.04, 5.1)
    '42-fold, PGV 7.0 m/s, PGD 5.1 m'
    """
    scaled = "" if factor != factor else f"{factor:.0f}-fold, " if factor >= 10.0 else f"{factor:.1f}-fold, "
    return f"{scaled}PGV {pgv_m_s:.1f} m/s, PGD {pgd_m:.1f} m"
